"""Goals of a task: which bodies belong where, when they are there, and how an expert brings them there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.se2 import Pose2, angle_off, wrap
from gem_lite.simulation.shapes import Body

if TYPE_CHECKING:
    from gem_lite.simulation.environment import Environment

Target = Body | Pose2
"""Where something belongs: at the origin of a body, wherever that lies, or at a pose in the world."""
FULL_TURN = 2 * math.pi
MIDDLE = Pose2(0.0, 0.0)
"""A body's own origin."""


def target_pose(environment: Environment, target: Target) -> Pose2:
    """A target's pose in the world."""
    return environment.pose(target)[0] if isinstance(target, Body) else target


class Metric(Protocol):
    """Says when a body is where it belongs.

    Attributes:
        symmetry: the smallest turn (radians) of a placed body that changes nothing; 0 where no yaw is wrong.
    """

    @property
    def symmetry(self) -> float:
        """See above."""
        ...

    def reached(self, environment: Environment, body: Body, target: Target) -> bool:
        """Whether a body is at a target."""
        ...


@dataclass(frozen=True)
class PoseMetric:
    """A body is at its target if their poses nearly agree.

    Attributes:
        distance: less than this (m) lies between the two, seen from above.
        symmetry: the smallest turn (radians) that changes nothing of the body: pi / 2 for a cube, 2 pi for an L;
            0 (the default) where the yaw is not scored.
        yaw: the yaw is less than this (radians) off.
        height: where the body's origin has to be (m); None (the default) where the height is not scored.
        height_distance: less than this (m) lies between that and where it is.
    """

    distance: float
    symmetry: float = 0.0
    yaw: float = math.radians(15)
    height: float | None = None
    height_distance: float = 0.01

    def reached(self, environment: Environment, body: Body, target: Target) -> bool:
        """Whether a body is at a target."""
        pose, z = environment.pose(body)
        off = target_pose(environment, target).inverse() @ pose
        near = math.hypot(off.x, off.y) < self.distance
        level = self.height is None or abs(z - self.height) < self.height_distance
        return near and level and angle_off(off.yaw, self.symmetry) < self.yaw


@dataclass(frozen=True)
class ZoneMetric:
    """A body is at its target if its origin is inside a box round the target's. No yaw is wrong.

    Attributes:
        size: the box's sides (m) along the target's x and y axes.
        height: its height (m) above the table.
    """

    size: tuple[float, float]
    height: float

    @property
    def symmetry(self) -> float:
        """0: every yaw is as good."""
        return 0.0

    def reached(self, environment: Environment, body: Body, target: Target) -> bool:
        """Whether a body is at a target."""
        pose, z = environment.pose(body)
        off = target_pose(environment, target).inverse() @ pose
        return abs(off.x) < self.size[0] / 2 and abs(off.y) < self.size[1] / 2 and z < self.height


@dataclass(frozen=True)
class Goal:
    """One sentence, and what it asks for.

    Attributes:
        sentence: the instruction.
        bodies: what has to be moved.
        targets: where to. Each body may go to any of them, and several bodies may share one.
        metric: says when a body is at a target.
        share: the goal's part of the task's reward, in proportion to those of the other goals.
        grasp: where the expert grasps a body, in the body's frame.
        grasp_symmetry: the smallest turn (radians) of the tool about that point that grasps as well; 0 where every
            yaw does.
    """

    sentence: str
    bodies: tuple[Body, ...]
    targets: tuple[Target, ...]
    metric: Metric
    share: float = 1.0
    grasp: Pose2 = MIDDLE
    grasp_symmetry: float = 0.0

    def at_targets(self, environment: Environment) -> np.ndarray:
        """(bodies, targets) bool: which body is at which target."""
        return np.array([[self.metric.reached(environment, b, t) for t in self.targets] for b in self.bodies])

    def done(self, environment: Environment) -> float:
        """The share of the bodies that are at a target, in [0, 1]."""
        return float(self.at_targets(environment).any(axis=1).mean())

    def placed(self, environment: Environment) -> set[int]:
        """The ids of the bodies that are at a target."""
        there = self.at_targets(environment)
        return {body.id for body, at in zip(self.bodies, there, strict=True) if at.any()}

    def next_move(self, environment: Environment) -> tuple[Body, Target]:
        """The body that is farthest from its nearest free target, and that target.

        A target is free if no body of the goal is at it; where none is, all serve.

        Raises:
            ValueError: every body is at a target.
        """
        there = self.at_targets(environment)
        waiting = np.flatnonzero(~there.any(axis=1))
        if len(waiting) == 0:
            raise ValueError(f"the goal {self.sentence!r} is reached: no body is left to move")
        free = np.flatnonzero(~there.any(axis=0))
        free = free if len(free) else np.arange(len(self.targets))
        bodies = _positions([environment.pose(body)[0] for body in self.bodies])
        targets = _positions([target_pose(environment, target) for target in self.targets])
        distances = np.linalg.norm(bodies[waiting, None] - targets[free], axis=-1)
        farthest = int(distances.min(axis=1).argmax())
        nearest = int(distances[farthest].argmin())
        return self.bodies[waiting[farthest]], self.targets[free[nearest]]


def _positions(poses: list[Pose2]) -> np.ndarray:
    """(N, 2) metres."""
    return np.array([(pose.x, pose.y) for pose in poses])


def pick_and_place(environment: Environment, goal: Goal) -> ExpertAction:
    """The expert's next pick and place for a goal that is not reached.

    It grasps the body by `Goal.grasp`, with the body's yaw. The body goes to its target by the smallest turn that makes
    the yaw right; where no yaw is wrong, the tool keeps its yaw and takes the grasped point to the target's middle.

    Raises:
        ValueError: the goal is reached.
    """
    body, target = goal.next_move(environment)
    lying = environment.pose(body)[0]
    belongs = target_pose(environment, target)
    symmetry = goal.metric.symmetry
    pick = lying @ goal.grasp
    if symmetry == 0:
        place = Pose2(belongs.x, belongs.y, pick.yaw)
    elif symmetry == FULL_TURN:
        place = belongs @ goal.grasp
    else:
        turns = FULL_TURN / symmetry
        turn = wrap(turns * (belongs.yaw - lying.yaw)) / turns
        place = Pose2(belongs.x, belongs.y, lying.yaw + turn) @ goal.grasp
    (pick, pick_table), (place, place_table) = environment.on_table(pick), environment.on_table(place)
    return ExpertAction(PickPlace(pick, place, pick_table, place_table), goal.grasp_symmetry, symmetry)


def push(environment: Environment, goal: Goal) -> ExpertAction:
    """The expert's next push for a goal that is not reached: from the farthest body straight to its target.

    Raises:
        ValueError: the goal is reached.
    """
    body, target = goal.next_move(environment)
    start, table = environment.on_table(environment.pose(body)[0])
    end, _ = environment.on_table(target_pose(environment, target))
    return ExpertAction(Push(start, end, table))
