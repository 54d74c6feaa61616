"""GEM's stored rows over several tables, by what the robot knows of the tables' poses."""

from __future__ import annotations

import summaries
from summaries import Score

from gem_lite import tasks
from gem_lite.evaluation import results, table_poses
from gem_lite.evaluation.table_poses import Condition


def score(task: str, condition: Condition) -> Score:
    """GEM's filed rows of a task over two tables at home, under a condition, on the first test episodes.

    They are pooled over training seeds.

    Raises:
        LookupError: there is no such row, or see `summaries.pool`.
    """
    required = {"method": "gem", "task": task, "tables": 2, "world": "home", "split": "test", "start": 0}
    required |= condition._asdict()
    shown = ("tables", "world", "poses", "shift", "turn")
    rows = results.read_rows(results.RESULTS / f"{tasks.family(task)}.jsonl")
    return summaries.pool(summaries.select(rows, required, shown), identity=table_poses.IDENTITY)
