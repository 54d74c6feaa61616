"""Boxes in camera views, and success by map source: figures of lesson 15."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, SAFE_COLORS, bare


def show_boxes(
    rows: Sequence[tuple[str, Sequence[np.ndarray], Sequence[Mapping[str, np.ndarray]]]],
) -> Figure:
    """Pictures of views, (H, W, 3), or maps of their pixels, (H, W), with boxes and what is written on them.

    Args:
        rows: a title, the panels, and the boxes of each panel by their labels: left, top, right, bottom in pixels.
    """
    columns = len(rows[0][1])
    fig, axes = plt.subplots(
        len(rows), columns, figsize=(3.1 * columns, 2.55 * len(rows)), squeeze=False, dpi=80, layout="constrained"
    )
    for line, (title, panels, boxes_of_panels) in zip(axes, rows, strict=True):
        for number, (ax, panel, boxes) in enumerate(zip(line, panels, boxes_of_panels, strict=True)):
            bare(ax, f"{title}, camera {number + 1}").imshow(panel, cmap=MAP_COLORS, vmin=0, vmax=1)
            for label, (left, top, right, bottom) in boxes.items():
                size = (right - left, bottom - top)
                ax.add_patch(Rectangle((left, top), *size, fill=False, color=PICK_COLOR, lw=1.4, path_effects=OUTLINE))
                ax.text(left, top - 6, label, color="white", fontsize=8)
    return fig


def show_success(success: Mapping[str, Mapping[str, tuple[float, float, float]]]) -> Figure:
    """Figure A7: success (%) in each task, a mark for each map source, with the interval of its mean.

    Args:
        success: by the name of a source and the title of a task: the mean, and both ends of its interval. The first
            source has all tasks.
    """
    titles = list(next(iter(success.values())))
    fig, ax = plt.subplots(figsize=(2.1 * len(titles), 3.1), dpi=90, layout="constrained")
    for number, ((name, of_tasks), color, mark) in enumerate(zip(success.items(), SAFE_COLORS, "osD^", strict=False)):
        mean, low, high = np.array(list(of_tasks.values())).T
        places = [titles.index(title) + 0.16 * (number - (len(success) - 1) / 2) for title in of_tasks]
        ax.errorbar(places, mean, [mean - low, high - mean], fmt=mark, color=color, capsize=3, label=name)
    ax.set(ylabel="success (%)", ylim=(-4, 104))
    ax.set_xticks(range(len(titles)), titles)
    ax.grid(axis="y", alpha=0.3)
    fig.legend(loc="outside upper center", ncols=len(success))
    return fig
