"""A kit: a flat board with five "holes" for pieces, after CLIPort. A hole is a dark print; it is not deep."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import trimesh

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.shapes import Body

KIT_SIZE = (0.28, 0.20, 0.005)
"""Sides (m) of the board."""
SPOTS = (
    Pose2(-0.09, 0.045), Pose2(0.0, 0.045), Pose2(0.09, 0.045), Pose2(-0.045, -0.045), Pose2(0.045, -0.045),
)  # fmt: skip
"""The places of the holes in the frame of the board."""
HOLE_COLOR = (0.2, 0.2, 0.2, 1.0)
PRINT = 0.0012
"""Height (m) of a hole's print over the board."""


@cache
def hole_mesh(shape: str) -> trimesh.Trimesh:
    """The print of a hole: the outline of a piece, `PRINT` thick."""
    return trimesh.creation.extrude_polygon(shapes.outline(shape), PRINT)


def add_full_kit(client: int, pose: Pose2, pieces: Sequence[str], yaws: Sequence[float]) -> tuple[Body, list[Body]]:
    """Put a fixed board with one hole for each of five pieces on the table. Other bodies do not touch the holes.

    Args:
        pieces: the names of the five shapes.
        yaws: the yaw (radians) of each hole in the world.

    Returns:
        The board and its holes.

    Raises:
        ValueError: no piece has one of these shapes.
    """
    board = shapes.add_box(client, KIT_SIZE, colors.rgba("brown"), pose, movable=False)
    holes = []
    for shape, spot, yaw in zip(pieces, SPOTS, yaws, strict=True):
        place = pose @ spot
        at = Pose2(place.x, place.y, yaw)
        holes.append(shapes.add_print(client, hole_mesh(shape), HOLE_COLOR, at, KIT_SIZE[2]))
    return board, holes
