"""Drawings of a pick network: its stages, its training, and its action map when things move."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from drawings.plot_kernels import SIGNED
from drawings.plot_shared import to_picture
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from scipy.ndimage import maximum_filter

from gem_lite.drawing.plots import OUTLINE, PICK_COLOR, bare, draw_gripper
from gem_lite.policies.inputs import Sample
from gem_lite.se2 import Pose2, Workspace

DPI = 72
"""The resolution of pictures with many maps: smooth colours make large files."""
SCORE_COLORS = SymLogNorm(linthresh=10, vmin=-1000, vmax=0)
"""Colours of action maps, by how far a score lies below the best: linear to 10 below it, from there logarithmic.

Networks differ: bare table may lie 50 below the best score, or 500.
"""
CLOSE_UP = 11.0
"""Half the side (pixels) of the square in which `show_peak_rule` looks at a pick from near."""


def show_stages(
    maps: Sequence[tuple[str, np.ndarray]],
    kernels: Sequence[tuple[str, np.ndarray]],
    logits: np.ndarray,
    workspace: Workspace,
) -> Figure:
    """Stages of a pick: maps (H, W), the action map of logits (R, H, W) with its best pixel, and kernels (h, h).

    Maps and kernels have a scale each, red where positive and blue where negative. NaN is grey.
    """
    columns = len(maps) + 2
    fig = plt.figure(figsize=(1.9 * columns, 4.6), layout="constrained", dpi=DPI)
    grid = fig.add_gridspec(len(kernels), columns, width_ratios=[1] * (columns - 1) + [0.75])
    spots = [fig.add_subplot(grid[:, i]) for i in range(columns - 1)]
    for ax, (title, panel) in zip(spots, maps, strict=False):
        _signed(bare(ax, f"{title}, channel 0"), panel, "bottom")
    best = np.unravel_index(int(logits.argmax()), logits.shape)[1:]
    image = _show_scores(spots[-1], logits, Pose2(*workspace.to_world(*best), 0), workspace)
    spots[-1].set_title("best score of each pixel", fontsize=9)
    _score_bar(image, spots[-1], location="bottom")
    for row, (title, panel) in enumerate(kernels):
        _signed(bare(fig.add_subplot(grid[row, -1]), title), panel, "right")
    return fig


def show_samples(samples: Sequence[Sample], workspace: Workspace) -> Figure:
    """What training reads of each sample: the picture with the pick's label, and the pick's map below it."""
    fig, axes = plt.subplots(
        2, len(samples), figsize=(1.5 * len(samples), 5.6), squeeze=False, layout="constrained", dpi=DPI
    )
    for i, (column, sample) in enumerate(zip(axes.T, samples, strict=True)):
        bare(column[0], f"sample {i}").imshow(to_picture(sample.rgbd))
        map_image = bare(column[1]).imshow(sample.maps["pick"][0], cmap=SIGNED, vmin=-1.2, vmax=1.2)
        label = Pose2(*workspace.to_world(*sample.pick), sample.pick_yaw)
        for ax in column:
            draw_gripper(ax, label, workspace, PICK_COLOR)
            ax.set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
    axes[0, 0].set_ylabel("picture and label", fontsize=9)
    axes[1, 0].set_ylabel("map of the pick phrase", fontsize=9)
    fig.colorbar(map_image, ax=axes[1], shrink=0.8, label="map")
    return fig


def show_loss(losses: Sequence[float], levels: dict[str, float], window: int = 20) -> Figure:
    """The loss of each training step and its mean over ``window`` steps, with named levels to compare with."""
    fig, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    ax.plot(losses, color="0.75", lw=0.8, label="each step")
    means = np.convolve(losses, np.ones(window) / window, mode="valid")
    ax.plot(np.arange(len(means)) + window - 1, means, color="C0", lw=2, label=f"mean of the last {window}")
    for i, (name, level) in enumerate(levels.items()):
        ax.axhline(level, color=f"C{i + 1}", ls="--", lw=1.2, label=f"{name}: {level:.2f}")
    ax.set(xlabel="step", ylabel="cross-entropy (nats)", ylim=(0, 1.35 * max(levels.values())))
    fig.legend(loc="outside upper center", ncols=2, fontsize=8)
    ax.grid(alpha=0.3)
    return fig


def show_yaws(truth: np.ndarray, chosen: dict[str, np.ndarray], symmetry: float) -> Figure:
    """Chosen yaws (N,) against true ones (N,), radians, modulo ``symmetry``.

    Points on the grey line are right; points on the dotted lines are a quarter of ``symmetry`` off.
    """
    period = np.degrees(symmetry)
    fig, ax = plt.subplots(figsize=(4.9, 4.0), layout="constrained")
    ax.plot([0, period], [0, period], color="0.7", lw=5, zorder=0, label="right")
    for i, (name, yaws) in enumerate(chosen.items()):
        ax.plot(np.degrees(truth) % period, np.degrees(yaws) % period, "osD^"[i % 4], ms=5, color=f"C{i}", label=name)
    for start, label in ((0.25, f"{period / 4:.0f}° off"), (0.75, None), (-0.25, None), (-0.75, None)):
        ax.axline((0, start * period), slope=1, color="0.6", ls=":", zorder=0, label=label)
    ticks = np.arange(0, period + 1, period / 4)
    ax.set(
        xlabel="the bar's yaw (degrees)", ylabel=f"chosen pick yaw, modulo {period:.0f}°", xticks=ticks, yticks=ticks,
        xlim=(-4, period + 4), ylim=(-4, period + 4),
    )  # fmt: skip
    ax.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    ax.grid(alpha=0.3)
    return fig


def show_choices(cases: Sequence[tuple[str, np.ndarray, np.ndarray, Pose2]], workspace: Workspace) -> Figure:
    """Scenes (H, W, 3) with the chosen pick, above their action maps from logits (R, H, W), all on one scale.

    Each cell of an action map shows the best of the 3 x 3 cells around it: single cells would be hard to see.
    """
    fig, axes = plt.subplots(
        2, len(cases), figsize=(1.6 * len(cases) + 0.7, 6.0), squeeze=False, layout="constrained", dpi=DPI
    )
    for (above, below), (title, picture, logits, pose) in zip(axes.T, cases, strict=True):
        bare(above, title).imshow(picture)
        draw_gripper(above, pose, workspace, PICK_COLOR)
        map_image = _show_scores(below, logits, pose, workspace)
        above.set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
    _score_bar(map_image, axes[1])
    return fig


def show_progress(
    picture: np.ndarray, logits: np.ndarray, pose: Pose2, losses: Sequence[float], steps: int, workspace: Workspace
) -> Figure:
    """One moment of a training: a scene (H, W, 3) with the best pick, its action map as in `show_choices`, the losses.

    Args:
        logits: (R, H, W), of the network at this moment.
        losses: one for each step that is done, of ``steps``; a dot shows the mean of the last ten.
    """
    fig, (scene, scores, curve) = plt.subplots(
        1, 3, figsize=(6.6, 3.7), width_ratios=[1, 1.25, 1.6], layout="constrained", dpi=DPI
    )
    bare(scene, "best pick").imshow(picture)
    draw_gripper(scene, pose, workspace, PICK_COLOR)
    scene.set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
    fig.colorbar(
        _show_scores(scores, logits, pose, workspace, levels=10), ax=scores, shrink=0.8, label="score - best score"
    )
    bare(scores, "action map")
    curve.plot(losses, color="0.6", lw=0.8)
    if losses:
        recent = np.mean(losses[-10:])
        curve.plot(len(losses), recent, "o", ms=6, color="C0")
    curve.set(xlim=(0, steps), ylim=(0, 18), xlabel="step", ylabel="loss (nats)")
    curve.set_title(f"after {len(losses)} steps", fontsize=9)
    curve.grid(alpha=0.3)
    return fig


def show_grasps(
    cases: Sequence[tuple[str, np.ndarray, Pose2]], middle: tuple[float, float], reach: float, workspace: Workspace
) -> Figure:
    """Chosen picks on scenes (H, W, 3), seen from near: the square of ``reach`` (m) about ``middle`` (x, y)."""
    fig, axes = plt.subplots(
        1, len(cases), figsize=(2.2 * len(cases), 2.5), squeeze=False, layout="constrained", dpi=DPI
    )
    row, col = workspace.to_pixel(*middle)
    half = reach / workspace.pixel
    for ax, (title, picture, pose) in zip(axes[0], cases, strict=True):
        bare(ax, title).imshow(picture)
        draw_gripper(ax, pose, workspace, PICK_COLOR)
        ax.set(xlim=(col - half, col + half), ylim=(row + half, row - half))
    return fig


def show_peak_rule(
    cases: Sequence[tuple[str, np.ndarray, np.ndarray, np.ndarray, Pose2, Pose2]], workspace: Workspace
) -> Figure:
    """What `choosing.near_peak` changes, a row for each case: scene and semantic map, whole and from near.

    The allowed cells are outlined on the maps. The square that is seen from near lies about the pick with the rule.

    Args:
        cases: title, picture (H, W, 3), map (H, W), allowed cells (H, W) bool, and the picks without and with the rule.
    """
    fig = plt.figure(figsize=(7.8, 3.4 * len(cases)), layout="constrained", dpi=DPI)
    rows = fig.subfigures(len(cases), 1, squeeze=False)[:, 0]
    # Quarters of cells, so that an outline has the corners of the cells.
    quarters = [np.arange(4 * side) / 4 - 0.375 for side in workspace.shape]
    for row_fig, (title, picture, semantic, allowed, without, with_rule) in zip(rows, cases, strict=True):
        row_fig.suptitle(title, fontsize=10)
        axes = row_fig.subplots(1, 4, width_ratios=[1, 1, 1.9, 1.9])
        spots = [workspace.to_pixel(pose.x, pose.y) for pose in (without, with_rule)]
        (row, col), reach = spots[1], CLOSE_UP
        for i, ax in enumerate(axes):
            if i % 2:
                image = bare(ax).imshow(semantic, cmap="inferno", vmin=0, vmax=1)
                fine = np.kron(allowed, np.ones((4, 4)))
                ax.contour(*quarters[::-1], fine, levels=[0.5], colors="white", linewidths=1)
                ax.plot([], color="white", label="allowed cells")
            else:
                bare(ax).imshow(picture)
            for spot, marker, label in zip(spots, "ox", ("without the rule", "with the rule"), strict=True):
                size = 6 if i < 2 else 9
                ax.plot(*spot[::-1], marker, ms=size, mfc="none", mec="black", mew=3.5)
                ax.plot(*spot[::-1], marker, ms=size, mfc="none", mec=PICK_COLOR, mew=1.6, label=label)
            if i < 2:
                corner, side = (col - reach, row - reach), 2 * reach
                ax.add_patch(plt.Rectangle(corner, side, side, fill=False, ec="0.8", lw=0.8))
                corners = np.array([(0, 0), np.array(workspace.shape) - 1, *spots])  # a pick may lie off the table
                (top, left), (bottom, right) = corners.min(axis=0) - 0.5, corners.max(axis=0) + 0.5
                ax.set(xlim=(left, right), ylim=(bottom, top))
            else:
                ax.set(xlim=(col - reach, col + reach), ylim=(row + reach, row - reach), facecolor="0.7")
        for ax, name in zip(axes, ("scene", "map", "the square, scene", "the square, map"), strict=True):
            ax.set_title(name, fontsize=9)
        row_fig.colorbar(image, ax=axes[3], shrink=0.7, label="map")
    # The map's panel has all three entries. One of them is a white line.
    entries = rows[-1].axes[1].get_legend_handles_labels()
    fig.legend(*entries, fontsize=8, loc="outside lower center", ncols=3, facecolor="0.6")
    return fig


def _show_scores(ax: Axes, logits: np.ndarray, pose: Pose2, workspace: Workspace, levels: int = 256) -> AxesImage:
    """The action map of logits (R, H, W) in ``levels`` colours, by `SCORE_COLORS`, with a ring about a pick."""
    shown = maximum_filter(logits.max(axis=0) - logits.max(), size=3)
    image = bare(ax).imshow(shown, cmap=plt.get_cmap("viridis", levels), norm=SCORE_COLORS)
    row, col = workspace.to_pixel(pose.x, pose.y)
    ax.plot(col, row, "o", ms=11, mfc="none", mec=PICK_COLOR, mew=1.5, path_effects=OUTLINE)
    ax.set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
    return image


def _score_bar(image: AxesImage, ax: Axes | Sequence[Axes], location: str = "right") -> None:
    """The colour bar of action maps, beside or below their axes."""
    bar: Colorbar = image.figure.colorbar(
        image, ax=ax, location=location, shrink=0.85, ticks=[0, -10, -100, -1000], label="score - best score"
    )
    bar.ax.minorticks_off()
    bar.ax.tick_params(labelsize=8)
    bar.set_ticklabels(["0", "-10", "-100", "-1000"])


def _signed(ax: Axes, panel: np.ndarray, location: str) -> None:
    """A panel (H, W) in red and blue, with a colour bar; NaN is grey."""
    top = np.nanmax(np.abs(panel))
    ax.set_facecolor("0.7")
    bar = ax.figure.colorbar(ax.imshow(panel, cmap=SIGNED, vmin=-top, vmax=top), ax=ax, location=location, shrink=0.85)
    bar.ax.tick_params(labelsize=7)
    bar.ax.locator_params(nbins=3)
