"""The benchmark in a few numbers: means over tasks, seen beside unseen, better rivals, and the rows of each table.

Everything is computed from stored rows (`benchmark.stored_rows`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gem_lite.config import MULTI_TASK
from gem_lite.evaluation import evaluate, results
from gem_lite.evaluation.results import Score
from gem_lite.evaluation.statistics import Difference
from gem_lite.policies import methods
from gem_lite.simulation.worlds import HOME

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


def mean_over_tasks(task_scores: Mapping[str, Score]) -> MeanAndInterval:
    """The mean (0-100) of several tasks' means, each counted once, and its 95 % interval.

    The tasks are fixed, and their episodes are independent. So the squares of the distances between each mean and the
    ends of its interval add up, on each side (Zou and Donner, Statistics in Medicine, 2008).

    Raises:
        ValueError: there is no task.
    """
    if not task_scores:
        raise ValueError("task_scores must hold at least one task, got none")
    return mean_of_means([(score.mean, score.interval) for score in task_scores.values()])


def mean_of_means(means: Sequence[tuple[float, tuple[float, float]]]) -> MeanAndInterval:
    """The mean of independent means, given with their intervals: see `mean_over_tasks`."""
    mean, (low, high) = _mean_and_ends(means)
    return mean, (max(0.0, low), min(100.0, high))


def mean_difference(differences: Mapping[str, Difference]) -> Difference:
    """The mean of several tasks' paired differences, each counted once; its interval is that of `mean_over_tasks`.

    Args:
        differences: by the task; all with the same numbers of training seeds.

    Raises:
        ValueError: there is no task, or the numbers of training seeds differ.
    """
    seeds = {difference.seeds for difference in differences.values()}
    if len(seeds) != 1:
        raise ValueError(f"differences must hold tasks with the same numbers of training seeds, got {sorted(seeds)}")
    mean, interval = _mean_and_ends([(difference.mean, difference.interval) for difference in differences.values()])
    return Difference(mean, interval, seeds.pop())


def _mean_and_ends(means: Sequence[tuple[float, tuple[float, float]]]) -> MeanAndInterval:
    """The mean of independent means and the ends of its interval, rounded; the ends may leave the means' range."""
    count = len(means)
    mean = sum(value for value, _ in means) / count
    below = math.hypot(*(value - low for value, (low, _) in means)) / count
    above = math.hypot(*(high - value for value, (_, high) in means)) / count
    return round(mean, 1), (round(mean - below, 1), round(mean + above, 1))


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


def table_rows(rows: Sequence[dict]) -> dict[str, list[dict]]:
    """The rows over all test episodes at home, by the table to which they belong. A row may belong to several.

    Returns:
        "table-1": whole methods, alone or for several tasks, seed 0. "table-a2": GEM and its ablations with 10
        demonstrations, seed 0, on the tasks on which an ablation was measured. "ceilings": methods without training.
        "seeds": methods of which a task has several training seeds. A table without rows is left out.
    """
    rows = [row for row in rows if (row["split"], row["subset"], row["world"]) == ("test", "all", HOME.name)]
    scripted = [row for row in rows if row["method"] in evaluate.SCRIPTED]
    trained = [row for row in rows if row["method"] not in evaluate.SCRIPTED]
    endings = {name: methods.split(name) for name in {row["method"] for row in trained}}
    whole = [row for row in trained if row["seed"] == 0 and set(endings[row["method"]][1]) <= {MULTI_TASK}]
    of_gem = [row for row in trained if endings[row["method"]][0] == "gem" and (row["seed"], row["demos"]) == (0, 10)]
    ablated = {row["task"] for row in of_gem if set(endings[row["method"]][1]) - {MULTI_TASK}}
    reseeded = {(row["method"], row["task"], row["demos"]) for row in trained if row["seed"] != 0}
    tables = {
        "table-1": whole,
        "table-a2": [row for row in of_gem if row["task"] in ablated and MULTI_TASK not in endings[row["method"]][1]],
        "ceilings": scripted,
        "seeds": [row for row in trained if (row["method"], row["task"], row["demos"]) in reseeded],
    }
    return {name: chosen for name, chosen in tables.items() if chosen}


def scaling(
    rows: Sequence[dict], names: Sequence[str], counts: Sequence[int]
) -> tuple[list[str], dict[str, dict[int, MeanAndInterval]]]:
    """Means over tasks against the number of demonstrations (Fig. A5), seed 0.

    Returns:
        The tasks on which every method was measured with every number; and by method and number the mean over these
        tasks. Without such a task, both are empty.
    """
    cells = {(name, count): scores(rows, name, count) for name in names for count in counts}
    tasks = sorted(set.intersection(*(set(found) for found in cells.values())))
    if not tasks:
        return [], {}
    curves: dict[str, dict[int, MeanAndInterval]] = {name: {} for name in names}
    for (name, count), found in cells.items():
        curves[name][count] = mean_over_tasks({task: found[task] for task in tasks})
    return tasks, curves
