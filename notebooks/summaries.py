"""From stored rows (`results.stored_rows`) to scores: training seeds pooled, differences, and means over tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gem_lite import tasks
from gem_lite.evaluation import results, statistics
from gem_lite.evaluation.statistics import Difference
from gem_lite.simulation.looks import HOME

COMPARED = ("gem", "cliport", "transporter-lan")
"""The methods that are compared with other numbers of demonstrations (Fig. A5)."""
DIFFER_BY_SEED = ("seed", "checkpoint_sha256")
"""Entries in which the rows of one `Score` may differ, since it holds several training seeds."""


@dataclass(frozen=True)
class Score:
    """What a method scored on episodes of a task.

    Attributes:
        rewards: (training seeds, episodes) in [0, 1].
        mean, interval: 0-100, with 95 %, over episodes and seeds (`statistics.mean_and_interval`).
        cpu_seconds: of one training, the mean over seeds; None if nothing was trained.
        episodes: the episodes' indices.
        outdated: whether a row was measured under earlier rules (`results.is_outdated`).
        rules: the versions of the rules of acting under which the rows were measured.
    """

    rewards: np.ndarray
    mean: float
    interval: tuple[float, float]
    cpu_seconds: float | None
    episodes: tuple[int, ...]
    outdated: bool = False
    rules: frozenset[int] = frozenset()

    def __str__(self) -> str:
        return f"{self.mean:.1f} [{self.interval[0]:.1f}, {self.interval[1]:.1f}]"


def paired_difference(first: Score, second: Score) -> Difference:
    """How much higher ``first`` is than ``second`` on the same episodes, see `statistics.paired_difference`.

    Raises:
        ValueError: the scores are of different episodes.
    """
    if first.episodes != second.episodes:
        raise ValueError(
            f"first and second must be of the same episodes, got {_span(first.episodes)} and {_span(second.episodes)}"
        )
    return statistics.paired_difference(first.rewards, second.rewards)


def _span(episodes: Sequence[int]) -> str:
    return f"{len(episodes)} episodes ({episodes[0]} to {episodes[-1]})"


def pool(rows: Sequence[dict], identity: Sequence[str] = results.IDENTITY) -> Score:
    """Rows of several training seeds as one score.

    Args:
        rows: at least one. They may differ in `DIFFER_BY_SEED` only.

    Raises:
        LookupError: the rows differ in other entries, two are of the same seed, or their episodes differ.
    """
    pair = "{method} on {task}".format(**rows[0])
    for name in identity:
        values = list(dict.fromkeys(results.entry(row, name) for row in rows))
        if len(values) > 1 and name not in DIFFER_BY_SEED:
            raise LookupError(f"rows of {pair} differ in {name}: {', '.join(map(str, values))}; ask for one of them")
    seeds = [row["seed"] for row in rows]
    if len(set(seeds)) < len(seeds):
        checkpoints = ", ".join(str(row["checkpoint_sha256"])[:12] for row in rows)
        raise LookupError(
            f"there are several rows of {pair} with the same training seed, of the checkpoints {checkpoints}: "
            "ask for one with checkpoint_sha256, or remove the others"
        )
    indices_of_rows = [sorted(map(int, row["rewards"])) for row in rows]
    indices = indices_of_rows[0]
    if any(other != indices for other in indices_of_rows):
        raise LookupError(f"the rows of {pair} are of different episodes")
    rewards = np.array([[row["rewards"][str(index)] for index in indices] for row in rows])
    seconds = [row["train_cpu_seconds"] for row in rows if row["train_cpu_seconds"] is not None]
    mean, interval = statistics.mean_and_interval(rewards)
    cpu_seconds = float(np.mean(seconds)) if seconds else None
    rules = frozenset(row.get("acting_rules", 1) for row in rows)
    return Score(rewards, mean, interval, cpu_seconds, tuple(indices), any(map(results.is_outdated, rows)), rules)


def select(rows: Sequence[dict], required: dict, shown: Sequence[str]) -> list[dict]:
    """The rows that have all entries of ``required``.

    Raises:
        LookupError: there are none; the message lists the entries ``shown`` of the task's rows.
    """
    matches = [row for row in rows if required.items() <= row.items()]
    if matches:
        return matches
    request = ", ".join(f"{name} {value}" for name, value in required.items())
    alternatives = [row for row in rows if row.get("task") == required["task"]]
    of_method = [row for row in alternatives if row.get("method") == required["method"]]
    if of_method:
        alternatives = of_method
    available = dict.fromkeys(", ".join(f"{name} {row.get(name)}" for name in shown) for row in alternatives)
    raise LookupError(f"there is no row with {request}. There are: {'; '.join(available) or 'none of this task'}")


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
        LookupError: two rows of a task have the same seed, or differ in more than the seed; see `pool`.
    """
    wanted: list[int | None] = [None] if demos is None else list(seeds)
    by_task: dict[str, list[dict]] = {}
    for row in rows:
        facts = (row["method"], row["demos"], row["split"], row["subset"], row["world"])
        if facts == (method, demos, "test", "all", world) and row["seed"] in wanted:
            by_task.setdefault(row["task"], []).append(row)
    return {task: pool(of_task) for task, of_task in by_task.items() if {row["seed"] for row in of_task} == set(wanted)}


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
