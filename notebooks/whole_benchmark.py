"""What lesson 11 and experiments/benchmark share: variants in pairs, better rivals, the rows of each table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import summaries
from summaries import Score

from gem_lite.config import MULTI_TASK
from gem_lite.evaluation import actors
from gem_lite.policies import methods
from gem_lite.simulation.looks import HOME


def seen_and_unseen(names: Sequence[str]) -> list[tuple[str, str]]:
    """The tasks of which both variants are given, as pairs: ("...-seen-colors", "...-unseen-colors")."""
    pairs = []
    for task in names:
        seen = task.replace("-unseen", "-seen")
        if "-unseen" in task and seen in names:
            pairs.append((seen, task))
    return pairs


def better_rivals(own: Score, rivals: Mapping[str, Score]) -> list[str]:
    """The rivals whose paired difference to ``own`` lies wholly above 0, with 95 %.

    Raises:
        ValueError: a rival's episodes are others, see `summaries.paired_difference`.
    """
    return [name for name, rival in rivals.items() if summaries.paired_difference(rival, own).interval[0] > 0]


def table_rows(rows: Sequence[dict]) -> dict[str, list[dict]]:
    """The rows over all test episodes at home, by the table to which they belong. A row may belong to several.

    Returns:
        "table-1": whole methods, alone or for several tasks, seed 0. "table-a2": GEM and its ablations with 10
        demonstrations, seed 0, on the tasks on which an ablation was measured. "ceilings": methods without training.
        "seeds": methods of which a task has several training seeds. A table without rows is left out.
    """
    rows = [row for row in rows if (row["split"], row["subset"], row["world"]) == ("test", "all", HOME.name)]
    scripted = [row for row in rows if row["method"] in actors.SCRIPTED]
    trained = [row for row in rows if row["method"] not in actors.SCRIPTED]
    endings = {name: methods.split(name) for name in {row["method"] for row in trained}}
    whole = [row for row in trained if row["seed"] == 0 and set(endings[row["method"]][1]) <= {MULTI_TASK}]
    of_gem = [row for row in trained if endings[row["method"]][0] == "gem" and (row["seed"], row["demos"]) == (0, 10)]
    of_gem = [row for row in of_gem if MULTI_TASK not in endings[row["method"]][1]]
    ablated = {row["task"] for row in of_gem if endings[row["method"]][1]}
    reseeded = {(row["method"], row["task"], row["demos"]) for row in trained if row["seed"] != 0}
    tables = {
        "table-1": whole,
        "table-a2": [row for row in of_gem if row["task"] in ablated],
        "ceilings": scripted,
        "seeds": [row for row in trained if (row["method"], row["task"], row["demos"]) in reseeded],
    }
    return {name: chosen for name, chosen in tables.items() if chosen}
