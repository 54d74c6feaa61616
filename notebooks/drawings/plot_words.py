"""What a language model finds likely, as tables of cells, and maps of relations: the figures of lesson 13."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gem_lite.drawing.plots import bare

NEAR_WHITE = 0.55
"""On cells above this share of the darkest one, numbers are written in white."""


def show_table(table: np.ndarray, rows: Sequence[str], columns: Sequence[str]) -> Figure:
    """Probabilities (rows, columns) as cells, dark where they are high, with their numbers."""
    fig, ax = plt.subplots(figsize=(1.4 * len(columns) + 1, 0.6 * len(rows) + 0.8), layout="constrained")
    _cells(ax, table, rows, columns, "{:.2f}")
    ax.xaxis.tick_top()
    return fig


def show_kinds(panels: Sequence[tuple[str, np.ndarray]], names: Sequence[str], kinds: Sequence[str]) -> Figure:
    """Scores (names, kinds) of several ways to ask, side by side; a frame marks each name's own kind.

    Args:
        panels: a title and scores; the names come in as many equal groups as there are kinds.
    """
    fig, axes = plt.subplots(
        1, len(panels), figsize=(4.6 * len(panels), 0.28 * len(names) + 1.2), layout="constrained", squeeze=False
    )  # fmt: skip
    of_kind = len(names) // len(kinds)
    for ax, (title, scores) in zip(axes.flat, panels, strict=True):
        _cells(ax, scores, names, kinds, "{:+.1f}")
        for row in range(len(names)):
            frame = plt.Rectangle((row // of_kind - 0.48, row - 0.46), 0.96, 0.92, fill=False, edgecolor="C1", lw=2)
            ax.add_patch(frame)
        ax.set_title(title, fontsize=10)
        ax.tick_params(axis="x", rotation=20)
    return fig


def _cells(ax: Axes, values: np.ndarray, rows: Sequence[str], columns: Sequence[str], form: str) -> None:
    low, high = float(values.min()), float(values.max())
    ax.imshow(values, cmap="Blues", vmin=low, vmax=high, aspect="auto")
    ax.set_xticks(range(len(columns)), columns, fontsize=9)
    ax.set_yticks(range(len(rows)), rows, fontsize=9)
    for (row, column), value in np.ndenumerate(values):
        dark = value > low + NEAR_WHITE * (high - low)
        ax.text(
            column, row, form.format(value), ha="center", va="center", color="white" if dark else "black", fontsize=8
        )


def show_relations(
    picture: np.ndarray, panels: Sequence[tuple[str, np.ndarray, tuple[float, float] | None]]
) -> Figure:  # fmt: skip
    """A table from above with the map of a relation over it, once for each.

    Args:
        picture: (H, W, 3) uint8.
        panels: a title, a map (H, W) whose places are above 0, and a chosen cell (row, column), if any.
    """
    fig, axes = plt.subplots(1, len(panels), figsize=(1.9 * len(panels), 4.2), layout="constrained")
    for ax, (title, semantic, cell) in zip(np.atleast_1d(axes), panels, strict=True):
        bare(ax).imshow(picture)
        ax.imshow(np.ma.masked_where(semantic <= 0, semantic), cmap="viridis", alpha=0.75, vmin=0)
        if cell is not None:
            ax.plot(cell[1], cell[0], marker="x", color="white", ms=9, mew=3)
            ax.plot(cell[1], cell[0], marker="x", color="C3", ms=9, mew=1.6)
        ax.set_title(title, fontsize=9)
    return fig
