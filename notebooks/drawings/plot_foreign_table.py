"""Drawings of lesson 12: margins of phrases, cameras that err, and what their errors cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.drawing.plots import bare


def show_margins(margins: Mapping[str, Sequence[float]], lowest: float) -> Figure:
    """Margins of phrases as dots, a line of dots for each group, and the lowest margin that is not refused.

    Args:
        margins: of each phrase, by group: at most two groups.
    """
    fig, ax = plt.subplots(figsize=(7.2, 1.1 + 0.6 * len(margins)), layout="constrained")
    rng = np.random.default_rng(0)
    for number, (values, mark) in enumerate(zip(margins.values(), "os", strict=False)):
        ax.scatter(values, number + rng.uniform(-0.18, 0.18, len(values)), s=22, marker=mark, alpha=0.75)
    ax.axvline(lowest, color="black", lw=1.2)
    ax.text(lowest, len(margins) - 0.45, " not refused from here on", fontsize=8, va="bottom")
    ax.set(yticks=range(len(margins)), yticklabels=list(margins), ylim=(-0.5, len(margins) - 0.1))
    ax.set_xlabel("margin of a phrase")
    ax.grid(axis="x", alpha=0.3)
    return fig


def show_error_curves(
    curves: Mapping[str, Mapping[str, tuple[float, float, float]]],
    levelled: Mapping[str, Mapping[str, tuple[float, float, float]]],
) -> Figure:
    """Success (%) against the size of each kind of error: a panel for each kind.

    Args:
        curves: for each kind and size the mean and the ends of its 95 % interval.
        levelled: the same with levelled poses, for some kinds and sizes.
    """
    columns = (len(curves) + 1) // 2
    fig, axes = plt.subplots(2, columns, figsize=(2.35 * columns, 4.8), layout="constrained", sharey=True)
    for ax in axes.flat[len(curves) :]:
        ax.set_axis_off()
    for ax, (kind, sizes) in zip(axes.flat, curves.items(), strict=False):
        means, lows, highs = np.array(list(sizes.values())).T
        ax.errorbar(range(len(means)), means, [means - lows, highs - means], fmt="o-", capsize=3, ms=5)
        for size, (mean, low, high) in levelled.get(kind, {}).items():
            place = list(sizes).index(size) + 0.15
            ax.errorbar(place, mean, [[mean - low], [high - mean]], fmt="s", color="C1", capsize=3, ms=6)
            ax.set_title(" squares: levelled", fontsize=8, loc="left", color="C1", y=0.03)
        ax.set(title=kind, ylim=(-3, 106), xlim=(-0.4, len(means) - 0.6))
        ax.set_xticks(range(len(means)), list(sizes), fontsize=8, rotation=25)
        ax.grid(alpha=0.3)
    for ax in axes[:, 0]:
        ax.set_ylabel("success (%)")
    return fig


def show_errors(panels: Sequence[tuple[str, np.ndarray, np.ndarray]]) -> Figure:
    """For cameras that err more and more: a depth picture above the table from above.

    Args:
        panels: title, depth (h, w) in metres with 0 where nothing was measured, and picture from above (H, W, 3).
    """
    fig, axes = plt.subplots(
        2, len(panels), figsize=(2.9 * len(panels), 6.4), height_ratios=(1, 1.9), layout="constrained"
    )  # fmt: skip
    colors = plt.get_cmap("viridis").copy()
    colors.set_bad("white")
    for column, (title, depth, picture) in zip(axes.T, panels, strict=True):
        measured = np.ma.masked_equal(depth, 0)
        image = bare(column[0], f"{title}: depth").imshow(measured, cmap=colors, vmin=0.5, vmax=1.8)
        bare(column[1], f"{title}: from above").imshow(picture)
    fig.colorbar(image, ax=axes[0], shrink=0.8, label="metres (white: none)")
    return fig


def show_bare_table(features: Mapping[str, np.ndarray]) -> Figure:
    """One feature of a bare table, from above, in one scale of colours.

    Args:
        features: (H, W) each, by title.
    """
    values = np.concatenate([feature.ravel() for feature in features.values()])
    fig, axes = plt.subplots(1, len(features), figsize=(1.9 * len(features) + 1.2, 3.4), layout="constrained")
    for ax, (title, feature) in zip(axes, features.items(), strict=True):
        image = bare(ax, title).imshow(feature, cmap="viridis", vmin=values.min(), vmax=values.max())
    fig.colorbar(image, ax=axes, label="feature", shrink=0.8)
    return fig
