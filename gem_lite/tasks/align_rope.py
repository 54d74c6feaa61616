"""align-rope: "align the rope from front left tip to front right tip", after CLIPort."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pybullet as p
import trimesh
from typing_extensions import override

from gem_lite.actions import ExpertAction
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body, add_print, boxes_mesh, create_body
from gem_lite.simulation.environment import Environment
from gem_lite.tasks import goals
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace
from gem_lite.tasks.task import Task

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
TOLERANCE = 0.02
FALL = 2.0
"""Seconds in which the rope falls onto the table, as in CLIPort."""
GUIDE_RADIUS = LENGTH / math.sqrt(2) + STRIP[0]
ROPE_RADIUS = 0.07


def add_rope(client: int, points: np.ndarray) -> list[Body]:
    """A rope: beads that are joined to their neighbours.

    Args:
        points: (`BEADS`, 3) the positions (m) of the beads' middles. Neighbours should be `SPACING` apart.

    Returns:
        The beads in their order along the rope. The two end beads are white.
    """
    collision = p.createCollisionShape(p.GEOM_BOX, halfExtents=(BEAD,) * 3, physicsClientId=client)
    beads: list[Body] = []
    middle = (0.0, 0.0, 0.0)
    for number, (x, y, z) in enumerate(points.tolist()):
        color = END_COLOR if number in (0, BEADS - 1) else ROPE_COLOR
        visual = p.createVisualShape(p.GEOM_SPHERE, radius=1.5 * BEAD, rgbaColor=color, physicsClientId=client)
        bead = create_body(client, collision, visual, Pose2(x, y), z, BEAD_MASS, movable=True)
        if beads:
            ends = (middle, (points[number] - points[number - 1]).tolist(), middle)
            joint = p.createConstraint(
                beads[-1].id, -1, bead.id, -1, p.JOINT_POINT2POINT, *ends, physicsClientId=client
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
    return [pose @ Pose2(*point) for point in (first + shares[:, None] * (last - first)).tolist()]


@register("align-rope")
class AlignRope(Task):
    """A rope of 20 beads that fell into loops, and a guide with four corners; the sentence names two of them.

    Each end of the rope may go to each of the two corners: a bead has two targets.
    """

    effector = "low-suction"
    max_steps = 20

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        guide_pose = free.take(GUIDE_RADIUS)
        self.put(environment, add_guide(environment.client, guide_pose), "square guide")
        points = hanging_points(free.take(ROPE_RADIUS))
        beads = [self.put(environment, bead, "rope") for bead in add_rope(environment.client, points)]
        environment.wait(FALL)
        start, end = DIRECTIONS[int(rng.integers(len(DIRECTIONS)))]
        places = tuple(targets(guide_pose, start, end))
        matches = tuple((number, BEADS - 1 - number) for number in range(BEADS))
        sentence = f"align the rope from {start} to {end}"
        return [Goal(sentence, tuple(beads), places, PoseMetric(TOLERANCE), matches=matches, rotations=False)]

    @override
    def expert(self, environment: Environment) -> ExpertAction | None:
        """As in every task, but the rope keeps the direction in which it is nearer to its targets."""
        if self._reached_now(environment) == len(self.goals):
            return None
        (goal,) = self.goals
        beads = np.array([(pose.x, pose.y) for pose in (environment.pose(bead)[0] for bead in goal.bodies)])
        places = np.array([(target.x, target.y) for target in goal.targets if not isinstance(target, goals.Body)])
        along, against = (np.square(beads - order).sum() for order in (places, places[::-1]))
        numbers = range(len(beads))
        one_way = numbers if along <= against else reversed(numbers)
        directed = replace(goal, matches=tuple((number,) for number in one_way))
        return goals.pick_and_place(environment, directed) if directed.done(environment) < 1 else None
