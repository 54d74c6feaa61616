"""Measure a policy over several tables: through tags, through true poses, and through poses that are wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from gem_lite import clip, tasks
from gem_lite.evaluation import results, workers
from gem_lite.evaluation.results import Score
from gem_lite.policies import gem, methods, several_tables
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd import tags
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import driving, worlds
from gem_lite.simulation.mobile_world import MobileWorld, side_by_side
from gem_lite.simulation.worlds import WorldStyle

TASKS = tasks.variants("object-sorting")
_SHARED = (name for name in results.IDENTITY if name not in ("subset", "skipped"))
IDENTITY = (*_SHARED, "tables", "poses", "shift", "turn")
"""The entries that identify a row of these results."""


class Condition(NamedTuple):
    """How the robot knows where a table is.

    Attributes:
        poses: by its tag, or by the simulator's truth.
        shift: metres by which the estimate is wrong, in a random direction.
        turn: radians by which it is turned about the table's middle, to a random side.
    """

    poses: Literal["tags", "truth"]
    shift: float = 0.0
    turn: float = 0.0

    def finder(self, rng: np.random.Generator) -> driving.Finder:
        """The robot's way of finding a table, with a new random error for every table."""
        find = driving.localise if self.poses == "tags" else driving.ask_simulator

        def find_with_error(world: MobileWorld, table: int) -> Pose2:
            direction = rng.uniform(-math.pi, math.pi)
            error = Pose2(
                self.shift * math.cos(direction), self.shift * math.sin(direction), self.turn * rng.choice([-1, 1])
            )
            return driving.disturbed(find, error)(world, table)

        return find_with_error


CURVE = (
    *(Condition("tags", shift / 100) for shift in (1, 2, 3, 4)),
    *(Condition("tags", 0.0, math.radians(turn)) for turn in (2, 4, 6, 8)),
)
"""Injected errors of the success curve."""


class Outcome(NamedTuple):
    """One episode: the reward under each condition, and the reason for each time that the robot could not act."""

    episode: int
    rewards: tuple[float, ...]
    errors: tuple[str, ...]


def run_episode(
    world: MobileWorld, policy: gem.Policy, task_name: str, split: tasks.Split, index: int,
    conditions: Sequence[Condition],
) -> Outcome:  # fmt: skip
    """Choose once, since the pictures do not depend on the robot; act under each condition from the same start."""
    rewards: list[float] = []
    errors: list[str] = []
    choice: several_tables.MobileChoice | None = None
    for number, condition in enumerate(conditions):
        task = tasks.make(task_name, split)
        world.begin(task, tasks.episode_seed(split, index))
        if choice is None:
            choice = several_tables.choose(policy, world.observe(), task.instruction)
        world.find = condition.finder(np.random.default_rng((index, number)))
        try:
            step = world.step(choice.action)
        except tags.LocalisationError as error:
            errors.append(str(error))
            rewards.append(0.0)
        else:
            rewards.append(step.reward)
    return Outcome(index, tuple(rewards), tuple(errors))


@dataclass(frozen=True)
class Job:
    """A few episodes for one process; see `measure` for what the attributes mean."""

    checkpoint: Path
    clip_name: str | None
    style: WorldStyle
    task_name: str
    split: tasks.Split
    indices: Sequence[int]
    conditions: tuple[Condition, ...]
    tables: int


def run_job(job: Job) -> list[Outcome]:
    """The episodes of a job, one after the other in one world."""
    policy = load_policy(job.checkpoint, clip.load(job.clip_name))
    with MobileWorld(side_by_side(job.tables), style=job.style) as world:
        return [run_episode(world, policy, job.task_name, job.split, index, job.conditions) for index in job.indices]


def check(
    checkpoint: Path, task_names: Sequence[str], split: tasks.Split = "test", clip_name: str | None = None,
    tables: int = 2,
) -> None:  # fmt: skip
    """Check that a policy can be measured on tasks over several tables.

    Raises:
        ValueError: unknown task or split, fewer than one table, a policy that is no GEM or of another table.
        FileNotFoundError: no such checkpoint.
    """
    if tables < 1:
        raise ValueError(f"tables must be at least 1, got {tables}")
    for name in task_names:
        if name not in TASKS:
            raise ValueError(f"task must be one of {', '.join(TASKS)}, got {name!r}")
    policy = several_tables.check_policy(load_policy(checkpoint, clip.load(clip_name)))
    for name in task_names:
        trained, asked = (_table_of(one) for one in (policy.config.workspace, tasks.make(name, split).workspace))
        if trained != asked:
            raise ValueError(
                f"the checkpoint {checkpoint} was trained for a table {trained}; that of {name} is {asked}"
            )


def _table_of(workspace: Workspace) -> str:
    """The limits of a table in words."""
    return f"x {workspace.x_min:.3f} to {workspace.x_max:.3f} m, y {workspace.y_min:.3f} to {workspace.y_max:.3f} m"


def measure(
    checkpoint: Path, task_name: str, episodes: int, conditions: Sequence[Condition], split: tasks.Split = "test",
    start: int = 0, clip_name: str | None = None, tables: int = 2, processes: int | None = None,
    world: str = "home",
) -> list[Outcome]:  # fmt: skip
    """Episodes ``start`` .. ``start + episodes - 1`` of a split under every condition, one process a core.

    Raises:
        ValueError: see `check`, or an unknown world, or no episode.
        FileNotFoundError: no such checkpoint.
    """
    parts = workers.chunks(start, episodes)
    style = worlds.style(world)
    check(checkpoint, [task_name], split, clip_name, tables)  # Errors are raised here, not in a worker.
    jobs = [Job(checkpoint, clip_name, style, task_name, split, part, tuple(conditions), tables) for part in parts]
    return workers.run_jobs(run_job, jobs, lambda outcome: outcome.rewards[0], task_name, processes)


def rows_of(outcomes: Sequence[Outcome], conditions: Sequence[Condition], facts: dict) -> list[dict]:
    """A row for each condition, with every episode's reward by its index."""
    return [
        facts
        | condition._asdict()
        | results.reward_entries({outcome.episode: outcome.rewards[number] for outcome in outcomes})
        for number, condition in enumerate(conditions)
    ]


def score(task: str, condition: Condition, tables: int = 2, world: str = "home") -> Score:
    """GEM's filed rows of a task under a condition, on the first test episodes, pooled over training seeds.

    Raises:
        LookupError: there is no such row, or see `results.pool`.
    """
    required = {"method": "gem", "task": task, "tables": tables, "world": world, "split": "test", "start": 0}
    required |= condition._asdict()
    shown = ("tables", "world", "poses", "shift", "turn")
    rows = results.read_rows(results.results_file(task))
    return results.pool(results.select(rows, required, shown), identity=IDENTITY)


def measure_and_file(
    checkpoint: Path, task_name: str, path: Path, curve: bool = False, episodes: int = 100,
    split: tasks.Split = "test", start: int = 0, clip_name: str | None = None, tables: int = 2,
    processes: int | None = None, world: str = "home",
) -> tuple[list[dict], list[str]]:  # fmt: skip
    """`measure` a policy by its tables' tags and by the truth, and file the rows in ``path``, one a condition.

    Args:
        curve: also under the injected errors of `CURVE`.

    Returns:
        The rows, and a line with episode and reason for each time that the robot could not act.

    Raises:
        ValueError: see `measure`, or ``path`` holds a row over more episodes, which is checked before measuring.
        FileNotFoundError: no such checkpoint.
    """
    conditions = [Condition("tags"), Condition("truth"), *(CURVE if curve else ())]
    card = read_card(checkpoint)
    facts = {
        "method": methods.canonical(card["method"]), "task": task_name, "tables": tables, "world": world,
        "split": split, "start": start, **results.facts_of(card, methods.of_card(card)[1]),
    }  # fmt: skip
    expected = [facts | condition._asdict() | {"episodes": episodes} for condition in conditions]
    results.check_rows(expected, path, IDENTITY)  # Before hours of measuring, not after them.
    outcomes = measure(checkpoint, task_name, episodes, conditions, split, start, clip_name, tables, processes, world)
    rows = rows_of(outcomes, conditions, facts)
    results.file_rows(rows, path, IDENTITY)
    return rows, [f"episode {outcome.episode}: {error}" for outcome in outcomes for error in outcome.errors]
