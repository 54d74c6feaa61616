"""block-stacking-pyramid: "pick the red block and place on green and blue block", of the paper's real tables.

It is the pyramid of `stack_block_pyramid` at the size of the real tables (A.11), on three plates that have colours of
their own.
"""

from __future__ import annotations

import math

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks import stack_block_pyramid
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.real_table import AREA, GAP, SCALE, WORKSPACE
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.stack_block_pyramid import QUARTER, SPOTS, YAW_TOLERANCE
from gem_lite.tasks.task import Task

BLOCK = SCALE * shapes.BLOCK_SIZE
PLATE = (SCALE * stack_block_pyramid.SPACING, SCALE * stack_block_pyramid.SPACING, 0.0025)
"""Sides (m) of a plate. Neighbouring plates touch, so that blocks in their middles leave 5 mm for a finger."""
PLATE_COLORS = tuple(colors.OTHERS)
"""The colours of the plates, in any order. No block has one of them."""
TOLERANCE = SCALE * stack_block_pyramid.TOLERANCE
"""A placed block is nearer than this (m) to its spot, in x and y and in height."""


@register("block-stacking-pyramid", {"seen": {}, "unseen": {"unseen": True}})
class BlockStackingPyramid(Task):
    """Six movable blocks of six colours, and three fixed plates in a row of three other colours; no distractors.

    The sentences have a fixed order, with the bottom layer first. An episode has twelve actions: six more than blocks.
    In validation and test, the blocks of the unseen variant have the unseen colours. The plates are the same: in A.11,
    "the evaluation involves blocks that have not been seen before".
    """

    workspace = WORKSPACE
    scale = SCALE
    effector = "parallel-jaw"
    max_steps = 2 * len(SPOTS)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(AREA, rng, environment.style, GAP)
        self.named_colors = tuple(draw(rng, self.palette, len(SPOTS)))
        left, middle, right = draw(rng, PLATE_COLORS, 3)
        base = free.take(math.hypot(PLATE[0], 3 * PLATE[1]) / 2)
        for color, (y, _) in zip((left, middle, right), SPOTS, strict=False):
            at = base @ Pose2(0.0, SCALE * y)
            plate = shapes.add_box(environment.client, PLATE, colors.rgba(color), at, movable=False)
            self.put(environment, plate, f"{color} plate")
        a, b, c, d, e, _ = self.named_colors
        places = (
            f"{left} plate", f"{middle} plate", f"{right} plate", f"{a} and {b} block", f"{b} and {c} block",
            f"{d} and {e} block",
        )  # fmt: skip
        goals = []
        for color, place, (y, layer) in zip(self.named_colors, places, SPOTS, strict=True):
            pose = free.take(BLOCK / math.sqrt(2), BLOCK / 2)
            block = shapes.add_box(environment.client, (BLOCK,) * 3, colors.rgba(color), pose)
            self.put(environment, block, f"{color} block")
            height = PLATE[2] + (layer + 0.5) * BLOCK
            on_spot = PoseMetric(TOLERANCE, QUARTER, YAW_TOLERANCE, height, TOLERANCE)
            sentence = f"pick the {color} block and place on {place}"
            goals.append(Goal(sentence, (block,), (base @ Pose2(0.0, SCALE * y),), on_spot, grasp_symmetry=QUARTER))
        return goals
