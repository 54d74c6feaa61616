"""stack-block-pyramid-seq: six sentences, "put the red block on the green and blue blocks", after CLIPort."""

from __future__ import annotations

import math

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.parts import BROWNS
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SPACING = 0.05
"""Distance (m) between the middles of neighbouring plates; also their length."""
PLATES = ("lightest brown block", "middle brown block", "darkest brown block")
"""The plates of the base along its +y: their names in the sentences. They have the colours `BROWNS`."""
SPOTS = ((-0.05, 0), (0.0, 0), (0.05, 0), (-0.025, 1), (0.025, 1), (0.0, 2))
"""The target of each of the six blocks: y (m) in the base's frame, and the layer."""
TOLERANCE = 0.01
"""A placed block is nearer than this (m) to its spot, in x and y and in height."""
YAW_TOLERANCE = math.radians(15)
QUARTER = math.pi / 2
BLOCK_EXTENT = (shapes.BLOCK_SIZE / math.sqrt(2), shapes.BLOCK_SIZE / 2)
"""The distances (m) from the centre of a block to its corners and to its sides."""


@register("stack-block-pyramid-seq", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class StackBlockPyramid(Task):
    """Six movable blocks of six colours, and a fixed base of three brown plates; no distractors.

    The sentences have a fixed order, with the bottom layer first. An episode has twelve actions: six more than blocks.
    """

    max_steps = 2 * len(SPOTS)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        self.named_colors = tuple(draw(rng, self.palette, len(SPOTS)))
        sizes = environment.style.plates
        width, thickness = sizes[free.choose(len(sizes))]
        base = free.take(math.hypot(width, 3 * SPACING) / 2)
        for name, rgba, (y, _) in zip(PLATES, BROWNS, SPOTS, strict=False):
            size = (width, SPACING, thickness)
            plate = shapes.add_box(environment.client, size, rgba, base @ Pose2(0, y), movable=False)
            self.put(environment, plate, name)
        a, b, c, d, e, _ = self.named_colors
        places = (*PLATES, f"{a} and {b} blocks", f"{b} and {c} blocks", f"{d} and {e} blocks")
        goals = []
        for color, place, (y, layer) in zip(self.named_colors, places, SPOTS, strict=True):
            block = shapes.add_block(environment.client, colors.rgba(color), free.take(*BLOCK_EXTENT))
            self.put(environment, block, f"{color} block")
            height = thickness + (layer + 0.5) * shapes.BLOCK_SIZE
            # A block lies parallel to the base; a cube looks the same after a quarter turn.
            on_spot = PoseMetric(TOLERANCE, QUARTER, YAW_TOLERANCE, height, TOLERANCE)
            sentence = f"put the {color} block on the {place}"
            goals.append(Goal(sentence, (block,), (base @ Pose2(0, y),), on_spot, grasp_symmetry=QUARTER))
        return goals
