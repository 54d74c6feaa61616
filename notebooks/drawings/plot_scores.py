"""Leads with their intervals, and seen beside unseen variants of tasks."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.drawing.plots import SAFE_COLORS
from gem_lite.evaluation.statistics import Difference


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
