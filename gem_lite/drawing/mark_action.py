"""A person marks a pick and a place on the table seen from above, with a mouse, a finger or the keys.

It needs a live notebook. A stored copy or a static page shows the marks with `show_marked`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anywidget
import traitlets
from matplotlib.figure import Figure

from gem_lite.actions import PickPlace
from gem_lite.drawing.plots import PICK_COLOR, PLACE_COLOR, show_heightmap
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2

LONGEST_SIDE = 640
"""The longest side of the drawn table in pixels of the page, if its cells are not too many."""

Keep = Callable[[PickPlace, str], object]
"""What happens with a kept action and its sentence."""


def show_marked(heightmap: HeightMap, action: PickPlace, sentence: str = "") -> Figure:
    """A marked pick and place as a still picture, with the table's heights beside it."""
    return show_heightmap(heightmap, action, f'"{sentence}"' if sentence else "")


class MarkAction(anywidget.AnyWidget):
    """The table from above, on which a person marks a demonstration.

    A click marks the pick, the next click marks the place, and a drag turns a mark towards the pointer. A click without
    a drag has yaw 0. The cell that shows the widget must be run before the cell that reads `action`.

    Attributes:
        pick, place: [x, y, yaw] in the table's frame (metres, radians), or empty if not marked. ``place``'s yaw is the
            tool's final yaw.
        sentence: what a person would say. The person may change it.
        kept: the pick, the place and the sentence at the last press of "keep", or empty.
        problem: why the last press of "keep" was refused, for the person to read.

    Raises:
        traitlets.TraitError: ``pick`` or ``place`` gets other values than these, or lies outside the table.
    """

    _esm = Path(__file__).with_name("mark_action.js")

    table = traitlets.Dict().tag(sync=True)
    """Where the cells are: the script computes metres from it."""
    rgb = traitlets.Bytes().tag(sync=True)
    colors = traitlets.Dict({"pick": PICK_COLOR, "place": PLACE_COLOR}).tag(sync=True)

    pick = traitlets.List().tag(sync=True)
    place = traitlets.List().tag(sync=True)
    sentence = traitlets.Unicode().tag(sync=True)
    kept = traitlets.Dict().tag(sync=True)
    problem = traitlets.Unicode().tag(sync=True)

    def __init__(self, heightmap: HeightMap, action: PickPlace | None = None, sentence: str = "") -> None:
        """Show a table, and the marks of an action if there is one already."""
        w = self.workspace = heightmap.workspace
        self._keeps: list[Keep] = []
        rows, cols = w.shape
        scale = max(1, LONGEST_SIDE // max(rows, cols))
        super().__init__(
            table={"rows": rows, "cols": cols, "x_min": w.x_min, "y_max": w.y_max, "cell": w.pixel, "scale": scale},
            rgb=heightmap.rgb.tobytes(),
            pick=_numbers(action.pick) if action else [],
            place=_numbers(action.place) if action else [],
            sentence=sentence,
        )

    def __repr__(self) -> str:
        """What a stored copy of a notebook shows in the widget's place."""
        return "the table from above: run this cell in a live notebook to mark an action"

    @property
    def action(self) -> PickPlace:
        """The marked action.

        Raises:
            ValueError: the pick or the place is not marked yet.
        """
        return _action(self.pick, self.place)

    @property
    def is_kept(self) -> bool:
        """Whether the person pressed "keep" and has changed nothing since then."""
        return self.kept == {"pick": self.pick, "place": self.place, "sentence": self.sentence}

    def on_keep(self, function: Keep) -> None:
        """Call a function with the action and the sentence each time the person presses "keep".

        It may refuse them with a ValueError, or fail with an OSError, as on a full disk: the person then reads the
        error's text. What it prints is not shown.
        """
        self._keeps.append(function)

    @traitlets.validate("pick", "place")
    def _check_mark(self, proposal: dict[str, Any]) -> list[float]:
        name, mark = proposal["trait"].name, proposal["value"]
        if not mark:
            return []
        if len(mark) != 3 or not all(isinstance(value, int | float) and math.isfinite(value) for value in mark):
            raise traitlets.TraitError(f"{name} must be [x, y, yaw] in metres and radians, or empty, got {mark}")
        if not self.workspace.contains(mark[0], mark[1]):
            raise traitlets.TraitError(
                f"{name} at ({mark[0]:.3f}, {mark[1]:.3f}) m lies outside the table, {self.workspace}"
            )
        return [float(value) for value in mark]

    @traitlets.observe("kept")
    def _hand_over(self, change: dict[str, Any]) -> None:
        kept = change["new"]
        if not kept:
            return
        try:
            for function in self._keeps:
                function(_action(kept["pick"], kept["place"]), kept["sentence"])
        except (ValueError, OSError) as error:
            self.kept = {}
            self.problem = str(error)


def _numbers(pose: Pose2) -> list[float]:
    return [pose.x, pose.y, pose.yaw]


def _action(pick: list[float], place: list[float]) -> PickPlace:
    for name, mark in (("pick", pick), ("place", place)):
        if not mark:
            raise ValueError(f"the {name} is not marked yet: click where the tool shall {name}")
    return PickPlace(Pose2(*pick), Pose2(*place))
