"""object-sorting: "pick the mug and place into the recycle box", the paper's task for several tables (A.12)."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh
from shapely import Point, Polygon, affinity, box, union_all
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import objects, shapes
from gem_lite.simulation.bodies.shapes import Body, create_body, create_boxes, create_visual
from gem_lite.simulation.bodies.solids import slab
from gem_lite.simulation.bodies.trays import CONTAINER_HEIGHT, FRICTION, WALL, container_boxes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, ZoneMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SEEN = (
    "mug", "hammer", "banana", "scissors", "bottle", "spoon", "pan", "brush", "key", "teapot", "toy car", "duck", "hat",
    "glasses", "pencil",
)  # fmt: skip
UNSEEN = (
    "headphones", "airplane", "dumbbell", "pear", "carrot", "lollipop", "mushroom", "magnifying glass", "flashlight",
    "wrench", "sailboat", "lamp",
)  # fmt: skip
SEEN_BOXES = ("recycle", "gear")
UNSEEN_BOXES = ("recycle", "smiley")
OBJECTS = 5
OBJECT_RADIUS = 0.06
TOPPLING = 2.0
"""Seconds before the first picture. In this time, bodies that cannot stand (some ducks) fall over."""
BOX_SIDE = 0.15
"""Length and width (m) of a symbol box between the middles of its walls."""
BOX_RADIUS = BOX_SIDE / np.sqrt(2) + WALL
SYMBOL_SIDE = 0.12
WALLS = (0.20, 0.33, 0.52, 1.0)
PAPER = (0.92, 0.92, 0.90, 1.0)
INK = (0.06, 0.06, 0.07, 1.0)
"""RGBA of the walls, the floor and the symbol."""
INSIDE = ZoneMetric((BOX_SIDE, BOX_SIDE), CONTAINER_HEIGHT)


def _arc(start: float, end: float, inner: float, outer: float) -> Polygon:
    """A part of a ring between two angles in degrees."""
    angles = np.radians(np.linspace(start, end, 24))
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return Polygon(np.concatenate([outer * ray, inner * ray[::-1]]))


def _recycle() -> Polygon:
    head = Polygon([(0.48, 0), (1.0, 0), (0.74, 0.42)])
    arrow = union_all([_arc(-72, 3, 0.60, 0.88), head])
    return union_all([affinity.rotate(arrow, turn, origin=(0, 0)) for turn in (0, 120, 240)])


def _gear() -> Polygon:
    tooth = Polygon([(0.6, -0.2), (1.0, -0.13), (1.0, 0.13), (0.6, 0.2)])
    teeth = [affinity.rotate(tooth, 45 * i, origin=(0, 0)) for i in range(8)]
    return union_all([Point(0, 0).buffer(0.74), *teeth]).difference(Point(0, 0).buffer(0.32))


def _smiley() -> Polygon:
    eyes = [affinity.scale(Point(x, 0.3).buffer(0.15), 0.85, 1.25) for x in (-0.34, 0.34)]
    return Point(0, 0).buffer(0.97).difference(union_all([*eyes, _arc(200, 340, 0.48, 0.70)]))


def _moon() -> Polygon:
    return Point(-0.1, 0).buffer(0.9).difference(Point(0.35, 0.12).buffer(0.75))


def _arrow() -> Polygon:
    return union_all([box(-0.95, -0.17, 0.3, 0.17), Polygon([(0.25, -0.55), (0.25, 0.55), (0.95, 0)])])


def _house() -> Polygon:
    roof = Polygon([(-0.95, 0.1), (0.95, 0.1), (0, 0.95)])
    return union_all([box(-0.7, -0.85, 0.7, 0.15), roof]).difference(box(-0.18, -0.85, 0.18, -0.25))


_DRAWN = {"recycle": _recycle, "gear": _gear, "smiley": _smiley, "moon": _moon, "arrow": _arrow, "house": _house}
SYMBOLS = (*_DRAWN, "heart", "star")
"""All symbols."""


@cache
def symbol_outline(symbol: str) -> Polygon:
    """A symbol (metres, centred), upright along +y, at most `SYMBOL_SIDE` wide and tall.

    Raises:
        ValueError: the symbol is unknown.
    """
    if symbol not in SYMBOLS:
        raise ValueError(f"symbol must be one of {', '.join(SYMBOLS)}, got {symbol!r}")
    drawn = _DRAWN[symbol]() if symbol in _DRAWN else shapes.outline(symbol)
    x0, y0, x1, y1 = drawn.bounds
    factor = SYMBOL_SIDE / max(x1 - x0, y1 - y0)
    centred = affinity.translate(drawn, -(x0 + x1) / 2, -(y0 + y1) / 2)
    return affinity.scale(centred, factor, factor, origin=(0, 0))


@cache
def _sheets(symbol: str) -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """The paper without the area of the symbol, and the symbol. They do not overlap, so both are visible."""
    ink = symbol_outline(symbol)
    half = BOX_SIDE / 2 - WALL
    return slab(box(-half, -half, half, half).difference(ink), 0, 2 * WALL), slab(ink, 0, 2 * WALL)


def add_symbol_box(client: int, symbol: str, pose: Pose2) -> Body:
    """A fixed box, open on top, with a black symbol on its white floor. Boxes differ in the symbol only.

    Raises:
        ValueError: the symbol is unknown.
    """
    collision, walls, lower = create_boxes(client, container_boxes((BOX_SIDE, BOX_SIDE)))
    colored = zip((walls, *_sheets(symbol)), (WALLS, PAPER, INK), strict=True)
    visuals = [create_visual(client, mesh, color, lower) for mesh, color in colored]
    return create_body(client, collision, visuals, pose, lower, 0.0, False, FRICTION, rolling=0.0)


@register("object-sorting", {"seen": {}, "unseen": {"unseen": True}})
class ObjectSorting(Task):
    """Two symbol boxes and five objects in any colours, spread over all tables; the sentence names one of each.

    The tables have the size of the paper's, 106 x 53 cm. The seed of an episode chooses the named object in turn, so
    75 demonstrations name each of the 15 training objects five times. An episode has one action.
    """

    workspace = Workspace.of_length(1.06)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        object_names, box_symbols = (UNSEEN, UNSEEN_BOXES) if self.unseen else (SEEN, SEEN_BOXES)
        free = [FreeSpace(environment.workspace, rng, environment.style) for _ in environment.tables]

        def random_pose(radius: float) -> Pose2:
            table = int(rng.integers(len(environment.tables)))
            return environment.tables[table] @ free[table].take(radius)

        boxes = []
        for symbol in box_symbols:
            made = add_symbol_box(environment.client, symbol, random_pose(BOX_RADIUS))
            boxes.append(self.put(environment, made, f"{symbol} box"))
        named = object_names[seed % len(object_names)]
        distractors = draw(rng, [name for name in object_names if name != named], OBJECTS - 1)
        bodies = []
        for name in (named, *distractors):
            color = str(rng.choice(list(colors.RGB)))
            pose = random_pose(OBJECT_RADIUS)
            variant = int(rng.integers(*objects.TEST_VARIANTS))
            body = objects.add_object(environment.client, name, colors.rgba(color), pose, variant)
            bodies.append(self.put(environment, body, f"{color} {name}"))
        environment.wait(TOPPLING)
        number = int(rng.integers(len(boxes)))
        sentence = f"pick the {named} and place into the {box_symbols[number]} box"
        return [Goal(sentence, (bodies[0],), (boxes[number],), INSIDE)]
