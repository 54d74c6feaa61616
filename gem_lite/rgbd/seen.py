"""How much of a table is seen, and which rectangle of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import is_inside, sort_points
from gem_lite.se2 import Workspace

SHADOW = 0.1
"""A part that is not seen counts as seen if it is narrower (m): the shadow of a thing."""
WIDE = 1.5
"""`seen_of_table` looks as far (m) along x and y from the middle of what is seen of the table."""
FINE = 0.01
"""The side (m) of its cells."""
WORTH_SAYING = 0.005
"""From this share of unseen cells on, the user is told."""
TABLE = 0.02
"""Points at most this far (m) from z = 0 are those of the table."""


def seen_of_table(view: View) -> tuple[float, float, float, float] | None:
    """The rectangle of the table that a view sees, to the centimetre: as `seen_rectangle`."""
    points = view.points()[view.depth > 0]
    table = points[np.abs(points[:, 2]) < TABLE]
    if not len(table):
        return None
    x, y = np.median(table[:, :2], axis=0).round(2).tolist()
    wide = replace(Workspace.covering(x - WIDE, x + WIDE, y - WIDE, y + WIDE, FINE), z_max=Workspace.z_max)
    return seen_rectangle(sort_points([view], wide).seen, wide)


def sees_nothing(view: View, workspace: Workspace) -> bool:
    """Whether no pixel of a view was measured inside the workspace."""
    return not is_inside(view.points(), view, workspace).any()


def unseen_in_words(seen: np.ndarray) -> str:
    """How much of a map (H, W) bool no camera saw, in words; "" if that is less than `WORTH_SAYING`."""
    share = 1 - float(seen.mean())
    if share < WORTH_SAYING:
        return ""
    return f"no camera sees {100 * share:.0f} % of the table: nothing is picked or placed there"


def as_option(rectangle: tuple[float, float, float, float]) -> str:
    """A rectangle as the commands take it."""
    return "--rectangle " + " ".join(f"{limit:.2f}" for limit in rectangle)


def seen_rectangle(seen: np.ndarray, workspace: Workspace) -> tuple[float, float, float, float] | None:
    """The largest rectangle of a map that is seen, apart from the shadows of things.

    Args:
        seen: (H, W) bool, the cells that a camera saw.

    Returns:
        x_min, x_max, y_min, y_max (m), or None if nothing is seen.
    """
    width = max(1, round(SHADOW / workspace.pixel))
    padded = np.pad(seen, width)
    filled = ndimage.binary_closing(padded, np.ones((width, width)))[width:-width, width:-width]
    best, size = None, 0
    for top in range(len(filled)):
        whole = np.ones(filled.shape[1], bool)  # columns that are seen in all rows from the top on
        for bottom in range(top, len(filled)):
            whole &= filled[bottom]
            if not whole.any() or whole.sum() * (len(filled) - top) <= size:
                break
            edges = np.flatnonzero(np.diff(np.concatenate([[0], whole.view(np.int8), [0]])))
            starts, ends = edges[::2], edges[1::2]
            longest = int((ends - starts).argmax())
            area = int(ends[longest] - starts[longest]) * (bottom - top + 1)
            if area > size:
                best, size = (top, bottom, starts[longest], ends[longest]), area
    if best is None:
        return None
    top, bottom, left, right = best
    pixel = workspace.pixel
    return (
        workspace.x_min + float(left) * pixel, workspace.x_min + float(right) * pixel,
        workspace.y_max - (bottom + 1) * pixel, workspace.y_max - top * pixel,
    )  # fmt: skip
