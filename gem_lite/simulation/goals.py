"""The goals of a task: which bodies have which targets, when a target is reached, and the expert's next action."""

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
"""The target of a body: the origin of another body, or a pose in the world."""
FULL_TURN = 2 * math.pi
MIDDLE = Pose2(0.0, 0.0)
"""A body's own origin."""


def target_pose(environment: Environment, target: Target) -> Pose2:
    """A target's pose in the world."""
    return environment.pose(target)[0] if isinstance(target, Body) else target


class Metric(Protocol):
    """Decides whether a body is at its target.

    Attributes:
        symmetry: the smallest turn (radians) of a placed body that changes nothing; 0 if every yaw is right.
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
        distance: the distance (m) of the two, seen from above, is less than this.
        symmetry: the smallest turn (radians) of the body that changes nothing: pi / 2 for a cube, 2 pi for an L;
            0 (the default) if the yaw is not scored.
        yaw: the error of the yaw is less than this (radians).
        height: the height (m) that the body's origin should have; None (the default) if it is not scored.
        height_distance: the error of the height is less than this (m).
    """

    distance: float
    symmetry: float = 0.0
    yaw: float = math.radians(15)
    height: float | None = None
    height_distance: float = 0.01

    def reached(self, environment: Environment, body: Body, target: Target) -> bool:
        """Whether a body is at a target."""
        pose, z = environment.pose(body)
        offset = target_pose(environment, target).inverse() @ pose
        near = math.hypot(offset.x, offset.y) < self.distance
        right_height = self.height is None or abs(z - self.height) < self.height_distance
        right_yaw = angle_off(offset.yaw, self.symmetry) < self.yaw
        return near and right_height and right_yaw


@dataclass(frozen=True)
class ZoneMetric:
    """A body is at its target if its origin is inside a box round the target's origin. Every yaw is right.

    Attributes:
        size: the box's sides (m) along the target's x and y axes.
        height: the box's height (m) above the table.
    """

    size: tuple[float, float]
    height: float

    @property
    def symmetry(self) -> float:
        """0: every yaw is right."""
        return 0.0

    def reached(self, environment: Environment, body: Body, target: Target) -> bool:
        """Whether a body is at a target."""
        pose, z = environment.pose(body)
        offset = target_pose(environment, target).inverse() @ pose
        return abs(offset.x) < self.size[0] / 2 and abs(offset.y) < self.size[1] / 2 and z < self.height


@dataclass(frozen=True)
class Goal:
    """One sentence and the scene that it demands.

    Attributes:
        sentence: the instruction.
        bodies: the bodies to move.
        targets: the possible targets. Each body may go to any of them, and several bodies may share one.
        metric: decides whether a body is at a target.
        share: the goal's part of the task's reward, in proportion to the shares of the other goals.
        grasp: the pose of the expert's grasp, in the body's frame.
        grasp_symmetry: the smallest turn (radians) of the tool about that point that does not change the grasp; 0 if
            every yaw is right.
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
        return np.array(
            [[self.metric.reached(environment, body, target) for target in self.targets] for body in self.bodies]
        )

    def done(self, environment: Environment) -> float:
        """The share of the bodies that are at a target, in [0, 1]."""
        return float(self.at_targets(environment).any(axis=1).mean())

    def placed(self, environment: Environment) -> set[int]:
        """The ids of the bodies that are at a target."""
        placed = self.at_targets(environment).any(axis=1)
        return {body.id for body, is_placed in zip(self.bodies, placed, strict=True) if is_placed}

    def next_move(self, environment: Environment) -> tuple[Body, Target]:
        """The body that is farthest from its nearest free target, and that target.

        A target is free if no body of the goal is at it. If no target is free, all targets are used.

        Raises:
            ValueError: every body is at a target.
        """
        at_targets = self.at_targets(environment)
        waiting = np.flatnonzero(~at_targets.any(axis=1))
        if len(waiting) == 0:
            raise ValueError(f"the goal {self.sentence!r} is reached: no body is left to move")
        free = np.flatnonzero(~at_targets.any(axis=0))
        if len(free) == 0:
            free = np.arange(len(self.targets))
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

    The expert grasps the body at `Goal.grasp`, with the body's yaw. It turns the body by the smallest angle that makes
    the yaw right. If every yaw is right, the tool keeps its yaw and brings the grasped point to the target's origin.

    Raises:
        ValueError: the goal is reached.
    """
    body, target = goal.next_move(environment)
    body_pose = environment.pose(body)[0]
    goal_pose = target_pose(environment, target)
    symmetry = goal.metric.symmetry
    pick = body_pose @ goal.grasp
    if symmetry == 0:
        place = Pose2(goal_pose.x, goal_pose.y, pick.yaw)
    elif symmetry == FULL_TURN:
        place = goal_pose @ goal.grasp
    else:
        turns = FULL_TURN / symmetry
        turn = wrap(turns * (goal_pose.yaw - body_pose.yaw)) / turns
        place = Pose2(goal_pose.x, goal_pose.y, body_pose.yaw + turn) @ goal.grasp
    pick, pick_table = environment.on_table(pick)
    place, place_table = environment.on_table(place)
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
