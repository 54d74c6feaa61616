"""The tasks in pictures, the first and the last one of an expert's episode (Fig. A10), and in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from typing_extensions import override

from gem_lite import tasks
from gem_lite.evaluation import actors
from gem_lite.evaluation.rollout import rollout
from gem_lite.simulation.world import World


@dataclass(frozen=True)
class ExpertStory:
    """An episode that an expert played.

    Attributes:
        task: its name.
        sentences: the instructions of the episode, each once, in their order.
        first, last: the pictures (H, W, 3) of the front camera before the first and after the last action.
        score: the task's score at the end, in [0, 1].
        actions: the number of actions.
    """

    task: str
    sentences: tuple[str, ...]
    first: np.ndarray
    last: np.ndarray
    score: float
    actions: int


def play(world: World, task_name: str, index: int = 0, split: tasks.Split = "test") -> ExpertStory:
    """Let the expert play an episode.

    Raises:
        ValueError: the task or the split is unknown.
    """
    task = tasks.make(task_name, split)
    turns = [
        (turn.instruction, turn.observations[0].views[0].rgb)
        for turn in rollout(world, task, tasks.episode_seed(split, index), actors.expert)
    ]
    sentences = tuple(dict.fromkeys(sentence for sentence, _ in turns))
    (last,) = world.observe()
    return ExpertStory(task_name, sentences, turns[0][1], last.views[0].rgb, task.score(world), len(turns))


def stories(names: Sequence[str]) -> Iterator[ExpertStory]:
    """The first test episode of each task."""
    with World() as world:
        for name in names:
            yield play(world, name)


class StillWorld(World):
    """A world in which no time passes. A task draws its sentences before a body moves, so they are the same."""

    @override
    def wait(self, seconds: float) -> None:
        """Do nothing."""

    @override
    def settle(self) -> bool:
        return True


def sentences(task_name: str, episodes: int = 50) -> Iterator[list[str]]:
    """For each of the first test episodes of a task the sentences of its goals. Nothing is simulated or rendered."""
    with StillWorld() as world:
        for index in range(episodes):
            task = tasks.make(task_name, "test")
            world.begin(task, tasks.episode_seed("test", index))
            yield [goal.sentence for goal in task.goals]
