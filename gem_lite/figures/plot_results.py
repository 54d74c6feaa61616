"""Drawings of trainings and comparisons: losses, success against demonstrations, tables, failures."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.evaluation.failures import Failure
from gem_lite.evaluation.results import Score
from gem_lite.figures.plots import MAP_COLORS, PICK_COLOR, PLACE_COLOR, action_map, bare, draw_gripper
from gem_lite.policies.samples import Sample, to_picture

METHOD_COLORS = {"gem": "C3", "transporter-lan": "C0", "cliport": "C2", "cliport-grounded": "C8"}
"""A method's colour in every figure."""


def show_losses(losses: dict[str, np.ndarray], floors: tuple[float, float], window: int = 25) -> Figure:
    """Losses of named trainings over their steps, (steps, 2) of pick and place, as running medians.

    Args:
        floors: the smallest losses that equally right angles of pick and place allow.
    """
    fig, axes = plt.subplots(1, 2, figsize=(9.0, 3.2), sharey=True, layout="constrained")
    for ax, column, role, floor in zip(axes, (0, 1), ("pick", "place"), floors, strict=True):
        ax.axhline(floor, color="0.5", ls=":", label="equally right angles")
        for name, values in losses.items():
            smooth = np.median(np.lib.stride_tricks.sliding_window_view(values[:, column], window), axis=1)
            ax.plot(np.arange(len(smooth)) + window, smooth, color=METHOD_COLORS.get(name), label=name)
        ax.set(xlabel="step", title=role, ylim=(0, None))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel(f"cross-entropy (median of {window} steps)")
    axes[0].legend(fontsize=8)
    return fig


def show_samples(samples: Sequence[Sample], titles: Sequence[str]) -> Figure:
    """What training sees of GEM's samples: the picture with the demonstrated pixels above the pick's map."""
    fig, axes = plt.subplots(2, len(samples), figsize=(1.5 * len(samples), 5.2), layout="constrained")
    for (above, below), sample, title in zip(axes.T, samples, titles, strict=True):
        bare(above, title).imshow(to_picture(sample.rgbd))
        for (row, col), color in ((sample.pick, PICK_COLOR), (sample.place, PLACE_COLOR)):
            above.plot(col, row, "o", mfc="none", mec=color, ms=9, mew=2)
        bare(below).imshow(sample.maps["pick"][0], cmap=MAP_COLORS, vmin=0, vmax=1)
    return fig


def show_success(panels: dict[str, dict[str, dict[int, Score]]], title: str = "") -> Figure:
    """Success against the number of demonstrations with 95 % intervals.

    Args:
        panels: title to method to number of demonstrations to score.
    """
    fig, axes = plt.subplots(1, len(panels), figsize=(4.6 * len(panels), 3.6), sharey=True, layout="constrained")
    for ax, (name, methods) in zip(np.atleast_1d(axes), panels.items(), strict=True):
        for number, (method, scores) in enumerate(methods.items()):
            counts = np.array(sorted(scores), float)
            means = np.array([scores[count].mean for count in sorted(scores)])
            ends = np.array([scores[count].interval for count in sorted(scores)]).T
            nudged = counts * (1 + 0.04 * (number - 1))  # so that intervals do not hide each other
            reach = np.clip([means - ends[0], ends[1] - means], 0, None)
            ax.errorbar(nudged, means, reach, fmt="o-", capsize=3, color=METHOD_COLORS.get(method), label=method)
        ax.set(xscale="log", ylim=(-3, 103), xlabel="demonstrations", title=name)
        ax.set_xticks([1, 5, 10, 20, 100], ["1", "5", "10", "20", "100"])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
    np.atleast_1d(axes)[0].set_ylabel("success (0-100)")
    np.atleast_1d(axes)[0].legend(fontsize=8, loc="lower right")
    fig.suptitle(title, fontsize=10)
    return fig


def show_scores(groups: dict[str, dict[str, Score]], title: str = "") -> Figure:
    """Means with 95 % intervals as horizontal bars: a row for each name, a colour for each group."""
    names = list(dict.fromkeys(name for scores in groups.values() for name in scores))
    fig, ax = plt.subplots(figsize=(7.6, 0.34 * len(names) * len(groups) + 1.1), layout="constrained")
    thick = 0.8 / len(groups)
    shared = {name: [group for group, scores in groups.items() if name in scores] for name in names}
    for number, (group, scores) in enumerate(groups.items()):
        # The bars of a name lie around it, even where some groups lack the name.
        offsets = [shared[name].index(group) - (len(shared[name]) - 1) / 2 for name in scores]
        rows = np.array([names.index(name) for name in scores]) + thick * np.array(offsets)
        means = np.array([score.mean for score in scores.values()])
        ends = np.array([score.interval for score in scores.values()]).T
        reach = np.clip([means - ends[0], ends[1] - means], 0, None)
        ax.barh(rows, means, 0.9 * thick, xerr=reach, capsize=3, color=f"C{number}", alpha=0.75, label=group)
        for row, mean, end in zip(rows, means, ends[1], strict=True):
            ax.text(end + 1.5, row, f"{mean:.1f}", va="center", fontsize=8)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set(xlim=(0, 112), xlabel="success (0-100), with 95 % interval", title=title)
    fig.legend(fontsize=8, loc="outside lower center", ncols=len(groups))
    ax.grid(axis="x", alpha=0.3)
    return fig


def show_worlds(panels: dict[str, dict[str, dict[str, Score]]], title: str = "") -> Figure:
    """Means with 95 % intervals in several worlds: a panel for each task family, a row for each world.

    Args:
        panels: family to set of words ("seen", "unseen") to world to score. A world that a panel does not
            have leaves its row empty there.
    """
    worlds = list(dict.fromkeys(world for sets in panels.values() for scores in sets.values() for world in scores))
    fig, axes = plt.subplots(1, len(panels), figsize=(3.4 * len(panels), 3.4), sharey=True, layout="constrained")
    for ax, (family, sets) in zip(np.atleast_1d(axes), panels.items(), strict=True):
        for number, (label, scores) in enumerate(sets.items()):
            rows = np.array([worlds.index(world) for world in scores]) + 0.24 * (number - (len(sets) - 1) / 2)
            means = np.array([score.mean for score in scores.values()])
            ends = np.array([score.interval for score in scores.values()]).T
            reach = np.clip([means - ends[0], ends[1] - means], 0, None)
            ax.errorbar(means, rows, xerr=reach, fmt="o", ms=4, capsize=2.5, color=f"C{number}", label=label)
        ax.set_yticks(range(len(worlds)), worlds)
        ax.set(xlim=(-3, 103), xlabel="success (0-100)", title=family)
        ax.grid(alpha=0.3)
    np.atleast_1d(axes)[0].invert_yaxis()
    np.atleast_1d(axes)[0].legend(fontsize=8)
    fig.suptitle(title, fontsize=10)
    return fig


def show_failures(failures: Sequence[tuple[str, Failure]], columns: int = 4) -> Figure:
    """A gallery: the scene with both grippers beside the action maps of pick and place, the reason underneath."""
    rows = -(-len(failures) // columns)
    fig = plt.figure(figsize=(3.1 * columns, 2.7 * rows), layout="constrained")
    parts = fig.subfigures(rows, columns, squeeze=False).flat
    for part, (title, failure) in zip(parts, failures, strict=False):  # the last row may be short
        trio = part.subplots(1, 3)
        choice = failure.choice
        workspace = choice.heightmap.workspace
        trio[0].imshow(choice.heightmap.rgb)
        draw_gripper(trio[0], choice.action.pick, workspace, PICK_COLOR)
        draw_gripper(trio[0], choice.action.place, workspace, PLACE_COLOR)
        trio[0].set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
        for ax, logits in zip(trio[1:], (choice.pick_logits, choice.place_logits), strict=True):
            ax.imshow(action_map(logits), cmap=MAP_COLORS)
        for ax, name in zip(trio, ("scene", "pick", "place"), strict=True):
            bare(ax, name)
        caption = [title, f'"{choice.instruction}"', *textwrap.wrap(failure.reason, 52)]
        part.supxlabel("\n".join(caption), x=0.02, ha="left", fontsize=7.5)
    return fig
