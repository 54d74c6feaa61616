"""bars-in-box: "put the red bar in the brown box", with a jaw that can grasp a bar only across the bar."""

from __future__ import annotations

import math

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw, put_brown_box
from gem_lite.tasks.task import Task

BAR_SIZE = (0.1, 0.015, 0.02)
BAR_RADIUS = math.hypot(*BAR_SIZE[:2]) / 2
BARS = 4
BOX_SIDES = (0.13, 0.16)
"""Each side (m) of the box is drawn from this range. A bar fits in at any yaw."""
PALETTE = tuple(name for name in colors.SEEN if name != "brown")


@register("bars-in-box")
class BarsInBox(Task):
    """One fixed brown box and four movable bars of four other colours; the sentence names one bar."""

    effector = "jaw"
    max_steps = 2

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        box, zone = put_brown_box(self, environment, rng, free, BOX_SIDES)
        bar_colors = draw(rng, PALETTE, BARS)
        bars = []
        for color in bar_colors:
            bar = shapes.add_box(environment.client, BAR_SIZE, colors.rgba(color), free.take(BAR_RADIUS))
            bars.append(self.put(environment, bar, f"{color} bar"))
        self.named_colors = (bar_colors[0],)
        # A bar is longest along its own x axis, so the jaw needs the bar's yaw. Half a turn more is the same grasp.
        return [Goal(f"put the {bar_colors[0]} bar in the brown box", (bars[0],), (box,), zone, grasp_symmetry=math.pi)]
