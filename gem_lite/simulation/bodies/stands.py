"""The stand and the rings of the towers of Hanoi, after CLIPort."""

from __future__ import annotations

from functools import cache

import numpy as np
import pybullet as p
import trimesh

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body, collide_boxes, create_body, create_visual

PLATE = (0.12, 0.12, 0.01)
"""Sides (m) of one of the stand's three plates."""
PEG_RADIUS = 0.005
PEG_TOP = 0.055
"""Height (m) of the upper end of a peg."""
PLATES: dict[str, RGBA] = {
    "lighter brown side": (0.918, 0.688, 0.559, 1.0),
    "middle of the stand": (0.612, 0.459, 0.373, 1.0),
    "darker brown side": (0.306, 0.229, 0.186, 1.0),
}
"""The plates along the stand's +y: their names in the sentences, and their RGBA."""
STAND_RADIUS = float(np.hypot(PLATE[0], 3 * PLATE[1]) / 2)
FRICTION = 0.5
RING_HEIGHT = 0.01
RING_HOLE = 0.015
RING_RADII = (0.03, 0.035, 0.04)
"""Outer radii (m) of the three rings."""
SEGMENTS = 12


def add_stand(client: int, pose: Pose2) -> list[Body]:
    """Put a fixed stand on the table: three plates, each with a peg in its middle. Returns the plates along +y."""
    places = [pose @ Pose2(0.0, step * PLATE[1]) for step in (-1, 0, 1)]
    return [_add_plate(client, rgba, place) for rgba, place in zip(PLATES.values(), places, strict=True)]


def _add_plate(client: int, rgba: RGBA, pose: Pose2) -> Body:
    lower = PLATE[2] / 2
    half = [side / 2 for side in PLATE]
    # Bullet's cylinders roll over each other badly; a thin box is as good a peg for a ring that hangs round it.
    peg = [PEG_RADIUS * 0.9, PEG_RADIUS * 0.9, (PEG_TOP - PLATE[2]) / 2]
    collision = collide_boxes(client, [half, peg], [[0, 0, 0], [0, 0, lower + peg[2]]])
    visual = create_visual(client, _plate_mesh(), rgba, lower)
    return create_body(client, collision, visual, pose, lower, 0.0, movable=False, friction=FRICTION)


@cache
def _plate_mesh() -> trimesh.Trimesh:
    x, y, z = (side / 2 for side in PLATE)
    plate = trimesh.creation.box(bounds=[[-x, -y, 0], [x, y, 2 * z]])
    peg = trimesh.creation.cylinder(PEG_RADIUS, segment=[(0, 0, 2 * z), (0, 0, PEG_TOP)], sections=12)
    return trimesh.util.concatenate([plate, peg])


@cache
def ring_mesh(radius: float) -> trimesh.Trimesh:
    """A flat ring with the outer ``radius`` (m)."""
    profile = [(RING_HOLE, 0), (radius, 0), (radius, RING_HEIGHT), (RING_HOLE, RING_HEIGHT), (RING_HOLE, 0)]
    return trimesh.creation.revolve(np.array(profile), sections=36)


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
