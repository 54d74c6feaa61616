"""assembling-kits-seq: "put the red letter R shape in the left letter R shape hole", after CLIPort."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import trimesh
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.shapes import USUAL_FORM, Body, PieceForm
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.packing_shapes import grasp_point, is_symmetric, piece_symmetry
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Split, Task

KIT_SIZE = (0.28, 0.20, 0.005)
"""Sides (m) of the board."""
SPOTS = (
    Pose2(-0.09, 0.045), Pose2(0.0, 0.045), Pose2(0.09, 0.045), Pose2(-0.045, -0.045), Pose2(0.045, -0.045),
)  # fmt: skip
"""The places of the holes in the frame of the board."""
HOLE_COLOR = (0.2, 0.2, 0.2, 1.0)
PRINT = 0.0012
"""Height (m) of a hole's print over the board."""
TOLERANCE = 0.01
YAW_TOLERANCE = math.radians(15)
KIT_RADIUS = math.hypot(*KIT_SIZE[:2]) / 2
PIECE_RADIUS = 0.042


@lru_cache(maxsize=256)
def hole_mesh(shape: str, form: PieceForm = USUAL_FORM) -> trimesh.Trimesh:
    """The print of a hole: the outline of a piece, `PRINT` thick."""
    return trimesh.creation.extrude_polygon(shapes.outline(shape, form), PRINT)


def add_full_kit(
    client: int, pose: Pose2, pieces: Sequence[str], yaws: Sequence[float], forms: Sequence[PieceForm]
) -> tuple[Body, list[Body]]:  # fmt: skip
    """Put a fixed board with one hole for each of five pieces on the table. Other bodies do not touch the holes.

    Args:
        pieces: the names of the five shapes.
        yaws: the yaw (radians) of each hole in the world.
        forms: the form of each shape.

    Returns:
        The board and its holes.

    Raises:
        ValueError: no piece has one of these shapes.
    """
    board = shapes.add_box(client, KIT_SIZE, colors.rgba("brown"), pose, movable=False)
    holes = []
    for shape, spot, yaw, form in zip(pieces, SPOTS, yaws, forms, strict=True):
        place = pose @ spot
        at = Pose2(place.x, place.y, yaw)
        holes.append(shapes.add_print(client, hole_mesh(shape, form), HOLE_COLOR, at, KIT_SIZE[2]))
    return board, holes


def location(hole: Pose2, twins: Sequence[Pose2]) -> str:
    """The word that tells a hole from others of the same shape, in the height map's directions; "" without twins.

    Left is towards smaller x, top towards larger y. A hole is the "top" one if it is above each twin by more than
    it is beside it, and so on; a hole to which no word fits is the "middle" one.
    """
    if not twins:
        return ""
    right = [hole.x - twin.x for twin in twins]
    up = [hole.y - twin.y for twin in twins]
    vertical = [abs(dy) > abs(dx) for dx, dy in zip(right, up, strict=True)]
    if all(vertical) and min(up) > 0:
        return "top"
    if all(vertical) and max(up) < 0:
        return "bottom"
    if max(right) < 0:
        return "left"
    if min(right) > 0:
        return "right"
    return "middle"


@register("assembling-kits-seq", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class AssemblingKits(Task):
    """A board with five holes and the five pieces, in any order of sentences; each piece has one right hole.

    Shapes may occur more than once; then the sentence says which hole. In validation and test, both variants have
    unseen shapes, as in CLIPort; the variants differ in the colours. A piece that is put wrongly is not put again.
    """

    max_steps = len(SPOTS)

    def __init__(self, split: Split = "train", unseen: bool = False) -> None:
        super().__init__(split, unseen)
        self.shapes = shapes.SEEN_SHAPES if split == "train" else shapes.UNSEEN_SHAPES

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        kit_pose = free.take(KIT_RADIUS)
        count = len(SPOTS)
        names = [str(name) for name in rng.choice(self.shapes, count)]
        yaws = rng.uniform(-math.pi, math.pi, count).tolist()
        form_of = {name: free.piece_form(symmetric=is_symmetric(name)) for name in sorted(set(names))}
        forms = [form_of[name] for name in names]
        board, holes = add_full_kit(environment.client, kit_pose, names, yaws, forms)
        self.put(environment, board, "kit")
        for hole, name in zip(holes, names, strict=True):
            self.put(environment, hole, f"{name} hole")
        self.named_colors = tuple(draw(rng, self.palette, count))
        places = [environment.pose(hole)[0] for hole in holes]
        goals = []
        for number in rng.permutation(count):
            name = names[number]
            color = self.named_colors[number]
            mesh = shapes.piece_mesh(name, forms[number])
            pose = free.take(PIECE_RADIUS * max(1.0, *forms[number].stretch))
            piece = shapes.add_mesh(environment.client, mesh, colors.rgba(color), pose)
            self.put(environment, piece, f"{color} {name}")
            twins = [place for i, place in enumerate(places) if i != number and names[i] == name]
            where = f"{location(places[number], twins)} {name} hole".strip()
            symmetry = piece_symmetry(name)
            metric = PoseMetric(TOLERANCE, symmetry, YAW_TOLERANCE)
            sentence = f"put the {color} {name} in the {where}"
            grasp = Pose2(*grasp_point(name, forms[number]))
            # The tool holds a ring off its centre, so a round piece must keep its yaw.
            goal = Goal(sentence, (piece,), (holes[number],), metric, 1.0, grasp, symmetry, rotations=symmetry > 0)
            goals.append(goal)
        return goals
