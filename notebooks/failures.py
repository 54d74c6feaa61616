"""Why a policy failed: its first action that gained nothing, explained with the simulator's truth.

The policy never sees this truth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gem_lite import tasks
from gem_lite.actions import Action, ExpertAction, Push
from gem_lite.evaluation.rollout import Observations, rollout
from gem_lite.policies.base import Policy
from gem_lite.policies.choosing import Choice
from gem_lite.se2 import Pose2, angle_off
from gem_lite.simulation.environment import body_at
from gem_lite.simulation.world import World


@dataclass(frozen=True)
class Failure:
    """An action that gained nothing: its episode and step, what the policy saw and chose, and the reason."""

    episode: int
    step: int
    choice: Choice
    reason: str


def thing_at(world: World, pose: Pose2) -> str:
    """The task's name of what lies topmost at a pose, or "table"."""
    return world.task.names.get(body_at(world, pose), "table")


def ends(action: Action) -> tuple[Pose2, Pose2]:
    """Where an action begins and where it ends: pick and place, or the start and the end of a push."""
    if isinstance(action, Push):
        return action.start, action.end
    return action.pick, action.place


def _distance(first: Pose2, second: Pose2) -> float:
    """Millimetres between two poses."""
    return 1000 * math.hypot(first.x - second.x, first.y - second.y)


def reason(choice: Choice, expert: ExpertAction, right: tuple[str, str], chosen: tuple[str, str], grasped: bool) -> str:
    """The first cause why an action was wrong, in one line.

    Args:
        right: the names of the things at the expert's pick and place.
        chosen: the names of the things at the policy's pick and place. If the tool lifted a body, its name stands for
            the pick.
        grasped: whether the tool held anything.
    """
    right_action = expert.action
    action = choice.action
    if isinstance(action, Push) or isinstance(right_action, Push):
        starts, stops = zip(ends(action), ends(right_action), strict=True)
        return f"began {_distance(*starts):.0f} mm and ended {_distance(*stops):.0f} mm from the expert's push"
    if chosen[0] != right[0]:
        return f"picked the {chosen[0]}, not the {right[0]}"
    if not grasped:
        turn = math.degrees(angle_off(action.pick.yaw - right_action.pick.yaw, expert.pick_symmetry))
        return f"grasped nothing of the {right[0]}, {turn:.0f}° off"
    if chosen[1] != right[1]:
        return f"placed on the {chosen[1]}, not on the {right[1]}"
    gap = _distance(action.place, right_action.place)
    turn = math.degrees(angle_off(action.delta - right_action.delta, expert.place_symmetry))
    return f"placed {gap:.0f} mm and {turn:.0f}° off"


def first_failure(
    world: World, policy: Policy, task_name: str, index: int, split: tasks.Split = "test"
) -> Failure | None:
    """Play an episode until an action gains nothing; None if every action gained something.

    Raises:
        ValueError: unknown task or split.
    """
    task = tasks.make(task_name, split)
    before: list[tuple[ExpertAction, tuple[str, ...]] | None] = []

    def actor(world: World, observations: Observations, empty_picks: Sequence[Pose2]) -> Choice:
        choice = policy.decide(observations[0], task.instruction, empty_picks)
        expert = task.expert(world)
        if expert is None:
            before.append(None)
            return choice
        poses = (*ends(expert.action), *ends(choice.action))
        before.append((expert, tuple(thing_at(world, pose) for pose in poses)))
        return choice

    for number, turn in enumerate(rollout(world, task, tasks.episode_seed(split, index), actor)):
        result = turn.result
        if np.isclose(result.reward, 0) or result.reward < 0:
            known = before[number]
            if known is None:
                return Failure(index, world.steps_taken, turn.decision, "the expert knows no act here")
            expert, (right_pick, right_place, picked, place) = known
            if result.held is not None:
                picked = task.names[result.held]
            cause = reason(turn.decision, expert, (right_pick, right_place), (picked, place), result.grasped)
            if result.held in turn.placed:
                cause = f"picked the {picked} that already lay in its place"
            return Failure(index, world.steps_taken, turn.decision, cause)
    return None
