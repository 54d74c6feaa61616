"""The real tables from above, maps of parts, crops, and a jaw that turns: the figures of lesson 14."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, bare
from gem_lite.se2 import Pose2
from gem_lite.simulation.grips import FINGER, OPENINGS

VERDICT_COLORS = {
    "holds": "#009e73",
    "slips": "#e69f00",
    "no room": "#d55e00",
    "two things": "#cc79a7",
    "nothing": "0.6",
}
"""What a jaw's yaw may lead to, each in a colour that colour-blind readers can tell from the others."""
HATCHES = {"holds": "", "slips": "//", "no room": "xx", "two things": "..", "nothing": ""}
HALF = 0.0225
"""Half of the side (m) of the square that a frame of the turning jaw shows."""


def show_tables(panels: Sequence[tuple[str, np.ndarray]]) -> Figure:
    """Tables from above (H, W, 3), each under its sentence."""
    fig, axes = plt.subplots(1, len(panels), figsize=(2.35 * len(panels), 3.4), layout="constrained")
    for ax, (sentence, picture) in zip(axes, panels, strict=True):
        bare(ax, textwrap.fill(f'"{sentence}"', 30)).imshow(picture)
    return fig


def show_maps(
    panels: Sequence[tuple[str, np.ndarray, np.ndarray | None, tuple[int, int] | None]], columns: int = 4
) -> Figure:
    """Pictures (H, W, 3) and maps (H, W), row by row. The cells of a part have an outline, a cross marks a peak.

    Args:
        panels: a title, a picture or a map, the cells of the part (H, W) bool, and the cell (row, col) of the cross;
            the last two may be None.
        columns: in each row; panels in one column have one shape.
    """
    columns = min(columns, len(panels))
    lines = -(-len(panels) // columns)
    widths = [panel.shape[1] / panel.shape[0] for _, panel, _, _ in panels[:columns]]
    fig, axes = plt.subplots(
        lines, columns, figsize=(2.9 * sum(widths) + 0.3, 3.2 * lines), width_ratios=widths, squeeze=False,
        dpi=80, layout="constrained",
    )  # fmt: skip
    for ax, (title, panel, cells, peak) in zip(axes.flat, panels, strict=True):
        bare(ax, title).imshow(panel, cmap=MAP_COLORS, vmin=0, vmax=max(1.0, float(panel.max())))
        if cells is not None:
            ax.contour(cells, levels=[0.5], colors="white", linewidths=2.6)
            ax.contour(cells, levels=[0.5], colors="#0072b2", linewidths=1.2)
        if peak is not None:
            ax.plot(peak[1], peak[0], "x", color=PICK_COLOR, ms=9, mew=2, path_effects=OUTLINE)
    return fig


@dataclass(frozen=True)
class Yaws:
    """What each yaw of a jaw leads to at one point, and the body there from above.

    Attributes:
        verdicts: of each yaw (degrees, of half a turn), keys of `VERDICT_COLORS`. The other half is the same.
        points: (N, 2) metres, relative to the jaw's middle, the lowest first.
        shades: the colour of each point.
    """

    verdicts: Mapping[int, str]
    points: np.ndarray
    shades: Sequence[str]


def show_yaws(panels: Mapping[str, Yaws]) -> Figure:
    """For each title a body from above in a ring of sectors. A sector is where a finger stands; its number is the yaw.

    Its colour says what the yaw leads to.
    """
    fig, axes = plt.subplots(
        1, len(panels), figsize=(2.9 * len(panels), 3.5), subplot_kw={"projection": "polar"}, layout="constrained"
    )
    seen = {verdict for yaws in panels.values() for verdict in yaws.verdicts.values()}
    inner = 0.62
    for ax, (title, yaws) in zip(axes, panels.items(), strict=True):
        distances = np.hypot(*yaws.points.T) * inner / HALF
        inside = distances < inner
        ax.scatter(
            np.arctan2(yaws.points[inside, 1], yaws.points[inside, 0]), distances[inside], s=3,
            c=np.array(yaws.shades)[inside], lw=0,
        )  # fmt: skip
        width = np.pi / len(yaws.verdicts)
        for degrees, verdict in yaws.verdicts.items():
            look = {"color": VERDICT_COLORS[verdict], "hatch": HATCHES[verdict], "ec": "white"}
            for finger in (np.radians(degrees) + np.pi / 2, np.radians(degrees) - np.pi / 2):
                # The edge has the colour of the hatches; without a width, no line separates two sectors.
                ax.bar(finger, 1 - inner, width, inner, lw=0, **look)
        ax.grid(False)
        ax.set(ylim=(0, 1), yticks=[])
        ax.set_xticks(
            np.radians(range(0, 360, 45)), [f"{(finger - 90) % 180}°" for finger in range(0, 360, 45)], fontsize=8
        )
        ax.tick_params(pad=-1)
        ax.set_title(title, fontsize=10)
    names = [name for name in VERDICT_COLORS if name in seen]
    handles = [plt.Rectangle((0, 0), 1, 1, fc=VERDICT_COLORS[name], hatch=HATCHES[name], ec="white") for name in names]
    fig.legend(handles, names, loc="outside lower center", ncols=len(names), fontsize=9)
    return fig


def show_jaw(points: np.ndarray, shades: Sequence[str], pose: Pose2, verdict: str, title: str) -> Figure:
    """A jaw from above, open as wide as it goes, over the points of a body. A frame of an animation.

    Args:
        points: (N, 2) metres, the lowest first.
        shades: the colour of each point.
        verdict: the colour of the fingers, a key of `VERDICT_COLORS`.
    """
    fig, ax = plt.subplots(figsize=(3.9, 4.0))
    fig.subplots_adjust(0.02, 0.02, 0.98, 0.88)
    bare(ax).scatter(*(1000 * points.T), s=14, c=shades, lw=0)
    reach = OPENINGS[0] / 2
    half = FINGER[1] / 2
    for side in (-1, 1):
        outline = ((-half, reach), (half, reach), (half, reach + FINGER[0]), (-half, reach + FINGER[0]))
        corners = [pose @ Pose2(x, side * y) for x, y in outline]
        ax.fill(*_millimetres(corners), color=VERDICT_COLORS[verdict], ec="black", lw=1)
    ax.plot(*_millimetres([pose @ Pose2(0, -reach), pose @ Pose2(0, reach)]), color="black", lw=0.8, ls=":")
    for axis, middle in ((ax.set_xlim, pose.x), (ax.set_ylim, pose.y)):
        axis(1000 * (middle - HALF), 1000 * (middle + HALF))
    ax.set_aspect("equal")
    ax.set_title(title, fontsize=11, color="black")
    return fig


def _millimetres(poses: Sequence[Pose2]) -> tuple[list[float], list[float]]:
    return [1000 * pose.x for pose in poses], [1000 * pose.y for pose in poses]
