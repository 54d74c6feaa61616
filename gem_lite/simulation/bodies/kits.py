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


def add_kit(client: int, pose: Pose2) -> Body:
    """Put a fixed board on the table."""
    return shapes.add_box(client, KIT_SIZE, colors.rgba("brown"), pose, movable=False)


def add_hole(client: int, shape: str, pose: Pose2) -> Body:
    """Print a hole on a board, at a pose in the world. It is fixed, and other bodies do not touch it.

    Raises:
        ValueError: no piece has this shape.
    """
    return shapes.add_print(client, hole_mesh(shape), HOLE_COLOR, pose, KIT_SIZE[2])


def add_full_kit(client: int, pose: Pose2, pieces: Sequence[str], yaws: Sequence[float]) -> tuple[Body, list[Body]]:
    """Put a board with one hole for each of five pieces on the table.

    Args:
        pieces: the names of the five shapes.
        yaws: the yaw (radians) of each hole in the world.

    Returns:
        The board and its holes.
    """
    board = add_kit(client, pose)
    places = [pose @ spot for spot in SPOTS]
    holes = [
        add_hole(client, shape, Pose2(place.x, place.y, yaw))
        for shape, place, yaw in zip(pieces, places, yaws, strict=True)
    ]
    return board, holes
