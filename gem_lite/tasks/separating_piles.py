"""separating-piles: "push the pile of red blocks into the green square", after CLIPort."""

from __future__ import annotations

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import piles
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, ZoneMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SCORED = (0.15, 0.15)
"""Sides (m) of the area that counts. It is larger than the drawn square, as in CLIPort."""
SPREAD = 0.1
"""The cubes lie at most this far (m) from the table's middle, in x and in y."""
SQUARE_RADIUS = 0.1
"""The middles of the squares are at least twice this far (m) apart."""


@register("separating-piles", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class SeparatingPiles(Task):
    """A pile of 50 small cubes and two squares, in three colours. A spatula pushes the pile into the named square."""

    effector = "spatula"
    max_steps = 20

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        square, other, pile = draw(rng, self.palette, 3)
        self.named_colors = (pile, square)
        w = environment.workspace
        free = FreeSpace(w, rng, environment.style, gap=0.0)
        squares = []
        for color in (square, other):
            body = piles.add_square(environment.client, colors.rgba(color), free.take(SQUARE_RADIUS))
            squares.append(self.put(environment, body, f"{color} square"))
        offsets = rng.uniform(-SPREAD, SPREAD, (piles.CUBES, 2))
        yaws = rng.uniform(-np.pi, np.pi, piles.CUBES)
        poses = [environment.middle @ Pose2(*place) for place in np.column_stack([offsets, yaws]).tolist()]
        made = piles.add_pile(environment.client, colors.rgba(pile), poses)
        cubes = [self.put(environment, cube, f"pile of {pile} blocks") for cube in made]
        sentence = f"push the pile of {pile} blocks into the {square} square"
        return [Goal(sentence, tuple(cubes), (squares[0],), ZoneMetric(SCORED, w.z_max))]
