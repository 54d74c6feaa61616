"""Measure a method over episodes, on one table or over several. The result is rows, see `results`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gem_lite import clip, tasks
from gem_lite.config import Config
from gem_lite.evaluation import actors, results, table_poses, workers
from gem_lite.evaluation.actors import LITE, SCRIPTED
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.rollout import Actor, Chosen, Observations, rollout
from gem_lite.evaluation.table_poses import Condition
from gem_lite.maps.relations import NoFreePlaceError
from gem_lite.policies import methods
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import looks
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.looks import Look
from gem_lite.simulation.mobile_world import MobileWorld, side_by_side
from gem_lite.simulation.world import World


@dataclass(frozen=True)
class Measurement:
    """What is measured: a method on a task's episodes.

    Attributes:
        method: its name: one of `SCRIPTED`, or a learned one.
        task: the task's name.
        episodes: the number of episodes.
        split, start: the split, and the index of the first episode in it.
        checkpoint: of a learned method.
        clip_name: see `clip.load`.
        world: the name of the world, see `looks.style`.
        preset: of the configuration, for a method without a checkpoint that depends on pixels and angles.
        skip: the indices of episodes to leave out, such as those that the expert does not solve: later ones take their
            place.
        tables: the number of tables, if there are ``conditions``.
        conditions: how a mobile robot knows where each table is. Every episode is played under each of them. Without
            any, the tool stands at one table.
    """

    method: str
    task: str
    episodes: int = 100
    split: tasks.Split = "test"
    start: int = 0
    checkpoint: Path | None = None
    clip_name: str | None = None
    world: str = "home"
    preset: str = "lite"
    skip: Sequence[int] = ()
    tables: int = 1
    conditions: Sequence[Condition] = ()

    @property
    def config(self) -> Config:
        """The preset on the task's table."""
        task = tasks.make(self.task, self.split)
        return Config.preset(self.preset).for_table(task.workspace.limits, task.scale)

    @property
    def parts(self) -> list[list[int]]:
        """The episodes' indices, in a list for each process. Raises ValueError if there is no episode."""
        return workers.chunks(self.start, self.episodes, self.skip)

    @property
    def acting_config(self) -> Config:
        """The configuration by which a learned method acts. Raises ValueError if the checkpoint cannot act so."""
        method = methods.canonical(self.method)
        if self.checkpoint is None:
            raise ValueError(f"{method} needs --checkpoint")
        try:
            return methods.acting_as(read_card(self.checkpoint), method)[1]
        except ValueError as error:
            raise ValueError(f"{self.checkpoint}: {error}") from error

    def actor(self, seed: int) -> Actor:
        """The method as an actor; ``seed`` is that of "random". Raises the errors of `check`."""
        match self.method:
            case "expert":
                return actors.expert
            case "expert-rounded":
                return actors.rounded_expert(self.config)
            case "random":
                return actors.random_actor(self.config, seed)
        try:
            methods.canonical(self.method)
        except ValueError as error:
            raise ValueError(f"{error}; without a checkpoint: {', '.join(SCRIPTED)}") from error
        acting = self.acting_config
        policy = load_policy(self.checkpoint, clip.load(self.clip_name))
        policy.act_as(acting)
        check_table(self.checkpoint, acting.workspace, tasks.make(self.task, self.split).workspace, self.task)
        if self.conditions:
            policy.check_tables()
        return actors.policy_actor(policy)

    def check(self) -> None:
        """Check that the episodes can be played.

        Raises:
            ValueError: an unknown method, task, split, world or preset; no episode; a checkpoint that is not the
                method's, was trained for another table, or has a preset of its own; for several tables no table, an
                episode to skip, a task without several tables, or a method that cannot choose over them.
            FileNotFoundError: no such checkpoint.
        """
        # These refuse what is wrong; their results are made again where they are used.
        workers.chunks(self.start, self.episodes, self.skip)
        looks.style(self.world)
        tasks.make(self.task, self.split)
        if self.conditions:
            if self.tables < 1:
                raise ValueError(f"tables must be at least 1, got {self.tables}")
            if self.skip:
                raise ValueError(f"skip must be empty for several tables, got {self.skip}")
            if self.task not in table_poses.TASKS:
                raise ValueError(f"task must be one of {', '.join(table_poses.TASKS)}, got {self.task!r}")
        if self.checkpoint is not None and Config.preset(self.preset) != LITE:
            raise ValueError(
                f"preset must be left out, because the checkpoint {self.checkpoint} has its own, got {self.preset!r}"
            )
        self.actor(self.start)


def check_table(checkpoint: Path, trained: Workspace, asked: Workspace, name: str) -> None:
    """Refuse a policy of another table.

    Args:
        trained: the table that the policy of ``checkpoint`` was trained for. Its cells may have another size.
        asked: the table of what is to be played, which ``name`` names.

    Raises:
        ValueError: the limits of the two tables differ, rounded to a millimetre.
    """
    if not is_same_table(trained, asked):
        raise ValueError(
            f"the checkpoint {checkpoint} was trained for a table {_limits(trained)}; that of {name} is "
            f"{_limits(asked)}"
        )


def is_same_table(first: Workspace, second: Workspace) -> bool:
    """Whether two tables have the same limits, rounded to a millimetre. Their cells may have different sizes."""
    return _limits(first) == _limits(second)


def _limits(workspace: Workspace) -> str:
    """The limits of a table in words."""
    return f"x {workspace.x_min:.3f} to {workspace.x_max:.3f} m, y {workspace.y_min:.3f} to {workspace.y_max:.3f} m"


@dataclass(frozen=True)
class Job:
    """A few episodes of a measurement for one process, in a world that may be unknown there."""

    measurement: Measurement
    style: Look
    indices: Sequence[int]


def run_job(job: Job) -> list[Episode]:
    """The episodes of a job, one after the other in one world."""
    m = job.measurement
    actor = m.actor(seed=job.indices[0])
    if m.conditions:
        with MobileWorld(side_by_side(m.tables), style=job.style) as world:
            played = [run_conditions(world, actor, m.task, m.split, index, m.conditions) for index in job.indices]
        return [episode for episodes in played for episode in episodes]
    with World(style=job.style) as world:
        return [run_episode(world, actor, m.task, m.split, index) for index in job.indices]


def run_episode(
    environment: Environment, actor: Actor, task_name: str, split: tasks.Split, index: int,
    observations: Observations = (),
) -> Episode:  # fmt: skip
    """One episode from reset to done; see `rollout`."""
    task = tasks.make(task_name, split)
    total = 0.0
    placed_decisions = 0
    retaken = 0
    outcomes = []
    error = ""
    try:
        for turn in rollout(environment, task, tasks.episode_seed(split, index), actor, observations):
            total += turn.result.reward
            placed_decisions += bool(turn.placed)
            retaken += turn.picked in turn.placed
            error = turn.error
            if turn.result.outcome:
                outcomes.append(turn.result.outcome.value)
    except NoFreePlaceError as reason:  # The policy refuses to act on, with this reason.
        error = str(reason)
    reward = min(max(total, 0.0), 1.0)  # gains and losses may add up to -1e-16
    return Episode(
        index, reward, environment.steps_taken, task.subsets(), placed_decisions, retaken, tuple(outcomes), error
    )


def run_conditions(
    world: MobileWorld, actor: Actor, task_name: str, split: tasks.Split, index: int, conditions: Sequence[Condition]
) -> list[Episode]:
    """An episode under each condition. The first action is chosen once: the robot is in no picture before it."""
    chosen: list[tuple[Observations, Chosen | None]] = []

    def choose(environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]) -> Chosen | None:
        if environment.steps_taken:
            return actor(environment, observations, empty_picks)
        if not chosen:
            chosen.append((observations, actor(environment, observations, empty_picks)))
        return chosen[0][1]

    episodes = []
    for number, condition in enumerate(conditions):
        world.find = condition.finder(np.random.default_rng((index, number)))
        seen = chosen[0][0] if chosen else ()
        episode = run_episode(world, choose, task_name, split, index, seen)
        episodes.append(replace(episode, condition=condition))
    return episodes


def evaluate(measurement: Measurement, processes: int | None = None) -> list[Episode]:
    """Play the episodes of a measurement, each under each condition.

    Method, task and world may come from outside the library, see `workers.run_jobs`.

    Args:
        processes: how many run at once; by default one a core.

    Raises:
        ValueError, FileNotFoundError: see `Measurement.check`.
        ChildProcessError: a process was killed, see `workers.run_jobs`.
    """
    measurement.check()  # Errors are raised here, not in a worker.
    style = looks.style(measurement.world)
    jobs = [Job(measurement, style, part) for part in measurement.parts]
    label = f"{measurement.method} on {measurement.task}"
    return workers.run_jobs(run_job, jobs, label, lambda episode: episode.reward, processes)


def rows_of(method: str, task_name: str, episodes: Sequence[Episode], facts: dict) -> list[dict]:
    """The rows of a measurement.

    There is one for each condition; without any, one over all episodes, and one over each of the task's subsets that
    occurs.

    Args:
        facts: the other entries that identify a row, see `results.policy_entries`.
    """
    conditions = dict.fromkeys(episode.condition for episode in episodes)
    if None not in conditions:
        return [
            {"method": method, "task": task_name, **facts, **condition._asdict()}
            | results.reward_entries({one.index: one.reward for one in episodes if one.condition == condition})
            for condition in conditions
        ]
    rows = [results.result_row(method, task_name, episodes, "all", facts)]
    for subset in dict.fromkeys(name for episode in episodes for name in episode.subsets):
        members = [episode for episode in episodes if subset in episode.subsets]
        rows.append(results.result_row(method, task_name, members, subset, facts))
    return rows


def measure_and_file(
    measurement: Measurement, path: Path, processes: int | None = None
) -> tuple[list[dict], list[str]]:  # fmt: skip
    """`evaluate` a measurement and file its rows in ``path``, see `rows_of`.

    Returns:
        The rows, and a line with episode and reason for each time that a robot could not act.

    Raises:
        ValueError: see `Measurement.check`, or ``path`` holds a row over more episodes, which is checked before
            measuring.
        FileNotFoundError: no such checkpoint.
        OSError: ``path`` cannot be written, which is checked before measuring, too.
        ChildProcessError: a process was killed; nothing is filed then.
    """
    m = measurement
    last = m.parts[-1][-1]
    facts = {"world": m.world, "split": m.split, "start": m.start}
    if m.conditions:
        identity = table_poses.IDENTITY
        facts = {"tables": m.tables, **facts}
        kinds = [condition._asdict() for condition in m.conditions]
    else:
        identity = results.IDENTITY
        facts["skipped"] = sorted(index for index in m.skip if m.start <= index < last)
        kinds = [{"subset": "all"}]
    method = m.method
    if method in SCRIPTED:
        facts |= results.policy_entries(None, None if method == "expert" else m.config)
    else:
        method = methods.canonical(method)
        config = m.acting_config
        facts |= results.policy_entries(read_card(m.checkpoint), config)
    names = {"method": method, "task": m.task, "episodes": m.episodes, **facts}
    results.check_rows([names | kind for kind in kinds], path, identity)  # Before hours of measuring, not after them.
    episodes = evaluate(m, processes)
    rows = rows_of(method, m.task, episodes, facts)
    results.file_rows(rows, path, identity)
    return rows, [f"episode {episode.index}: {episode.error}" for episode in episodes if episode.error]
