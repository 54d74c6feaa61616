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
NOT_ASKED = "0.6"
"""The colour of boxes of things that are not asked for."""


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


@dataclass(frozen=True)
class Panel:
    """A table from above, or a map of it.

    Attributes:
        title: what to write above it.
        picture: (H, W, 3) uint8, or a map (H, W) in [0, 1].
        color: of the box and of the cross.
        box: (4,), around what is asked for, as in `Shown`.
        peak: the row and the column of the cross.
        prompt: a picture of the sentence, drawn small into the upper right corner.
    """

    title: str
    picture: np.ndarray
    color: str
    box: np.ndarray | None = None
    peak: tuple[int, int] | None = None
    prompt: np.ndarray | None = None


def draw_box(ax: Axes, box: np.ndarray, color: str, shape: Sequence[int]) -> tuple[float, float]:
    """Draw a box (4,) of shares on a picture of a shape. Returns its upper left corner (x, y)."""
    row, column, height, width = box * np.tile(shape[:2], 2)
    corner = (column - width / 2 - 0.5, row - height / 2 - 0.5)
    ax.add_patch(Rectangle(corner, width, height, fill=False, color=color, lw=2, path_effects=OUTLINE))
    return corner


def show_maps(title: str, panels: Sequence[Panel]) -> Figure:
    """Tables and maps of one size in a row. Good for a frame, too."""
    fig, axes = plt.subplots(1, len(panels), figsize=(2.1 * len(panels), 4.7))
    fig.subplots_adjust(0.01, 0.01, 0.99, 0.85, 0.06)
    fig.suptitle(title, fontsize=11)
    for ax, panel in zip(axes, panels, strict=True):
        bare(ax, panel.title).imshow(panel.picture, cmap=MAP_COLORS, vmin=0, vmax=1)
        if panel.box is not None:
            draw_box(ax, panel.box, panel.color, panel.picture.shape)
        if panel.peak is not None:
            ax.plot(panel.peak[1], panel.peak[0], "x", color=panel.color, ms=9, mew=2, path_effects=OUTLINE)
        if panel.prompt is not None:
            corner = bare(ax.inset_axes((0.54, 0.76, 0.44, 0.22)))
            corner.imshow(panel.prompt)
            corner.spines[:].set(color=panel.color, linewidth=2)
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


@dataclass(frozen=True)
class Weights:
    """Weights of one picture of the sentence.

    Attributes:
        title: what to write above them.
        shares: of things (N,), or of places (m, n).
        mean: the weighted mean (row, column), as shares of the table's picture.
        asked: the number of the thing that is asked for.
        color: of this thing's box and of the mean.
    """

    title: str
    shares: np.ndarray
    mean: np.ndarray
    asked: int
    color: str


def show_places(table: np.ndarray, boxes: np.ndarray, panels: Sequence[Weights]) -> Figure:
    """Weights on things (written on their boxes) and on places (as a map), and a cross at the weighted mean of each.

    Args:
        table: (H, W, 3).
        boxes: (N, 4) of the things, as shares of the picture.
    """
    fig, axes = plt.subplots(1, len(panels), figsize=(2.05 * len(panels), 3.9), dpi=80, layout="constrained")
    height, width = table.shape[:2]
    for ax, panel in zip(axes, panels, strict=True):
        bare(ax, panel.title)
        of_things = panel.shares.ndim == 1
        if of_things:
            ax.imshow(table)
        else:
            ax.imshow(panel.shares / panel.shares.max(), cmap=MAP_COLORS, extent=(0, width, height, 0))
        for number, box in enumerate(boxes):
            x, y = draw_box(ax, box, panel.color if number == panel.asked else NOT_ASKED, table.shape)
            if of_things:
                ax.text(x, y - 4, f"{panel.shares[number]:.2f}", color="white", fontsize=9, path_effects=OUTLINE)
        ax.plot(panel.mean[1] * width, panel.mean[0] * height, "x", color=panel.color, ms=9, mew=2,
                path_effects=OUTLINE)  # fmt: skip
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
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig
