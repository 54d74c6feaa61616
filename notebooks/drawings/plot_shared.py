"""Drawings that several lessons use."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gem_lite.drawing.plots import bare
from gem_lite.policies.inputs import TABLE_GRAY
from gem_lite.rgbd.camera import View

LEAST_LOGIT = -20.0
"""Action maps are cut here: a cell 20 logits below the best has e^-20 of its probability."""
SHARE_LABEL = "(probability / the best one's) to the power 0.2"
"""What a colour bar says of `action_share`."""


def show_views(views: Sequence[View]) -> Figure:
    """The cameras' pictures above their depth."""
    fig, axes = plt.subplots(2, len(views), figsize=(3.4 * len(views), 5.0), layout="constrained")
    for column, view in zip(axes.T, views, strict=True):
        bare(column[0], f"{view.camera.name}: RGB").imshow(view.rgb)
        depth_image = bare(column[1], f"{view.camera.name}: depth").imshow(
            np.ma.masked_equal(view.depth, 0), cmap="viridis", vmin=0.4, vmax=1.8
        )
    fig.colorbar(depth_image, ax=axes[1], shrink=0.8, label="metres (white: not measured)")
    return fig


def to_picture(rgbd: torch.Tensor) -> np.ndarray:
    """(H, W, 3) float32 in [0, 1]: the colours of an output of `to_rgbd`, recoloured or not."""
    return (rgbd[:3] + TABLE_GRAY).clamp(0, 1).permute(1, 2, 0).numpy()


def action_map(logits: np.ndarray) -> np.ndarray:
    """Logits (R, H, W) to (H, W): each pixel's largest logit, minus the largest of all, at least `LEAST_LOGIT`.

    The best pixel is 0. These are logits and not probabilities: a trained policy's probabilities show one bright
    pixel on black.
    """
    return np.maximum(logits.max(axis=0) - logits.max(), LEAST_LOGIT)


def action_share(logits: np.ndarray) -> np.ndarray:
    """Logits (R, H, W) to (H, W): each pixel's largest probability, divided by the largest of all, to the power 0.2.

    The best pixel is 1, and a pixel of a thousandth of its probability 0.25. Without the power, a trained policy's map
    is one bright pixel on black.
    """
    return np.exp(0.2 * (logits.max(axis=0) - logits.max()))


def draw_zoom(
    ax: Axes, values: np.ndarray, row: float, col: float, box: tuple[float, float, float, float], reach: int = 8
) -> None:
    """The cells around (row, col) of an action map (H, W), enlarged.

    Args:
        box: where the enlarged part stands: left, bottom, width, height, as parts of the panel.
        reach: how many cells it shows to each side.
    """
    inset = ax.inset_axes(box)
    bare(inset).imshow(values, cmap="viridis", vmin=LEAST_LOGIT, vmax=0)
    inset.set(xlim=(col - reach - 0.5, col + reach + 0.5), ylim=(row + reach + 0.5, row - reach - 0.5))
    for edge in inset.spines.values():
        edge.set_color("white")
    ax.indicate_inset_zoom(inset, edgecolor="white", alpha=0.8)


def show_story(pictures: Sequence[tuple[str, np.ndarray]], suptitle: str = "") -> Figure:
    """A row of pictures (H, W, 3) with their titles."""
    widths = [picture.shape[1] / picture.shape[0] for _, picture in pictures]
    fig, axes = plt.subplots(
        1, len(pictures), figsize=(3.2 * sum(widths) + 0.3, 3.6), width_ratios=widths, layout="constrained"
    )
    for ax, (title, picture) in zip(np.atleast_1d(axes), pictures, strict=True):
        bare(ax, title).imshow(picture)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_tables(tables: Sequence[tuple[str, np.ndarray]]) -> Figure:
    """Small arrays (H, W) with every entry written into its cell."""
    width = sum(table.shape[1] for _, table in tables)
    fig, axes = plt.subplots(
        1, len(tables), figsize=(0.62 * width + 1, 3.0), width_ratios=[t.shape[1] for _, t in tables],
        layout="constrained",
    )  # fmt: skip
    for ax, (title, table) in zip(np.atleast_1d(axes), tables, strict=True):
        bare(ax, title).imshow(table, cmap="Blues", vmin=table.min(), vmax=2 * table.max() - table.min())
        for (row, col), value in np.ndenumerate(table):
            ax.text(col, row, f"{value:.3g}", ha="center", va="center", fontsize=9)
    return fig


def show_curves(x: Sequence[float], curves: dict[str, np.ndarray], xlabel: str, ylabel: str) -> Figure:
    """Named curves (N,) over x, from 0 upwards."""
    fig, ax = plt.subplots(figsize=(5.4, 3.2), layout="constrained")
    for name, values in curves.items():
        ax.plot(x, values, "o-", label=name)
    ax.set(xlabel=xlabel, ylabel=ylabel, ylim=(0, None))
    ax.legend()
    ax.grid(alpha=0.3)
    return fig
