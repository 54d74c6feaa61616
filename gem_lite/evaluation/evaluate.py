"""Measure a policy over episodes. The result is rows, see `results`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gem_lite import clip, tasks
from gem_lite.actions import Action, PickPlace, Push
from gem_lite.config import Config
from gem_lite.evaluation import results, workers
from gem_lite.evaluation.results import Episode
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.simulation import worlds
from gem_lite.simulation.environment import Environment, body_at
from gem_lite.simulation.world import World
from gem_lite.simulation.worlds import WorldStyle

LITE = Config.preset("lite")
"""Pixels and angles of the scripted methods."""
Observations = tuple[Observation, ...]
Actor = Callable[[Environment, Observations, Sequence[Pose2]], Action | None]
"""Chooses an action from the environment, the observations and the empty picks.

Empty picks are the poses at which the tool has grasped nothing since it last held something. Only experts read the
environment. A policy's actor reads the observations and the empty picks."""


def run_episode(
    environment: Environment, actor: Actor, task_name: str, split: tasks.Split, index: int
) -> Episode:  # fmt: skip
    """One episode from reset to done."""
    task = tasks.make(task_name, split)
    observations = environment.reset(task, tasks.episode_seed(split, index))
    total = 0.0
    done = False
    placed_decisions = 0
    retaken = 0
    empty_picks: list[Pose2] = []
    while not done:
        action = actor(environment, observations, empty_picks)
        if action is None:
            break
        placed = task.placed(environment)
        if placed:
            placed_decisions += 1
        if isinstance(action, PickPlace):
            picked = body_at(environment, environment.tables[action.pick_table] @ action.pick)
            if picked in placed:
                retaken += 1
        step = environment.step(action, last_look=False)
        if isinstance(action, PickPlace):
            empty_picks = [] if step.grasped else [*empty_picks, action.pick]
        observations = step.observations
        total += step.reward
        done = step.done
    reward = min(max(total, 0.0), 1.0)  # gains and losses may add up to -1e-16
    return Episode(index, reward, environment.steps_taken, task.subsets(), placed_decisions, retaken)


def expert(environment: Environment, _: Observations = (), __: Sequence[Pose2] = ()) -> Action | None:
    """The scripted expert; it reads the simulator's truth."""
    expert_action = environment.task.expert(environment)
    return None if expert_action is None else expert_action.action


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
            case PickPlace(pick, place) as action:
                pick_yaw = rounded_angle(pick.yaw)
                place_yaw = pick_yaw + rounded_angle(action.delta)
                return replace(action, pick=rounded_pose(pick, pick_yaw), place=rounded_pose(place, place_yaw))
            case Push(start, end) as action:
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
    """A policy as an actor on one table. It gets only the camera views, the sentence and the empty picks."""

    def actor(environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]) -> Action:
        (observation,) = observations
        return policy.act(observation, environment.task.instruction, empty_picks)

    return actor


SCRIPTED = ("expert", "expert-rounded", "random")
"""Methods that need no checkpoint."""


def make_actor(method: str, settings: Config, checkpoint: Path | None, clip_name: str | None, seed: int) -> Actor:
    """The actor of a method's name: one of `SCRIPTED`, or a learned one from its checkpoint."""
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
    if checkpoint is None:
        raise ValueError(f"{method} needs --checkpoint")
    config = _acting_config(checkpoint, method)
    policy = load_policy(checkpoint, clip.load(clip_name))
    policy.act_as(config)
    table = policy.config.workspace.length
    if table != settings.workspace.length:
        raise ValueError(
            f"the checkpoint {checkpoint} was trained for a table {table} m long; the task's is "
            f"{settings.workspace.length} m long"
        )
    return policy_actor(policy)


def _acting_config(checkpoint: Path, method: str) -> Config:
    """The configuration by which a checkpoint acts as a method. Raises ValueError if it cannot."""
    try:
        return methods.acting_as(read_card(checkpoint), method)[1]
    except ValueError as error:
        raise ValueError(f"{checkpoint}: {error}") from error


def settings_of(task_name: str, split: tasks.Split, settings: Config = LITE) -> Config:
    """``settings`` for the table of a task, for scripted methods that depend on pixels and angles."""
    return settings.on_table(tasks.make(task_name, split).workspace.length)


@dataclass(frozen=True)
class Job:
    """A few episodes for one process; see `evaluate` for what the attributes mean."""

    method: str
    settings: Config
    checkpoint: Path | None
    clip_name: str | None
    style: WorldStyle
    task_name: str
    split: tasks.Split
    indices: Sequence[int]


def run_job(job: Job) -> list[Episode]:
    """The episodes of a job, one after the other in one world."""
    actor = make_actor(job.method, job.settings, job.checkpoint, job.clip_name, seed=job.indices[0])
    with World(style=job.style) as world:
        return [run_episode(world, actor, job.task_name, job.split, index) for index in job.indices]


def evaluate(
    method: str, task_name: str, episodes: int, split: tasks.Split = "test", start: int = 0,
    settings: Config = LITE, checkpoint: Path | None = None, clip_name: str | None = None,
    processes: int | None = None, world: str = "home", skip: Collection[int] = (),
) -> list[Episode]:  # fmt: skip
    """Run the first episodes of a split from ``start`` on in a world, one process a core.

    Method, task and world may come from outside the library, see `workers.run_jobs`.

    Args:
        episodes: the number of episodes.
        skip: the indices of episodes to leave out, such as those that the expert does not solve.

    Raises:
        ValueError: an unknown method, task, split or world, a checkpoint that is not the method's, or no episode.
        FileNotFoundError: no such checkpoint.
        ChildProcessError: a process was killed, see `workers.run_jobs`.
    """
    parts = workers.chunks(start, episodes, skip)
    style = worlds.style(world)
    settings = settings_of(task_name, split, settings)
    make_actor(method, settings, checkpoint, clip_name, seed=start)  # Errors are raised here, not in a worker.
    jobs = [Job(method, settings, checkpoint, clip_name, style, task_name, split, part) for part in parts]
    label = f"{method} on {task_name}"
    return workers.run_jobs(run_job, jobs, lambda episode: episode.reward, label, processes)


def rows_of(method: str, task_name: str, episodes: Sequence[Episode], facts: dict) -> list[dict]:
    """The rows of a measurement: one over all episodes, and one over each of the task's subsets that occurs.

    Args:
        facts: the other entries that identify a row, see `results.facts_of`.
    """
    rows = [results.result_row(method, task_name, episodes, "all", facts)]
    for subset in dict.fromkeys(name for episode in episodes for name in episode.subsets):
        members = [episode for episode in episodes if subset in episode.subsets]
        rows.append(results.result_row(method, task_name, members, subset, facts))
    return rows


def measure_and_file(
    method: str, task_name: str, path: Path, episodes: int = 100, split: tasks.Split = "test", start: int = 0,
    checkpoint: Path | None = None, clip_name: str | None = None, processes: int | None = None, world: str = "home",
    preset: str = "lite", skip: Collection[int] = (),
) -> list[dict]:  # fmt: skip
    """`evaluate` a method and file its rows in ``path``: one of all episodes, and one of each of the task's subsets.

    Args:
        preset: of the configuration, for a method without a checkpoint that depends on pixels and angles.
        skip: see `evaluate`; the rows name those that lie before the last episode.

    Raises:
        ValueError: see `evaluate`; there is no such preset; a checkpoint has a preset of its own; or ``path`` holds a
            row over more episodes, which is checked before measuring.
        FileNotFoundError: no such checkpoint.
        OSError: ``path`` cannot be written, which is checked before measuring, too.
        ChildProcessError: a process was killed; nothing is filed then.
    """
    settings = Config.preset(preset)
    if checkpoint is not None and settings != LITE:
        raise ValueError(f"preset must be left out, because the checkpoint {checkpoint} has its own, got {preset!r}")
    method, facts = _name_and_facts(method, task_name, split, checkpoint, settings)
    last = workers.chunks(start, episodes, skip)[-1][-1]
    skipped = sorted(index for index in skip if start <= index < last)
    facts = {"world": world, "split": split, "start": start, "skipped": skipped} | facts
    expected = {"method": method, "task": task_name, "subset": "all", **facts, "episodes": episodes}
    results.check_rows([expected], path)  # Before hours of measuring, not after them.
    measured = evaluate(
        method, task_name, episodes, split, start, settings=settings, checkpoint=checkpoint, clip_name=clip_name,
        processes=processes, world=world, skip=skip,
    )  # fmt: skip
    rows = rows_of(method, task_name, measured, facts)
    results.file_rows(rows, path)
    return rows


def _name_and_facts(
    method: str, task_name: str, split: tasks.Split, checkpoint: Path | None, settings: Config
) -> tuple[str, dict]:  # fmt: skip
    """The method's name as results hold it, and the entries of a row that describe its policy."""
    if method in SCRIPTED:
        used = None if method == "expert" else settings_of(task_name, split, settings)
        return method, results.facts_of(None, used)
    method = methods.canonical(method)
    if checkpoint is None:
        raise ValueError(f"{method} needs --checkpoint")
    return method, results.facts_of(read_card(checkpoint), _acting_config(checkpoint, method))
