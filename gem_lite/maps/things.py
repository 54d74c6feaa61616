"""The things on a table, found in the height map without any words: what rises, and what has another colour."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Workspace

RISES = 0.008
"""A cell belongs to a thing if it is higher (m) above the table than this, and than the table's own noise."""
NOISE = 3.0
"""A cell is above the table's noise if it is higher by this many standard deviations."""
DIFFERS = 40
"""A cell belongs to a flat thing if one of its colour values (0-255) differs by more than this from the table's."""
BESIDE = 2
"""Cells at most this far from a thing that rises belong to its edge, and to no flat thing."""
FEWEST_CELLS = 12
"""A region of fewer cells is no thing."""


def things(heightmap: HeightMap) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The things on a table, each as an (H, W) bool mask: those that rise above it, and those that do not.

    Only cells that a camera saw count. The first are the connected regions of cells that are higher than the table: its
    level is the median of the heights near z = 0, however full it is, and its noise follows from the median deviation.
    The second are the regions of another colour than the table's median one, such as painted lines and thin boards. The
    holes of flat things belong to them. A shadow and the inside of a bowl are no flat things.
    """
    height, seen = heightmap.height, heightmap.seen
    low = heightmap.near_table
    if not low.any():
        low = seen
    level = np.median(height[low])
    noise = 1.4826 * np.median(np.abs(height[low] - level))  # the standard deviation, if the noise is normal
    rises = seen & (height > level + max(RISES, NOISE * noise))
    rgb = heightmap.rgb.astype(np.float32)
    table = np.maximum(np.median(rgb[low], axis=0), 1)
    light = np.minimum((rgb @ table) / (table @ table), 1)  # below 1 in a shadow, which has the table's colour
    difference = np.abs(rgb - light[..., None] * table).max(axis=-1)
    differs = seen & (difference > max(DIFFERS, NOISE * 1.4826 * float(np.median(difference[low]))))
    standing = ndimage.binary_dilation(ndimage.binary_fill_holes(rises), iterations=BESIDE)
    flat = ndimage.binary_fill_holes(differs | rises) & ~standing
    return _regions(rises), _regions(flat)


def _regions(cells: np.ndarray) -> list[np.ndarray]:
    """The connected regions of cells (H, W) that are large enough to be things."""
    regions, count = ndimage.label(cells)
    masks = [regions == number for number in range(1, count + 1)]
    return [mask for mask in masks if mask.sum() >= FEWEST_CELLS]


def middle(mask: np.ndarray, workspace: Workspace) -> tuple[float, float]:
    """The x and y (m) of the middle of a mask's cells."""
    rows, cols = np.nonzero(mask)
    x, y = workspace.to_world(float(rows.mean()), float(cols.mean()))
    return float(x), float(y)
