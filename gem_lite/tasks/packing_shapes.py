"""packing-shapes: "pack the letter R shape in the brown box", after CLIPort."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from shapely.geometry import Point
from shapely.ops import nearest_points
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.shapes import USUAL_FORM, PieceForm
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw, put_brown_box
from gem_lite.tasks.task import Task

PIECES = 5
BOX_SIDES = (0.1, 0.15)
"""Each side (m) of the box is drawn from this range."""
TURNS = {
    "triangle": 3, "square": 4, "plus": 4, "diamond": 2, "pentagon": 5, "rectangle": 2, "flower": 4, "star": 5,
    "hexagon": 6,
}  # fmt: skip
"""Shapes that look the same after a part of a full turn, and the number of these parts in a full turn."""
ROUND = ("circle", "ring")
"""Shapes that look the same after every turn."""


@register("packing-shapes", {"seen": {}, "unseen": {"unseen": True}})
class PackingShapes(Task):
    """One fixed brown box and five movable pieces of five shapes and five colours; the sentence names one shape.

    CLIPort's task is the unseen variant: in validation and test, shapes and colours come from the unseen
    sets. An episode has one action.
    """

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        box, zone = put_brown_box(self, environment, rng, free, BOX_SIDES)
        shape_names = shapes.UNSEEN_SHAPES if self.unseen else shapes.SEEN_SHAPES
        piece_shapes = draw(rng, shape_names, PIECES)
        pieces, forms = [], []
        for shape, color in zip(piece_shapes, draw(rng, self.palette, PIECES), strict=True):
            form = free.piece_form(symmetric=is_symmetric(shape))
            forms.append(form)
            mesh = shapes.piece_mesh(shape, form)
            pose = free.take(float(np.linalg.norm(mesh.vertices[:, :2], axis=1).max()))
            piece = shapes.add_mesh(environment.client, mesh, colors.rgba(color), pose)
            pieces.append(self.put(environment, piece, f"{color} {shape}"))
        named = piece_shapes[0]
        sentence = f"pack the {named} in the brown box"
        grasp = Pose2(*grasp_point(named, forms[0]))
        return [Goal(sentence, (pieces[0],), (box,), zone, 1.0, grasp, piece_symmetry(named))]


def piece_symmetry(shape: str) -> float:
    """The smallest turn (radians) after which a piece looks the same; 0 for a round piece, whose every yaw is right."""
    return 0.0 if shape in ROUND else 2 * math.pi / TURNS.get(shape, 1)


def is_symmetric(shape: str) -> bool:
    """Whether a piece looks the same after less than half a turn. Then it has one length, not a length and a width."""
    return piece_symmetry(shape) < math.pi


@lru_cache(maxsize=256)
def grasp_point(shape: str, form: PieceForm = USUAL_FORM) -> tuple[float, float]:
    """The point of the material that is nearest to a piece's centre (m, in the piece's frame).

    A ring and many letters have no material in the middle. The tool could still grasp them there, because contact
    uses the convex hull; a real tool could not.
    """
    solid = shapes.outline(shape, form).buffer(-0.004)
    point = nearest_points(solid, Point(0, 0))[0]
    return point.x, point.y
