"""The benchmark's tables, as pictures and as Markdown, and its scaling with demonstrations (Fig. A5)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.evaluation.summaries import MeanAndInterval, mean_of_means
from gem_lite.figures.plots import MAP_COLORS, SAFE_COLORS

Row = Mapping[str, object]
"""A row of results, see `gem_lite.evaluation.results`."""
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
        ValueError: two rows have the same column and task.
    """
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


def markdown(table: Table, tasks: Sequence[str]) -> str:
    """A Markdown table: a line for each task, a column for each method, "mean [low, high]" in each cell.

    The last line is the mean over the tasks, for the columns that have them all.
    """
    head = f"| task | {' | '.join(table)} |"
    lines = [head, "|---|" + "---|" * len(table)]
    for task in tasks:
        cells = []
        for column in table.values():
            row = column.get(task)
            cells.append(_cell(_interval(row)) if row else "")
        lines.append(f"| {task} | {' | '.join(cells)} |")
    means = []
    for column in table.values():
        complete = all(task in column for task in tasks)
        means.append(_cell(mean_of_means([_interval(column[task]) for task in tasks])) if complete else "")
    lines.append(f"| **mean of the {len(tasks)}** | {' | '.join(means)} |")
    return "\n".join(lines) + "\n"


def _interval(row: Row) -> MeanAndInterval:
    low, high = map(float, row["ci95"])  # type: ignore[call-overload]
    return float(str(row["mean"])), (low, high)


def _cell(value: MeanAndInterval) -> str:
    mean, (low, high) = value
    return f"{mean:.1f} [{low:.1f}, {high:.1f}]"


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


def _mean(row: Row | None) -> float:
    return float(str(row["mean"])) if row else float("nan")


def _ink(background: tuple[float, ...]) -> str:
    """White on a dark background, black on a bright one."""
    red, green, blue = background[:3]
    return "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
