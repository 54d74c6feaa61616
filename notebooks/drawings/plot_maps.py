"""Drawings of lesson 02: a small CLIP in training, scores of patches, votes of cameras, where a map points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, SAFE_COLORS, bare
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap

SIGNED = "PuOr_r"
"""Cosines have both signs: orange is positive, purple negative, white 0."""


def show_training(
    pictures: np.ndarray, names: Sequence[str], before: np.ndarray, after: np.ndarray, losses: np.ndarray,
    guess: float,
) -> Figure:  # fmt: skip
    """A small CLIP: N pictures (N, h, w, 3), their cosines with N captions before and after, and the loss over steps.

    Args:
        names: the captions.
        before, after: (N, N), row i is picture i.
        losses: (S,), one for each step.
        guess: the loss of equal cosines, drawn as a dashed line.
    """
    fig = plt.figure(figsize=(11, 3.9), layout="constrained")
    grid = fig.add_gridspec(1, 4, width_ratios=[1 / len(pictures), 1, 1, 1])
    bare(fig.add_subplot(grid[0])).imshow(np.clip(np.concatenate(pictures), 0, 1))
    for column, (title, cosines) in enumerate((("cosines before", before), ("after", after)), start=1):
        ax = bare(fig.add_subplot(grid[column]), title)
        image = ax.imshow(cosines, cmap=SIGNED, vmin=-1, vmax=1)
        ax.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    fig.colorbar(image, ax=ax, shrink=0.7, label="cosine")
    ax = fig.add_subplot(grid[3])
    ax.plot(losses)
    ax.axhline(guess, color="0.4", ls="--", label="all cosines equal: log N")
    ax.set(xlabel="step", ylabel="InfoNCE", ylim=(0, None))
    ax.legend(fontsize=8)
    ax.grid(alpha=0.3)
    return fig


def show_votes(
    names: Sequence[str], shares: Sequence[np.ndarray], maps: Sequence[np.ndarray], picture: np.ndarray,
    fused: np.ndarray,
) -> Figure:  # fmt: skip
    """Each camera's share of the points of every cell (top), its map alone (bottom); last: the picture, the fused map.

    Args:
        shares: for each camera (H, W) in [0, 1].
        maps: for each camera (H, W), cosines.
        picture: (H, W, 3) from above; ``fused`` (H, W) is the map of all cameras.
    """
    fig, axes = plt.subplots(2, len(names) + 1, figsize=(1.6 * len(names) + 2.4, 6.4), layout="constrained")
    for column, name, share, semantic in zip(axes.T, names, shares, maps, strict=False):
        share_image = bare(column[0], f"{name}: its share").imshow(share, cmap="viridis", vmin=0, vmax=1)
        map_image = bare(column[1], f"{name} alone").imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
    bare(axes[0, -1], "from above").imshow(picture)
    bare(axes[1, -1], "all three, fused").imshow(fused, cmap=MAP_COLORS, vmin=0, vmax=1)
    fig.colorbar(share_image, ax=axes[0], shrink=0.8, label="share of a cell's points")
    fig.colorbar(map_image, ax=axes[1], shrink=0.8, label="cosine")
    return fig


def show_scale(cosines: dict[str, np.ndarray], low: float, high: float, picture: np.ndarray, absent: str) -> Figure:
    """How many cells of each phrase's map have which cosine, over the scale of ``low`` and ``high``; below, the maps.

    Args:
        cosines: (H, W) by phrase.
        picture: (H, W, 3) from above.
        absent: the phrase whose map is also shown stretched between its own minimum and maximum.
    """
    fig = plt.figure(figsize=(8.4, 6.2), layout="constrained")
    grid = fig.add_gridspec(2, len(cosines) + 2, height_ratios=[1, 1.05])
    ax = fig.add_subplot(grid[0, :])
    edges = np.linspace(min(m.min() for m in cosines.values()), high + 0.02, 45)
    for name, values in cosines.items():
        color = ax.stairs(
            np.histogram(values, edges)[0] / values.size, edges, lw=1.8, label=f'"{name}"'
        ).get_edgecolor()
        ax.plot(values.max(), 1.6e-4, "v", ms=7, color=color)
    ax.plot([], [], "v", ms=7, color="0.4", label="a phrase's highest cell")
    for mark, name in ((low, "text_low "), (high, "text_high ")):
        ax.axvline(mark, color="0.3", ls="--", lw=1)
        ax.text(mark, 0.5, name, fontsize=8, color="0.3", ha="right")
    ax.set(yscale="log", ylim=(1e-4, 1), xlabel="cosine", ylabel="share of the cells")
    ax.legend(fontsize=8)
    top = ax.secondary_xaxis(
        "top",
        functions=(
            lambda cosine: (np.asarray(cosine, float) - low) / (high - low),
            lambda scaled: low + np.asarray(scaled, float) * (high - low),
        ),
    )
    top.set_xlabel("value of the map")
    bare(fig.add_subplot(grid[1, 0]), "from above").imshow(picture)
    panels = {f'"{name}"': (values - low) / (high - low) for name, values in cosines.items()}
    panels[f'"{absent}",\nstretched: wrong'] = (cosines[absent] - cosines[absent].min()) / np.ptp(cosines[absent])
    axes = [fig.add_subplot(grid[1, column]) for column in range(1, len(panels) + 1)]
    for ax, (title, values) in zip(axes, panels.items(), strict=True):
        image = bare(ax, title).imshow(values, cmap=MAP_COLORS, vmin=0, vmax=1)
    fig.colorbar(image, ax=axes, shrink=0.9, label="map")
    return fig


def show_patch(picture: np.ndarray, semantic: np.ndarray, patch: int, centre: tuple[float, float]) -> Figure:
    """A picture (H, W, 3) with one square patch around ``centre`` (row, col), beside its map (H, W): one frame."""
    fig, axes = plt.subplots(1, 2, figsize=(9, 2.3), layout="constrained")
    bare(axes[0], f"p = {patch:2d}, s = {patch // 2:2d}").imshow(picture)
    corner = (centre[1] - patch / 2 - 0.5, centre[0] - patch / 2 - 0.5)
    axes[0].add_patch(Rectangle(corner, patch, patch, fill=False, ec="white", lw=1.6))
    image = bare(axes[1], "map").imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
    fig.colorbar(image, ax=axes, shrink=0.9, label="map")
    return fig


class Plateau(NamedTuple):
    """What `show_plateaus` draws of one map.

    Attributes:
        title: of its column.
        picture: (H, W, 3) from above.
        semantic: (H, W).
        path: (K, 2), the cells (row, col) through which the mean shift went, from the brightest cell to the result.
    """

    title: str
    picture: np.ndarray
    semantic: np.ndarray
    path: np.ndarray


def show_plateaus(cases: Sequence[Plateau], foot: float, reach: float, margin: float | None = 22) -> Figure:
    """Where maps point: picture above map, with the plateau's outline and the last circle of the mean shift.

    Args:
        foot: how far (in the map's values) the plateau reaches below the peak.
        reach: the circle's radius, in cells.
        margin: cells around the result; None shows whole maps.
    """
    size = (2.15 * len(cases) + 0.7, 4.7) if margin else (1.8 * len(cases) + 0.7, 6.9)
    fig, axes = plt.subplots(2, len(cases), figsize=size, squeeze=False, layout="constrained")
    for (upper, lower), case in zip(axes.T, cases, strict=True):
        bare(upper, case.title).imshow(case.picture)
        image = bare(lower).imshow(case.semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
        row, col = case.path[-1]
        lower.contour(case.semantic, [case.semantic.max() - foot], colors="white", linewidths=1.2, linestyles="--")
        lower.add_patch(Circle((col, row), reach, fill=False, ec=SAFE_COLORS[4], lw=1.6))
        lower.plot(case.path[:, 1], case.path[:, 0], "-", color="white", lw=1.2, path_effects=OUTLINE)
        lower.plot(case.path[0, 1], case.path[0, 0], "x", color="white", ms=7, mew=1.6, path_effects=OUTLINE)
        for ax in (upper, lower):
            ax.plot(col, row, "o", ms=6, color=SAFE_COLORS[4], mec="black")
            if margin:
                ax.set(xlim=(col - margin, col + margin), ylim=(row + margin, row - margin), facecolor="0.7")
    fig.colorbar(image, ax=axes, shrink=0.6, label="map")
    return fig


def show_rates(panels: dict[str, dict[str, dict[str, dict]]], limit: float) -> Figure:
    """Filed rates of the pointing game with their intervals: a panel for each kind of scene, a line for each map.

    Args:
        panels: by kind, then by the map's name: ``near`` and ``exact`` (`pointing.rate`).
        limit: how near is near (m).
    """
    fig, axes = plt.subplots(1, len(panels), figsize=(8.6, 2.9), sharey=True, squeeze=False, layout="constrained")
    styles = {"near": ("o", SAFE_COLORS[0], -0.13), "exact": ("s", SAFE_COLORS[1], 0.13)}
    labels = {"near": f"near: within {1000 * limit:.0f} mm", "exact": "exact: on a right object"}
    for ax, (kind, rates) in zip(axes[0], panels.items(), strict=True):
        for measure, (marker, color, shift) in styles.items():
            means = np.array([rate[measure]["mean"] for rate in rates.values()])
            intervals = np.array([rate[measure]["ci95"] for rate in rates.values()]).T
            error = np.abs(intervals - means)
            ax.errorbar(means, np.arange(len(rates)) + shift, xerr=error, fmt=marker, color=color, ms=5, capsize=3,
                        label=labels[measure])  # fmt: skip
        ax.set(xlim=(0, 101), xlabel="% of the scenes' phrases", yticks=range(len(rates)), yticklabels=list(rates))
        ax.set_title(kind, fontsize=9)
        ax.grid(alpha=0.3)
    axes[0, 0].invert_yaxis()
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    return fig


def show_patches(patches: np.ndarray, scores: np.ndarray, title: str) -> Figure:
    """Patches (m, n, p, p, 3) in their order, each framed in the colour of its score (m, n) in [0, 1]."""
    rows, cols = scores.shape
    fig, axes = plt.subplots(rows, cols, figsize=(0.95 * cols + 0.9, 1.12 * rows + 0.4), layout="constrained")
    shade = plt.get_cmap(MAP_COLORS)
    for ax, patch, score in zip(axes.flat, patches.reshape(-1, *patches.shape[2:]), scores.flat, strict=True):
        bare(ax, f"{score:.2f}").imshow(patch)
        for edge in ax.spines.values():
            edge.set(color=shade(float(np.clip(score, 0, 1))), linewidth=3)
    scale = plt.cm.ScalarMappable(plt.Normalize(0, 1), MAP_COLORS)
    fig.colorbar(scale, ax=axes, label="cosine (the frames)", shrink=0.8)
    fig.suptitle(title, fontsize=10)
    return fig


def show_fusion(views: Sequence[View], maps: Sequence[np.ndarray], heightmap: HeightMap, fused: np.ndarray,
                title: str) -> Figure:  # fmt: skip
    """Panel (b) of Figure 2: the views with their maps (NaN: outside the workspace), and both fused from above."""
    fig = plt.figure(figsize=(12, 4.8), layout="constrained")
    grid = fig.add_gridspec(2, len(views) + 2, width_ratios=[4 / 3] * len(views) + [1, 1])
    for column, (view, semantic) in enumerate(zip(views, maps, strict=True)):
        bare(fig.add_subplot(grid[0, column]), view.camera.name).imshow(view.rgb)
        ax = bare(fig.add_subplot(grid[1, column]), f"{view.camera.name}: map")
        ax.imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
        ax.set_facecolor("0.7")
    bare(fig.add_subplot(grid[:, -2]), "fused: colour").imshow(heightmap.rgb)
    ax = bare(fig.add_subplot(grid[:, -1]), "fused: map")
    fig.colorbar(ax.imshow(fused, cmap=MAP_COLORS, vmin=0, vmax=1), ax=ax, shrink=0.8, label="cosine")
    fig.suptitle(title, fontsize=10)
    return fig


def show_groups(groups: dict[str, np.ndarray], label: str) -> Figure:
    """Values of named groups as dots, side by side, with each group's mean as a bar."""
    fig, ax = plt.subplots(figsize=(1.9 * len(groups) + 1, 3.4), layout="constrained")
    for column, values in enumerate(groups.values()):
        spread = np.linspace(-0.14, 0.14, len(values))
        ax.plot(column + spread, values, "o", ms=4, alpha=0.6, color="C0")
        ax.plot([column - 0.22, column + 0.22], [np.mean(values)] * 2, color=SAFE_COLORS[5], lw=2.5)
    ax.set_xticks(range(len(groups)), groups)
    ax.set_ylabel(label)
    ax.grid(axis="y", alpha=0.3)
    return fig
