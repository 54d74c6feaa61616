"""Drawings of lesson 10: ten tasks, how they are drawn, one memory, kernels of phrases, and one policy at work."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gem_lite.drawing.plots import PICK_COLOR, bare, draw_gripper
from gem_lite.se2 import Pose2, Workspace

SIGNED = "RdBu_r"
"""Kernels and cosines have both signs: red is positive, blue negative, white 0."""
SAME_COLOR, OTHER_COLOR = "#0072b2", "#d55e00"
"""Pairs of phrases with the same grasp (dots), and with different grasps (crosses)."""


def show_shares(names: Sequence[str], shares: Mapping[str, np.ndarray], bound: float) -> Figure:
    """Each task's share of the draws (%), for several ways of drawing; the band is the equal share and a bound.

    Args:
        shares: by the name of the way of drawing, (tasks,) in [0, 1].
        bound: how far (0 to 1) a share may lie from the equal one.
    """
    fig, ax = plt.subplots(figsize=(8.2, 0.34 * len(names) + 1.2), layout="constrained")
    equal = 100 / len(names)
    ax.axvspan(equal - 100 * bound, equal + 100 * bound, color="0.85", label="equal share ± bound")
    rows = np.arange(len(names))
    for number, (name, values) in enumerate(shares.items()):
        ax.plot(100 * values, rows, "osD"[number % 3], ms=7, color=f"C{number}", mec="black", mew=0.5, label=name)
    ax.set_yticks(rows, names, fontsize=8)
    ax.set(xlabel="share of the draws (%)", xlim=(0, None), ylim=(len(names) - 0.4, -0.6))
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, loc="lower right")
    return fig


@dataclass(frozen=True)
class Retrieval:
    """What a phrase finds in the memory of its own task, and in the memory of all tasks.

    Attributes:
        phrase: the query, and the task that says it.
        own, shared: a crop (S, S, 3) uint8 with a note below; None and a reason if there is no crop.
    """

    phrase: str
    own: tuple[np.ndarray | None, str]
    shared: tuple[np.ndarray | None, str]


def show_retrievals(retrievals: Sequence[Retrieval]) -> Figure:
    """A column for each phrase: above, what its own task's memory gives; below, what the memory of all tasks gives."""
    fig, axes = plt.subplots(
        2, len(retrievals), figsize=(1.95 * len(retrievals), 4.9), squeeze=False, layout="constrained"
    )  # fmt: skip
    for column, retrieval in zip(axes.T, retrievals, strict=True):
        for ax, (crop, note) in zip(column, (retrieval.own, retrieval.shared), strict=True):
            bare(ax).imshow(np.full((20, 20, 3), 245, np.uint8) if crop is None else crop)
            if crop is None:
                ax.text(0.5, 0.5, "no crop", transform=ax.transAxes, ha="center", va="center", fontsize=10)
            ax.set_xlabel(textwrap.fill(note, 24), fontsize=8)
        column[0].set_title(textwrap.fill(retrieval.phrase, 24), fontsize=9)
    axes[0, 0].set_ylabel("own task's memory", fontsize=9)
    axes[1, 0].set_ylabel("memory of all tasks", fontsize=9)
    return fig


def show_phrase_kernels(phrases: Sequence[str], kernels: np.ndarray, inside: np.ndarray) -> Figure:
    """As Figure A2: the kernels of phrases beside each other, a row for each channel, all rows on their own scale.

    Args:
        kernels: (N, C, h, h).
        inside: (h, h) bool, the disc in which kernels are read; outside is grey.
    """
    channels = kernels.shape[1]
    fig, axes = plt.subplots(
        channels, len(phrases), figsize=(1.3 * len(phrases) + 0.9, 1.3 * channels + 0.6), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for channel, row in enumerate(axes):
        top = np.abs(kernels[:, channel][:, inside]).max()
        for ax, phrase, kernel in zip(row, phrases, kernels[:, channel], strict=True):
            shown = bare(ax, textwrap.fill(phrase, 14) if channel == 0 else "")
            image = shown.imshow(np.where(inside, kernel, np.nan), cmap=SIGNED, vmin=-top, vmax=top)
            ax.set_facecolor("0.8")
        row[0].set_ylabel(f"channel {channel}", fontsize=9)
        fig.colorbar(image, ax=row, shrink=0.85, aspect=12)
    return fig


def show_cosines(
    phrases: Sequence[str], cosines: np.ndarray, title: str, label: str = "cosine, the mean subtracted"
) -> Figure:
    """Cosines (N, N) of all pairs of phrases, each written into its cell."""
    side = 0.62 * len(phrases) + 1.6
    fig, ax = plt.subplots(figsize=(side + 0.8, side), layout="constrained")
    image = ax.imshow(cosines, cmap=SIGNED, vmin=-1, vmax=1)
    for (row, col), value in np.ndenumerate(cosines):
        color = "white" if abs(value) > 0.75 else "black"
        ax.text(col, row, f"{value:.2f}", ha="center", va="center", fontsize=8, color=color)
    ax.set_xticks(range(len(phrases)), phrases, rotation=40, ha="right", fontsize=8)
    ax.set_yticks(range(len(phrases)), phrases, fontsize=8)
    ax.tick_params(length=0)
    fig.colorbar(image, ax=ax, shrink=0.8, label=label)
    ax.set_title(title, fontsize=9)
    return fig


def show_pairs(
    panels: Mapping[str, np.ndarray], same: np.ndarray, levels: tuple[float, float], names: Sequence[str]
) -> Figure:
    """Cosines (N,) of pairs of phrases for several kinds of vectors: same grasp above, different grasps below.

    Args:
        same: (N,) bool.
        levels: the largest cosine wanted of different grasps, and the smallest wanted of the same grasp; dashed.
        names: N names. The last panel writes the two lowest of the same grasp and the two highest of different ones.
    """
    fig, axes = plt.subplots(len(panels), 1, figsize=(8.4, 1.5 * len(panels) + 0.5), sharex=True, layout="constrained")
    groups = ((same, "o", SAME_COLOR, "same grasp"), (~same, "x", OTHER_COLOR, "different grasps"))
    for ax, (title, cosines) in zip(np.atleast_1d(axes), panels.items(), strict=True):
        for y, (members, mark, color, _) in enumerate(groups):
            values = cosines[members]
            heights = y + np.linspace(-0.25, 0.25, len(values))
            ax.plot(values, heights, mark, ms=6, mew=1.4, color=color, mfc="none")
            ax.plot([values.mean()] * 2, [y - 0.38, y + 0.38], color="black", lw=2)
            ax.plot([levels[1 - y]] * 2, [y - 0.45, y + 0.45], color=color, ls="--", lw=1.2)
            if ax.get_subplotspec().is_last_row():
                _name_extremes(ax, values, heights, [names[i] for i in np.flatnonzero(members)], lowest=y == 0)
        ax.set_yticks([0, 1], [name for *_, name in groups], fontsize=9)
        ax.set(ylim=(1.6, -0.5), xlim=(-1.05, 1.05))
        ax.set_title(title, fontsize=9)
        ax.grid(axis="x", alpha=0.3)
    ax.set_xlabel("cosine (black: the mean; dashed: the levels that we want)")
    return fig


def _name_extremes(ax: Axes, values: np.ndarray, heights: np.ndarray, names: Sequence[str], lowest: bool) -> None:
    """Write the names of the two lowest (or highest) of several marks to the left of them."""
    order = np.argsort(values if lowest else -values)
    for i, offset in zip(sorted(order[:2]), ((-6, 5), (-6, -7)), strict=False):  # there may be one mark only
        ax.annotate(
            names[i], (values[i], heights[i]), offset, textcoords="offset points", fontsize=8, ha="right", va="center"
        )


def show_lent_kernels(
    answers: Mapping[str, tuple[Pose2, np.ndarray]], picture: np.ndarray, centre: Pose2, workspace: Workspace,
    reach: int = 13,
) -> Figure:  # fmt: skip
    """One thing from above with the pick of each kernel, and below it the scores over the yaw at that pick.

    The round end of a cross points in the direction of the yaw.

    Args:
        answers: for each kernel the best pick, and the scores (R,) at its pixel for all yaws.
        picture: (H, W, 3) uint8, the table from above.
        centre: the middle of what is shown; ``reach`` cells to each side.
    """
    fig, axes = plt.subplots(
        2, len(answers), figsize=(2.5 * len(answers), 4.4), height_ratios=[1.3, 1], sharey="row", layout="constrained"
    )  # fmt: skip
    row, col = workspace.to_pixel(centre.x, centre.y)
    for (above, below), (name, (pose, scores)) in zip(axes.T, answers.items(), strict=True):
        bare(above, name).imshow(picture)
        draw_gripper(above, pose, workspace, PICK_COLOR)
        above.set(xlim=(col - reach, col + reach), ylim=(row + reach, row - reach), facecolor="0.2")
        yaws = 360 * np.arange(len(scores)) / len(scores)
        below.plot(yaws, scores - scores.max(), "o-", ms=3, lw=1, color="C0")
        below.set(xlabel="yaw of the pick (degrees)", xticks=[0, 90, 180, 270, 360])
        below.grid(alpha=0.3)
    axes[1, 0].set_ylabel("logit - best logit")
    return fig


def draw_learning(
    phrases: Sequence[str], kernels: np.ndarray, inside: np.ndarray, curves: Mapping[str, np.ndarray],
    steps: Sequence[int], moment: int,
) -> Figure:  # fmt: skip
    """One moment of a training: the phrases' kernels now, and cosines over the steps. A frame of an animation.

    Args:
        kernels: (N, h, h), one channel each.
        inside: (h, h) bool, see `show_phrase_kernels`.
        curves: named cosines (M,), one for each of ``steps``.
        moment: the index of this frame in ``steps``.
    """
    fig = plt.figure(figsize=(8.6, 3.1))
    top = np.abs(kernels[:, inside]).max()
    columns = -(-len(phrases) // 2)
    for number, (phrase, kernel) in enumerate(zip(phrases, kernels, strict=True)):
        row, column = divmod(number, columns)
        ax = bare(fig.add_axes((0.01 + 0.46 * column / columns, 0.5 - 0.47 * row, 0.43 / columns, 0.37)), phrase)
        ax.imshow(np.where(inside, kernel, np.nan), cmap=SIGNED, vmin=-top, vmax=top)
        ax.set_facecolor("0.8")
    ax = fig.add_axes((0.57, 0.16, 0.41, 0.72))
    for (name, values), style, mark in zip(curves.items(), ("-", "--", ":"), "osD", strict=False):
        ax.plot(steps, values, style, lw=1.5, label=name)
        ax.plot(steps[moment], values[moment], mark, ms=8, mec="black", color=ax.lines[-1].get_color())
    ax.set(xlabel="step of the training", ylim=(-1.1, 1.1), ylabel="mean cosine")
    ax.set_title(f"after {steps[moment]} steps", fontsize=9)
    ax.legend(fontsize=8, loc="center right")
    ax.grid(alpha=0.3)
    return fig
