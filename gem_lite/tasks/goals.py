"""The goals of a task: which bodies have which targets, when a target is reached, and the expert's next action."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.language import Instruction
from gem_lite.se2 import Pose2, angle_off, wrap
from gem_lite.simulation.bodies.shapes import Body
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
    """Decides how far a body is at its target.

    Attributes:
        symmetry: the smallest turn (radians) of a placed body that changes nothing; 0 if every yaw is right.
    """

    @property
    def symmetry(self) -> float:
        """See above."""

    def share(self, environment: Environment, body: Body, target: Target) -> float:
        """The share of a body that is at a target, in [0, 1]. The body is there if it is 1."""


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
        wrong_yaw: the share of a body whose yaw alone is wrong.
    """

    distance: float
    symmetry: float = 0.0
    yaw: float = math.radians(15)
    height: float | None = None
    height_distance: float = 0.01
    wrong_yaw: float = 0.0

    def share(self, environment: Environment, body: Body, target: Target) -> float:
        """1 if a body is at a target, `wrong_yaw` if all but its yaw is right, else 0."""
        pose, z = environment.pose(body)
        offset = target_pose(environment, target).inverse() @ pose
        near = math.hypot(offset.x, offset.y) < self.distance
        right_height = self.height is None or abs(z - self.height) < self.height_distance
        right_yaw = angle_off(offset.yaw, self.symmetry) < self.yaw
        if not (near and right_height):
            return 0.0
        return 1.0 if right_yaw else self.wrong_yaw


@dataclass(frozen=True)
class ZoneMetric:
    """A body is at its target if its origin is inside a box round the target's origin. Every yaw is right.

    Attributes:
        size: the box's sides (m) along the target's x and y axes.
        height: the box's height (m) above the table.
        symmetry: 0, because every yaw is right.
    """

    size: tuple[float, float]
    height: float
    symmetry: float = 0.0

    def share(self, environment: Environment, body: Body, target: Target) -> float:
        """1 if a body is at a target, else 0."""
        pose, z = environment.pose(body)
        offset = target_pose(environment, target).inverse() @ pose
        return float(abs(offset.x) < self.size[0] / 2 and abs(offset.y) < self.size[1] / 2 and z < self.height)


@dataclass(frozen=True)
class VolumeMetric:
    """CLIPort's zone metric: the share of a body's volume that is inside a box round the origin of another body.

    The volume is sampled: a grid of points fills the body's bounding box, starting at its lowest corner. A body's
    target says where an expert puts it; it does not change the share.

    Attributes:
        zone: the body in the middle of the box.
        size: the box's sides (m) along the zone's x and y axes.
        height: the box's height (m) above the table.
        extents: the sides (m) of each body's bounding box in its own frame, by its id.
        symmetry: the smallest turn (radians) of a placed body that changes nothing; 0 if every yaw is right.
        spacing: the distance (m) of neighbouring points of the grid.
    """

    zone: Body
    size: tuple[float, float]
    height: float
    extents: Mapping[int, tuple[float, float, float]]
    symmetry: float = 0.0
    spacing: float = 0.02

    def share(self, environment: Environment, body: Body, target: Target) -> float:
        """The share of the grid's points that are inside."""
        axes = [np.arange(-side / 2, side / 2, self.spacing) for side in self.extents[body.id]]
        points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
        position, turn = environment.placement(body)
        in_world = points @ turn.T + position
        zone = environment.pose(self.zone)[0]
        cosine = math.cos(zone.yaw)
        sine = math.sin(zone.yaw)
        in_zone = (in_world[:, :2] - (zone.x, zone.y)) @ np.array([[cosine, -sine], [sine, cosine]])
        inside = (np.abs(in_zone) < np.array(self.size) / 2).all(axis=1) & (in_world[:, 2] < self.height)
        return float(inside.mean())


@dataclass(frozen=True)
class Goal:
    """One sentence and the scene that it demands.

    Attributes:
        sentence: the instruction, with or without pictures.
        bodies: the bodies to move.
        targets: the possible targets. Each body may go to any of them, and several bodies may share one.
        metric: decides whether a body is at a target.
        share: the goal's part of the task's reward, in proportion to the shares of the other goals.
        grasp: the pose of the expert's grasp, in the body's frame.
        grasp_symmetry: the smallest turn (radians) of the tool about that point that does not change the grasp; 0 if
            every yaw is right.
        matches: for each body, the numbers of the targets to which it may go; by default it may go to all of them.
        rotations: whether the expert may turn the body. If not, the body keeps its yaw wherever the tool holds it.
    """

    sentence: Instruction
    bodies: tuple[Body, ...]
    targets: tuple[Target, ...]
    metric: Metric
    share: float = 1.0
    grasp: Pose2 = MIDDLE
    grasp_symmetry: float = 0.0
    matches: tuple[tuple[int, ...], ...] | None = None
    rotations: bool = True

    @property
    def allowed(self) -> np.ndarray:
        """(bodies, targets) bool: which body may go to which target."""
        shape = (len(self.bodies), len(self.targets))
        allowed = np.full(shape, self.matches is None)
        for body, numbers in enumerate(self.matches or ()):
            allowed[body, list(numbers)] = True
        return allowed

    def shares(self, environment: Environment) -> np.ndarray:
        """(bodies, targets): the share of each body that is at each of its targets, in [0, 1]."""
        shares = np.zeros((len(self.bodies), len(self.targets)))
        for body, target in np.argwhere(self.allowed):
            shares[body, target] = self.metric.share(environment, self.bodies[body], self.targets[target])
        return shares

    def at_targets(self, environment: Environment) -> np.ndarray:
        """(bodies, targets) bool: which body is at which target."""
        return self.shares(environment) == 1

    def done(self, environment: Environment) -> float:
        """The mean over the bodies of the share that is at a target, in [0, 1]."""
        return float(self.shares(environment).max(axis=1).mean())

    def placed(self, environment: Environment) -> set[int]:
        """The ids of the bodies that are at a target."""
        return {self.bodies[number].id for number, _ in np.argwhere(self.at_targets(environment))}

    def next_move(self, environment: Environment) -> tuple[Body, Target]:
        """The body that is farthest from its nearest free target, and that target.

        A target is free if no body of the goal is at it. A body whose targets are all taken may use any of them.

        Raises:
            ValueError: every body is at a target.
        """
        at_targets = self.at_targets(environment)
        waiting = np.flatnonzero(~at_targets.any(axis=1))
        if len(waiting) == 0:
            raise ValueError(f"the goal {str(self.sentence)!r} is reached: no body is left to move")
        free = self.allowed & ~at_targets.any(axis=0)
        free = np.where(free.any(axis=1, keepdims=True), free, self.allowed)
        bodies = _positions([environment.pose(body)[0] for body in self.bodies])
        targets = _positions([target_pose(environment, target) for target in self.targets])
        distances = np.linalg.norm(bodies[:, None] - targets, axis=-1)
        distances = np.where(free, distances, np.inf)[waiting]
        farthest = int(distances.min(axis=1).argmax())
        nearest = int(distances[farthest].argmin())
        return self.bodies[waiting[farthest]], self.targets[nearest]


def _positions(poses: list[Pose2]) -> np.ndarray:
    """(N, 2) metres."""
    return np.array([(pose.x, pose.y) for pose in poses])


def pick_and_place(environment: Environment, goal: Goal) -> ExpertAction:
    """The expert's next pick and place for a goal that is not reached.

    The expert grasps the body at `Goal.grasp`, with the body's yaw. It turns the body by the smallest angle that makes
    the yaw right. If every yaw is right, the tool keeps its yaw and brings the grasped point to the target's origin. A
    body of a goal without rotations keeps its yaw, and its own origin comes to the target's.

    Raises:
        ValueError: the goal is reached.
    """
    body, target = goal.next_move(environment)
    body_pose = environment.pose(body)[0]
    goal_pose = target_pose(environment, target)
    symmetry = goal.metric.symmetry
    pick = body_pose @ goal.grasp
    if not goal.rotations:
        place = Pose2(goal_pose.x, goal_pose.y, body_pose.yaw) @ goal.grasp
        symmetry = FULL_TURN
    elif symmetry == 0:
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

    A push begins on the table, even if the body lies beside it.

    Raises:
        ValueError: the goal is reached.
    """
    body, target = goal.next_move(environment)
    start, table = environment.on_table(environment.pose(body)[0])
    start = environment.workspace.nearest_pose(start)
    end, _ = environment.on_table(target_pose(environment, target))
    return ExpertAction(Push(start, end, table))
