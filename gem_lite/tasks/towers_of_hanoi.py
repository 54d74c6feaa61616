"""towers-of-hanoi-seq: "move the red ring to the lighter brown side", seven sentences, after CLIPort."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pybullet as p
import trimesh
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import BROWNS, RGBA
from gem_lite.simulation.bodies.shapes import Body, collide_boxes, create_body, create_visual
from gem_lite.simulation.bodies.solids import bar, join, rod, turned
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SIDE, THICKNESS = 0.12, 0.01
"""The side (m) of one of the stand's three square plates, and its thickness."""
PEG_RADIUS = 0.005
PEG_TOP = 0.055
"""Height (m) of the upper end of a peg."""
PLATES = ("lighter brown side", "middle of the stand", "darker brown side")
"""The plates along the stand's +y: their names in the sentences. They have the colours `BROWNS`."""
STAND_RADIUS = float(np.hypot(SIDE, 3 * SIDE) / 2)
FRICTION = 0.5
RING_HEIGHT = 0.01
RING_HOLE = 0.015
RING_RADII = (0.03, 0.035, 0.04)
"""Outer radii (m) of the three rings."""
SEGMENTS = 12
SMALL, MIDDLE, LARGE = range(3)
MOVES = ((SMALL, 2), (MIDDLE, 1), (SMALL, 1), (LARGE, 2), (SMALL, 0), (MIDDLE, 2), (SMALL, 2))
"""The ring of each of the seven moves, and the number of the peg to which it goes."""
TOLERANCE = 0.01
STACKING = 0.0105
"""The height (m) from one ring of the first tower to the next: a little more than a ring's, so that they can settle."""


def add_stand(client: int, pose: Pose2, side: float = SIDE, peg_top: float = PEG_TOP) -> list[Body]:
    """Put a fixed stand on the table: three plates, each with a peg in its middle. Returns the plates along +y.

    Args:
        side: of a plate (m).
        peg_top: height (m) of the upper end of a peg.
    """
    places = [pose @ Pose2(0.0, step * side) for step in (-1, 0, 1)]
    return [_add_plate(client, rgba, place, side, peg_top) for rgba, place in zip(BROWNS, places, strict=True)]


def _add_plate(client: int, rgba: RGBA, pose: Pose2, side: float, peg_top: float) -> Body:
    lower = THICKNESS / 2
    half = [side / 2, side / 2, lower]
    # Bullet's cylinders roll over each other badly; a thin box is as good a peg for a ring that hangs round it.
    peg = [PEG_RADIUS * 0.9, PEG_RADIUS * 0.9, (peg_top - THICKNESS) / 2]
    collision = collide_boxes(client, [half, peg], [[0, 0, 0], [0, 0, lower + peg[2]]])
    visual = create_visual(client, _plate_mesh(side, peg_top), rgba, lower)
    return create_body(client, collision, visual, pose, lower, 0.0, movable=False, friction=FRICTION)


@lru_cache(maxsize=16)
def _plate_mesh(side: float, peg_top: float) -> trimesh.Trimesh:
    plate = bar(-side / 2, side / 2, side, 0, THICKNESS)
    return join(plate, rod((0, 0, THICKNESS), (0, 0, peg_top), PEG_RADIUS, sections=12))


@lru_cache(maxsize=16)
def ring_mesh(radius: float) -> trimesh.Trimesh:
    """A flat ring with the outer ``radius`` (m)."""
    profile = [(RING_HOLE, 0), (radius, 0), (radius, RING_HEIGHT), (RING_HOLE, RING_HEIGHT), (RING_HOLE, 0)]
    return turned(profile, sections=36)


def add_ring(client: int, radius: float, color: RGBA, pose: Pose2, height: float = 0.0) -> Body:
    """A movable ring, its lower side at ``height`` (m). Its contact shape is a ring of boxes, so a peg fits into it."""
    middle = (RING_HOLE + radius) / 2
    angles = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    half = [[(radius - RING_HOLE) / 2, middle * np.tan(np.pi / SEGMENTS), RING_HEIGHT / 2]] * SEGMENTS
    middles = [[middle * np.cos(angle), middle * np.sin(angle), 0] for angle in angles]
    turns = [p.getQuaternionFromEuler((0, 0, angle)) for angle in angles]
    collision = collide_boxes(client, half, middles, turns)
    visual = create_visual(client, ring_mesh(radius), color, RING_HEIGHT / 2)
    return create_body(client, collision, visual, pose, height + RING_HEIGHT / 2, 0.1, True, FRICTION)


@register("towers-of-hanoi-seq", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
class TowersOfHanoi(Task):
    """A stand of three pegs on three brown plates, and three rings of three sizes and colours on the lighter side."""

    max_steps = 2 * len(MOVES)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        of_stand, of_pegs, of_rings = free.factor(), free.factor(), free.factor()
        stand = free.take(of_stand * STAND_RADIUS)
        plates = add_stand(environment.client, stand, of_stand * SIDE, of_pegs * PEG_TOP)
        for plate, name in zip(plates, PLATES, strict=True):
            self.put(environment, plate, name)
        self.named_colors = tuple(draw(rng, self.palette, 3))
        tower = environment.pose(plates[0])[0]
        rings = {}
        for layer, size in enumerate((LARGE, MIDDLE, SMALL)):
            color = self.named_colors[size]
            pose = Pose2(tower.x, tower.y, rng.uniform(-math.pi, math.pi))
            height = THICKNESS + layer * STACKING
            radius = of_rings * RING_RADII[size]
            ring = add_ring(environment.client, radius, colors.rgba(color), pose, height)
            rings[size] = self.put(environment, ring, f"{color} ring")
        goals = []
        for size, peg in MOVES:
            grasp = Pose2((RING_HOLE + of_rings * RING_RADII[size]) / 2, 0.0)
            sentence = f"move the {self.named_colors[size]} ring to the {PLATES[peg]}"
            metric = PoseMetric(TOLERANCE)
            # The tool holds a ring off its centre, so the ring must keep its yaw.
            goals.append(Goal(sentence, (rings[size],), (plates[peg],), metric, grasp=grasp, rotations=False))
        return goals
