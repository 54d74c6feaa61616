"""A pile of small cubes, and the square outlines into which a spatula pushes it, after CLIPort."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import trimesh
from shapely.geometry import box

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body, add_box, add_print

CUBE = 0.01
"""Side (m) of a cube of a pile."""
CUBES = 50
SQUARE = 0.12
"""Side (m) of a square, measured outside."""
LINE = 0.006
"""Width (m) of a square's outline."""
PRINT = 0.001
"""Height (m) of the outline over the table."""


def add_pile(client: int, color: RGBA, poses: Sequence[Pose2]) -> list[Body]:
    """Put movable cubes on the table, one at each pose. They may start inside each other's space; then they part."""
    return [add_box(client, (CUBE,) * 3, color, pose, mass=0.001, friction=0.5) for pose in poses]


@cache
def square_mesh() -> trimesh.Trimesh:
    """A square outline, flat."""
    outer = SQUARE / 2
    inner = outer - LINE
    frame = box(-outer, -outer, outer, outer).difference(box(-inner, -inner, inner, inner))
    return trimesh.creation.extrude_polygon(frame, PRINT)


def add_square(client: int, color: RGBA, pose: Pose2) -> Body:
    """Draw a square outline on the table. It is fixed, and other bodies do not touch it."""
    return add_print(client, square_mesh(), color, pose)
