"""put-block-in-bowl: "put the red blocks in a green bowl", after CLIPort."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, TableFullError, draw
from gem_lite.tasks.task import Task

TOLERANCE = 0.05
"""A block is in a bowl if its distance (metres, in x and y) to the bowl's centre is less than this."""
DISTRACTORS = 6
BLOCK_RADIUS = shapes.BLOCK_SIZE / math.sqrt(2)
BOTH_NEW = "both named colours new"
"""The subset of episodes whose sentence names two colours that no demonstration names."""


@register("put-block-in-bowl", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class PutBlockInBowl(Task):
    """1-3 fixed bowls of one colour, at most as many blocks of another, six movable distractors.

    Each distractor is a block or a bowl with equal probability. The distractors take the remaining colours of the full
    list in order, as in CLIPort. So in training, they also have colours that no sentence names.
    """

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        bowl_count = int(rng.integers(1, 4))
        block_count = int(rng.integers(1, bowl_count + 1))
        block_color, bowl_color = draw(rng, self.palette, 2)
        bowls = [self._add_bowl(environment, free, bowl_color, movable=False) for _ in range(bowl_count)]
        blocks = [self._add_block(environment, free, block_color) for _ in range(block_count)]
        for color in [name for name in colors.RGB if name not in (block_color, bowl_color)][:DISTRACTORS]:
            is_block = rng.random() < 0.5
            with suppress(TableFullError):
                if is_block:
                    self._add_block(environment, free, color)
                else:
                    self._add_bowl(environment, free, color, movable=True)
        self.named_colors = (block_color, bowl_color)
        self.max_steps = block_count + 1
        # A cube looks the same after a quarter turn. In a round bowl, every yaw is right.
        sentence = f"put the {block_color} blocks in a {bowl_color} bowl"
        return [Goal(sentence, tuple(blocks), tuple(bowls), PoseMetric(TOLERANCE), grasp_symmetry=math.pi / 2)]

    @override
    def subsets(self) -> tuple[str, ...]:
        both_new = set(self.named_colors) <= set(colors.NEW)
        return (BOTH_NEW,) if both_new else ()

    def _add_bowl(self, environment: Environment, free: FreeSpace, color: str, movable: bool) -> shapes.Body:
        profiles = environment.style.bowls
        profile = profiles[free.choose(len(profiles))]
        pose = free.take(profile.rim)
        bowl = shapes.add_bowl(environment.client, colors.rgba(color), pose, movable, profile)
        return self.put(environment, bowl, f"{color} bowl")

    def _add_block(self, environment: Environment, free: FreeSpace, color: str) -> shapes.Body:
        pose = free.take(BLOCK_RADIUS, shapes.BLOCK_SIZE / 2)
        block = shapes.add_block(environment.client, colors.rgba(color), pose)
        return self.put(environment, block, f"{color} block")
