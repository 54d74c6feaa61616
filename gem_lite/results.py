"""Reads the rows of data/results: one cell of a comparison, over all training seeds that were measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gem_lite import evaluate
from gem_lite.config import LITE


@dataclass(frozen=True)
class Cell:
    """What a method scored on the test episodes of a task.

    Attributes:
        rewards: (training seeds, episodes) in [0, 1].
        mean, interval: 0-100, with 95 %, over episodes and seeds (`evaluate.mean_and_interval`).
        cpu_seconds: of one training, the mean over seeds; None for what is not trained.
    """

    rewards: np.ndarray
    mean: float
    interval: tuple[float, float]
    cpu_seconds: float | None

    def __str__(self) -> str:
        return f"{self.mean:.1f} [{self.interval[0]:.1f}, {self.interval[1]:.1f}]"


def paired_difference(one: Cell, other: Cell, seed: int = 0) -> tuple[float, tuple[float, float]]:
    """What ``one`` scored more than ``other`` on the same episodes (0-100), with its 95 % interval over episodes.

    Each method's training seeds are averaged first. Sharper than comparing two intervals: what makes an
    episode hard is hard for both.

    Raises:
        ValueError: the cells are of different numbers of episodes.
    """
    if one.rewards.shape[1] != other.rewards.shape[1]:
        raise ValueError(f"cells must be of the same episodes, got {one.rewards.shape[1]} and {other.rewards.shape[1]}")
    more = 100 * (one.rewards.mean(axis=0) - other.rewards.mean(axis=0))
    draws = more[np.random.default_rng(seed).integers(len(more), size=(10_000, len(more)))].mean(axis=1)
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(more.mean()), (float(low), float(high))


def cell(method: str, task: str, demos: int | None = 10, episodes: int | None = None, steps: int = LITE.steps) -> Cell:
    """The rows of a method, pooled over training seeds.

    Args:
        demos: demonstrations it was trained on; None for what is not trained.
        episodes: only the first so many, to compare with a cell that has fewer.
        steps: of its training.

    Raises:
        LookupError: there is no such row, or rows of different episodes.
    """
    wanted = {"method": method, "task": task, "demos": demos, "split": "test", "start": 0, "subset": "all"}
    wanted |= {"steps": steps} if demos else {}
    rows = [row for row in evaluate.read_rows(evaluate.results_file(task)) if wanted.items() <= row.items()]
    if not rows:
        raise LookupError(f"no row of {method} with {demos} demonstrations on {task} in data/results")
    played = [sorted(row["rewards"], key=int)[:episodes] for row in rows]
    if any(one != played[0] for one in played):
        raise LookupError(f"the rows of {method} with {demos} demonstrations on {task} are of different episodes")
    rewards = np.array([[row["rewards"][index] for index in played[0]] for row in rows])
    seconds = [row["train_cpu_seconds"] for row in rows if row["train_cpu_seconds"] is not None]
    return Cell(rewards, *evaluate.mean_and_interval(rewards), float(np.mean(seconds)) if seconds else None)
