"""Tables with pictures in their sentences, weights on things and places, and success: the figures of lesson 16."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, SAFE_COLORS, bare

METHOD_NAMES = {"gem": "GEM", "vima-like": "rival after VIMA"}
"""Methods as the figure names them."""


@dataclass(frozen=True)
class Shown:
    """A scene and its sentence.

    Attributes:
        title: what to write above it.
        table: (H, W, 3) uint8, from above.
        pictures: of the sentence: what to pick, and where to place it.
        boxes: (2, 4), where both are: middle (row, column), height and width, as shares of the table's picture.
    """

    title: str
    table: np.ndarray
    pictures: Sequence[np.ndarray]
    boxes: np.ndarray


def show_prompts(scenes: Sequence[Shown]) -> Figure:
    """Each table from above, and beside it the two pictures of its sentence in the colours of pick and place."""
    fig, axes = plt.subplots(
        2, 2 * len(scenes), figsize=(3.6 * len(scenes), 3.7), width_ratios=[1.35, 1] * len(scenes), dpi=80,
        layout="constrained",
    )  # fmt: skip
    for number, scene in enumerate(scenes):
        above, below = axes[0, 2 * number], axes[1, 2 * number]
        below.remove()
        grid = above.get_subplotspec().get_gridspec()
        above.set_subplotspec(grid[:, 2 * number])
        bare(above, scene.title).imshow(scene.table)
        pairs = zip(axes[:, 2 * number + 1], ("put ...", "... into ..."), scene.pictures, strict=True)
        for (ax, words, picture), box, color in zip(pairs, scene.boxes, (PICK_COLOR, PLACE_COLOR), strict=True):
            bare(ax, words).imshow(picture)
            ax.spines[:].set(color=color, linewidth=3)
            draw_box(above, box, color, scene.table.shape)
    return fig


def draw_box(ax: Axes, box: np.ndarray, color: str, shape: Sequence[int]) -> tuple[float, float]:
    """Draw a box (4,) of shares on a picture of a shape. Returns its upper left corner (x, y)."""
    row, column, height, width = box * np.tile(shape[:2], 2)
    corner = (column - width / 2 - 0.5, row - height / 2 - 0.5)
    ax.add_patch(Rectangle(corner, width, height, fill=False, color=color, lw=2, path_effects=OUTLINE))
    return corner


def show_maps(title: str, panels: Sequence[tuple[str, np.ndarray]], peaks: Sequence[tuple[int, int] | None]) -> Figure:
    """Tables and maps of one size in a row. A cross marks the brightest cell. Good for a frame, too."""
    fig, axes = plt.subplots(1, len(panels), figsize=(1.75 * len(panels), 3.8))
    fig.subplots_adjust(0.01, 0.01, 0.99, 0.83, 0.06)
    fig.suptitle(title, fontsize=10)
    for ax, (name, panel), peak in zip(axes, panels, peaks, strict=True):
        bare(ax, name).imshow(panel, cmap=MAP_COLORS, vmin=0, vmax=1)
        if peak is not None:
            ax.plot(peak[1], peak[0], "x", color=PICK_COLOR, ms=9, mew=2, path_effects=OUTLINE)
    return fig


def show_shares(
    things: Sequence[np.ndarray], prompts: Sequence[np.ndarray], shares: Mapping[str, np.ndarray]
) -> Figure:
    """How much weight each prompt puts on each thing.

    Args:
        things: N cutouts (H, W, 3).
        prompts: two cutouts (H, W, 3).
        shares: for each title, (2, N).
    """
    count = len(things)
    fig = plt.figure(figsize=(0.75 * len(shares) * (count + 1), 2.9), dpi=90, layout="constrained")
    for block, (title, weights) in zip(fig.subfigures(1, len(shares), wspace=0.06), shares.items(), strict=True):
        part = block.subplots(3, count + 1)
        block.suptitle(title, fontsize=10)
        part[0, 0].axis("off")
        for ax, thing in zip(part[0, 1:], things, strict=True):
            bare(ax).imshow(thing)
        for line, prompt, row in zip(part[1:], prompts, weights, strict=True):
            bare(line[0]).imshow(prompt)
            for ax, weight in zip(line[1:], row, strict=True):
                bare(ax).imshow([[weight]], cmap=MAP_COLORS, vmin=0, vmax=1)
                ax.text(0, 0, f"{weight:.2f}", ha="center", va="center", color="black" if weight > 0.6 else "white")
    return fig


def show_places(
    table: np.ndarray, boxes: np.ndarray, rows: Sequence[tuple[str, np.ndarray, np.ndarray, np.ndarray]]
) -> Figure:
    """Weights on things (on their boxes) and on places (as a map), and a cross at the weighted mean of each.

    Args:
        table: (H, W, 3).
        boxes: (N, 4) of the things, as shares of the picture.
        rows: a title, the shares of things (N,) or of places (m, n), the mean (row, column) as shares of the picture,
            and its colour.
    """
    fig, axes = plt.subplots(1, len(rows), figsize=(2.05 * len(rows), 3.9), dpi=80, layout="constrained")
    height, width = table.shape[:2]
    for ax, (title, weights, mean, color) in zip(axes, rows, strict=True):
        bare(ax, title)
        if weights.ndim == 1:
            ax.imshow(table)
            for box, weight in zip(boxes, weights, strict=True):
                x, y = draw_box(ax, box, color, table.shape)
                ax.text(x, y - 4, f"{weight:.2f}", color="white", fontsize=9, path_effects=OUTLINE)
        else:
            ax.imshow(weights / weights.max(), cmap=MAP_COLORS, extent=(0, width, height, 0))
        ax.plot(mean[1] * width, mean[0] * height, "x", color=color, ms=9, mew=2, path_effects=OUTLINE)
    return fig


def show_success(rows: Sequence[dict], levels: Mapping[str, str]) -> Figure:
    """Success (%) against the number of demonstrations: a panel for each level, a colour for each method.

    Args:
        rows: of experiments.picture_prompts, each with its interval.
        levels: titles by the names of tasks.
    """
    fig, axes = plt.subplots(1, len(levels), figsize=(3.3 * len(levels), 3.2), sharey=True, layout="constrained")
    trained = sorted({row["demos"] for row in rows})
    for ax, (task, title) in zip(axes, levels.items(), strict=True):
        for (method, name), color, mark in zip(METHOD_NAMES.items(), SAFE_COLORS, "os", strict=False):
            own = sorted((row["demos"], row["mean"], *row["ci95"]) for row in rows
                         if row["task"] == task and row["method"] == method)  # fmt: skip
            demos, mean, low, high = np.array(own, float).reshape(-1, 4).T
            ax.errorbar(demos, mean, [mean - low, high - mean], fmt=mark, color=color, capsize=3, label=name)
            numbers = np.unique(demos)
            ax.plot(numbers, [mean[demos == number].mean() for number in numbers], color=color, lw=1)
        ax.set(title=title, xlabel="demonstrations", xscale="log", ylim=(-4, 104))
        ax.set_xticks(trained, [f"{count}" for count in trained])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("success (%)")
    axes[-1].legend(loc="lower right", fontsize=8)
    return fig
