"""Drawings of lesson 03: the demonstrations' crops, and the crops that a phrase retrieves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.actions import GripperState
from gem_lite.figures.plots import MAP_COLORS, PICK_COLOR, PLACE_COLOR, bare, draw_gripper
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2
from gem_lite.simulation.floating_tool import LOG_EVERY, RATE


def show_trace(trace: Sequence[GripperState], events: Sequence[tuple[str, Pose2]], heightmap: HeightMap) -> Figure:
    """A gripper's path over the table, and its holding signal over time with the events at its edges."""
    w = heightmap.workspace
    event_colors = {"pick": PICK_COLOR, "place": PLACE_COLOR}
    fig, axes = plt.subplots(1, 2, figsize=(8.6, 4.6), width_ratios=[1, 2.4], layout="constrained")
    bare(axes[0], "over the table").imshow(heightmap.rgb)
    rows, cols = w.to_pixel(np.array([s.x for s in trace]), np.array([s.y for s in trace]))
    holding = np.array([s.holding for s in trace])
    axes[0].plot(cols, rows, color="0.75", lw=1, ls="--", label="empty")
    axes[0].plot(cols[holding], rows[holding], color="white", lw=2, label="holding")
    for kind, pose in events:
        draw_gripper(axes[0], pose, w, event_colors[kind], kind)
    axes[0].set(xlim=(-0.5, w.shape[1] - 0.5), ylim=(w.shape[0] - 0.5, -0.5))
    axes[0].legend(
        fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=2, facecolor="0.5", labelcolor="white"
    )
    seconds = np.arange(len(trace)) * LOG_EVERY / RATE
    axes[1].step(seconds, holding, where="post", color="0.3", lw=2)
    edges = np.flatnonzero(np.diff(holding)) + 1
    for edge, (kind, _) in zip(edges, events, strict=True):
        axes[1].axvline(seconds[edge], color=event_colors[kind], lw=2, label=f"{kind} at {seconds[edge]:.1f} s")
    axes[1].set(xlabel="seconds", yticks=[0, 1], yticklabels=["empty", "holding"], ylim=(-0.15, 1.15))
    axes[1].set_title("what the suction tool says of itself", fontsize=9)
    axes[1].legend(fontsize=8, loc="center right")
    return fig


def show_crops(crops: Sequence[tuple[str, np.ndarray]], columns: int = 10, suptitle: str = "") -> Figure:
    """A grid of crops (S, S, 3), each under its phrase."""
    columns = min(columns, len(crops))
    rows = -(-len(crops) // columns)
    fig, axes = plt.subplots(
        rows, columns, figsize=(1.15 * columns + 0.2, 1.35 * rows + 0.3), squeeze=False, layout="constrained"
    )
    for ax in axes.flat:
        ax.axis("off")
    for ax, (phrase, crop) in zip(axes.flat, crops, strict=False):
        ax.imshow(crop)
        ax.set_title(phrase, fontsize=8)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_precision_recall(same: np.ndarray, other: np.ndarray, threshold: float) -> Figure:
    """Cosines of phrases that mean the same (N,) and of others (M,): histograms, and precision and recall."""
    fig, axes = plt.subplots(1, 2, figsize=(9.4, 3.4), layout="constrained")
    bins = np.linspace(min(same.min(), other.min()), 1, 45)
    axes[0].hist(other, bins, color="C7", alpha=0.8, label=f"{len(other)} pairs that mean something else")
    axes[0].hist(same, bins, color="C4", alpha=0.8, label=f"{len(same)} pairs that mean the same")
    axes[0].set(xlabel="cosine of the two phrases", ylabel="pairs")
    levels = np.unique(np.concatenate([same, other]))
    recall = np.array([(same >= level).mean() for level in levels])
    wrong = np.array([(other >= level).sum() for level in levels])
    axes[1].step(levels, recall * len(same) / (recall * len(same) + wrong), where="pre", color="C0", label="precision")
    axes[1].step(levels, recall, where="pre", color="C1", label="recall")
    axes[1].set(xlabel="threshold", ylim=(0, 1.05), xlim=(1 - 5 * (1 - threshold), 1 + 0.2 * (1 - threshold)))
    for ax in axes:
        ax.axvline(threshold, color="k", ls="--", lw=1, label=f"calibrated: {threshold:.3f}")
        ax.legend(fontsize=7, loc="lower left" if ax is axes[1] else "upper center")
        ax.grid(alpha=0.3)
    return fig


def show_synonyms(stored: dict[str, dict[str, float]], threshold: float, title: str = "") -> Figure:
    """Figure A8: stored phrases (yellow), with queries and their cosines around them; synonyms are purple."""
    fig, axes = plt.subplots(1, len(stored), figsize=(4.4 * len(stored), 4.3), layout="constrained")
    box = {"boxstyle": "round,pad=0.35", "ec": "0.4", "lw": 0.8}
    for ax, (phrase, queries) in zip(np.atleast_1d(axes), stored.items(), strict=True):
        angles = np.pi / 2 + 2 * np.pi * np.arange(len(queries)) / len(queries)
        for angle, (query, cosine) in zip(angles, queries.items(), strict=True):
            x = np.cos(angle)
            y = np.sin(angle)
            near = cosine >= threshold
            ax.plot([0, x], [0, y], color="#8e44ad" if near else "0.75", lw=2 if near else 1, zorder=1)
            ax.text(x, y, query, ha="center", va="center", fontsize=9, bbox={"fc": "#d7bde2" if near else "w", **box})
            ax.text(
                0.58 * x, 0.58 * y, f"{cosine:.3f}", ha="center", va="center", fontsize=8,
                bbox={"fc": "w", "ec": "none", "pad": 1},
            )  # fmt: skip
        ax.text(0, 0, phrase, ha="center", va="center", fontsize=10, bbox={"fc": "#f7dc6f", **box})
        ax.set(xlim=(-1.45, 1.45), ylim=(-1.2, 1.2))
        ax.axis("off")
    fig.suptitle(title, fontsize=10)
    return fig


@dataclass(frozen=True)
class Comparison:
    """A row of `show_comparison`: a phrase, its retrieved crop with a caption, its maps (H, W) by name, and the truth.

    ``target`` and ``pointed`` (one for each map) are (row, col) in the pictures' cells.
    """

    phrase: str
    crop: np.ndarray
    caption: str
    picture: np.ndarray
    maps: dict[str, np.ndarray]
    target: tuple[float, float]
    pointed: dict[str, tuple[float, float]]


def show_comparison(rows: Sequence[Comparison], pixel: float, suptitle: str = "") -> Figure:
    """Figure A1: for each phrase its crop, the scene and its maps; a cross where a map points, a circle at the truth.

    Args:
        pixel: side of a cell (m).
    """
    columns = 2 + len(rows[0].maps)
    fig, axes = plt.subplots(
        len(rows), columns, figsize=(2.25 * columns, 2.5 * len(rows) + 0.4), squeeze=False, layout="constrained"
    )
    for axs, row in zip(axes, rows, strict=True):
        bare(axs[0], row.caption).imshow(row.crop)
        axs[0].set_ylabel(f'"{row.phrase}"', fontsize=10)
        bare(axs[1], "the scene").imshow(row.picture)
        for ax, (name, semantic) in zip(axs[2:], row.maps.items(), strict=True):
            r, c = row.pointed[name]
            distance = 1000 * pixel * np.hypot(r - row.target[0], c - row.target[1])
            map_image = bare(ax, f"{name}: {distance:.0f} mm off").imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
            ax.plot(c, r, "x", color="#19c819", ms=8, mew=2)
        for ax in axs[1:]:
            ax.plot(row.target[1], row.target[0], "o", ms=13, mfc="none", mec="white", mew=1.2)
    fig.colorbar(map_image, ax=axes, shrink=0.5, aspect=40, label="0: typical cell, 1: typical match")
    fig.suptitle(suptitle, fontsize=10)
    return fig
