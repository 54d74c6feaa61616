"""Drawings of lesson 03: the demonstrations' crops, the search by phrase and its threshold, and the blended maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gem_lite.actions import GripperState
from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, bare, draw_gripper
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import plateau_centre
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2
from gem_lite.simulation.effectors import LOG_EVERY, RATE

SAME_COLOR, OTHER_COLOR = "#8e44ad", "0.45"
"""Purple: two phrases that mean the same, as in the paper's Figure A8. Grey: two that do not."""
NINES = (0.5, 0.9, 0.99, 0.999, 0.9999)
"""Cosines at the ticks of an axis on which each step from 0.9 on is ten times nearer to 1."""


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


def show_similarity(queries: Sequence[str], phrases: Sequence[str], cosines: np.ndarray) -> Figure:
    """Eq. 2 as a table: a row for each query, a column for each stored phrase, a frame around each row's largest.

    Args:
        cosines: (queries, phrases).
    """
    fig, ax = plt.subplots(figsize=(0.72 * len(phrases) + 1.6, 0.42 * len(queries) + 1.2), layout="constrained")
    ax.imshow(cosines, cmap="Purples", vmin=0, vmax=1.6, aspect="auto")
    for (row, col), value in np.ndenumerate(cosines):
        ax.text(col, row, f"{value:.2f}", ha="center", va="center", fontsize=8)
    for row, col in enumerate(cosines.argmax(axis=1)):
        ax.add_patch(plt.Rectangle((col - 0.48, row - 0.46), 0.96, 0.92, fill=False, ec="black", lw=2))
    ax.set_xticks(range(len(phrases)), phrases, rotation=35, ha="left", fontsize=8)
    ax.xaxis.tick_top()
    ax.set_yticks(range(len(queries)), [f'"{query}"' for query in queries], fontsize=9)
    ax.tick_params(length=0)
    return fig


def show_calibration(
    same: np.ndarray, other: np.ndarray, threshold: float, wordings: Sequence[str], closest: float
) -> Figure:
    """How the threshold is found: cosines of rewordings with their own phrase (N,) and with the nearest other (N,).

    Upper panel: everything. Lower panel: the right end. A ruler leads from each group's mean to the threshold, with a
    tick for each standard deviation of that group.

    Args:
        wordings: the N rewordings; those below the threshold are written beside their dots.
        closest: where the lower panel begins.
    """
    jitter = np.random.default_rng(0).uniform(-0.17, 0.17, len(same))
    fig, axes = plt.subplots(2, 1, figsize=(8.6, 4.6), height_ratios=[1.6, 1], layout="constrained")
    for ax in axes:
        ax.plot(same, 1 + jitter, "o", ms=4, alpha=0.5, color=SAME_COLOR, mec="none")
        ax.plot(other, jitter, "x", ms=4, alpha=0.7, color=OTHER_COLOR)
        ax.axvline(threshold, color="black", ls="--", lw=1.2)
        ax.set(yticks=[0, 1], yticklabels=["nearest other\nphrase", "its own\nphrase"])
        ax.grid(axis="x", alpha=0.3)
    for ax, y, group, color in ((axes[0], 0.38, other, OTHER_COLOR), (axes[1], 0.55, same, SAME_COLOR)):
        mean = group.mean()
        towards = np.sign(threshold - mean)
        count = abs(threshold - mean) / group.std()
        ticks = mean + towards * group.std() * np.arange(int(count) + 1)
        ax.plot([mean, threshold], [y, y], color=color, lw=2)
        ax.plot(ticks, np.full(len(ticks), y), "|", ms=11, mew=2, color=color)
        ax.plot(mean, y, "D", ms=6, color=color)
        ax.text(mean, y + 0.1, f"mean {mean:.4f}", ha="right" if towards > 0 else "left", fontsize=9)
        ax.text(
            (mean + threshold) / 2, y + 0.1, f"{count:.1f} standard deviations of {group.std():.4f}", ha="center",
            fontsize=9,
        )  # fmt: skip
    for wording, cosine, y in zip(wordings, same, 1 + jitter, strict=True):
        if cosine < threshold:
            axes[1].annotate(f'"{wording}"', (cosine, y), (6, -3), textcoords="offset points", fontsize=8)
    axes[0].text(threshold - 0.004, 1.3, f"threshold {threshold:.3f}", ha="right", va="center", fontsize=9)
    axes[0].set(xlim=(None, 1.012), ylim=(-0.4, 1.45))
    axes[1].set(xlim=(closest, 1 + 0.12 * (1 - closest)), ylim=(0.35, 1.35), xlabel="cosine of two phrases")
    axes[1].set_title(f"the right end, from {closest:g} on", fontsize=9)
    return fig


def nines(cosine: np.ndarray | float) -> np.ndarray:
    """-log10(1 - cosine), at most 5: the positions of an axis that does not squeeze what lies near 1."""
    return -np.log10(np.maximum(1 - np.asarray(cosine, float), 1e-5))


def show_threshold(
    same: np.ndarray, other: np.ndarray, threshold: float, calibrated: float, lines: Sequence[str]
) -> Figure:
    """One position of a threshold: which pairs it retrieves, with precision and recall. A frame of an animation.

    Args:
        same, other: cosines of pairs that mean the same (N,), and of pairs that do not (M,).
        calibrated: the calibrated threshold, dashed.
        lines: what to write on the right, for example the retrieved pairs.
    """
    fig = plt.figure(figsize=(9.2, 3.7))
    above = fig.add_axes((0.105, 0.55, 0.5, 0.42))
    below = fig.add_axes((0.105, 0.135, 0.5, 0.36), sharex=above)
    rng = np.random.default_rng(0)
    for y, group, mark, color in ((1, same, "o", SAME_COLOR), (0, other, "x", "black")):
        found = group >= threshold
        spots = y + rng.uniform(-0.28, 0.28, len(group))
        above.plot(nines(group[found]), spots[found], mark, ms=5, color=color, mew=1.2)
        above.plot(nines(group[~found]), spots[~found], mark, ms=5, mfc="none", color="0.6", mew=0.7)
    levels = np.linspace(0.1, 4.2, 400)
    cut = 1 - 10**-levels
    right, wrong = ((group[:, None] >= cut).sum(axis=0) for group in (same, other))
    below.plot(levels, right / np.maximum(right + wrong, 1), color="C0", lw=1.6, label="precision")
    below.plot(levels, right / len(same), color="C1", ls="-.", lw=1.6, label="recall")
    for ax in (above, below):
        ax.axvspan(float(nines(threshold)), 4.6, color="0.92", zorder=0)
        ax.axvline(float(nines(threshold)), color="black", lw=2)
        ax.axvline(float(nines(calibrated)), color="black", ls="--", lw=1)
    above.set(yticks=[0, 1], yticklabels=["something\nelse", "the same"], ylim=(-0.5, 1.5), xlim=(0.1, 4.6))
    above.tick_params(labelbottom=False)
    below.set(xlabel="cosine of two phrases (each 9 is ten times nearer to 1)", ylim=(0, 1.08))
    below.set_xticks(nines(np.array(NINES)), [f"{cosine:g}" for cosine in NINES])
    below.legend(fontsize=8, loc="lower left")
    for i, line in enumerate(lines):
        fig.text(0.625, 0.93 - 0.075 * i, line, fontsize=9, va="center")
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
            ax.plot([0, x], [0, y], color=SAME_COLOR if near else "0.75", lw=2 if near else 1, zorder=1)
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


def show_crop_to_map(crop: np.ndarray, picture: np.ndarray, cosines: np.ndarray, semantic: np.ndarray) -> Figure:
    """Eq. 3 in four steps: the crop (S, S, 3), the scene (H, W, 3), a cosine for each patch, and the map (H, W)."""
    fig, axes = plt.subplots(1, 4, figsize=(9.6, 4.2), layout="constrained")
    bare(axes[0], "the crop").imshow(crop)
    bare(axes[1], "the new scene").imshow(picture)
    coarse = bare(axes[2], "one cosine a patch").imshow(cosines, cmap=MAP_COLORS)
    fine = bare(axes[3], "spread over the pixels, scaled").imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
    fig.colorbar(coarse, ax=axes[2], shrink=0.8, label="cosine with the crop")
    fig.colorbar(fine, ax=axes[3], shrink=0.8, label="0: typical cell, 1: typical match")
    return fig


@dataclass(frozen=True)
class Comparison:
    """A row of `show_comparison`: a phrase, its retrieved crop, the scene, its maps (H, W) by name, and the truth.

    ``target`` is (row, col) in the pictures' cells.
    """

    phrase: str
    crop: np.ndarray
    picture: np.ndarray
    maps: dict[str, np.ndarray]
    target: tuple[float, float]


def show_comparison(rows: Sequence[Comparison], config: PatchConfig, band: slice) -> Figure:
    """Figure A1: for each phrase its crop, the scene and its maps; a cross where a map points, a circle at the truth.

    Args:
        config: of the maps' resolution.
        band: the rows of cells to show.
    """
    columns = 2 + len(rows[0].maps)
    fig, axes = plt.subplots(
        len(rows), columns, figsize=(2.1 * columns, 2.35 * len(rows) + 0.2), squeeze=False, layout="constrained"
    )
    for axs, row in zip(axes, rows, strict=True):
        bare(axs[0], "the crop").imshow(row.crop)
        axs[0].set_ylabel(f'"{row.phrase}"', fontsize=10)
        bare(axs[1], "the scene").imshow(row.picture)
        _circle(axs[1], row.target, band)
        for ax, (name, semantic) in zip(axs[2:], row.maps.items(), strict=True):
            pointed = plateau_centre(semantic, config)
            distance = 1000 * config.pixel * np.hypot(*np.subtract(pointed, row.target))
            map_image = bare(ax, f"{name}: {distance:.0f} mm off").imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
            ax.plot(pointed[1], pointed[0], "x", color="white", ms=9, mew=2, path_effects=OUTLINE)
            _circle(ax, row.target, band)
    fig.colorbar(map_image, ax=axes, shrink=0.5, aspect=40, label="0: typical cell, 1: typical match")
    return fig


def show_blend(
    blends: Sequence[tuple[str, np.ndarray, tuple[float, float]]], weights: np.ndarray, distances: Sequence[np.ndarray],
    index: int, config: PatchConfig, band: slice,
) -> Figure:  # fmt: skip
    """One blend weight: a map for each phrase, and how far off each weight's map points. A frame of an animation.

    Args:
        blends: for each phrase its blended map (H, W) and the truth (row, col).
        weights: (N,), w2 of all frames; ``index`` is this frame's.
        distances: for each phrase (N,) in mm.
        config: of the maps' resolution.
        band: the rows of cells to show.
    """
    fig = plt.figure(figsize=(8.4, 3.3))
    for i, (phrase, semantic, target) in enumerate(blends):
        ax = bare(fig.add_axes((0.01 + 0.275 * i, 0.03, 0.26, 0.85)), f'"{phrase}"')
        ax.imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
        row, col = plateau_centre(semantic, config)
        ax.plot(col, row, "x", color="white", ms=9, mew=2, path_effects=OUTLINE)
        _circle(ax, target, band)
    ax = fig.add_axes((0.645, 0.15, 0.34, 0.73))
    for (phrase, _, _), values, style in zip(blends, distances, ("-", "-.", "--", ":"), strict=False):
        line = ax.plot(weights, values, style, lw=1.6, label=f'"{phrase}"')[0]
        ax.plot(weights[index], values[index], "o", ms=8, color=line.get_color(), mec="black")
    ax.axvline(weights[index], color="black", lw=0.8)
    ax.set(xlabel="w2 (w1 = 1 - w2)", ylim=(0, 1.12 * max(values.max() for values in distances)))
    ax.set_title(f"how far off (mm), w2 = {weights[index]:.2f}", fontsize=9)
    ax.legend(fontsize=8, loc="upper right")
    ax.grid(alpha=0.3)
    return fig


def _circle(ax: Axes, target: tuple[float, float], band: slice) -> None:
    """The truth (row, col) in a picture, of which only the rows of ``band`` are shown."""
    ax.plot(target[1], target[0], "o", ms=14, mfc="none", mec="white", mew=1.6, path_effects=OUTLINE)
    ax.set_ylim(band.stop - 0.5, band.start - 0.5)
