"""The benchmark's tables, as pictures and as Markdown, leads with their intervals, seen beside unseen, Fig. A5."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.drawing.plots import MAP_COLORS, SAFE_COLORS
from gem_lite.evaluation import benchmark, results
from gem_lite.evaluation.statistics import Difference
from gem_lite.evaluation.summaries import MeanAndInterval, mean_over_tasks

Row = dict[str, Any]
"""A row of results, see `gem_lite.evaluation.results`."""
MARK = "†"
"""Behind a number of rows that are outdated (`results.is_outdated`)."""
NOTE = f"{MARK} Measured by an earlier version of this library, in which policies acted by other rules."
"""Below a table with a `MARK`."""
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
        ValueError: two rows have the same column and task, or see `benchmark.check_checkpoints`.
    """
    benchmark.check_checkpoints(rows)
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
    """A Markdown table from the texts of its cells, with the `NOTE` below it if a cell has the `MARK`."""
    rows = [head, ["---"] * len(head), *lines]
    text = "".join(f"| {' | '.join(cells)} |\n" for cells in rows)
    return f"{text}\n{NOTE}\n" if MARK in text else text


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
    scores = {task: results.pool([column[task]]) for task in tasks}
    return interval_text(*mean_over_tasks(scores)) + (MARK if any(s.outdated for s in scores.values()) else "")


def show_table(table: Table, tasks: Sequence[str]) -> Figure:
    """The same as `markdown`, as a picture: brighter is better, and cells that are not measured are grey."""
    means = np.array([[_mean(column.get(task)) for column in table.values()] for task in tasks])
    size = (2.2 + 1.15 * len(table), 1.2 + 0.32 * len(tasks))
    fig, ax = plt.subplots(figsize=size, layout="constrained")
    colors = plt.get_cmap(MAP_COLORS).with_extremes(bad="#cccccc")
    image = ax.imshow(np.ma.masked_invalid(means), cmap=colors, vmin=0, vmax=100, aspect="auto")
    ax.set_xticks(range(len(table)), [column.replace(", ", "\n") for column in table], fontsize=8)
    ax.xaxis.tick_top()
    ax.set_yticks(range(len(tasks)), tasks, fontsize=8)
    ax.tick_params(length=0)
    for (line, column), mean in np.ndenumerate(means):
        if not np.isnan(mean):
            ax.text(column, line, f"{mean:.0f}", ha="center", va="center", fontsize=8, color=_ink(colors(mean / 100)))
    fig.colorbar(image, ax=ax, shrink=0.6, label="mean over the episodes")
    return fig


def show_scaling(tasks: Sequence[str], curves: Mapping[str, Mapping[int, MeanAndInterval]]) -> Figure:
    """Success against the number of demonstrations (Fig. A5): means over ``tasks``, of `summaries.scaling`."""
    fig, ax = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
    for number, ((name, points), color) in enumerate(zip(curves.items(), itertools.cycle(SAFE_COLORS), strict=False)):
        counts = np.array(list(points)) * 1.03 ** (
            number - len(curves) / 2
        )  # side by side, so that bars do not overlap
        means = np.array([mean for mean, _ in points.values()])
        ends = np.array([interval for _, interval in points.values()])
        bars = np.abs(ends.T - means)
        ax.errorbar(counts, means, bars, color=color, marker="os^Dv"[number % 5], capsize=3, label=name)
    ax.set_xscale("log")
    numbers = sorted({count for points in curves.values() for count in points})
    ax.set_xticks(numbers, [str(count) for count in numbers])
    ax.minorticks_off()
    ax.set(xlabel="demonstrations", ylabel=f"mean over {len(tasks)} tasks", ylim=(0, 102))
    ax.legend(loc="lower right", fontsize=8)
    return fig


def show_leads(leads: Mapping[str, Mapping[str, Difference]], label: str) -> Figure:
    """Paired differences with their 95 % intervals: a line for each task, a colour and a mark for each group.

    A mark is filled if its interval does not contain 0.

    Args:
        leads: by group and task.
        label: what is subtracted from what; written below the axis.
    """
    names = list(dict.fromkeys(name for of_group in leads.values() for name in of_group))
    height = 0.17 * len(names) * (1 + len(leads)) + 1.2
    fig, ax = plt.subplots(figsize=(7.8, height), layout="constrained")
    for number in range(0, len(names), 2):
        ax.axhspan(number - 0.5, number + 0.5, color="0.95", lw=0)
    ax.axvline(0, color="black", lw=1)
    for number, (group, of_group) in enumerate(leads.items()):
        color = SAFE_COLORS[number % len(SAFE_COLORS)]
        mark = "osD^v"[number % 5]
        for name, difference in of_group.items():
            row = names.index(name) + 0.8 * ((number + 0.5) / len(leads) - 0.5)
            ax.plot(difference.interval, [row, row], color=color, lw=2)
            clear = difference.interval[0] > 0 or difference.interval[1] < 0
            ax.plot(difference.mean, row, mark, ms=6, color=color, mfc=color if clear else "white", mew=1.5)
        ax.plot([], [], mark, color=color, label=group)
    ax.set_yticks(range(len(names)), names, fontsize=8)
    ax.set(ylim=(len(names) - 0.5, -0.5), xlabel=label)
    ax.set_title("filled: the interval does not contain 0", fontsize=9)
    ax.grid(axis="x", alpha=0.3)
    if len(leads) > 1:
        fig.legend(fontsize=8, loc="outside lower center", ncols=len(leads))
    return fig


def show_seen_unseen(panels: Mapping[str, Mapping[str, tuple[float, float]]]) -> Figure:
    """For each method a panel: a thin line for each task from its seen to its unseen variant, a thick one for the mean.

    Args:
        panels: by method and task, the means (0-100) of the seen and the unseen variant.
    """
    fig, axes = plt.subplots(1, len(panels), figsize=(2.3 * len(panels), 3.4), sharey=True, layout="constrained")
    for ax, (method, lines) in zip(np.atleast_1d(axes), panels.items(), strict=True):
        for ends in lines.values():
            ax.plot((0, 1), ends, color="0.6", lw=1, marker="o", ms=3)
        mean = np.mean(list(lines.values()), axis=0)
        ax.plot((0, 1), mean, color=SAFE_COLORS[0], lw=3, marker="s", ms=7)
        for place, value in enumerate(mean):
            ax.annotate(f"{value:.0f}", (place, value), (0, 9), textcoords="offset points", ha="center", fontsize=9)
        ax.set_xticks((0, 1), ("seen", "unseen"))
        ax.set(xlim=(-0.3, 1.3), ylim=(-3, 112))
        ax.set_yticks(range(0, 101, 20))
        ax.set_title(f"{method}\n{len(lines)} pairs of tasks", fontsize=9)
        ax.grid(axis="y", alpha=0.3)
    np.atleast_1d(axes)[0].set_ylabel("mean over 50 episodes")
    return fig


def _mean(row: Row | None) -> float:
    return float(str(row["mean"])) if row else float("nan")


def _ink(background: tuple[float, ...]) -> str:
    """White on a dark background, black on a bright one."""
    red, green, blue = background[:3]
    return "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
