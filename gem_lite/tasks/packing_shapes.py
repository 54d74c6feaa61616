"""packing-shapes: "pack the letter R shape in the brown box", after CLIPort."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from shapely.geometry import Point
from shapely.ops import nearest_points

from gem_lite import colors
from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Action, Pose2
from gem_lite.simulation import shapes, trays
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

PIECES = 5
BOX_SIDES = (0.1, 0.15)
"""The box's sides (m) are drawn from this range, each for itself."""
TURNS = {
    "triangle": 3, "square": 4, "plus": 4, "diamond": 2, "pentagon": 5, "rectangle": 2, "flower": 4, "star": 5,
    "hexagon": 6,
}  # fmt: skip
"""Shapes that look the same after a part of a full turn, and how many such turns there are."""
ROUND = ("circle", "ring")


class PackingShapes(Task):
    """One fixed brown box and five movable pieces of five shapes and five colours; the sentence names one shape.

    CLIPort's task is the unseen variant: in validation and test, shapes and colours come from the unseen
    sets. There is one try.
    """

    def __init__(self, unseen: bool) -> None:
        super().__init__()
        self._palette = colors.UNSEEN if unseen else colors.SEEN
        self._shapes = shapes.UNSEEN_SHAPES if unseen else shapes.SEEN_SHAPES

    def reset(self, world: World, rng: np.random.Generator) -> None:
        """See `Task.reset`."""
        free = FreeSpace(world.workspace, rng, world.style)
        self._size = tuple(rng.uniform(*BOX_SIDES, 2).tolist())
        heights = world.style.box_heights
        self._height = heights[free.choose(len(heights))]
        pose = free.take(math.hypot(*self._size) / 2)
        self._box = world.add(trays.add_container(world.client, self._size, colors.rgba("brown"), pose, self._height))
        self.names = {self._box.id: "brown box"}
        chosen = [str(name) for name in rng.choice(self._shapes, PIECES, replace=False)]
        bodies = []
        for shape, color in zip(chosen, rng.choice(self._palette, PIECES, replace=False), strict=True):
            mesh = shapes.piece_mesh(shape)
            pose = free.take(float(np.linalg.norm(mesh.vertices[:, :2], axis=1).max()))
            bodies.append(world.add(shapes.add_mesh(world.client, mesh, colors.rgba(str(color)), pose)))
            self.names[bodies[-1].id] = f"{color} {shape}"
        self._shape, self._piece = chosen[0], bodies[0]
        self.instruction = f"pack the {self._shape} in the brown box"
        self.max_steps = 1

    def score(self, world: World) -> float:
        """1 if the piece's centre is in the box, else 0."""
        return float(trays.in_container(world, self._box, self._size, self._piece, self._height))

    def expert(self, world: World) -> ExpertAction | None:
        """Take the piece by its `grasp_point` to the box's middle, where every turn is as good."""
        if self.score(world):
            return None
        grasp = grasp_point(self._shape)
        pick, box = world.pose(self._piece)[0] @ Pose2(*grasp), world.pose(self._box)[0]
        symmetry = 0.0 if self._shape in ROUND else 2 * math.pi / TURNS.get(self._shape, 1)
        return ExpertAction(Action(pick, Pose2(box.x, box.y, pick.yaw)), symmetry, 0.0)


@cache
def grasp_point(shape: str) -> tuple[float, float]:
    """The point (m, in the piece's frame) nearest to a piece's centre where the tip is on material.

    A ring and many a letter have none in the middle; contact by convex hulls would let the tool grasp
    them there all the same.
    """
    solid = shapes.outline(shape).buffer(-0.004)
    point = nearest_points(solid, Point(0, 0))[0]
    return point.x, point.y
