"""Why a policy failed: its first action that gained nothing, explained with the simulator's truth.

The policy never sees this truth.
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
    """An action that gained nothing: its episode and step, what the policy saw and chose, and the reason."""

    episode: int
    step: int
    choice: Choice
    reason: str


def thing_at(world: World, pose: Pose2) -> str:
    """The task's name of what lies topmost at a pose, or "table"."""
    return world.task.names.get(body_at(world, pose), "table")


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
    if chosen[0] != right[0]:
        return f"picked the {chosen[0]}, not the {right[0]}"
    if not grasped:
        turn = math.degrees(angle_off(action.pick.yaw - right_action.pick.yaw, expert.pick_symmetry))
        return f"grasped nothing of the {right[0]}, {turn:.0f}° off"
    if chosen[1] != right[1]:
        return f"placed on the {chosen[1]}, not on the {right[1]}"
    gap = 1000 * math.hypot(action.place.x - right_action.place.x, action.place.y - right_action.place.y)
    turn = math.degrees(angle_off(action.delta - right_action.delta, expert.place_symmetry))
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

    def record_lifted_body(moment: str) -> None:
        if moment == "picked" and world.effector.held is not None:
            lifted.append(task.names[world.effector.held])

    (observation,) = world.reset(task, tasks.episode_seed(split, index))
    done = False
    while not done:
        lifted.clear()
        choice = policy.decide(observation, task.instruction)
        expert = task.expert(world)
        right = thing_at(world, expert.action.pick), thing_at(world, expert.action.place)
        picked = thing_at(world, choice.action.pick)
        place = thing_at(world, choice.action.place)
        step = world.step(choice.action, record_lifted_body)
        if np.isclose(step.reward, 0) or step.reward < 0:
            if lifted:
                picked = lifted[0]
            cause = reason(choice, expert, right, (picked, place), step.grasped)
            return Failure(index, world.steps_taken, choice, cause)
        (observation,) = step.observations
        done = step.done
    return None
