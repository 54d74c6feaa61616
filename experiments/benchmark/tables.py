"""Rows as Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import summaries
from summaries import mean_over_tasks

from experiments.benchmark.checks import check_checkpoints
from gem_lite.evaluation import results

Row = dict[str, Any]
"""A row of results, see `gem_lite.evaluation.results`."""
MARK = "†"
"""Behind a number of rows that are outdated (`results.is_outdated`)."""
NOTE = f"{MARK} Measured by an earlier version of this library: other rules of acting, or other heights."
"""Below a table with a `MARK`."""
MIXED = "‡"
"""Behind a difference of scores that were measured under different versions of the rules of acting."""
MIXED_NOTE = f"{MIXED} Its scores were measured under different rules of acting: the difference holds that change, too."
"""Below a table with a `MIXED`."""
Table = dict[str, dict[str, Row]]
"""The rows by column and task. A column is a method with its number of demonstrations and its training seed."""


def column_of(row: Row) -> str:
    """The column of a row: "gem, 10 demonstrations", "expert", "gem, 10 demonstrations, seed 1"."""
    entries = [str(row["method"])]
    if row["demos"]:
        entries.append(f"{row['demos']} demonstrations")
    elif row["config"] not in (None, "lite"):
        entries.append(str(row["config"]))
    if row["seed"]:
        entries.append(f"seed {row['seed']}")
    return ", ".join(entries)


def arranged(rows: Sequence[Row]) -> Table:
    """The rows over all test episodes, by column and task.

    Raises:
        ValueError: two rows have the same column and task, or see `check_checkpoints`.
    """
    check_checkpoints(rows)
    table: Table = {}
    for row in rows:
        if row["split"] != "test" or row["subset"] != "all":
            continue
        column = table.setdefault(column_of(row), {})
        task = str(row["task"])
        if task in column:
            raise ValueError(f"rows must differ in method, demonstrations, seed or task, got two of {column_of(row)!r}")
        column[task] = row
    return table


def markdown(table: Table, tasks: Sequence[str], averaged: Sequence[str] | None = None) -> str:
    """A Markdown table: a line for each task, a column for each method, "mean [low, high]" in each cell.

    The last line is the mean over the tasks, for the columns that have them all.

    Args:
        averaged: the tasks of the mean; all without it. The others get a star.
    """
    averaged = tasks if averaged is None else averaged
    lines = []
    for task in tasks:
        star = "" if task in averaged else "*"
        cells = [cell(column[task]) if task in column else "" for column in table.values()]
        lines.append([f"{task}{star}", *cells])
    means = [_mean_cell(column, averaged) for column in table.values()]
    return lines_of(["task", *table], [*lines, [f"**mean of the {len(averaged)}**", *means]])


def lines_of(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table from the texts of its cells, with the notes below it for the marks that a cell has."""
    rows = [head, ["---"] * len(head), *lines]
    text = "".join(f"| {' | '.join(cells)} |\n" for cells in rows)
    notes = [note for mark, note in ((MARK, NOTE), (MIXED, MIXED_NOTE)) if mark in text]
    return text + "".join(f"\n{note}\n" for note in notes)


def cell(row: Row) -> str:
    """A row as "mean [low, high]", with the `MARK` if it is outdated."""
    return interval_text(float(row["mean"]), row["ci95"]) + (MARK if results.is_outdated(row) else "")


def interval_text(mean: float, ends: Sequence[float], sign: str = "") -> str:
    """A mean and the ends of its interval, with one digit; ``sign`` is "+" for a difference."""
    low, high = ends
    return f"{mean:{sign}.1f} [{low:{sign}.1f}, {high:{sign}.1f}]"


def _mean_cell(column: Mapping[str, Row], tasks: Sequence[str]) -> str:
    """The mean over tasks as in `cell`; empty if a task is not measured."""
    if not all(task in column for task in tasks):
        return ""
    scores = {task: summaries.pool([column[task]]) for task in tasks}
    return interval_text(*mean_over_tasks(scores)) + (MARK if any(s.outdated for s in scores.values()) else "")
