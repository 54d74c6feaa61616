"""Diagrams: boxes for what is computed, arrows with the shapes of what is passed on, pictures where one can see it."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from drawings.plot_kernels import SIGNED
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

from gem_lite.drawing.plots import MAP_COLORS

LEARNED, FIXED = "#fbe3c0", "#dcecf7"
"""Boxes with weights that GEM learns (light orange), and without (light blue)."""

Point = tuple[float, float]


def canvas(width: float, height: float) -> tuple[Figure, Axes]:
    """An empty drawing whose units are inches."""
    fig, ax = plt.subplots(figsize=(width, height), dpi=80)
    fig.subplots_adjust(0, 0, 1, 1)
    ax.axis("off")
    ax.set(xlim=(0, width), ylim=(0, height), autoscale_on=False)
    return fig, ax


def box(ax: Axes, corner: Point, width: float, height: float, text: str, color: str) -> None:
    """What is computed; ``corner`` is the lower left one."""
    ax.add_patch(
        FancyBboxPatch(corner, width, height, boxstyle="round,pad=0,rounding_size=0.08", fc=color, ec="0.3", lw=1)
    )
    ax.text(corner[0] + width / 2, corner[1] + height / 2, text, fontsize=8, ha="center", va="center")


def arrow(ax: Axes, start: Point, end: Point, label: str = "", at: float = 0.5) -> None:
    """An arrow; its label stands above the part ``at`` of its way."""
    ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "0.2", "lw": 1.2, "shrinkA": 0, "shrinkB": 0})
    x, y = (a + at * (b - a) for a, b in zip(start, end, strict=True))
    ax.text(x, y + 0.06, label, fontsize=8, ha="center", va="bottom")


def line(ax: Axes, *points: Point) -> None:
    """A line without a head, through all points."""
    ax.plot(*zip(*points, strict=True), color="0.2", lw=1.2, solid_capstyle="butt")


def sign(ax: Axes, middle: Point, text: str) -> None:
    """An operation's sign in a circle."""
    ax.text(*middle, text, fontsize=19, ha="center", va="center", bbox={"boxstyle": "circle,pad=0.05", "fc": "white"})


def inset(ax: Axes, values: np.ndarray, middle: Point, height: float, title: str, signed: bool = False) -> None:
    """A picture (H, W, 3) or a map (H, W), on a scale of its own, under its title."""
    rows, cols = values.shape[:2]
    half = height / 2
    width = half * cols / rows
    (x, y), top = middle, np.nanmax(np.abs(values))
    scale = {"cmap": SIGNED, "vmin": -top, "vmax": top} if signed else {"cmap": MAP_COLORS, "vmin": np.nanmin(values)}
    ax.imshow(values, extent=(x - width, x + width, y - half, y + half), **scale)
    ax.add_patch(Rectangle((x - width, y - half), 2 * width, height, fill=False, ec="0.3", lw=0.8))
    ax.text(x, y + half + 0.06, title, fontsize=9, ha="center", va="bottom")


def legend(ax: Axes, corner: Point) -> None:
    """What the two colours of boxes mean; ``corner`` is the lower left one."""
    for i, (color, text) in enumerate(((LEARNED, "has weights that GEM learns"), (FIXED, "learns nothing here"))):
        x = corner[0] + 2.4 * i
        ax.add_patch(Rectangle((x, corner[1]), 0.22, 0.16, fc=color, ec="0.3", lw=0.8))
        ax.text(x + 0.3, corner[1] + 0.08, text, fontsize=8, va="center")
