"""Drawings of trainings and comparisons: losses, success against demonstrations, tables, failures."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from drawings.plot_shared import LEAST_LOGIT, action_map, to_picture
from failures import Failure
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
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
BOXES = {
    "GEM": (
        (("RGB-D from above", 1, 0), ("semantic map of the phrase,\nby CLIP, from all views", 0, 0),
         ("pick: words\nplace: crop at the pick", 2, 0)),
        (("map, refined: it gates", 0, 1), ("U-Net with the words", 1, 1), ("kernel network", 2, 1)),
        "one kernel,\nsteered to 36 angles",
    ),
    "CLIPort": (
        (("CLIP's features from above:\nlast and inner ones", 0, 0), ("RGB-D from above", 1, 0),
         ("place: crop at the pick,\nturned 36 times", 2, 0)),
        (("semantic stream,\ntimes words at three levels", 0, 1), ("spatial stream: U-Net", 1, 1),
         ("both streams again", 2, 1)),
        "pick: none (36 channels)\nplace: 36 crops' features",
    ),
    "Transporter-Lan": (
        (("RGB-D from above", 1, 0), ("place: crop at the pick,\nturned 36 times", 2, 0)),
        (("U-Net with the words", 1, 1), ("U-Net with the words", 2, 1)),
        "pick: none (36 channels)\nplace: 36 crops' features",
    ),
}  # fmt: skip
"""For each method: boxes of inputs and of networks (text, line, column), and the text of the kernel's box."""


def readable(name: str) -> str:
    """The name of a task, a method or an ablation as figures show it; unknown names stay as they are."""
    if name in ABLATION_NAMES or name in TASK_NAMES:
        return (ABLATION_NAMES | TASK_NAMES)[name]
    for method in sorted(METHOD_NAMES, key=len, reverse=True):
        rest = name.removeprefix(method)
        if rest != name and (not rest or rest[1:] in ABLATION_NAMES):
            return METHOD_NAMES[method] + (f", {ABLATION_NAMES[rest[1:]]}" if rest else "")
    return name


def show_boxes() -> Figure:
    """Every method of `BOXES` as a group of rows: inputs, networks, kernel, scores. Grey is of the frozen CLIP."""
    fig, axes = plt.subplots(len(BOXES), 1, figsize=(10.6, 7.6), layout="constrained")
    for ax, (name, (inputs, networks, kernel)) in zip(axes, BOXES.items(), strict=True):
        color = METHOD_COLORS[name]
        bare(ax).set(xlim=(-0.5, 3.5), ylim=(2.5, -0.5))
        ax.spines[:].set_visible(False)
        ax.set_title(name, loc="left", color=color, fontweight="bold")
        for text, line, _ in inputs:
            _box(ax, 0, line, text, "0.6" if "CLIP" in text else "white", "black")
            _arrow(ax, (0.42, line), (0.58, line))
        for text, line, _ in networks:
            _box(ax, 1, line, text, color, color)
        _box(ax, 2, 2, kernel, "white", color)
        _arrow(ax, (1.42, 2), (1.58, 2))
        _box(ax, 3, 1, "scores of every action:\n36 angles x 160 x 80", "white", "black")
        _arrow(ax, (1.42, 1), (2.58, 1))
        ax.text(2.0, 0.86, "features", ha="center", fontsize=8)
        _arrow(ax, (2.42, 2), (2.75, 1.42))
        ax.text(2.72, 1.95, "correlate" + ("" if name == "GEM" else " (place)"), fontsize=8)
        if all(line > 0 for _, line, _ in networks):
            ax.text(0, 0, "no picture features of CLIP", fontsize=8, fontstyle="italic", ha="center", va="center")
        elif name == "CLIPort":
            _arrow(ax, (1.0, 0.64), (1.0, 0.36))
            ax.text(1.05, 0.5, "joins at every level", fontsize=8, va="center")
            _arrow(ax, (1.42, 0), (2.58, 0.76))
            ax.text(1.75, 0.12, "features of both streams: their sum", fontsize=8)
        else:
            _arrow(ax, (1.0, 0.36), (1.0, 0.64))
            ax.text(1.05, 0.5, "times", fontsize=8, va="center")
    for column, title in enumerate(("inputs", "networks", "kernel", "scores")):
        axes[0].text(column, -0.72, title, ha="center", fontsize=10, fontstyle="italic")
    legend = (
        "filled with colour: learned    grey: a picture or map of the frozen CLIP    "
        "white: another input, a kernel or the result    words: CLIP's embedding of the phrase, frozen"
    )
    fig.supxlabel(legend, fontsize=8)
    return fig


def _box(ax: Axes, column: float, line: float, text: str, fill: str, edge: str) -> None:
    """A box with a text in the middle; ``fill`` is made pale."""
    shape = FancyBboxPatch((column - 0.4, line - 0.3), 0.8, 0.6, "round,pad=0.02,rounding_size=0.06")
    shape.set(facecolor=fill, alpha=0.25, edgecolor="none")
    ax.add_patch(shape)
    outline = FancyBboxPatch((column - 0.4, line - 0.3), 0.8, 0.6, "round,pad=0.02,rounding_size=0.06")
    outline.set(facecolor="none", edgecolor=edge, linewidth=1.2)
    ax.add_patch(outline)
    ax.text(column, line, text, ha="center", va="center", fontsize=8)


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], style: str = "->") -> None:
    ax.annotate("", end, start, arrowprops={"arrowstyle": style, "lw": 1.2})


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
            ax.imshow(2 * np.round(action_map(logits) / 2), cmap=MAP_COLORS, vmin=-20, vmax=0)
            ax.plot(col, row, mark, ms=9, mfc="none", mec=color, mew=2, path_effects=OUTLINE)
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
            above.plot(col, row, mark, mfc="none", mec=color, ms=9, mew=2, path_effects=OUTLINE)
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


def show_failures(failures: Sequence[tuple[str, Failure]], columns: int = 4) -> Figure:
    """A gallery: the scene with pick and place beside both action maps, the reason underneath.

    A ring marks the pick, a square the place; the line at each points along the tool's yaw. Action maps lie over a
    dim picture of the scene, and only where a score is less than 20 below the best.
    """
    rows = -(-len(failures) // columns)
    fig = plt.figure(figsize=(3.1 * columns, 2.7 * rows), layout="constrained")
    parts = fig.subfigures(rows, columns, squeeze=False).flat
    for part, (title, failure) in zip(parts, failures, strict=False):  # the last row may be short
        trio = part.subplots(1, 3)
        choice = failure.choice
        workspace = choice.heightmap.workspace
        trio[0].imshow(choice.heightmap.rgb)
        _ring(trio[0], choice.action.pick, workspace, PICK_COLOR, "o")
        _ring(trio[0], choice.action.place, workspace, PLACE_COLOR, "s")
        trio[0].set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
        dim = np.repeat(choice.heightmap.rgb.mean(axis=2, keepdims=True) / 400, 3, axis=2)
        for ax, logits in zip(trio[1:], (choice.pick_logits, choice.place_logits), strict=True):
            scores = action_map(logits)
            ax.imshow(dim)
            ax.imshow(scores, cmap=MAP_COLORS, vmin=LEAST_LOGIT, vmax=0, alpha=(scores > LEAST_LOGIT).astype(float))
        for ax, name in zip(trio, ("scene", "pick", "place"), strict=True):
            bare(ax, name)
        caption = [title, f'"{choice.instruction}"', *textwrap.wrap(failure.reason, 52)]
        part.supxlabel("\n".join(caption), x=0.02, ha="left", fontsize=7.5)
    return fig


def _ring(ax: Axes, pose: Pose2, workspace: Workspace, color: str, mark: str) -> None:
    """An open mark around a pose, so that the thing inside stays visible, with a short line along the yaw."""
    row, col = workspace.to_pixel(pose.x, pose.y)
    drow, dcol = rotation_matrix(pose.yaw) @ np.array([0.0, 1.0])
    line = np.array([7.0, 13.0])
    ax.plot(col, row, mark, ms=11, mfc="none", mec=color, mew=1.4, path_effects=OUTLINE)
    ax.plot(col + line * dcol, row + line * drow, color=color, lw=1.4, path_effects=OUTLINE)
