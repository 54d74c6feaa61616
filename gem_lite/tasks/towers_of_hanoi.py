"""towers-of-hanoi-seq: "move the red ring to the lighter brown side", seven sentences, after CLIPort."""

from __future__ import annotations

import math

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import stands
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SMALL, MIDDLE, LARGE = range(3)
MOVES = ((SMALL, 2), (MIDDLE, 1), (SMALL, 1), (LARGE, 2), (SMALL, 0), (MIDDLE, 2), (SMALL, 2))
"""The ring of each of the seven moves, and the number of the peg to which it goes."""
PLACES = tuple(stands.PLATES)
TOLERANCE = 0.01
STACKING = 0.0105
"""The height (m) from one ring of the first tower to the next: a little more than a ring's, so that they can settle."""


@register("towers-of-hanoi-seq", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class TowersOfHanoi(Task):
    """A stand of three pegs on three brown plates, and three rings of three sizes and colours on the lighter side."""

    max_steps = 2 * len(MOVES)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        plates = stands.add_stand(environment.client, free.take(stands.STAND_RADIUS))
        for plate, name in zip(plates, PLACES, strict=True):
            self.put(environment, plate, name)
        self.named_colors = tuple(draw(rng, self.palette, 3))
        tower = environment.pose(plates[0])[0]
        rings = {}
        for layer, size in enumerate((LARGE, MIDDLE, SMALL)):
            color = self.named_colors[size]
            pose = Pose2(tower.x, tower.y, rng.uniform(-math.pi, math.pi))
            height = stands.PLATE[2] + layer * STACKING
            radius = stands.RING_RADII[size]
            ring = stands.add_ring(environment.client, radius, colors.rgba(color), pose, height)
            rings[size] = self.put(environment, ring, f"{color} ring")
        goals = []
        for size, peg in MOVES:
            grasp = Pose2((stands.RING_HOLE + stands.RING_RADII[size]) / 2, 0.0)
            sentence = f"move the {self.named_colors[size]} ring to the {PLACES[peg]}"
            metric = PoseMetric(TOLERANCE)
            # The tool holds a ring off its centre, so the ring must keep its yaw.
            goals.append(Goal(sentence, (rings[size],), (plates[peg],), metric, grasp=grasp, rotations=False))
        return goals
