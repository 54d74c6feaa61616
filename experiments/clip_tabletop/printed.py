"""Letter tiles, and blocks and towels with a pattern: bodies in a colour and in an ink that stands out from it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import trimesh
from shapely import Polygon, box, union_all
from shapely.geometry.base import BaseGeometry as Area

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import BLOCK_SIZE, Body
from gem_lite.simulation.bodies.solids import join
from gem_lite.simulation.bodies.tiles import SUNK, add_printed, ink_on, printed_plate, tile_ink, upper_face

TEXTURES = ("striped", "dotted", "checkered")
"""The names of all patterns."""

TILE_SIZE = (0.048, 0.048, 0.012)
TOWEL_SIZE = (0.09, 0.06, 0.008)
TOWEL_CORNER = 0.01
"""The radius (m) of a towel's corners."""
STRIPE = 0.008
DOT = 0.008
DOT_GRID = 0.0145
CHECK = 0.01
"""Width (m) of a stripe, of a dot, of the dots' grid and of a check. All but a dot change a little to fit the face."""
Meshes = Sequence[trimesh.Trimesh]
"""What has the body's colour, and what has the ink's. They are centred on the body's origin."""


def add_tile(client: int, name: str, color: RGBA, pose: Pose2) -> Body:
    """A flat square tile with a capital letter or a digit on it. A bar below the glyph tells 6 from 9, and M from W.

    Raises:
        ValueError: the name is unknown.
    """
    return add_printed(client, _tile(name), (color, ink_on(color)), TILE_SIZE, pose, mass=0.02)


def add_textured_block(
    client: int, texture: str, color: RGBA, pose: Pose2, size: tuple[float, float, float] = (BLOCK_SIZE,) * 3
) -> Body:
    """A box of ``size`` (x, y, z metres) with a pattern on all faces but the lowest.

    Raises:
        ValueError: the texture is unknown.
    """
    _check_texture(texture)
    return add_printed(client, _block(texture, size), (color, ink_on(color)), size, pose, mass=0.01)


def add_towel(client: int, texture: str, color: RGBA, pose: Pose2) -> Body:
    """A folded towel: flat, with round corners, and with a pattern on its upper face.

    Raises:
        ValueError: the texture is unknown.
    """
    _check_texture(texture)
    return add_printed(client, _towel(texture), (color, ink_on(color)), TOWEL_SIZE, pose, mass=0.02)


def _check_texture(texture: str) -> None:
    if texture not in TEXTURES:
        raise ValueError(f"texture must be one of {', '.join(TEXTURES)}, got {texture!r}")


# Areas


@cache
def pattern(texture: str, width: float, height: float) -> Area:
    """The area (metres, centred) of the ink on a face. The stripes are upright."""
    if texture == "striped":
        count = 2 * round((width / STRIPE - 1) / 2) + 1  # odd: the outer stripes have the body's colour
        edges = np.linspace(-width / 2, width / 2, max(3, count) + 1)
        return union_all([box(edges[i], -height / 2, edges[i + 1], height / 2) for i in range(1, len(edges) - 2, 2)])
    pitch = CHECK if texture == "checkered" else DOT_GRID
    columns, rows = max(1, round(width / pitch)), max(1, round(height / pitch))
    dx, dy = width / columns, height / rows

    def corner(i: int, j: int) -> tuple[float, float]:
        return i * dx - width / 2, j * dy - height / 2

    if texture == "checkered":
        cells = [(i, j) for i in range(columns) for j in range(rows) if (i + j) % 2 == 0]
        return union_all([box(*corner(i, j), *corner(i + 1, j + 1)) for i, j in cells])
    inner = [corner(i, j) for i in range(1, columns) for j in range(1, rows)]
    middles = [(x + dx / 2, y + dy / 2) for x, y in (corner(i, j) for i in range(columns) for j in range(rows))]
    return union_all([_dot(x, y) for x, y in inner + middles])


def _dot(x: float, y: float) -> Polygon:
    angles = 2 * np.pi * np.arange(10) / 10
    return Polygon(np.stack([x + DOT / 2 * np.cos(angles), y + DOT / 2 * np.sin(angles)], axis=1))


# Meshes


@cache
def _tile(name: str) -> Meshes:
    width, depth, thickness = TILE_SIZE
    return printed_plate(box(-width / 2, -depth / 2, width / 2, depth / 2), [tile_ink(name)], thickness)


@cache
def _towel(texture: str) -> Meshes:
    width, depth, thickness = TOWEL_SIZE
    x, y = width / 2 - TOWEL_CORNER, depth / 2 - TOWEL_CORNER
    return printed_plate(box(-x, -y, x, y).buffer(TOWEL_CORNER, 6), [pattern(texture, width, depth)], thickness)


@cache
def _block(texture: str, size: tuple[float, float, float]) -> Meshes:
    x, y, z = size
    plain = [trimesh.creation.box(np.subtract(size, 2 * SUNK))]
    inked = []
    upright = trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))  # the face then looks along -y
    turns = [trimesh.transformations.rotation_matrix(i * np.pi / 2, (0, 0, 1)) @ upright for i in range(4)]
    faces = [(x, y, z, np.eye(4)), *((*((x, z, y) if i % 2 == 0 else (y, z, x)), turns[i]) for i in range(4))]
    for width, height, distance, turn in faces:
        ink = pattern(texture, width, height)
        rest = box(-width / 2, -height / 2, width / 2, height / 2).difference(ink)
        plain.append(upper_face(rest, distance / 2).apply_transform(turn))
        inked.append(upper_face(ink, distance / 2).apply_transform(turn))
    return [join(*plain), join(*inked)]
