"""Drawings of relative angles: crops, kernels, actions on the table, place maps, predicted against right angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import matplotlib.pyplot as plt
import numpy as np
import torch
from drawings.plot_kernels import SIGNED
from drawings.plot_shared import to_picture
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gem_lite.actions import PickPlace
from gem_lite.drawing.plots import MAP_COLORS, PICK_COLOR, PLACE_COLOR, bare, draw_gripper
from gem_lite.policies.inputs import HEIGHT_SCALE, RGBD
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2


@dataclass(frozen=True)
class ActionColumn:
    """A column of `show_actions`: a titled table from above, and an action."""

    title: str
    heightmap: HeightMap
    action: PickPlace


def show_actions(columns: Sequence[ActionColumn], suptitle: str = "", width: float = 1.75) -> Figure:
    """Tables side by side with pick (cyan) and place (orange)."""
    fig, axes = plt.subplots(
        1, len(columns), figsize=(width * len(columns), 2 * width + 0.9), squeeze=False, layout="compressed"
    )
    for ax, column in zip(axes[0], columns, strict=True):
        _draw_action(ax, column)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_crop(crop: torch.Tensor, suptitle: str = "") -> Figure:
    """A crop (5, h, h): its picture, then its channels red, green and blue, height, and pick map.

    Each of the three colours is drawn in its own colour, on one scale for all three, up to the brightest pixel.
    """
    fig = plt.figure(figsize=(9.6, 2.3), layout="constrained")
    grid = fig.add_gridspec(1, 6)
    picture = to_picture(crop)
    brightest = max(float(picture.max()), 1e-6)
    for channel, name in enumerate(("red", "green", "blue")):
        one_color = np.zeros_like(picture)
        one_color[..., channel] = picture[..., channel] / brightest
        title = f"{name}\n{picture[..., channel].min():.2f} to {picture[..., channel].max():.2f}"
        bare(fig.add_subplot(grid[channel + 1]), title).imshow(one_color)
    height_ax, map_ax = (bare(fig.add_subplot(grid[i]), name) for i, name in ((4, "height (mm)"), (5, "pick map")))
    height = height_ax.imshow(1000 * HEIGHT_SCALE * crop[RGBD - 1], cmap="viridis", vmin=0)
    semantic = map_ax.imshow(crop[RGBD], cmap=MAP_COLORS, vmin=0, vmax=1)
    fig.colorbar(height, ax=height_ax, shrink=0.8)
    fig.colorbar(semantic, ax=map_ax, shrink=0.8)
    bare(fig.add_subplot(grid[0]), "the picture").imshow(picture)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_correlation(
    kernel: torch.Tensor, features: torch.Tensor, answer: ActionColumn, scores: np.ndarray, suptitle: str = ""
) -> Figure:
    """What a place module correlates, and what comes out: kernel above features, the action, scores over the angle.

    Args:
        kernel: (C, h, h); its channels share one scale.
        features: (C, H, W); each channel has its own scale.
        answer: the table with the action that was read off.
        scores: logits (R,) over the angle bins, above the pixel of the place.
    """
    count = len(kernel)
    fig = plt.figure(figsize=(1.5 * count + 5.4, 4.6), layout="constrained")
    grid = fig.add_gridspec(2, count + 2, height_ratios=(1, 1.7), width_ratios=(*(1,) * count, 1.3, 2.1))
    top = float(kernel.abs().max())
    for i in range(count):
        bare(fig.add_subplot(grid[0, i]), f"kernel {i}").imshow(kernel[i], cmap=SIGNED, vmin=-top, vmax=top)
        peak = float(features[i].abs().max())
        title = f"features {i}\n(±{peak:.1f})"
        bare(fig.add_subplot(grid[1, i]), title).imshow(features[i] / peak, cmap=SIGNED, vmin=-1, vmax=1)
    _draw_action(fig.add_subplot(grid[:, count]), answer)
    ax = fig.add_subplot(grid[:, count + 1])
    angles, values = _centred(scores)
    ax.plot(angles, values, "o-", ms=3, color="C0")
    ax.plot(angles[values.argmax()], values.max(), "s", ms=8, mfc="none", mec=PLACE_COLOR, mew=2)
    ax.set(xlabel="Δ (degrees)", ylabel="logit", xticks=[-180, -90, 0, 90, 180])
    ax.set_title("scores at the place", fontsize=9)
    ax.grid(alpha=0.3)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def _draw_action(ax: Axes, column: ActionColumn) -> None:
    """A titled table from above with the grippers of an action. It is drawn brighter than it is."""
    w = column.heightmap.workspace
    bare(ax, column.title).imshow((column.heightmap.rgb / 255) ** 0.5)
    draw_gripper(ax, column.action.pick, w, PICK_COLOR, "pick")
    draw_gripper(ax, column.action.place, w, PLACE_COLOR, "place")
    ax.set(xlim=(-0.5, w.shape[1] - 0.5), ylim=(w.shape[0] - 0.5, -0.5))


def _centred(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (R,) over the angle bins, R even, from -180 to 180 degrees: angles (R + 1,) and values (R + 1,)."""
    rolled = np.roll(values, len(values) // 2)
    return np.linspace(-180, 180, len(values) + 1), np.append(rolled, rolled[0])


def show_turning(
    column: ActionColumn, kernel: torch.Tensor, curves: dict[str, np.ndarray], right: PickPlace, lowest: float = -100.0
) -> Figure:
    """A frame of an animation: pick, kernel and place of a scene, beside them the scores over the relative angle.

    Args:
        column: the scene, and the action of the first curve's policy.
        kernel: (h, h), a channel of the kernel that the first curve's policy makes from the crop at the pick.
        curves: for each policy, logits (R,) over the angle bins, drawn below their best. The first is a full line; the
            others are dashed. Every peak has a mark.
        right: the right action: the middle of the pictures, and a vertical line at its relative angle.
        lowest: the lower end of the axis, below the best logit.
    """
    fig = plt.figure(figsize=(7.4, 4.8))
    grid = fig.add_gridspec(3, 2, width_ratios=(1, 2.7), left=0.01, right=0.98, bottom=0.11, top=0.88, hspace=0.24)
    for row, pose, name in ((0, right.pick, "at the pick"), (2, right.place, "at the goal")):
        ax = fig.add_subplot(grid[row, 0])
        _draw_action(ax, replace(column, title=name))
        center = column.heightmap.workspace.to_pixel(pose.x, pose.y)
        half = kernel.shape[-1] / 2
        ax.set(xlim=(center[1] - half, center[1] + half), ylim=(center[0] + half, center[0] - half))
    top = float(kernel.abs().max())
    bare(fig.add_subplot(grid[1, 0]), "kernel").imshow(kernel, cmap=SIGNED, vmin=-top, vmax=top)
    ax = fig.add_subplot(grid[:, 1])
    ax.axvline(np.degrees(right.delta), color="0.6", lw=5, alpha=0.6, label="right Δ")
    for i, (name, logits) in enumerate(curves.items()):
        angles, values = _centred(logits - logits.max())
        ax.plot(angles, values, "--" if i else "-", lw=1.8, color=f"C{i}", label=name)
        ax.plot(angles[values.argmax()], 0, "D" if i else "o", ms=7, color=f"C{i}")
    ax.set(xlim=(-185, 185), ylim=(lowest, -lowest / 8), xticks=[-180, -90, 0, 90, 180], xlabel="Δ (degrees)")
    ax.set_title("logit - best logit, at the chosen pixel", fontsize=9)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, ncols=len(curves) + 1, loc="upper center")
    fig.suptitle(column.title, fontsize=10)
    return fig


def show_deltas(
    panels: Sequence[tuple[str, np.ndarray, np.ndarray]], shown: Sequence[float], suptitle: str = ""
) -> Figure:
    """Predicted against right relative angles (radians), one panel for each method.

    Args:
        panels: title, right angles (N,), predicted angles (N,).
        shown: the relative angles that training showed, drawn as vertical lines.
    """
    fig, axes = plt.subplots(
        1, len(panels), figsize=(2.75 * len(panels) + 0.5, 3.6), sharey=True, squeeze=False, layout="constrained"
    )
    for ax, (title, right, predicted) in zip(axes[0], panels, strict=True):
        ax.plot([-180, 180], [-180, 180], color="0.7", lw=1, label="right")
        for i, angle in enumerate(shown):
            ax.axvline(np.degrees(angle), color="C1", lw=1, ls="--", label="" if i else "shown in training")
        x, wrapped, error = (np.degrees(np.angle(np.exp(1j * a))) for a in (right, predicted, predicted - right))
        y = np.where(abs(x + error) < 195, x + error, wrapped)  # near 180° a right answer stays on the diagonal
        ax.plot(x, y, "o", ms=4.5, color="C0", alpha=0.75)
        ticks = [-180, -90, 0, 90, 180]
        ax.set(xlabel="right Δ (degrees)", xticks=ticks, yticks=ticks, xlim=(-195, 195), ylim=(-195, 195))
        ax.set_aspect("equal")
        ax.set_title(title, fontsize=9)
        ax.grid(alpha=0.3)
    axes[0, 0].set_ylabel("predicted Δ (degrees)")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    fig.suptitle(suptitle, fontsize=10)
    return fig


@dataclass(frozen=True)
class CloseUp:
    """A panel of `show_closeups`: a titled table from above, where a gripper went and where it should have gone."""

    title: str
    heightmap: HeightMap
    chosen: Pose2
    right: Pose2


def show_closeups(panels: Sequence[CloseUp], suptitle: str = "", radius: float = 0.11) -> Figure:
    """The table around the right place and its heights: the chosen pose is orange with a square, the right pose white.

    Args:
        radius: distance (m) from the right place to the edge of the picture.
    """
    fig, axes = plt.subplots(2, len(panels), figsize=(1.9 * len(panels) + 0.6, 4.5), squeeze=False, layout="compressed")
    for column, panel in zip(axes.T, panels, strict=True):
        w = panel.heightmap.workspace
        bare(column[0], panel.title).imshow(panel.heightmap.rgb)
        heights = bare(column[1]).imshow(1000 * panel.heightmap.height, cmap="viridis", vmin=0, vmax=70)
        row, col = w.to_pixel(panel.right.x, panel.right.y)
        half = radius / w.pixel
        draw_gripper(column[0], panel.right, w, "white")
        draw_gripper(column[0], panel.chosen, w, PLACE_COLOR)
        for ax in column:
            ax.set(xlim=(col - half, col + half), ylim=(row + half, row - half))
    fig.colorbar(heights, ax=axes[1], shrink=0.8, label="height (mm)")
    fig.suptitle(suptitle, fontsize=10)
    return fig
