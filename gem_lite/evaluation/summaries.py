"""The benchmark in a few numbers: means over tasks, seen beside unseen, and the rivals that are better.

Everything is computed from stored rows (`benchmark.stored_rows`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gem_lite.evaluation import results
from gem_lite.evaluation.results import Score


def scores(
    rows: Sequence[dict], method: str, demos: int | None = None, seeds: Sequence[int] = (0,)
) -> dict[str, Score]:
    """A method's score on each task of which there are rows.

    Args:
        rows: of results.
        demos: the number of demonstrations; None for a scripted method.
        seeds: the training seeds to pool. A task for which one is missing is left out.

    Raises:
        LookupError: two rows of a task have the same seed, or differ in more than the seed; see `results.pool`.
    """
    wanted: list[int | None] = [None] if demos is None else list(seeds)
    by_task: dict[str, list[dict]] = {}
    for row in rows:
        facts = (row["method"], row["demos"], row["split"], row["subset"])
        if facts == (method, demos, "test", "all") and row["seed"] in wanted:
            by_task.setdefault(row["task"], []).append(row)
    return {
        task: results.pool(of_task)
        for task, of_task in by_task.items()
        if {row["seed"] for row in of_task} == set(wanted)
    }


def mean_over_tasks(task_scores: Mapping[str, Score]) -> tuple[float, tuple[float, float]]:
    """The mean (0-100) of several tasks' means, each counted once, and its 95 % interval.

    The tasks are fixed, and their episodes are independent. So the squares of the distances between each mean and the
    ends of its interval add up, on each side (Zou and Donner, Statistics in Medicine, 2008).

    Raises:
        ValueError: there is no task.
    """
    if not task_scores:
        raise ValueError("task_scores must hold at least one task, got none")
    count = len(task_scores)
    members = task_scores.values()
    mean = sum(score.mean for score in members) / count
    below = math.hypot(*(score.mean - score.interval[0] for score in members)) / count
    above = math.hypot(*(score.interval[1] - score.mean for score in members)) / count
    return round(mean, 1), (round(max(0.0, mean - below), 1), round(min(100.0, mean + above), 1))


def seen_and_unseen(tasks: Sequence[str]) -> list[tuple[str, str]]:
    """The tasks of which both variants are given, as pairs: ("...-seen-colors", "...-unseen-colors")."""
    pairs = []
    for task in tasks:
        seen = task.replace("-unseen", "-seen")
        if "-unseen" in task and seen in tasks:
            pairs.append((seen, task))
    return pairs


def better_rivals(own: Score, rivals: Mapping[str, Score]) -> list[str]:
    """The rivals whose paired difference to ``own`` lies wholly above 0, with 95 %.

    Raises:
        ValueError: a rival's episodes are others, see `results.paired_difference`.
    """
    return [name for name, rival in rivals.items() if results.paired_difference(rival, own).interval[0] > 0]
