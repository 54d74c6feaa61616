"""Four task families on the table of another simulator.

Sentences, goals, rewards and numbers of acts are those of gem_lite's tasks; sizes and proportions are others, and
differ from episode to episode.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.foreign_tasks import bodies
from experiments.foreign_tasks.table import TaskTable
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.tasks import assembling_kits, separating_piles, stack_block_pyramid, towers_of_hanoi
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

QUARTER = math.pi / 2


def other_size(rng: np.random.Generator) -> float:
    """A factor: 5 to 10 % smaller or larger."""
    return 1 + float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.1))


class StackBlockPyramid(Task):
    """Six blocks and a base of three long plates with cut corners."""

    max_steps = 12

    def lay_out(self, environment: TaskTable, rng: np.random.Generator, seed: int) -> list[Goal]:
        """See `Task.lay_out`."""
        free = FreeSpace(environment.workspace, rng)
        factor = other_size(rng)
        side = factor * shapes.BLOCK_SIZE
        spacing = factor * stack_block_pyramid.SPACING
        width = rng.uniform(1.2, 1.5) * spacing
        thickness = rng.uniform(0.007, 0.012)
        base = free.take(math.hypot(width, 3 * spacing) / 2)
        for color, (y, _) in zip(bodies.BROWNS, stack_block_pyramid.SPOTS, strict=False):
            bodies.add_plate(environment, (width, spacing), thickness, color, base @ Pose2(0, factor * y))
        self.named_colors = tuple(draw(rng, self.palette, len(stack_block_pyramid.SPOTS)))
        a, b, c, d, e, _ = self.named_colors
        places = (*stack_block_pyramid.PLATES, f"{a} and {b} blocks", f"{b} and {c} blocks", f"{d} and {e} blocks")
        goals = []
        for color, place, (y, layer) in zip(self.named_colors, places, stack_block_pyramid.SPOTS, strict=True):
            block = bodies.add_block(environment, side, color, free.take(side / math.sqrt(2)))
            self.put(environment, block, f"{color} block")
            height = thickness + (layer + 0.5) * side
            on_spot = PoseMetric(0.01, QUARTER, math.radians(15), height, 0.01)
            sentence = f"put the {color} block on the {place}"
            goals.append(Goal(sentence, (block,), (base @ Pose2(0, factor * y),), on_spot, grasp_symmetry=QUARTER))
        return goals


FAMILIES = {"stack-block-pyramid": StackBlockPyramid}
