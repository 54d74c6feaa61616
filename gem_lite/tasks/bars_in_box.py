"""bars-in-box: "put the red bar in the brown box", with a jaw that grasps a bar only across it."""

from __future__ import annotations

import math

import numpy as np

from gem_lite import colors
from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Action, Pose2
from gem_lite.simulation import shapes, trays
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

BAR_SIZE = (0.1, 0.015, 0.02)
BAR_RADIUS = math.hypot(*BAR_SIZE[:2]) / 2
BARS = 4
BOX_SIDES = (0.13, 0.16)
"""The box's sides (m) are drawn from this range, each for itself: wide enough for a bar at any yaw."""


class BarsInBox(Task):
    """One fixed brown box and four movable bars of four other colours; the sentence names one bar."""

    jaw = True

    def __init__(self, unseen_colors: bool) -> None:
        super().__init__()
        self._palette = [name for name in (colors.UNSEEN if unseen_colors else colors.SEEN) if name != "brown"]

    def reset(self, world: World, rng: np.random.Generator) -> None:
        """See `Task.reset`."""
        free = FreeSpace(world.workspace, rng, world.style)
        self._size = tuple(rng.uniform(*BOX_SIDES, 2).tolist())
        heights = world.style.box_heights
        self._height = heights[free.choose(len(heights))]
        pose = free.take(math.hypot(*self._size) / 2)
        self._box = world.add(trays.add_container(world.client, self._size, colors.rgba("brown"), pose, self._height))
        chosen = [str(name) for name in rng.choice(self._palette, BARS, replace=False)]
        bars = [
            world.add(shapes.add_box(world.client, BAR_SIZE, colors.rgba(name), free.take(BAR_RADIUS)))
            for name in chosen
        ]
        self._bar = bars[0]
        self.names = {self._box.id: "brown box"} | {
            bar.id: f"{color} bar" for bar, color in zip(bars, chosen, strict=True)
        }
        self.named_colors = (chosen[0],)
        self.instruction = f"put the {chosen[0]} bar in the brown box"
        self.max_steps = 2

    def score(self, world: World) -> float:
        """1 if the bar's centre is in the box, else 0."""
        return float(trays.in_container(world, self._box, self._size, self._bar, self._height))

    def expert(self, world: World) -> ExpertAction | None:
        """Grasp the bar by its middle, across it, and take it to the box's middle, where every turn is as good.

        The bar lies along its own x, so the jaw's yaw is the bar's; half a turn on, it closes just the same.
        """
        if self.score(world):
            return None
        pick, box = world.pose(self._bar)[0], world.pose(self._box)[0]
        return ExpertAction(Action(pick, Pose2(box.x, box.y, pick.yaw)), math.pi, 0.0)
