"""Why a policy failed: its first action that gained nothing, judged by the simulator's truth.

The truth explains; the policy never sees it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gem_lite import tasks
from gem_lite.actions import ExpertAction
from gem_lite.policies.base import Choice, PickPlacePolicy
from gem_lite.se2 import Pose2, angle_off
from gem_lite.simulation.environment import body_at
from gem_lite.simulation.world import World


@dataclass(frozen=True)
class Failure:
    """An action that gained nothing: in which step of which episode, what the policy saw and chose, and why."""

    episode: int
    step: int
    choice: Choice
    reason: str


def thing_at(world: World, pose: Pose2) -> str:
    """The task's name of what lies topmost at a pose, or "table"."""
    return world.task.names.get(body_at(world, pose), "table")


def reason(choice: Choice, expert: ExpertAction, wanted: tuple[str, str], found: tuple[str, str], grasped: bool) -> str:
    """One line on what was wrong with an action, the first cause first.

    Args:
        wanted: what lies at the expert's pick and place.
        found: the same for the policy; what the tool lifted counts more than what lies under the pick.
        grasped: whether the tool held anything.
    """
    right, done = expert.action, choice.action
    if found[0] != wanted[0]:
        return f"picked the {found[0]}, not the {wanted[0]}"
    if not grasped:
        turn = math.degrees(angle_off(done.pick.yaw - right.pick.yaw, expert.pick_symmetry))
        return f"grasped nothing of the {wanted[0]}, {turn:.0f}° off"
    if found[1] != wanted[1]:
        return f"placed on the {found[1]}, not on the {wanted[1]}"
    gap = 1000 * math.hypot(done.place.x - right.place.x, done.place.y - right.place.y)
    turn = math.degrees(angle_off(done.delta - right.delta, expert.place_symmetry))
    return f"placed {gap:.0f} mm and {turn:.0f}° off"


def first_failure(
    world: World, policy: PickPlacePolicy, task_name: str, index: int, split: tasks.Split = "test"
) -> Failure | None:
    """Play an episode until an action gains nothing; None if every action gained something.

    Raises:
        ValueError: unknown task or split.
    """
    task = tasks.make(task_name, split)
    lifted: list[str] = []

    def note_what_is_lifted(moment: str) -> None:
        if moment == "picked" and world.effector.held is not None:
            lifted.append(task.names[world.effector.held])

    (observation,) = world.reset(task, tasks.episode_seed(split, index))
    done = False
    while not done:
        lifted.clear()
        choice, expert = policy.decide(observation, task.instruction), task.expert(world)
        wanted, found = (
            tuple(thing_at(world, pose) for pose in (action.pick, action.place))
            for action in (expert.action, choice.action)
        )
        step = world.step(choice.action, note_what_is_lifted)
        if np.isclose(step.reward, 0) or step.reward < 0:
            picked = lifted[0] if lifted else found[0]
            why = reason(choice, expert, wanted, (picked, found[1]), step.grasped)
            return Failure(index, world.steps_taken, choice, why)
        (observation,) = step.observations
        done = step.done
    return None
