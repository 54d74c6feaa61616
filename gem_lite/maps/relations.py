"""Places that are relations: the map of "left of green bowl", from the map of "green bowl" and the height map.

A relation holds in the table's frame, which is the picture from above: "left of" has a smaller x, "right of" a larger
x, "in front of" a smaller y, and "behind" a larger y. Training turns the pictures, so a network cannot learn it. As
with the location words (`query_maps.located`), the words act on the map of the unturned table.

This part is ours; the paper has no relations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from gem_lite import language
from gem_lite.language import Query, Spot
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import PLATEAU, plateau_centre
from gem_lite.maps.things import things
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Length, Workspace

HALF = 0.05
"""Half the length (m) of a thing that is put down: so far from the middle of the place, everything is free. A block
needs 0.028 m; everyday objects are up to 0.12 m long."""
GAP = 0.01
"""Space (m) between that and other things, for what pick and place are off."""
WIDTH = 0.05
"""How wide (m) the band of places beside a thing is. It begins at `HALF` and `GAP` from the thing."""
SECTOR = math.radians(30)
"""Seen from the thing's middle, a place is at most so far (radians) off the direction that the relation says."""
MIDDLE_THIRD = (1 / 3, 2 / 3)
"""A place between two things has a share of the way from one middle to the other that lies in this range."""
OFF_LINE = 0.04
"""It is at most this far (m) from the line through both middles."""
AT_THING = 0.02
"""The peak of a thing's map lies on the thing or at most this far (m) from it: patches blur the map."""
LOWEST_VALUE = 0.5
"""Free places have at least this value. It grows to 1 where most places around are free, too."""
SPREAD = 0.04
"""The width (m, one standard deviation) of what counts as around."""
SPOT_RADIUS = 0.02
"""Cells at most this far (m) from a spot belong to it."""
DIRECTIONS = {"left of": (-1, 0), "right of": (1, 0), "in front of": (0, -1), "behind": (0, 1)}
"""Unit steps in x and y of the table."""
BESIDE = "beside"
"""Any of the four directions."""


class NoFreePlaceError(ValueError):
    """No place with a relation to things is free, or no camera sees a spot. The message names it."""


def place_map(
    relation: str, anchors: Sequence[np.ndarray], heightmap: HeightMap, config: PatchConfig
) -> np.ndarray:  # fmt: skip
    """The map of a place with a relation to one thing or, for "between", to two.

    Args:
        relation: a value of `language.word_lists.RELATIONS`.
        anchors: the semantic map (H, W) of each thing.
        config: of the maps' resolution.

    Returns:
        (H, W) float32: from half the lowest peak of the ``anchors`` to this peak on free table at a fitting distance,
        and 0 elsewhere. It is 0 everywhere if there is no such place, or if a map of a thing has no peak.

    Raises:
        ValueError: an unknown relation, or a wrong number of maps.
    """
    if len(anchors) != language.anchor_count(relation):
        raise ValueError(f"anchors must be {language.anchor_count(relation)} for {relation!r}, got {len(anchors)}")
    nothing = np.zeros(heightmap.workspace.shape, np.float32)
    peak = min(float(semantic.max()) for semantic in anchors)
    if peak <= 0 or any(semantic.max() - np.median(semantic) <= PLATEAU for semantic in anchors):
        return nothing
    rising, flat = ([ndimage.binary_fill_holes(mask) for mask in masks] for masks in things(heightmap))
    masks = [thing_at_peak(semantic, rising, config) for semantic in anchors]
    everything = covered([*masks, *rising, *flat], heightmap.workspace)
    places = free_places(relation, masks, everything, heightmap.workspace) & heightmap.seen
    return peak * graded(places, heightmap.workspace) if places.any() else nothing


def spot_map(spot: Spot, heightmap: HeightMap) -> np.ndarray:
    """The map (H, W) float32 of a spot: 1 in its midst, and 0 beyond `SPOT_RADIUS` or where no camera saw the table."""
    x, y = heightmap.workspace.to_world(*np.indices(heightmap.workspace.shape))
    places = (np.hypot(x - spot.x, y - spot.y) <= SPOT_RADIUS) & heightmap.seen
    return graded(places, heightmap.workspace) if places.any() else np.zeros(places.shape, np.float32)


def free_spot(heightmap: HeightMap, table: int = 0) -> Spot | None:
    """The seen spot of a table that is farthest from all things and from the border; None if none has room.

    Args:
        table: the table's number.
    """
    workspace = heightmap.workspace
    x, y = workspace.to_world(*np.indices(workspace.shape))
    to_border = np.minimum.reduce([x - workspace.x_min, workspace.x_max - x, y - workspace.y_min, workspace.y_max - y])
    rising, flat = things(heightmap)
    to_thing = distance_to(covered([*rising, *flat], workspace), workspace)
    room = np.where(heightmap.seen, np.minimum(to_thing, to_border), 0)
    if room.max() < HALF + GAP:
        return None
    row, col = np.unravel_index(int(room.argmax()), room.shape)
    return Spot(float(x[row, col]), float(y[row, col]), table)


def covered(masks: Sequence[np.ndarray], workspace: Workspace) -> np.ndarray:
    """The cells (H, W) bool of all things, given as (H, W) bool each, with their holes."""
    cells = np.zeros(workspace.shape, bool)
    for mask in masks:
        cells |= ndimage.binary_fill_holes(mask)
    return cells


def graded(places: np.ndarray, workspace: Workspace) -> np.ndarray:
    """Free places (H, W) bool, at least one of them, as a map (H, W) float32: 1 in their midst, 0 outside."""
    around = ndimage.gaussian_filter(places.astype(np.float32), SPREAD / workspace.pixel, mode="constant")
    highest = around[places].max()
    return np.where(places, LOWEST_VALUE + (1 - LOWEST_VALUE) * around / highest, 0).astype(np.float32)


def no_free_place(query: Query) -> str:
    """One sentence for a relation, such as "left of green bowl", of which no place is free, or for an unseen spot."""
    if isinstance(query, Spot):
        return f"no camera sees the table at {query}"
    relation, anchors = language.split_relation(str(query))
    return f"there is no free place {relation} " + " and ".join(f'"{anchor}"' for anchor in anchors)


def thing_at_peak(semantic: np.ndarray, rising: Sequence[np.ndarray], config: PatchConfig) -> np.ndarray:
    """The cells (H, W) bool of the thing at the centre of a map's highest plateau.

    It is what rises there from the table. Of something flat, it is the map's own plateau.

    Args:
        rising: the cells (H, W) bool of each thing that rises, with its holes.
    """
    row, col = plateau_centre(semantic, config)
    rows, cols = np.indices(semantic.shape)
    away = np.hypot(rows - row, cols - col) * config.pixel
    distances = [float(away[mask].min()) for mask in rising]
    if distances and min(distances) <= AT_THING:
        return rising[int(np.argmin(distances))]
    plateaus, _ = ndimage.label(semantic >= semantic.max() - PLATEAU)
    cells = np.argwhere(plateaus > 0)
    nearest = cells[np.argmin(np.hypot(*(cells - (row, col)).T))]
    return plateaus == plateaus[tuple(nearest)]


def free_places(
    relation: str, anchors: Sequence[np.ndarray], everything: np.ndarray, workspace: Workspace
) -> np.ndarray:  # fmt: skip
    """The cells (H, W) bool of free table at a fitting distance from things.

    Args:
        anchors: the cells (H, W) bool of each thing of the relation.
        everything: (H, W) bool, the cells of all things.

    Raises:
        ValueError: an unknown relation.
    """
    if relation not in (*DIRECTIONS, BESIDE, language.BETWEEN):
        allowed = ", ".join(dict.fromkeys(language.RELATIONS.values()))
        raise ValueError(f"relation must be one of {allowed}, got {relation!r}")
    x, y = workspace.to_world(*np.indices(workspace.shape))
    free = (distance_to(everything, workspace) >= HALF + GAP) & workspace.contains(x, y, HALF)
    if relation == language.BETWEEN:
        return free & _around_middle(anchors, x, y)
    band = distance_to(anchors[0], workspace) <= HALF + GAP + WIDTH
    steps = DIRECTIONS.values() if relation == BESIDE else [DIRECTIONS[relation]]
    return free & band & np.any([_sector(anchors[0], step, x, y) for step in steps], axis=0)


def distance_to(cells: np.ndarray, workspace: Workspace) -> np.ndarray:
    """How far (m) each cell (H, W) is from the nearest of some cells (H, W) bool, from centre to centre."""
    if not cells.any():
        return np.full(cells.shape, np.inf)
    return ndimage.distance_transform_edt(~cells) * workspace.pixel


def _sector(anchor: np.ndarray, step: tuple[int, int], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The cells beyond a thing in the direction of a step, at most `SECTOR` off as seen from its middle."""
    along = step[0] * x + step[1] * y
    across = step[1] * x - step[0] * y
    off = np.abs(across - across[anchor].mean())
    return (along > along[anchor].max()) & (off <= math.tan(SECTOR) * (along - along[anchor].mean()))


def _around_middle(anchors: Sequence[np.ndarray], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The cells around the middle of the line from one thing to another; none if both are the same."""
    start, end = (np.array([x[anchor].mean(), y[anchor].mean()]) for anchor in anchors)
    if np.array_equal(start, end):
        return np.zeros(x.shape, bool)
    share, off = along_line(x, y, start, end)
    first, last = MIDDLE_THIRD
    return (share >= first) & (share <= last) & (np.abs(off) <= OFF_LINE)


def along_line(x: Length, y: Length, start: np.ndarray, end: np.ndarray) -> tuple[Length, Length]:
    """Where points lie along a line from ``start`` to ``end``, (2,) m each: the share of the way, and how far (m) off.

    Points to the right of the way have a positive distance.
    """
    way_x, way_y = end - start
    length = math.hypot(way_x, way_y)
    share = ((x - start[0]) * way_x + (y - start[1]) * way_y) / length**2
    return share, ((x - start[0]) * way_y - (y - start[1]) * way_x) / length
