"""A rope of beads, and the guide to which it is aligned: a square that is open on one side. After CLIPort."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pybullet as p
import trimesh

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body, add_print, boxes_mesh, create_body

BEADS = 20
BEAD = 0.005
"""Half the side (m) of a bead's contact shape, a cube."""
SPACING = 2 * BEAD * math.sqrt(2)
"""Distance (m) between the middles of neighbouring beads."""
LENGTH = BEADS * SPACING
"""Length (m) of the rope, and of each side of the guide."""
BEAD_MASS = 0.1
ROPE_COLOR: RGBA = (1.0, 0.341, 0.349, 1.0)
END_COLOR: RGBA = (1.0, 1.0, 1.0, 1.0)
GUIDE_COLOR: RGBA = (0.0, 1.0, 0.0, 1.0)
STRIP = (0.01, 0.001)
"""Width and height (m) of a strip of the guide."""
CORNERS = {
    "front left tip": (-1, 1),
    "front right tip": (1, 1),
    "back left corner": (-1, -1),
    "back right corner": (1, -1),
}
"""The corners of the guide by their names: the signs of x and y in the guide's frame. It is open towards its +y."""
DIRECTIONS = (
    ("front left tip", "front right tip"),
    ("front right tip", "back right corner"),
    ("front left tip", "back left corner"),
    ("back left corner", "back right corner"),
)
"""The lines along which a sentence may want the rope."""


def add_rope(client: int, points: np.ndarray) -> list[Body]:
    """A rope: beads that are joined to their neighbours.

    Args:
        points: (`BEADS`, 3) the positions (m) of the beads' middles. Neighbours should be `SPACING` apart.

    Returns:
        The beads in their order along the rope. The two end beads are white.
    """
    collision = p.createCollisionShape(p.GEOM_BOX, halfExtents=(BEAD,) * 3, physicsClientId=client)
    beads: list[Body] = []
    for number, point in enumerate(points):
        color = END_COLOR if number in (0, BEADS - 1) else ROPE_COLOR
        visual = p.createVisualShape(p.GEOM_SPHERE, radius=1.5 * BEAD, rgbaColor=color, physicsClientId=client)
        pose = Pose2(float(point[0]), float(point[1]))
        bead = create_body(client, collision, visual, pose, float(point[2]), BEAD_MASS, movable=True)
        if beads:
            offset = (0.0, 0.0, 0.0)
            arm = np.asarray(points[number] - points[number - 1]).tolist()
            joint = p.createConstraint(
                beads[-1].id, -1, bead.id, -1, p.JOINT_POINT2POINT, offset, arm, offset, physicsClientId=client
            )
            p.changeConstraint(joint, maxForce=100, physicsClientId=client)
        beads.append(bead)
    return [Body(bead.id, BEAD, movable=True) for bead in beads]


def hanging_points(pose: Pose2) -> np.ndarray:
    """(`BEADS`, 3) positions (m) of a rope that hangs over a place: it falls into loops."""
    heights = BEAD + SPACING * np.arange(BEADS)
    return np.stack([np.full(BEADS, pose.x), np.full(BEADS, pose.y), heights], axis=1)


@cache
def guide_mesh() -> trimesh.Trimesh:
    """Three flat strips: the sides of a square, without the side towards +y."""
    half = LENGTH / 2
    width = STRIP[0] / 2
    height = STRIP[1]
    return boxes_mesh([
        [[-half, -half - width, 0], [half, -half + width, height]],
        [[-half - width, -half, 0], [-half + width, half, height]],
        [[half - width, -half, 0], [half + width, half, height]],
    ])  # fmt: skip


def add_guide(client: int, pose: Pose2) -> Body:
    """Draw a guide on the table. It is fixed, and other bodies do not touch it."""
    return add_print(client, guide_mesh(), GUIDE_COLOR, pose)


def targets(pose: Pose2, start: str, end: str) -> list[Pose2]:
    """The places (in the world) of the beads of a rope from one corner of a guide to another, evenly spaced."""
    half = LENGTH / 2
    first = half * np.array(CORNERS[start])
    last = half * np.array(CORNERS[end])
    shares = (np.arange(BEADS) + 0.5) / BEADS
    points = first + shares[:, None] * (last - first)
    return [pose @ Pose2(float(x), float(y)) for x, y in points]
