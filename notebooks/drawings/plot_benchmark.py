"""The benchmark in pictures: its tasks (Fig. A10), and a table of rows."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from gallery import ExpertStory
from matplotlib.figure import Figure

from gem_lite.drawing.plots import MAP_COLORS, bare

TABLE_PART = np.s_[150:, :]
"""The part of the front camera's picture that shows the table."""


def show_gallery(stories: Sequence[ExpertStory], columns: int = 6) -> Figure:
    """For each story its name, its first sentence, and below each other its first and its last picture."""
    rows = -(-len(stories) // columns)
    fig, axes = plt.subplots(
        2 * rows, columns, figsize=(2.3 * columns, 4.1 * rows), squeeze=False, layout="constrained"
    )  # fmt: skip
    for ax in axes.flat:
        ax.set_axis_off()
    for number, story in enumerate(stories):
        row, column = divmod(number, columns)
        sentence = "\n".join(textwrap.wrap(f'"{story.sentences[0]}"', 36))
        title = f"{story.task}\n{sentence}"
        bare(axes[2 * row, column]).imshow(story.first[TABLE_PART])
        axes[2 * row, column].set_title(title, fontsize=7)
        bare(axes[2 * row + 1, column]).imshow(story.last[TABLE_PART])
        axes[2 * row + 1, column].set_title(f"after {story.actions} actions", fontsize=7)
    return fig


def show_table(table: Mapping[str, Mapping[str, dict]], tasks: Sequence[str]) -> Figure:
    """Means of rows as a picture, a line for each task: brighter is better, and cells that are not measured are grey.

    Args:
        table: rows of results (`gem_lite.evaluation.results`) by column and task.
    """
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


def _mean(row: dict | None) -> float:
    return float(str(row["mean"])) if row else float("nan")


def _ink(background: tuple[float, ...]) -> str:
    """White on a dark background, black on a bright one."""
    red, green, blue = background[:3]
    return "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
