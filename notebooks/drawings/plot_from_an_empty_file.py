"""A kernel that turns, an act with its logits, and losses: the figures of the lesson "GEM from an empty file"."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.drawing.plots import MAP_COLORS, PICK_COLOR, PLACE_COLOR, bare, draw_gripper
from gem_lite.se2 import Pose2, Workspace

BELOW = 60.0
"""Logits at most this far below the highest are drawn; what is lower is as dark."""


def show_kernel(kernel: np.ndarray, angle: float) -> Figure:
    """One frame: a kernel (h, h), turned by an angle (radians)."""
    fig, ax = plt.subplots(figsize=(2.6, 2.9))
    bare(ax, f"turned by {math.degrees(angle):.0f}°").imshow(kernel, cmap="gray", vmin=-0.3, vmax=1.1)
    return fig


def show_act(rgb: np.ndarray, picking: np.ndarray, placing: np.ndarray, pick: Pose2, place: Pose2) -> Figure:
    """The table (H, W, 3) with an act, and the logits (R, H, W) of pick and place at the best angle of each cell."""
    fig, axes = plt.subplots(1, 3, figsize=(6.6, 4.4), layout="constrained")
    bare(axes[0], "the act").imshow(rgb)
    draw_gripper(axes[0], pick, Workspace(), PICK_COLOR, "pick")
    draw_gripper(axes[0], place, Workspace(), PLACE_COLOR, "place")
    axes[0].legend(loc="lower right", fontsize=8)
    for ax, title, logits in zip(
        axes[1:], ("logits of the pick", "logits of the place"), (picking, placing), strict=True
    ):
        best = logits.max(axis=0)
        image = bare(ax, title).imshow(best - best.max(), cmap=MAP_COLORS, vmin=-BELOW, vmax=0)
    fig.colorbar(image, ax=axes, label="below the highest logit", shrink=0.7)
    return fig


def show_losses(history: np.ndarray, untaught: float) -> Figure:
    """The losses (steps, 2) of pick and place, and the loss of networks that know nothing."""
    fig, ax = plt.subplots(figsize=(5.2, 2.8), layout="constrained")
    ax.plot(history[:, 0], label="pick")
    ax.plot(history[:, 1], "--", label="place")
    ax.axhline(untaught, color="0.4", ls=":", label="knows nothing")
    ax.set(xlabel="step", ylabel="cross-entropy")
    ax.legend()
    return fig
