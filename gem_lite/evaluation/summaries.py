"""The benchmark in a few numbers: scores by task and means over tasks, from stored rows (`results.stored_rows`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gem_lite import tasks
from gem_lite.evaluation import results, statistics
from gem_lite.evaluation.results import Score
from gem_lite.evaluation.statistics import Difference
from gem_lite.simulation.looks import HOME

COMPARED = ("gem", "cliport", "transporter-lan")
"""The methods that are compared with other numbers of demonstrations (Fig. A5)."""


def scores(
    rows: Sequence[dict], method: str, demos: int | None = None, seeds: Sequence[int] = (0,), world: str = HOME.name
) -> dict[str, Score]:
    """A method's score on each task of which there are rows.

    Args:
        rows: of results.
        demos: the number of demonstrations; None for a scripted method.
        seeds: the training seeds to pool. A task for which one is missing is left out.
        world: in which it was measured.

    Raises:
        LookupError: two rows of a task have the same seed, or differ in more than the seed; see `results.pool`.
    """
    wanted: list[int | None] = [None] if demos is None else list(seeds)
    by_task: dict[str, list[dict]] = {}
    for row in rows:
        facts = (row["method"], row["demos"], row["split"], row["subset"], row["world"])
        if facts == (method, demos, "test", "all", world) and row["seed"] in wanted:
            by_task.setdefault(row["task"], []).append(row)
    return {
        task: results.pool(of_task)
        for task, of_task in by_task.items()
        if {row["seed"] for row in of_task} == set(wanted)
    }


MeanAndInterval = tuple[float, tuple[float, float]]
"""A mean (0-100) and the ends of its 95 % interval."""
Term = tuple[float, str, Score]
"""A part of a weighted sum: the weight, the name of the task, and the score on it."""


def mean_over_tasks(task_scores: Mapping[str, Score]) -> MeanAndInterval:
    """The mean (0-100) of several tasks' means, each counted once, and its 95 % interval, see `weighted_sum`.

    Raises:
        ValueError: there is no task; or see `weighted_sum`.
    """
    if not task_scores:
        raise ValueError("task_scores must hold at least one task, got none")
    return weighted_sum([(1 / len(task_scores), task, score) for task, score in task_scores.items()])


def mean_difference(first: Mapping[str, Score], second: Mapping[str, Score]) -> Difference:
    """How much higher ``first`` is than ``second``, in the mean over the same tasks and episodes.

    Args:
        first, second: scores by the task. Only the tasks of ``first`` count; ``second`` may hold more.

    Raises:
        ValueError: there is no task, ``second`` lacks one, or the episodes of a task differ; or see `weighted_sum`.
    """
    missing = [task for task in first if task not in second]
    if missing or not first:
        raise ValueError(f"second must hold the tasks of first, at least one, got none of {', '.join(missing)}")
    terms: list[Term] = []
    for task, score in first.items():
        if score.episodes != second[task].episodes:
            raise ValueError(f"first and second must be of the same episodes of {task}")
        terms += [(1 / len(first), task, score), (-1 / len(first), task, second[task])]
    mean, interval = weighted_sum(terms)
    return Difference(mean, interval, (len(terms[0][2].rewards), len(terms[1][2].rewards)))


def weighted_sum(terms: Sequence[Term]) -> MeanAndInterval:
    """A weighted sum of tasks' means (0-100 each), and its 95 % interval.

    Episodes with one index in tasks of one family begin with the same seed: most pairs of seen and unseen variants
    have the same layouts then, and their rewards are correlated. So the weighted sum of such rewards counts as one
    draw. Draws of other indices and families are independent. `statistics.bounded_interval` over all draws is right
    near 0 and 100, too. It is widened by the training seeds' (`statistics.seed_half_width`).

    Args:
        terms: at least one. All terms with weights of one sign are of one method, and seed s of one belongs to seed s
            of the others.

    Raises:
        ValueError: a task is unknown, the tasks of a family have different numbers of episodes, or the terms of a sign
            have different numbers of training seeds.
    """
    families: dict[str, list[tuple[float, Score]]] = {}
    for weight, task, score in terms:
        families.setdefault(tasks.family(task), []).append((weight, score))
    values = []
    weights = []
    lowest = 0.0
    for family, members in families.items():
        low = sum(min(weight, 0.0) for weight, _ in members)
        extent = sum(abs(weight) for weight, _ in members)
        draws = _draws(family, members)
        values.append((draws - low) / extent)
        weights.append(np.full(len(draws), extent / len(draws)))
        lowest += low
    total = sum(abs(weight) for weight, _, _ in terms)
    shares = np.clip(np.concatenate(values), 0.0, 1.0)  # sums may be rounded to beyond the ends
    low, high = statistics.bounded_interval(shares, 0.0, 1.0, np.concatenate(weights))
    mean = sum(weight * float(score.rewards.mean()) for weight, _, score in terms)
    ends = statistics.widened(mean, (lowest + total * low, lowest + total * high), _seed_half_width(terms))
    low, high = max(ends[0], lowest), min(ends[1], lowest + total)
    return statistics.percent(mean), (statistics.percent(low), statistics.percent(high))


def _draws(family: str, members: Sequence[tuple[float, Score]]) -> np.ndarray:
    """The weighted sums (E,) of the rewards of each layout of a family, the mean over training seeds.

    Where the members have other episodes, since some were skipped, those that are left meet in their order.
    """
    counts = {len(score.episodes) for _, score in members}
    if len(counts) > 1:
        raise ValueError(f"the tasks of {family} must have the same number of episodes, got {sorted(counts)}")
    shared = set.intersection(*(set(score.episodes) for _, score in members))
    total = np.zeros(counts.pop())
    for weight, score in members:
        order = np.lexsort((score.episodes, [episode not in shared for episode in score.episodes]))
        total += weight * score.rewards.mean(axis=0)[order]
    return total


def _seed_half_width(terms: Sequence[Term]) -> float:
    """`statistics.seed_half_width` of a weighted sum; terms with weights of one sign are of one method."""
    sums = []
    for sign in (1, -1):
        parts = [weight * score.rewards.mean(axis=1, keepdims=True) for weight, _, score in terms if sign * weight > 0]
        if len({len(part) for part in parts}) > 1:
            raise ValueError("all scores of a method must have the same number of training seeds")
        if parts:
            sums.append(np.sum(parts, axis=0))
    return statistics.seed_half_width(*sums)
