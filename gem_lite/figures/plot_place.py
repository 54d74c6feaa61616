"""Drawings of relative angles: actions on the table, place maps, and predicted against right angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.figure import Figure

from gem_lite.actions import PickPlace
from gem_lite.figures.plot_kernels import SIGNED
from gem_lite.figures.plots import PICK_COLOR, PLACE_COLOR, action_map, bare, draw_gripper
from gem_lite.policies.samples import HEIGHT_SCALE, RGBD, to_picture
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2


@dataclass(frozen=True)
class ActionColumn:
    """A column of `show_actions`: a titled table from above, an action, and the place logits (R, H, W), if any."""

    title: str
    heightmap: HeightMap
    action: PickPlace
    logits: np.ndarray | None = None


def show_actions(columns: Sequence[ActionColumn], suptitle: str = "", width: float = 1.75) -> Figure:
    """Tables side by side with pick (green) and place (red). Action maps are below, if the columns have logits."""
    has_maps = columns[0].logits is not None
    maps = [action_map(column.logits) for column in columns] if has_maps else []
    low = min((float(np.percentile(scores, 1)) for scores in maps), default=0.0)
    fig, axes = plt.subplots(
        1 + has_maps, len(columns),
        figsize=(width * len(columns) + 0.8 * has_maps, 2 * width * (1 + has_maps) + 0.9),
        squeeze=False, layout="compressed",
    )  # fmt: skip
    for i, (panels, column) in enumerate(zip(axes.T, columns, strict=True)):
        w = column.heightmap.workspace
        bare(panels[0], column.title).imshow(column.heightmap.rgb)
        draw_gripper(panels[0], column.action.pick, w, PICK_COLOR, "pick")
        draw_gripper(panels[0], column.action.place, w, PLACE_COLOR, "place")
        if has_maps:
            map_image = bare(panels[1]).imshow(maps[i], cmap="viridis", vmin=low, vmax=0)
            row, col = w.to_pixel(column.action.place.x, column.action.place.y)
            panels[1].plot(col, row, "o", ms=11, mfc="none", mec=PLACE_COLOR, mew=1.5)
        for ax in panels:
            ax.set(xlim=(-0.5, w.shape[1] - 0.5), ylim=(w.shape[0] - 0.5, -0.5))
    if has_maps:
        fig.colorbar(map_image, ax=axes[1], shrink=0.8, label="logit - best logit")
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_crop(crop: torch.Tensor, suptitle: str = "") -> Figure:
    """The five channels of a crop (5, h, h): colours in their own colour, height, and pick map."""
    fig, axes = plt.subplots(1, 5, figsize=(8.2, 2.3), layout="constrained")
    picture = to_picture(crop)
    for channel, (ax, name) in enumerate(zip(axes, ("red", "green", "blue"), strict=False)):
        one_color = np.zeros_like(picture)
        one_color[..., channel] = picture[..., channel]
        bare(ax, name).imshow(one_color)
    height = bare(axes[3], "height (mm)").imshow(1000 * HEIGHT_SCALE * crop[RGBD - 1], cmap="viridis", vmin=0)
    semantic = bare(axes[4], "pick map").imshow(crop[RGBD], cmap=SIGNED, vmin=-1.2, vmax=1.2)
    for ax, image in ((axes[3], height), (axes[4], semantic)):
        fig.colorbar(image, ax=ax, shrink=0.8)
    fig.suptitle(suptitle, fontsize=10)
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
    """The table around the right place and its heights: the chosen pose is black, the right pose white.

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
        draw_gripper(column[0], panel.chosen, w, "black")
        for ax in column:
            ax.set(xlim=(col - half, col + half), ylim=(row + half, row - half))
    fig.colorbar(heights, ax=axes[1], shrink=0.8, label="height (mm)")
    fig.suptitle(suptitle, fontsize=10)
    return fig
