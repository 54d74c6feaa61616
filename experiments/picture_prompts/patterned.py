"""The things of VIMABench's visual manipulation at their real sizes, with textures: 19 to drag, and 6 containers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from shapely import Point, Polygon, affinity, box, union_all
from shapely.ops import nearest_points

from experiments.picture_prompts import textures
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes, trays
from gem_lite.simulation.bodies.parts import RGBA, Part
from gem_lite.simulation.bodies.shapes import Body, BowlProfile
from gem_lite.simulation.bodies.solids import bar, join

WHITE: RGBA = (1.0, 1.0, 1.0, 1.0)
"""The renderer multiplies a texture with the body's own colour."""
MASS = 0.1
BLOCK = "block"
BLOCK_SIDE, BLOCK_MASS = 0.07, 0.01


@dataclass(frozen=True)
class Flat:
    """A flat thing: the outline of a kitting shape, stretched.

    Attributes:
        outline: a name of `shapes.outline`, or "L".
        size: its sides (m) along x, y and z.
    """

    outline: str
    size: tuple[float, float, float]


FLAT: dict[str, Flat] = {
    "letter A": Flat("letter A shape", (0.100, 0.100, 0.033)),
    "letter E": Flat("letter E shape", (0.058, 0.100, 0.033)),
    "letter G": Flat("letter G shape", (0.095, 0.102, 0.033)),
    "letter M": Flat("letter M shape", (0.092, 0.096, 0.031)),
    "letter R": Flat("letter R shape", (0.085, 0.100, 0.033)),
    "letter T": Flat("letter T shape", (0.108, 0.100, 0.033)),
    "letter V": Flat("letter V shape", (0.100, 0.100, 0.033)),
    "L-block": Flat("L", (0.096, 0.096, 0.029)),
    "cross": Flat("plus", (0.096, 0.096, 0.029)),
    "diamond": Flat("diamond", (0.120, 0.096, 0.029)),
    "triangle": Flat("triangle", (0.096, 0.096, 0.029)),
    "flower": Flat("flower", (0.108, 0.108, 0.033)),
    "heart": Flat("heart", (0.100, 0.095, 0.033)),
    "hexagon": Flat("hexagon", (0.094, 0.109, 0.033)),
    "pentagon": Flat("pentagon", (0.104, 0.099, 0.033)),
    "ring": Flat("ring", (0.096, 0.096, 0.029)),
    "round": Flat("circle", (0.096, 0.096, 0.029)),
    "star": Flat("star", (0.104, 0.099, 0.033)),
}
"""VIMABench's real sizes, where we know them; the others are within its range."""
DRAGGED = (BLOCK, *FLAT)
HELD_OUT_DRAGGED = ("letter R", "diamond", "hexagon", "round", "star")
CONTAINERS = ("bowl", "frame", "container", "square", "pan", "pallet")
HELD_OUT_CONTAINERS = ("pan", "pallet")
"""What is held out is in no scene of training."""

BOWL = BowlProfile(rim=0.1, base=0.06, height=0.069, wall=0.005, floor=0.006, bend=0.7)
DISH = BowlProfile(rim=0.0845, base=0.07, height=0.041, wall=0.005, floor=0.005)
"""Of the pan. The pan's origin is in the middle of the dish."""
HANDLE: trays.Box = ((0.078, -0.012, 0.027), (0.2095, 0.012, 0.039))
CONTAINER_SIDES = (0.15, 0.17)
"""Each side (m) of a container is drawn from this range."""
CONTAINER_HEIGHT = 0.0455
_STRIPS: dict[str, tuple[float, float, float, float]] = {
    "frame": (0.18, 0.18, 0.02, 0.0015),
    "square": (0.24, 0.20, 0.04, 0.001),
}
"""Two flat hollow things of four strips: the outer side, a strip's length, its width and its height (m)."""


@cache
def outline(name: str) -> Polygon:
    """The outline (metres, centred) of a flat thing. Raises KeyError for another name."""
    flat = FLAT[name]
    raw = union_all([box(0, 0, 5, 2), box(0, 0, 2, 5)]) if flat.outline == "L" else shapes.outline(flat.outline)
    x0, y0, x1, y1 = raw.bounds
    centred = affinity.translate(raw, -(x0 + x1) / 2, -(y0 + y1) / 2)
    width, length, _ = flat.size
    return affinity.scale(centred, width / (x1 - x0), length / (y1 - y0), origin=(0, 0))


@cache
def grasp_point(name: str) -> tuple[float, float]:
    """The point of the material that is nearest to the middle of a thing to drag (m, in its own frame)."""
    if name not in FLAT:
        return 0.0, 0.0
    point = nearest_points(outline(name).buffer(-0.006), Point(0, 0))[0]
    return point.x, point.y


@cache
def boxes(name: str, sides: tuple[float, float] = CONTAINER_SIDES) -> tuple[trays.Box, ...]:
    """The boxes of a container that is made of boxes alone.

    Args:
        sides: of the "container" (m); the others have one size.

    Raises:
        ValueError: no such container has this name.
    """
    if name == "container":
        return tuple(trays.container_boxes(sides, CONTAINER_HEIGHT))
    if name in _STRIPS:
        outer, length, width, height = _STRIPS[name]
        inner = outer / 2 - width
        along = [((-length / 2, y, 0.0), (length / 2, y + width, height)) for y in (inner, -outer / 2)]
        across = [((x, -length / 2, 0.0), (x + width, length / 2, height)) for x in (inner, -outer / 2)]
        return (*along, *across)
    if name == "pallet":
        top = [((x - 0.0125, -0.0875, 0.018), (x + 0.0125, 0.0875, 0.026)) for x in np.linspace(-0.0925, 0.0925, 6)]
        beams = [((-0.105, y - 0.01, 0.0), (0.105, y + 0.01, 0.018)) for y in (-0.0775, 0.0, 0.0775)]
        return (*top, *beams)
    raise ValueError(f"name must be container, pallet, {' or '.join(_STRIPS)}, got {name!r}")


@cache
def mesh(name: str, sides: tuple[float, float] = CONTAINER_SIDES) -> trimesh.Trimesh:
    """A thing as a mesh that rests on z = 0.

    Args:
        sides: of the "container" (m); the others have one size.

    Raises:
        ValueError: the name is unknown.
    """
    if name == BLOCK:
        return shapes.box_mesh((BLOCK_SIDE,) * 3)
    if name in FLAT:
        return trimesh.creation.extrude_polygon(outline(name), FLAT[name].size[2])
    if name == "bowl":
        return shapes.bowl_mesh(BOWL)
    if name == "pan":
        (x0, y0, z0), (x1, y1, z1) = HANDLE
        return join(shapes.bowl_mesh(DISH), bar(x0, x1, y1 - y0, z0, z1))
    if name in CONTAINERS:
        return shapes.boxes_mesh(boxes(name, sides))
    raise ValueError(f"no thing is named {name!r}; the names are {', '.join(DRAGGED + CONTAINERS)}")


def radius(name: str, sides: tuple[float, float] = CONTAINER_SIDES) -> float:
    """A thing lies within a circle of this radius (m) about its origin. Arguments and errors as `mesh`."""
    return float(np.linalg.norm(mesh(name, sides).vertices[:, :2], axis=1).max())


def add(
    client: int, name: str, texture: str, pose: Pose2, sides: tuple[float, float] = CONTAINER_SIDES
) -> Body:  # fmt: skip
    """Put a thing on the table. What is to be dragged is movable, a container is fixed.

    Args:
        name: one of `DRAGGED` or `CONTAINERS`.
        texture: one of `textures.NAMES`.
        sides: of the "container" (m); the others have one size.

    Raises:
        ValueError: the name or the texture is unknown.
    """
    if name in DRAGGED:
        body = shapes.add_mesh(client, mesh(name), WHITE, pose, BLOCK_MASS if name == BLOCK else MASS)
    elif name == "bowl":
        body = shapes.add_bowl(client, WHITE, pose, movable=False, profile=BOWL)
    elif name == "pan":
        body = _add_pan(client, pose)
    else:
        body = trays.add_boxes(client, boxes(name, sides), WHITE, pose)
    return textures.dress(client, body, texture)


def _add_pan(client: int, pose: Pose2) -> Body:
    half, middles, turns = shapes.bowl_boxes(DISH, sides=14)  # With floor and handle 16 boxes: PyBullet drops others.
    low, high = np.array(HANDLE)
    half.append(((high - low) / 2).tolist())
    middles.append(((low + high) / 2 - [0, 0, DISH.height / 2]).tolist())
    turns.append([0, 0, 0, 1])
    collision = shapes.collide_boxes(client, half, middles, turns)
    visual = shapes.create_visual(client, mesh("pan"), WHITE, DISH.height / 2)
    parts = [Part("", mesh("pan"))]
    return shapes.create_body(client, collision, visual, pose, DISH.height / 2, 0.0, movable=False, parts=parts)


def square(name: str, sides: tuple[float, float] = CONTAINER_SIDES) -> tuple[float, float, float]:
    """The least square around a thing: x and y of its middle in the thing's frame, and its side (m)."""
    low, high = mesh(name, sides).bounds[:, :2]
    x, y = ((low + high) / 2).tolist()
    return x, y, float((high - low).max())
