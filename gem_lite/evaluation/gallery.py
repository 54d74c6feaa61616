"""The tasks in pictures: the first and the last one of an expert's episode (Fig. A10)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gem_lite import tasks
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
    (observation,) = world.reset(task, tasks.episode_seed(split, index))
    sentences: dict[str, None] = {}
    actions = 0
    while (expert := task.expert(world)) is not None:
        sentences[task.instruction] = None
        step = world.step(expert.action, last_look=False)
        actions += 1
        if step.done:
            break
    (last,) = world.observe()
    front, end = (observation.views[0].rgb, last.views[0].rgb)
    return ExpertStory(task_name, tuple(sentences), front, end, task.score(world), actions)


def stories(names: Sequence[str]) -> Iterator[ExpertStory]:
    """The first test episode of each task."""
    with World() as world:
        for name in names:
            yield play(world, name)
