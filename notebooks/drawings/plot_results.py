"""Drawings of trainings and comparisons: losses, success against demonstrations, tables, failures."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from drawings.plot_shared import SHARE_LABEL, action_share, to_picture
from failures import Failure
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.ndimage import maximum_filter
from summaries import Score

from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, SAFE_COLORS, bare
from gem_lite.policies.choosing import Choice
from gem_lite.policies.inputs import Sample
from gem_lite.se2 import Pose2, Workspace, rotation_matrix

METHOD_NAMES = {
    "gem": "GEM",
    "transporter-lan": "Transporter-Lan",
    "cliport": "CLIPort",
    "cliport-grounded": "grounded CLIPort",
}
"""Methods as figures name them."""
ABLATION_NAMES = {
    "without-semantic-map": "no semantic map",
    "with-single-view": "one view",
    "without-steerable-kernel": "one unrotated kernel",
    "with-free-kernels": "36 free kernels",
    "without-image-map": "no image map",
    "with-wide-patches": "wide patches",
    "without-recoloring": "no recolouring",
    "without-parsing": "no parsing",
    "without-language-in-attention": "no words in the U-Nets",
    "with-matched-single-view": "one view, matched patches",
    "keeps-own-crop": "keeps its own crop",
    "with-part-crops": "crops of 30 mm",
    "with-dense-map": "one pass for each view",
    "with-region-map": "a thing is one region",
    "without-rotation-augmentation": "no turned pictures",
    "without-map-scaling": "no rescaled maps",
    "without-conjuncts": '"and" as one phrase',
    "without-peak": "no pick rule",
    "with-place-peak": "a place rule",
    "with-bracketing": "three exposures",
    "with-continued-border": "a continued border",
    "without-empty-spots": "no rule on empty spots",
    "without-locations": "no location words",
}
"""Endings of methods' names as figures name them."""
TASK_NAMES = {
    "put-block-in-bowl-seen-colors": "bowls, seen colours",
    "put-block-in-bowl-unseen-colors": "bowls, unseen colours",
    "block-insertion": "block insertion (L)",
    "bars-in-box": "bars in a box",
    "stack-block-pyramid-seq-seen-colors": "pyramid, seen colours",
    "stack-block-pyramid-seq-unseen-colors": "pyramid, unseen colours",
    "packing-shapes-seen": "packing, seen shapes",
    "packing-shapes-unseen": "packing, unseen shapes",
}
"""Tasks as figures name them."""
METHOD_COLORS = dict(zip(METHOD_NAMES, SAFE_COLORS, strict=False))
METHOD_COLORS |= {METHOD_NAMES[name]: color for name, color in METHOD_COLORS.items()}
"""A method's colour in every figure, by its name in the library and in figures."""


def readable(name: str) -> str:
    """The name of a task, a method or an ablation as figures show it; unknown names stay as they are."""
    if name in ABLATION_NAMES or name in TASK_NAMES:
        return (ABLATION_NAMES | TASK_NAMES)[name]
    for method in sorted(METHOD_NAMES, key=len, reverse=True):
        rest = name.removeprefix(method)
        if rest != name and (not rest or rest[1:] in ABLATION_NAMES):
            return METHOD_NAMES[method] + (f", {ABLATION_NAMES[rest[1:]]}" if rest else "")
    return name


def draw_learning(choices: dict[str, Choice], step: int) -> Figure:
    """A small frame for `pictures.animated`: one scene, and for each method its action maps of pick and place.

    Args:
        choices: what each method chooses in the scene after ``step`` training steps.
    """
    fig, axes = plt.subplots(1, 1 + 2 * len(choices), figsize=(6.6, 3.1), layout="constrained")
    bare(axes[0], f"step {step}").imshow(next(iter(choices.values())).heightmap.rgb)
    for number, (name, choice) in enumerate(choices.items()):
        for column, role, logits, (_, row, col), mark, color in (
            (1, "pick", choice.pick_logits, choice.pick_cell, "o", PICK_COLOR),
            (2, "place", choice.place_logits, choice.place_cell, "s", PLACE_COLOR),
        ):
            ax = bare(axes[2 * number + column], f"{name}\n{role}")
            _draw_shares(ax, choice, logits)
            ax.plot(col, row, mark, ms=11, mfc="none", mec=color, mew=1.4, path_effects=OUTLINE)
    return fig


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
        for (row, col), color, mark in ((sample.pick, PICK_COLOR, "o"), (sample.place, PLACE_COLOR, "s")):
            above.plot(col, row, mark, mfc="none", mec=color, ms=15, mew=1.4, path_effects=OUTLINE)
        bare(below).imshow(sample.maps["pick"][0], cmap=MAP_COLORS, vmin=0, vmax=1)
    return fig


def show_dots(groups: dict[str, dict[str, Score]], title: str = "") -> Figure:
    """Means as dots with 95 % intervals on one axis: a line for each name, a colour and a mark for each group."""
    names = list(dict.fromkeys(name for scores in groups.values() for name in scores))
    fig, ax = plt.subplots(figsize=(7.6, 0.14 * len(names) * (1 + len(groups)) + 1.5), layout="constrained")
    shared = {name: [group for group, scores in groups.items() if name in scores] for name in names}
    for number in range(0, len(names), 2):
        ax.axhspan(number - 0.5, number + 0.5, color="0.95", lw=0)
    for number, (group, scores) in enumerate(groups.items()):
        # The dots of a name lie around its line, even where some groups lack the name.
        offsets = [shared[name].index(group) - (len(shared[name]) - 1) / 2 for name in scores]
        rows = np.array([names.index(name) for name in scores]) + 0.25 * np.array(offsets)
        means = np.array([score.mean for score in scores.values()])
        ends = np.array([score.interval for score in scores.values()]).T
        reach = np.clip([means - ends[0], ends[1] - means], 0, None)
        style = {"fmt": "osD^"[number % 4], "ms": 5, "capsize": 2.5, "color": SAFE_COLORS[number % len(SAFE_COLORS)]}
        ax.errorbar(means, rows, xerr=reach, label=group, **style)
    ax.set_yticks(range(len(names)), names)
    ax.set(xlim=(-3, 103), ylim=(len(names) - 0.5, -0.5), xlabel="success (0-100) with 95 % interval")
    ax.set_title(title, fontsize=10)
    if len(groups) > 1:
        fig.legend(fontsize=8, loc="outside lower center", ncols=len(groups))
    ax.grid(axis="x", alpha=0.3)
    return fig


def show_failures(failures: Sequence[tuple[str, Failure]], columns: int = 2) -> Figure:
    """A gallery: the scene with pick and place beside both action maps, the reason underneath.

    A ring marks the pick, a square the place; the line at each points along the tool's yaw. Action maps lie over a
    gray picture of the scene: the brighter a cell, the higher its probability (`action_share`).
    """
    rows = -(-len(failures) // columns)
    fig = plt.figure(figsize=(3.6 * columns + 0.8, 3.3 * rows), layout="constrained")
    gallery, scale = fig.subfigures(1, 2, width_ratios=(3.6 * columns, 0.8))
    for part, (title, failure) in zip(gallery.subfigures(rows, columns, squeeze=False).flat, failures, strict=False):
        trio = part.subplots(1, 3)
        action = failure.choice.action
        trio[0].imshow(failure.choice.heightmap.rgb)
        _draw_shares(trio[1], failure.choice, failure.choice.pick_logits)
        _draw_shares(trio[2], failure.choice, failure.choice.place_logits)
        _ring(trio[0], action.pick, failure.choice.heightmap.workspace, PICK_COLOR, "o")
        _ring(trio[0], action.place, failure.choice.heightmap.workspace, PLACE_COLOR, "s")
        height, width = failure.choice.heightmap.workspace.shape
        for ax, name in zip(trio, ("scene", "pick", "place"), strict=True):
            bare(ax, name).set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        caption = [title, f'"{failure.choice.instruction}"', *textwrap.wrap(failure.reason, 60)]
        part.supxlabel("\n".join(caption), x=0.02, ha="left", fontsize=8)
    bar = scale.colorbar(ScalarMappable(Normalize(0, 1), MAP_COLORS), cax=scale.add_axes((0.1, 0.3, 0.15, 0.45)))
    bar.set_label(SHARE_LABEL, fontsize=8)
    return fig


def _draw_shares(ax: Axes, choice: Choice, logits: np.ndarray) -> None:
    """An action map over a gray picture of its scene: it covers the picture where the probability is high.

    A cell shows the largest share within one cell of it, so that a single best cell is seen.
    """
    share = maximum_filter(action_share(logits), size=3)
    cover = np.minimum(1.0, 4 * share)[..., None]
    gray = 0.35 + 0.35 * choice.heightmap.rgb.mean(axis=2, keepdims=True) / 255
    ax.imshow(cover * plt.get_cmap(MAP_COLORS)(share)[..., :3] + (1 - cover) * gray)


def _ring(ax: Axes, pose: Pose2, workspace: Workspace, color: str, mark: str) -> None:
    """An open mark around a pose, so that the thing inside stays visible, with a short line along the yaw."""
    row, col = workspace.to_pixel(pose.x, pose.y)
    drow, dcol = rotation_matrix(pose.yaw) @ np.array([0.0, 1.0])
    line = np.array([7.0, 13.0])
    ax.plot(col, row, mark, ms=11, mfc="none", mec=color, mew=1.4, path_effects=OUTLINE)
    ax.plot(col + line * dcol, row + line * drow, color=color, lw=1.4, path_effects=OUTLINE)
