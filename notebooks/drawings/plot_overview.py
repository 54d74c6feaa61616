"""Two pictures of the whole: how a semantic map comes about, and what a policy does in scenes that are new to it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from drawings.boxes import FIXED, LEARNED, Point, arrow, box, canvas, inset, legend, line, sign
from drawings.plot_panels import Panel, draw_action
from drawings.plot_table import seen_from
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gem_lite.drawing.plots import MAP_COLORS, bare
from gem_lite.maps.patches import PatchEmbeddings, PatchGrid
from gem_lite.rgbd.camera import View
from gem_lite.se2 import Workspace


def show_semantic_module(
    views: Sequence[View], sides: Sequence[PatchEmbeddings], view_maps: Sequence[np.ndarray],
    maps: dict[str, np.ndarray], crops: Sequence[tuple[str, np.ndarray]], phrase: str, top: PatchEmbeddings,
    workspace: Workspace,
) -> Figure:  # fmt: skip
    """The semantic module after Figure 2 of the paper, with the shape of what each arrow carries.

    Args:
        views: three.
        sides: the patches of each view.
        view_maps: the text-conditioned map of each view (H_n, W_n).
        maps: "colour" (H, W, 3), the table from above; "text", "image", "blend" (H, W).
        crops: four phrases and pictures (h, h, 3) of demonstrations; the first is the one that is retrieved.
        top: the patches of the table from above.
        workspace: of the table from above.
    """
    rows, cols = maps["text"].shape
    m, n, dim = sides[0].values.shape
    grid = sides[0].grid
    heights = (6.95, 5.7, 4.45)
    middle = heights[1]
    fig, ax = canvas(14.0, 8.0)
    for title, x, y in (
        ("(a) patches", 0.15, 7.82), ("(b) text-conditioned map", 4.0, 7.82), ("(c) image-conditioned map", 0.15, 2.87),
    ):  # fmt: skip
        ax.text(x, y, title, fontsize=11, fontweight="bold", va="center")

    for number, (view, values, y) in enumerate(zip(views, view_maps, heights, strict=True), start=1):
        inset(ax, view.rgb, (0.85, y), 0.9, f"$O^{number}$")
        inset(ax, _over(view.rgb, values), (7.25, y), 0.9, f"$M^{number}_{{text}}$")
    _draw_patches(ax, views[0].rgb, grid, (2.67, heights[0] + 0.1), 1.0)
    _brace(ax, 1.6, heights)
    arrow(ax, (1.7, middle), (2.1, middle))
    cut = f"$\\mathcal{{P}}$: squares of\n{grid.patch} pixels, one\nevery {grid.stride}"
    box(ax, (2.1, middle - 0.4), 1.15, 0.8, cut, FIXED)
    arrow(ax, (3.25, middle), (4.0, middle), f"{m} x {n}")
    box(ax, (4.0, middle - 0.35), 0.9, 0.7, "CLIP's\nimage tower", FIXED)
    arrow(ax, (4.9, middle), (5.85, middle), f"({m}, {n}, {dim})")
    sign(ax, (6.05, middle), "$\\cdot$")
    arrow(ax, (6.25, middle), (6.6, middle), "$\\mathcal{P}^{-1}$")
    _brace(ax, 8.0, heights)
    arrow(ax, (8.1, middle), (8.45, middle))
    inset(ax, _semantic_cloud(views, view_maps, workspace), (9.55, middle), 1.7, "semantic point cloud")
    arrow(ax, (10.65, middle), (11.1, middle), "from\nabove")
    inset(ax, maps["text"], (11.6, middle), 1.7, "$M_{text}$ (Eq. 1)")

    box(ax, (0.2, 3.2), 1.3, 0.6, f'phrase $\\ell$:\n"{phrase}"', "white")
    arrow(ax, (1.5, 3.5), (2.1, 3.5))
    box(ax, (2.1, 3.15), 1.15, 0.7, "CLIP's\ntext tower", FIXED)
    line(ax, (3.25, 3.5), (6.05, 3.5))
    ax.text(4.3, 3.56, f"$\\mathcal{{E}}_\\ell$, below called $Q$: (1, {dim})", fontsize=8, ha="center")
    arrow(ax, (6.05, 3.5), (6.05, middle - 0.2))
    arrow(ax, (5.3, 3.5), (5.3, 2.4))

    for i, (name, crop) in enumerate(crops):
        x, y = 0.6 + 1.05 * (i % 2), 2.3 - 1.1 * (i // 2)
        inset(ax, crop, (x, y), 0.7, "")
        ax.text(x, y - 0.4, f'"{name}"', fontsize=7, ha="center", va="top")
    ax.text(1.1, 0.55, "crops of demonstrations", fontsize=9, ha="center", va="top")
    arrow(ax, (2.05, 2.05), (2.6, 2.05), "phrases")
    box(ax, (2.6, 1.7), 0.9, 0.7, "CLIP's\ntext tower", FIXED)
    arrow(ax, (3.5, 2.05), (4.7, 2.05), f"$K_{{crop}}$ ({len(crops)}, {dim})")
    box(ax, (4.7, 1.7), 1.2, 0.7, "argmax of\n$Q\\,K_{crop}^T$ (Eq. 2)", FIXED)
    arrow(ax, (5.9, 2.05), (6.25, 2.05))
    inset(ax, crops[0][1], (6.65, 2.05), 0.8, "QueriedCrop")
    arrow(ax, (7.05, 2.05), (7.4, 2.05))
    box(ax, (7.4, 1.7), 0.9, 0.7, "CLIP's\nimage tower", FIXED)
    arrow(ax, (8.3, 2.05), (9.65, 2.05), f"$\\mathcal{{E}}_{{crop}}$ (1, {dim})")
    sign(ax, (9.85, 2.05), "$\\cdot$")
    arrow(ax, (10.05, 2.05), (11.1, 2.05), "$\\mathcal{P}^{-1}$")
    inset(ax, maps["image"], (11.6, 2.05), 1.7, "$M_{image}$ (Eq. 3)")
    inset(ax, maps["colour"], (5.3, 0.75), 1.2, "$o$: from above")
    arrow(ax, (5.6, 0.7), (7.0, 0.7), f"({rows}, {cols}, 3)")
    box(ax, (7.0, 0.4), 1.3, 0.6, "$\\mathcal{P}$, and CLIP's\nimage tower", FIXED)
    line(ax, (8.3, 0.7), (9.85, 0.7))
    ax.text(9.0, 0.76, str(tuple(top.values.shape)), fontsize=8, ha="center")
    arrow(ax, (9.85, 0.7), (9.85, 1.85))

    line(ax, (12.05, middle), (12.55, middle))
    arrow(ax, (12.55, middle), (12.55, 4.25))
    line(ax, (12.05, 2.05), (12.55, 2.05))
    arrow(ax, (12.55, 2.05), (12.55, 3.5))
    box(ax, (12.3, 3.5), 1.5, 0.75, "average with\nweights $w_1$, $w_2$", FIXED)
    arrow(ax, (13.3, 4.25), (13.3, 4.84))
    inset(ax, maps["blend"], (13.3, middle), 1.7, "blend, the raw map")
    arrow(ax, (13.3, 6.95), (13.3, 7.2))
    box(ax, (12.6, 7.2), 1.35, 0.6, "$f_\\theta$ (Eq. 4),\nlesson 06", LEARNED)
    arrow(ax, (11.9, 7.5), (12.6, 7.5), "heights")
    ax.text(13.28, 7.9, "$\\mathcal{M}$", fontsize=10, ha="center", va="center")
    legend(ax, (0.15, 0.1))
    return fig


def _draw_patches(ax: Axes, rgb: np.ndarray, grid: PatchGrid, middle: Point, height: float) -> None:
    """The middle of a view, enlarged, with its patches: every second one, so that they do not overlap."""
    tops, lefts = grid.starts()
    top, left = tops[len(tops) // 2], lefts[len(lefts) // 2 - 8]
    rows, cols = 6 * grid.patch, 8 * grid.patch
    inset(ax, rgb[top : top + rows, left : left + cols], middle, height, "part of $O^1$: its patches")
    side = height / 6
    for row in range(6):
        for col in range(8):
            corner = (middle[0] + (col - 4) * side, middle[1] + (row - 3) * side)
            ax.add_patch(Rectangle(corner, side, side, fill=False, ec="w", lw=0.6))


def _brace(ax: Axes, x: float, heights: Sequence[float]) -> None:
    """A line that joins several insets."""
    line(ax, (x, max(heights) + 0.4), (x, min(heights) - 0.4))


def _over(rgb: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A map over its picture, (H, W, 3) uint8: what is high is bright, and the rest of the picture stays visible."""
    return (0.35 * rgb + 0.65 * _colored(values)).astype(np.uint8)


def _colored(values: np.ndarray) -> np.ndarray:
    """A map's values from 0 to its highest as colours, (..., 3) from 0 to 255."""
    return 255 * plt.get_cmap(MAP_COLORS)(np.clip(values / values.max(), 0, 1))[..., :3]


def _semantic_cloud(views: Sequence[View], view_maps: Sequence[np.ndarray], workspace: Workspace) -> np.ndarray:
    """The points of all views above the workspace, coloured by their maps, from the front and above."""
    points = np.concatenate([view.points().reshape(-1, 3) for view in views])
    colors = np.concatenate(
        [_over(view.rgb, values).reshape(-1, 3) for view, values in zip(views, view_maps, strict=True)]
    )
    kept = workspace.contains(points[:, 0], points[:, 1]) & (points[:, 2] > -0.01)
    return seen_from(points[kept], colors[kept], azimuth=-0.6, elevation=0.9)


DEMONSTRATED, TESTED = "#f0c000", "#009e73"
"""Frames of what an expert demonstrated (yellow), and of what a policy does with it (green)."""


def show_generalization(groups: Sequence[tuple[str, Sequence[Panel]]], workspace: Workspace) -> Figure:
    """A policy in scenes that are new to it, after Figure 1 of the paper.

    Args:
        groups: what is new, and three panels: a demonstration, the policy in a new scene, and in the same scene turned.
    """
    fig, axes = plt.subplots(1, 3 * len(groups), figsize=(4.4 * len(groups), 3.9), dpi=80)
    fig.subplots_adjust(0.01, 0.07, 0.99, 0.77, wspace=0.12)
    for i, (title, panels) in enumerate(groups):
        first, last = axes[3 * i].get_position(), axes[3 * i + 2].get_position()
        fig.text((first.x0 + last.x1) / 2, 0.955, title, fontsize=11, fontweight="bold", ha="center")
        for ax, panel, color in zip(axes[3 * i :], panels, (DEMONSTRATED, TESTED, TESTED), strict=False):
            bare(ax).imshow(panel.picture)
            draw_action(ax, panel.action, workspace)
            sentence = textwrap.fill(f'"{panel.sentence}"', 20)
            ax.set_title(f"{panel.title}\n{sentence}", fontsize=8, va="bottom")
            ax.set_xlabel(panel.note, fontsize=8)
            for spine in ax.spines.values():
                spine.set(color=color, linewidth=4, visible=True)
    return fig
