"""Drawings of one's own table: what the cameras see together, a phrase's map with its best places, an action."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.actions import PickPlace
from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, bare, draw_from_above, draw_gripper
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Workspace

if TYPE_CHECKING:
    from gem_lite.maps.places import Place


def show_table_from_above(heightmap: HeightMap) -> Figure:
    """The fused picture, its heights in millimetres, and the cells that no camera saw."""
    fig, axes = plt.subplots(1, 3, figsize=(8.4, 5.2), layout="constrained")
    draw_from_above(bare(axes[0], "from above"), heightmap)
    image = bare(axes[1], "height").imshow(1000 * heightmap.height, cmap="viridis", vmin=0)
    fig.colorbar(image, ax=axes[1], label="mm", shrink=0.8)
    bare(axes[2], "seen (white)").imshow(heightmap.seen, cmap="gray", vmin=0, vmax=1)
    return fig


def show_set_up(
    rgb: np.ndarray, to_pixels: Callable[[np.ndarray], np.ndarray], workspace: Workspace, heightmap: HeightMap,
    clicks: Sequence[Sequence[float]] = (),
) -> Figure:  # fmt: skip
    """A camera's picture with the table's rectangle, its axes and the given points, beside the table from above.

    Args:
        to_pixels: the pixels (N, 2) of points (N, 3) in the table's frame.
        clicks: pixels, numbered from 1.
    """
    x0, x1, y0, y1 = workspace.limits
    border = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0], [x0, y0, 0]])
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0])
    fig, axes = plt.subplots(1, 2, figsize=(11, 5.2), width_ratios=[3, 1.2], layout="constrained")
    bare(axes[0], "the rectangle (white), its middle with +x and +y (0.1 m)").imshow(rgb)
    axes[0].plot(*to_pixels(border).T, color="white", lw=2, path_effects=OUTLINE)
    for step, name, color in ((np.array([0.1, 0, 0]), "+x", PICK_COLOR), (np.array([0, 0.1, 0]), "+y", PLACE_COLOR)):
        start, end = to_pixels(np.stack([middle, middle + step]))
        axes[0].annotate("", end, start, arrowprops={"arrowstyle": "->", "color": color, "lw": 2.5})
        axes[0].text(*end, name, color=color, weight="bold", path_effects=OUTLINE)
    for number, (x, y) in enumerate(clicks, 1):
        axes[0].plot(x, y, "o", mfc="none", mec="white", ms=9, path_effects=OUTLINE)
        axes[0].text(x + 8, y - 8, str(number), color="white", path_effects=OUTLINE)
    axes[0].set(xlim=(0, rgb.shape[1]), ylim=(rgb.shape[0], 0))
    draw_from_above(bare(axes[1], "from above"), heightmap)
    return fig


def show_look(
    heightmap: HeightMap, maps: Mapping[str, np.ndarray], places: Mapping[str, Sequence[Place]],
    action: PickPlace | None = None,
) -> Figure:  # fmt: skip
    """The table from above beside a map for each phrase, with numbered places; with an action, its pick and place.

    Args:
        maps: (H, W) by phrase.
        places: the best places of each map.
    """
    workspace = heightmap.workspace
    fig, axes = plt.subplots(1, 1 + len(maps), figsize=(2.9 * (1 + len(maps)) + 0.8, 5.2), layout="constrained")
    draw_from_above(bare(axes[0], "from above"), heightmap)
    for ax, (phrase, semantic) in zip(axes[1:], maps.items(), strict=True):
        image = bare(ax, f'"{phrase}"').imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
        for number, place in enumerate(places[phrase], 1):
            row, col = workspace.to_pixel(place.x, place.y)
            ax.text(col, row, str(number), color="white", ha="center", va="center", path_effects=OUTLINE)
    fig.colorbar(image, ax=axes[1:], shrink=0.8, label="map: about 1 on a match on our tables")
    if action is not None:
        draw_gripper(axes[0], action.pick, workspace, PICK_COLOR, "pick")
        draw_gripper(axes[0], action.place, workspace, PLACE_COLOR, "place")
        axes[0].legend(fontsize=8, loc="lower center")
    return fig
