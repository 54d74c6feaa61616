"""pick-shapes-in-bowl: "pick the yellow pentagon and place into green bowl", of the paper's real tables (A.11)."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import trimesh
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks import put_block_in_bowl
from gem_lite.tasks.goals import MIDDLE, Goal, PoseMetric
from gem_lite.tasks.packing_shapes import ROUND, TURNS
from gem_lite.tasks.real_table import AREA, GAP, SCALE, WORKSPACE
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SHAPES = ("square", "plus", "diamond", "pentagon", "rectangle", "flower", "circle")
UNSEEN_SHAPES = ("ring", "hexagon", "heart")
"""Those of CLIPort's kitting shapes that are no letters, and that a jaw can hold by their middle. It cannot hold a
triangle, and a star only by its arms."""
GRASPS = {
    "diamond": Pose2(0.0, 0.0, math.pi / 4), "pentagon": Pose2(0.0, 0.0, math.pi / 2),
    "hexagon": Pose2(0.0, 0.0, math.pi / 2), "heart": Pose2(0.0, 0.0035, math.pi / 2),
}  # fmt: skip
"""The expert's grasp in the frame of a shape, where it is not the shape's own pose."""
PIECE_SCALE = 0.45
"""The size of a piece as a multiple of CLIPort's: up to 34 mm long. A square of 27 mm leaves the jaw some room."""
IN_BOWL = PoseMetric(SCALE * put_block_in_bowl.TOLERANCE)
BOWLS = 3


@cache
def piece_mesh(shape: str) -> trimesh.Trimesh:
    """A kitting shape at the size of the real tables, 9 mm thick."""
    return shapes.piece_mesh(shape).copy().apply_scale(PIECE_SCALE)


def grasp_symmetry(shape: str) -> float:
    """The smallest turn (radians) of a jaw on a shape that does not change the grasp; 0 for a round shape.

    Half a turn of a jaw changes nothing, nor does a turn after which the shape looks the same.
    """
    return 0.0 if shape in ROUND else 2 * math.pi / math.lcm(2, TURNS.get(shape, 1))


@register("pick-shapes-in-bowl", {"seen": {}, "unseen": {"unseen": True}})
class PickShapesInBowl(Task):
    """Four movable pieces and three fixed bowls; the sentence names the colour and the shape of one piece, and a bowl.

    Of the other pieces, one has the named colour, one the named shape, and one neither: both words decide. In
    validation and test, shapes and colours of the unseen variant come from the unseen sets. An episode has one action.
    """

    workspace = WORKSPACE
    scale = SCALE
    effector = "parallel-jaw"

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(AREA, rng, environment.style, GAP)
        named, other_1, other_2 = draw(rng, UNSEEN_SHAPES if self.unseen else SHAPES, 3)
        color, color_2, color_3, *of_bowls = draw(rng, self.palette, 3 + BOWLS)
        self.named_colors = (color, of_bowls[0])
        bowls = []
        for of_bowl in of_bowls:
            profiles = environment.style.bowls
            profile = profiles[free.choose(len(profiles))].scaled(SCALE)
            bowl = shapes.add_bowl(environment.client, colors.rgba(of_bowl), free.take(profile.rim), False, profile)
            bowls.append(self.put(environment, bowl, f"{of_bowl} bowl"))
        pieces = []
        for of_piece, shape in ((color, named), (color, other_1), (color_2, named), (color_3, other_2)):
            mesh = piece_mesh(shape)
            pose = free.take(float(np.linalg.norm(mesh.vertices[:, :2], axis=1).max()))
            piece = shapes.add_mesh(environment.client, mesh, colors.rgba(of_piece), pose, mass=0.01)
            pieces.append(self.put(environment, piece, f"{of_piece} {shape}"))
        sentence = f"pick the {color} {named} and place into {of_bowls[0]} bowl"
        grasp = GRASPS.get(named, MIDDLE)
        return [Goal(sentence, (pieces[0],), (bowls[0],), IN_BOWL, grasp=grasp, grasp_symmetry=grasp_symmetry(named))]
