"""Play the four tasks on the table of another simulator: by an expert that knows the truth, or by a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from tqdm import tqdm

from experiments.foreign_table import measuring
from experiments.foreign_tasks.families import FAMILIES
from experiments.foreign_tasks.table import TaskTable
from gem_lite.actions import Push
from gem_lite.evaluation.results import Episode
from gem_lite.policies import robot_plan
from gem_lite.policies.base import Policy
from gem_lite.se2 import Pose2
from gem_lite.simulation.environment import SOLVED
from gem_lite.tasks.task import Split, Task

SEEDS = {"val": range(20_000, 21_000), "test": range(30_000, 31_000)}
"""The seeds of the episodes of a split."""
EmptyPicks = Sequence[Pose2]
Player = Callable[[TaskTable, Task, EmptyPicks], EmptyPicks]
"""Acts once. Gets and returns the picks at which the tool has held nothing since it last held something."""


def by_expert(table: TaskTable, task: Task, empty_picks: EmptyPicks) -> EmptyPicks:
    """Act by the true poses. Nothing happens if the expert knows no act, for instance if a thing fell off the table."""
    expert = task.expert(table)
    if expert is not None:
        table.act(expert.action)
    return ()


def by_policy(policy: Policy, table: TaskTable, task: Task, empty_picks: EmptyPicks) -> EmptyPicks:
    """Act by what the cameras see and by the sentence."""
    choice = policy.decide(measuring.seen(table), task.instruction, empty_picks)
    if isinstance(choice.action, Push):
        table.push(choice.action)
        return ()
    planned = robot_plan.plan(choice)
    held = table.pick_place(planned.pick, planned.place)
    return () if held else (*empty_picks, choice.action.pick)


def make(family: str, split: Split) -> Task:
    """The task of a family. Raises ValueError if there is none."""
    if family not in FAMILIES:
        raise ValueError(f"family must be one of {', '.join(FAMILIES)}, got {family!r}")
    return FAMILIES[family](split)


def play(table: TaskTable, task: Task, split: Split, index: int, player: Player) -> Episode:
    """An episode, until it is solved or the task's number of acts is reached."""
    table.begin(task, SEEDS[split][index])
    empty_picks: EmptyPicks = ()
    score = 0.0
    steps = 0
    while score <= SOLVED and steps < task.max_steps:
        empty_picks = player(table, task, empty_picks)
        score = task.score(table)
        task.advance(table)
        steps += 1
    return Episode(index, score, steps, ())


def play_all(family: str, episodes: int, split: Split, player: Player) -> list[Episode]:
    """The first episodes of a split. Raises ValueError if there is no such family or number of episodes."""
    task = make(family, split)
    measuring.check_count("episodes", episodes)
    played = []
    with TaskTable() as table, tqdm(range(episodes), family, unit="episode") as bar:
        for index in bar:
            played.append(play(table, task, split, index, player))
            bar.set_postfix(mean=f"{100 * sum(episode.reward for episode in played) / len(played):.0f}")
    return played


def load(checkpoint: Path, endings: Sequence[str]) -> Policy:
    """A policy, with the rules of acting that the endings of a method's name stand for. See `measuring.load`."""
    policy = measuring.load(checkpoint)
    for ending in endings:
        policy.act_as(policy.config.ablated(ending))
    return policy


def measure(checkpoint: Path, family: str, episodes: int, split: Split, endings: Sequence[str], out: Path) -> None:
    """Measure a policy, and file its row."""
    task = make(family, split)
    measuring.check_count("episodes", episodes)
    policy = load(checkpoint, endings)
    played = play_all(family, episodes, split, partial(by_policy, policy))
    facts = {"world": "MuJoCo", "split": split, "start": 0, "actions": task.max_steps}
    measuring.file_row(checkpoint, policy, f"foreign-{family}", played, "all", facts, out)
