"""Drawings that several lessons use. Each function returns a matplotlib Figure."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from gem_lite.actions import PickPlace
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace, rotation_matrix

PICK_COLOR, PLACE_COLOR = "#35d0ff", "#ff9d1c"
"""Cyan and orange: colour-blind readers can tell them apart. Every figure draws pick and place in them."""
MAP_COLORS = "inferno"
OUTLINE = (Stroke(linewidth=2.8, foreground="black"), Normal())
"""Drawn under a coloured line, so that it is seen on every picture."""
LEAST_LOGIT = -20.0
"""Action maps are cut here: a cell 20 logits below the best has e^-20 of its probability."""
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


def show_views(views: Sequence[View]) -> Figure:
    """The cameras' pictures above their depth."""
    fig, axes = plt.subplots(2, len(views), figsize=(3.4 * len(views), 5.0), layout="constrained")
    for column, view in zip(axes.T, views, strict=True):
        bare(column[0], f"{view.camera.name}: RGB").imshow(view.rgb)
        depth_image = bare(column[1], f"{view.camera.name}: depth").imshow(
            np.ma.masked_equal(view.depth, 0), cmap="viridis", vmin=0.4, vmax=1.8
        )
    fig.colorbar(depth_image, ax=axes[1], shrink=0.8, label="metres (white: not measured)")
    return fig


def show_heightmap(heightmap: HeightMap, action: PickPlace | None = None, title: str = "") -> Figure:
    """The height map's colours and heights from above, with axes in metres, and the grippers of an action."""
    w = heightmap.workspace
    rows, cols = w.shape
    fig, axes = plt.subplots(1, 2, figsize=(6.4, 5.6), layout="constrained")
    axes[0].imshow(heightmap.rgb)
    height_image = axes[1].imshow(1000 * heightmap.height, cmap="viridis")
    fig.colorbar(height_image, ax=axes[1], label="height (mm)", shrink=0.8)
    for ax, name in zip(axes, ("colour", "height"), strict=True):
        if action is not None:
            draw_gripper(ax, action.pick, w, PICK_COLOR, "pick")
            draw_gripper(ax, action.place, w, PLACE_COLOR, "place")
        x_ticks = np.arange(0.3, w.x_max, 0.2)
        y_ticks = np.arange(-0.4, w.y_max, 0.2)
        ax.set_xticks(w.to_pixel(x_ticks, 0)[1], [f"{x:.1f}" for x in x_ticks])
        ax.set_yticks(w.to_pixel(0, y_ticks)[0], [f"{y:.1f}" for y in y_ticks])
        ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5))
        ax.set_title(name, fontsize=9)
    if action is not None:
        fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    fig.suptitle(title, fontsize=10)
    return fig


def action_map(logits: np.ndarray) -> np.ndarray:
    """Logits (R, H, W) to (H, W): each pixel's largest logit, minus the largest of all, at least `LEAST_LOGIT`.

    The best pixel is 0. These are logits and not probabilities: a trained policy's probabilities show one bright
    pixel on black.
    """
    return np.maximum(logits.max(axis=0) - logits.max(), LEAST_LOGIT)


def draw_zoom(
    ax: Axes, values: np.ndarray, row: float, col: float, box: tuple[float, float, float, float], reach: int = 8
) -> None:
    """The cells around (row, col) of an action map (H, W), enlarged.

    Args:
        box: where the enlarged part stands: left, bottom, width, height, as parts of the panel.
        reach: how many cells it shows to each side.
    """
    inset = ax.inset_axes(box)
    bare(inset).imshow(values, cmap="viridis", vmin=LEAST_LOGIT, vmax=0)
    inset.set(xlim=(col - reach - 0.5, col + reach + 0.5), ylim=(row + reach + 0.5, row - reach - 0.5))
    for edge in inset.spines.values():
        edge.set_color("white")
    ax.indicate_inset_zoom(inset, edgecolor="white", alpha=0.8)


def show_story(pictures: Sequence[tuple[str, np.ndarray]], suptitle: str = "") -> Figure:
    """A row of pictures (H, W, 3) with their titles."""
    widths = [picture.shape[1] / picture.shape[0] for _, picture in pictures]
    fig, axes = plt.subplots(
        1, len(pictures), figsize=(3.2 * sum(widths) + 0.3, 3.6), width_ratios=widths, layout="constrained"
    )
    for ax, (title, picture) in zip(np.atleast_1d(axes), pictures, strict=True):
        bare(ax, title).imshow(picture)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_tables(tables: Sequence[tuple[str, np.ndarray]]) -> Figure:
    """Small arrays (H, W) with every entry written into its cell."""
    width = sum(table.shape[1] for _, table in tables)
    fig, axes = plt.subplots(
        1, len(tables), figsize=(0.62 * width + 1, 3.0), width_ratios=[t.shape[1] for _, t in tables],
        layout="constrained",
    )  # fmt: skip
    for ax, (title, table) in zip(np.atleast_1d(axes), tables, strict=True):
        bare(ax, title).imshow(table, cmap="Blues", vmin=table.min(), vmax=2 * table.max() - table.min())
        for (row, col), value in np.ndenumerate(table):
            ax.text(col, row, f"{value:.3g}", ha="center", va="center", fontsize=9)
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
        ax.set_facecolor("0.7")
        if panel.ndim == 2:
            map_image = image
    if map_image is not None:
        fig.colorbar(map_image, ax=axes, shrink=0.8)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_curves(x: Sequence[float], curves: dict[str, np.ndarray], xlabel: str, ylabel: str) -> Figure:
    """Named curves (N,) over x, from 0 upwards."""
    fig, ax = plt.subplots(figsize=(5.4, 3.2), layout="constrained")
    for name, values in curves.items():
        ax.plot(x, values, "o-", label=name)
    ax.set(xlabel=xlabel, ylabel=ylabel, ylim=(0, None))
    ax.legend()
    ax.grid(alpha=0.3)
    return fig
