"""Who plays an episode: the expert, the expert with rounded actions, chance, or a policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gem_lite.actions import Action, ExpertAction, PickPlace, Push
from gem_lite.config import Config
from gem_lite.evaluation.rollout import Actor, Chosen, Observations
from gem_lite.policies.base import Policy
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.simulation.environment import Environment

LITE = Config.preset("lite")
"""Pixels and angles of the scripted methods."""
SCRIPTED = ("expert", "expert-rounded", "random")
"""Methods that need no checkpoint."""


def expert(environment: Environment, _: Observations = (), __: Sequence[Pose2] = ()) -> ExpertAction | None:
    """The scripted expert; it reads the simulator's truth."""
    return environment.task.expert(environment)


def rounded_expert(config: Config) -> Actor:
    """The expert with its action rounded to a configuration's pixels and angles: the best that a policy can do."""
    workspace = config.workspace
    bins = angle_bins(config.angles)

    def rounded_angle(angle: float) -> float:
        return float(bins[round(angle / (2 * np.pi / config.angles)) % config.angles])

    def rounded_pose(pose: Pose2, yaw: float) -> Pose2:
        return Pose2(*workspace.to_world(*workspace.nearest_cell(pose.x, pose.y)), yaw)

    def actor(environment: Environment, _: Observations, __: Sequence[Pose2] = ()) -> Action | None:
        match expert(environment):
            case ExpertAction(PickPlace(pick, place) as action):
                pick_yaw = rounded_angle(pick.yaw)
                place_yaw = pick_yaw + rounded_angle(action.delta)
                return replace(action, pick=rounded_pose(pick, pick_yaw), place=rounded_pose(place, place_yaw))
            case ExpertAction(Push(start, end) as action):
                return replace(action, start=rounded_pose(start, 0.0), end=rounded_pose(end, 0.0))
        return None

    return actor


def random_actor(config: Config, seed: int) -> Actor:
    """An action that the tool can do, between uniformly random pixels and angles of the first table."""
    rng = np.random.default_rng(seed)
    workspace = config.workspace
    bins = angle_bins(config.angles)

    def pose() -> Pose2:
        cell = [rng.integers(length) for length in workspace.shape]
        return Pose2(*workspace.to_world(*cell), float(rng.choice(bins)))

    def actor(environment: Environment, _: Observations, __: Sequence[Pose2] = ()) -> Action:
        action_type = environment.effector.actions[0]
        first, second = pose(), pose()
        while action_type is Push and (first.x, first.y) == (second.x, second.y):
            second = pose()  # A push has a length.
        return action_type(first, second)

    return actor


def policy_actor(policy: Policy) -> Actor:
    """A policy as an actor. It gets only the camera views, the sentence and the empty picks."""

    def actor(environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]) -> Chosen:
        sentence = environment.task.instruction
        if len(observations) > 1:
            return policy.decide_over(observations, sentence, empty_picks)
        return policy.decide(observations[0], sentence, empty_picks)

    return actor
