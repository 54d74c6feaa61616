"""Who plays an episode: the expert, its rounded actions, chance, or a policy; by name, for `evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gem_lite import clip
from gem_lite.actions import Action, ExpertAction, PickPlace, Push
from gem_lite.config import Config
from gem_lite.evaluation.rollout import Actor, Decision, Observations
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.se2 import Pose2, Workspace, angle_bins
from gem_lite.simulation.environment import Environment

LITE = Config.preset("lite")
"""Pixels and angles of the scripted methods."""
SCRIPTED = ("expert", "expert-rounded", "random")
"""Methods that need no checkpoint."""


def expert(environment: Environment, _: Observations = (), __: Sequence[Pose2] = ()) -> ExpertAction | None:
    """The scripted expert; it reads the simulator's truth."""
    return environment.task.expert(environment)


def rounded_expert(settings: Config) -> Actor:
    """The expert with its action rounded to a configuration's pixels and angles: the best that a policy can do."""
    workspace = settings.workspace
    bins = angle_bins(settings.angles)

    def rounded_angle(angle: float) -> float:
        return float(bins[round(angle / (2 * np.pi / settings.angles)) % settings.angles])

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


def random_actor(settings: Config, seed: int) -> Actor:
    """An action that the tool can do, between uniformly random pixels and angles of the first table."""
    rng = np.random.default_rng(seed)
    workspace = settings.workspace
    bins = angle_bins(settings.angles)

    def pose() -> Pose2:
        cell = [rng.integers(length) for length in workspace.shape]
        return Pose2(*workspace.to_world(*cell), float(rng.choice(bins)))

    def actor(environment: Environment, _: Observations, __: Sequence[Pose2] = ()) -> Action:
        action_type = environment.effector.actions[0]
        return action_type(pose(), pose())

    return actor


def policy_actor(policy: PickPlacePolicy) -> Actor:
    """A policy as an actor. It gets only the camera views, the sentence and the empty picks."""

    def actor(environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]) -> Decision:
        sentence = environment.task.instruction
        if len(observations) > 1:
            return policy.decide_over(observations, sentence, empty_picks)
        return policy.decide(observations[0], sentence, empty_picks)

    return actor


def make_actor(
    method: str, settings: Config, checkpoint: Path | None, clip_name: str | None, seed: int,
    several_tables: bool = False,
) -> Actor:  # fmt: skip
    """The actor of a method's name: one of `SCRIPTED`, or a learned one from its checkpoint.

    Args:
        settings: the configuration of a scripted method, on the task's table.
        seed: of the method "random".
        several_tables: whether it must choose over several tables.

    Raises:
        ValueError: an unknown method, a checkpoint that is not the method's or of another table, or a method that
            cannot choose over several tables.
        FileNotFoundError: no such checkpoint.
    """
    match method:
        case "expert":
            return expert
        case "expert-rounded":
            return rounded_expert(settings)
        case "random":
            return random_actor(settings, seed)
    try:
        method = methods.canonical(method)
    except ValueError as error:
        raise ValueError(f"{error}; without a checkpoint: {', '.join(SCRIPTED)}") from error
    acting = acting_config(checkpoint, method)
    policy = load_policy(checkpoint, clip.load(clip_name))
    policy.act_as(acting)
    trained, asked = (_limits(config.workspace) for config in (policy.config, settings))
    if trained != asked:
        raise ValueError(f"the checkpoint {checkpoint} was trained for a table {trained}; the task's is {asked}")
    if several_tables:
        policy.check_tables()
    return policy_actor(policy)


def acting_config(checkpoint: Path | None, method: str) -> Config:
    """The configuration by which a checkpoint acts as a method. Raises ValueError if it cannot, or is missing."""
    if checkpoint is None:
        raise ValueError(f"{method} needs --checkpoint")
    try:
        return methods.acting_as(read_card(checkpoint), method)[1]
    except ValueError as error:
        raise ValueError(f"{checkpoint}: {error}") from error


def _limits(workspace: Workspace) -> str:
    """The limits of a table in words."""
    return f"x {workspace.x_min:.3f} to {workspace.x_max:.3f} m, y {workspace.y_min:.3f} to {workspace.y_max:.3f} m"
