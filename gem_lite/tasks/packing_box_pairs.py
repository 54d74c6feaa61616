"""packing-box-pairs: "pack all the red and blue blocks into the brown box", after CLIPort."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, VolumeMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, TableFullError, put_brown_box, split_floor
from gem_lite.tasks.task import Task

BOX_SIDES = (0.05, 0.3)
"""Each side (m) of the brown box is drawn from this range."""
SHORTEST = 0.05
"""The cells of the brown box have sides (m) between about this and twice as much."""
BLOCK_HEIGHT = 0.05
ABOVE = 0.0775
"""A point of a block counts as packed below this height (m): CLIPort's 0.0525 m above the box's middle."""
DISTRACTORS = 4


@register("packing-box-pairs", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class PackingBoxPairs(Task):
    """A brown box, blocks of two colours that fill it, and four blocks of other colours. One sentence for all blocks.

    The brown box is cut into cells; each cell gives a block of its size. A block without a free place is left out.
    """

    max_steps = 20

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        box, zone = put_brown_box(self, environment, rng, free, BOX_SIDES)
        box_pose = environment.pose(box)[0]
        cells = split_floor(rng, zone.size, SHORTEST)
        shuffled = [str(name) for name in rng.permutation(self.palette)]
        named = tuple(shuffled[: min(2, len(cells))])
        self.named_colors = named
        blocks = []
        targets = []
        extents = {}
        for place, size in cells:
            color = named[int(rng.integers(len(named)))]
            with suppress(TableFullError):
                block = self._add_block(environment, free, size, color)
                blocks.append(block)
                targets.append(box_pose @ place)
                extents[block.id] = (*size, BLOCK_HEIGHT)
        others = shuffled[len(named) :]
        for _ in range(DISTRACTORS):
            _, size = cells[int(rng.integers(len(cells)))]
            with suppress(TableFullError):
                self._add_block(environment, free, size, others[int(rng.integers(len(others)))])
        metric = VolumeMetric(box, zone.size, ABOVE, extents, symmetry=math.pi)
        sentence = f"pack all the {' and '.join(named)} blocks into the brown box"
        own = tuple((number,) for number in range(len(blocks)))
        return [Goal(sentence, tuple(blocks), tuple(targets), metric, grasp_symmetry=math.pi, matches=own)]

    def _add_block(
        self, environment: Environment, free: FreeSpace, size: tuple[float, float], color: str
    ) -> shapes.Body:  # fmt: skip
        pose = free.take(math.hypot(*size) / 2)
        block = shapes.add_box(environment.client, (*size, BLOCK_HEIGHT), colors.rgba(color), pose, mass=0.1)
        return self.put(environment, block, f"{color} block")
