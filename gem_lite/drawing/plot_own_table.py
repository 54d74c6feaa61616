"""Drawings of one's own table: what the cameras see together, a phrase's map with its best places, an action."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.actions import PickPlace
from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, bare, draw_from_above, draw_gripper
from gem_lite.rgbd.heightmap import HeightMap

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
    rgb: np.ndarray, border: np.ndarray, axes: np.ndarray, heightmap: HeightMap | None = None,
    clicks: Sequence[Sequence[float]] | np.ndarray = (),
) -> Figure:  # fmt: skip
    """A camera's picture with the table's rectangle, its axes and the given points, beside the table from above.

    Args:
        rgb: (H, W, 3) uint8.
        border: (N, 2) pixels along the rectangle; NaN is not drawn.
        axes: (3, 2) pixels of the rectangle's middle, and of the points 0.1 m along +x and along +y from it.
        heightmap: of the rectangle, if the camera sees something of it.
        clicks: pixels, numbered from 1.
    """
    fig, panels = plt.subplots(1, 2, figsize=(11, 5.2), width_ratios=[3, 1.2], layout="constrained")
    bare(panels[0], "the rectangle (white), and 0.1 m along +x and +y from its middle").imshow(rgb)
    panels[0].plot(*border.T, color="white", lw=2, path_effects=OUTLINE)
    for end, name, color in ((axes[1], "+x", PICK_COLOR), (axes[2], "+y", PLACE_COLOR)):
        if np.isfinite(axes).all():
            panels[0].annotate("", end, axes[0], arrowprops={"arrowstyle": "->", "color": color, "lw": 2.5})
            panels[0].text(*end, name, color=color, weight="bold", path_effects=OUTLINE, clip_on=True)
    for number, (x, y) in enumerate(clicks, 1):
        panels[0].plot(x, y, "o", mfc="none", mec="white", ms=9, path_effects=OUTLINE)
        panels[0].text(x + 8, y - 8, str(number), color="white", path_effects=OUTLINE)
    panels[0].set(xlim=(0, rgb.shape[1]), ylim=(rgb.shape[0], 0))
    if heightmap is None:
        bare(panels[1], "from above: nothing is seen")
    else:
        draw_from_above(bare(panels[1], "from above"), heightmap)
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
        ax.title.set_parse_math(False)
        for number, place in enumerate(places[phrase], 1):
            row, col = workspace.to_pixel(place.x, place.y)
            ax.text(col, row, str(number), color="white", ha="center", va="center", path_effects=OUTLINE)
    fig.colorbar(image, ax=axes[1:], shrink=0.8, label="map: about 1 on a match on our tables")
    if action is not None:
        draw_gripper(axes[0], action.pick, workspace, PICK_COLOR, "pick")
        draw_gripper(axes[0], action.place, workspace, PLACE_COLOR, "place")
        axes[0].legend(fontsize=8, loc="lower center")
    return fig
