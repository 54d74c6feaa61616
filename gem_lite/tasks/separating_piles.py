"""separating-piles: "push the pile of red blocks into the green square", after CLIPort."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import trimesh
from shapely.geometry import box
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body, add_box, add_print
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, ZoneMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

CUBE = 0.01
"""Side (m) of a cube of a pile."""
CUBES = 50
SQUARE = 0.12
"""Side (m) of a square, measured outside."""
LINE = 0.006
"""Width (m) of a square's outline."""
PRINT = 0.001
"""Height (m) of the outline over the table."""
SCORED = (0.15, 0.15)
"""Sides (m) of the area that counts. It is larger than the drawn square, as in CLIPort."""
SPREAD = 0.1
"""The cubes lie at most this far (m) from the table's middle, in x and in y."""
SQUARE_RADIUS = 0.1
"""The middles of the squares are at least twice this far (m) apart."""


def add_pile(client: int, color: RGBA, poses: Sequence[Pose2]) -> list[Body]:
    """Put movable cubes on the table, one at each pose. They may start inside each other's space; then they part."""
    return [add_box(client, (CUBE,) * 3, color, pose, mass=0.001, friction=0.5) for pose in poses]


@cache
def square_mesh() -> trimesh.Trimesh:
    """A square outline, flat."""
    outer = SQUARE / 2
    inner = outer - LINE
    frame = box(-outer, -outer, outer, outer).difference(box(-inner, -inner, inner, inner))
    return trimesh.creation.extrude_polygon(frame, PRINT)


def add_square(client: int, color: RGBA, pose: Pose2) -> Body:
    """Draw a square outline on the table. It is fixed, and other bodies do not touch it."""
    return add_print(client, square_mesh(), color, pose)


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
            body = add_square(environment.client, colors.rgba(color), free.take(SQUARE_RADIUS))
            squares.append(self.put(environment, body, f"{color} square"))
        offsets = rng.uniform(-SPREAD, SPREAD, (CUBES, 2))
        yaws = rng.uniform(-np.pi, np.pi, CUBES)
        poses = [environment.middle @ Pose2(*place) for place in np.column_stack([offsets, yaws]).tolist()]
        made = add_pile(environment.client, colors.rgba(pile), poses)
        cubes = [self.put(environment, cube, f"pile of {pile} blocks") for cube in made]
        sentence = f"push the pile of {pile} blocks into the {square} square"
        return [Goal(sentence, tuple(cubes), (squares[0],), ZoneMetric(SCORED, w.z_max))]
