"""Success against the number of demonstrations (Fig. A5)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from summaries import MeanAndInterval, mean_over_tasks, scores

from gem_lite.drawing.plots import SAFE_COLORS


def scaling(
    rows: Sequence[dict], names: Sequence[str], counts: Sequence[int]
) -> tuple[list[str], dict[str, dict[int, MeanAndInterval]]]:
    """Means over tasks against the number of demonstrations, training seed 0.

    Returns:
        The tasks on which every method was measured with every number; and by method and number the mean over these
        tasks. Without such a task, both are empty.
    """
    cells = {(name, count): scores(rows, name, count) for name in names for count in counts}
    common = sorted(set.intersection(*(set(found) for found in cells.values())))
    if not common:
        return [], {}
    curves: dict[str, dict[int, MeanAndInterval]] = {name: {} for name in names}
    for (name, count), found in cells.items():
        curves[name][count] = mean_over_tasks({task: found[task] for task in common})
    return common, curves


def show_scaling(tasks: Sequence[str], curves: Mapping[str, Mapping[int, MeanAndInterval]]) -> Figure:
    """Success against the number of demonstrations; both arguments are what `scaling` returns."""
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
