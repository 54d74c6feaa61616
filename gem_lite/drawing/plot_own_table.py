"""Drawings of one's own table: what the cameras see together, a phrase's map with its best places, an action."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.actions import PickPlace
from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, bare, draw_from_above, draw_gripper
from gem_lite.maps.places import Place
from gem_lite.rgbd.heightmap import HeightMap


def show_table_from_above(heightmap: HeightMap) -> Figure:
    """The fused picture, its heights in millimetres, and the cells that no camera saw."""
    fig, axes = plt.subplots(1, 3, figsize=(8.4, 5.2), layout="constrained")
    draw_from_above(bare(axes[0], "from above"), heightmap)
    image = bare(axes[1], "height").imshow(1000 * heightmap.height, cmap="viridis", vmin=0)
    fig.colorbar(image, ax=axes[1], label="mm", shrink=0.8)
    bare(axes[2], "seen (white)").imshow(heightmap.seen, cmap="gray", vmin=0, vmax=1)
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
