"""What library and lessons draw alike: height maps, maps, grippers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from gem_lite.actions import PickPlace
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace, rotation_matrix

PICK_COLOR, PLACE_COLOR = "#35d0ff", "#ff9d1c"
"""Cyan and orange: colour-blind readers can tell them apart. Every figure draws pick and place in them."""
MAP_COLORS = "inferno"
OUTLINE = (Stroke(linewidth=2.8, foreground="black"), Normal())
"""Drawn under a coloured line, so that it is seen on every picture."""
SAFE_COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000")
"""Okabe and Ito's colours, which colour-blind readers can tell apart."""


def use_safe_colors() -> None:
    """Let matplotlib draw lines in `SAFE_COLORS` from now on."""
    plt.rcParams["axes.prop_cycle"] = plt.cycler(color=SAFE_COLORS)


def bare(ax: Axes, title: str = "") -> Axes:
    """Axes without ticks, for a picture."""
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_title(title, fontsize=9)
    return ax


def draw_from_above(ax: Axes, heightmap: HeightMap) -> None:
    """The colours of a height map. The cells that no camera saw are hatched: their colours are not measured."""
    ax.imshow(heightmap.rgb)
    if not heightmap.seen.all():
        ax.contourf(~heightmap.seen, levels=[0.5, 1.5], colors="none", hatches=["xxxx"])


def draw_gripper(ax: Axes, pose: Pose2, workspace: Workspace, color: str, label: str = "") -> None:
    """A gripper from above: a cross at its pixel, the long arm along its yaw, and a mark at that arm's end.

    The mark is a square for `PLACE_COLOR` and a dot for every other colour.
    """
    row, col = workspace.to_pixel(pose.x, pose.y)
    for turn, length in ((0, 0.045), (np.pi / 2, 0.02)):
        # "Right" in the picture, turned counter-clockwise by the yaw.
        drow, dcol = rotation_matrix(pose.yaw + turn) @ np.array([0, length / workspace.pixel])
        ax.plot([col - dcol, col + dcol], [row - drow, row + drow], color=color, lw=1.6, path_effects=OUTLINE)
        if turn == 0:
            mark = "s" if color == PLACE_COLOR else "o"
            ax.plot(col + dcol, row + drow, mark, color=color, mec="black", mew=0.6, ms=4.5, label=label or None)


def show_heightmap(heightmap: HeightMap, action: PickPlace | None = None, title: str = "") -> Figure:
    """The height map's colours and heights from above, with axes in metres, and the grippers of an action."""
    w = heightmap.workspace
    rows, cols = w.shape
    fig, axes = plt.subplots(1, 2, figsize=(6.4, 5.6), layout="constrained")
    draw_from_above(axes[0], heightmap)
    height_image = axes[1].imshow(1000 * heightmap.height, cmap="viridis")
    fig.colorbar(height_image, ax=axes[1], label="height (mm)", shrink=0.8)
    for ax, name in zip(axes, ("colour", "height"), strict=True):
        if action is not None:
            draw_gripper(ax, action.pick, w, PICK_COLOR, "pick")
            draw_gripper(ax, action.place, w, PLACE_COLOR, "place")
        x_ticks = np.arange(0.2 * math.ceil(round((w.x_min - 0.1) / 0.2, 6)) + 0.1, w.x_max + 1e-6, 0.2)
        y_ticks = np.arange(0.2 * math.ceil(round(w.y_min / 0.2, 6)), w.y_max + 1e-6, 0.2)
        ax.set_xticks(w.to_pixel(x_ticks, 0)[1], [f"{x:.1f}" for x in x_ticks])
        ax.set_yticks(w.to_pixel(0, y_ticks)[0], [f"{y:.1f}" for y in y_ticks])
        ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5))
        ax.set_title(name, fontsize=9)
    if action is not None:
        fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    fig.suptitle(title, fontsize=10, parse_math=False)
    return fig


def show_maps(panels: Sequence[tuple[str, np.ndarray]], suptitle: str = "", top: float = 1.0) -> Figure:
    """A row of pictures (H, W, 3) and maps (H, W); all maps share one scale from 0 to ``top``. NaN is grey."""
    widths = [panel.shape[1] / panel.shape[0] for _, panel in panels]
    size = (min(12.0, 3.6 * sum(widths) + 1.6), 3.9 if sum(widths) < 3.2 else 2.9)
    fig, axes = plt.subplots(1, len(panels), figsize=size, width_ratios=widths, layout="constrained")
    axes = np.atleast_1d(axes)
    map_image = None
    for ax, (title, panel) in zip(axes, panels, strict=True):
        image = bare(ax, title).imshow(panel, cmap=MAP_COLORS, vmin=0, vmax=top)
        ax.title.set_parse_math(False)  # A title may be a sentence, or the name of a file.
        ax.set_facecolor("0.7")
        if panel.ndim == 2:
            map_image = image
    if map_image is not None:
        fig.colorbar(map_image, ax=axes, shrink=0.8, label="map")
    fig.suptitle(suptitle, fontsize=10)
    return fig
