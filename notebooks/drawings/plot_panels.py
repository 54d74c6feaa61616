"""Tables from above with a sentence and an action, side by side: what several lessons draw of an episode."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gem_lite.actions import Action, Push
from gem_lite.drawing.plots import PICK_COLOR, PLACE_COLOR, bare, draw_gripper
from gem_lite.se2 import Workspace


@dataclass(frozen=True)
class Panel:
    """A table from above, and what is done on it.

    Attributes:
        title: the name of the task.
        sentence: the instruction.
        picture: (H, W, 3) uint8.
        action: drawn on the picture; None if there is none.
        note: written below the picture.
    """

    title: str
    sentence: str
    picture: np.ndarray
    action: Action | None = None
    note: str = ""


def show_panels(panels: Sequence[Panel], workspace: Workspace, columns: int = 5) -> Figure:
    """Tables from above with their sentences and actions."""
    rows = -(-len(panels) // columns)
    fig, axes = plt.subplots(
        rows, columns, figsize=(2.1 * columns, 4.5 * rows), squeeze=False, layout="constrained"
    )  # fmt: skip
    for ax in axes.flat:
        ax.set_axis_off()
    for ax, panel in zip(axes.flat, panels, strict=False):
        ax.set_axis_on()
        sentence = textwrap.fill(f'"{panel.sentence}"', 27)
        lines = 4 - sentence.count("\n") - 1
        bare(ax).imshow(panel.picture)
        ax.set_title(f"{panel.title}\n{sentence}" + "\n" * lines, fontsize=8)
        ax.set_xlabel(panel.note, fontsize=8)
        if panel.action is not None:
            draw_action(ax, panel.action, workspace)
    return fig


def draw_action(ax: Axes, action: Action, workspace: Workspace) -> None:
    """Pick and place as grippers; a push as an arrow."""
    height, width = workspace.shape
    if isinstance(action, Push):
        (row, col), (end_row, end_col) = (workspace.to_pixel(pose.x, pose.y) for pose in (action.start, action.end))
        for width_of_line, color in ((5.0, "black"), (2.4, PICK_COLOR)):
            arrow = {"arrowstyle": "-|>", "color": color, "lw": width_of_line, "shrinkA": 0, "shrinkB": 0}
            ax.annotate("", (end_col, end_row), (col, row), arrowprops=arrow)
        ax.plot(col, row, "o", color=PICK_COLOR, mec="black", ms=5)
    else:
        draw_gripper(ax, action.pick, workspace, PICK_COLOR)
        draw_gripper(ax, action.place, workspace, PLACE_COLOR)
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
