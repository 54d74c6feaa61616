"""Letters and digits on tiles, the ink that stands out from a colour, and bodies with printed areas."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from string import ascii_uppercase, digits

import numpy as np
import pybullet as p
import trimesh
from shapely import Polygon, affinity, box, union_all
from shapely.geometry.base import BaseGeometry as Area

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import RGBA, Part
from gem_lite.simulation.bodies.shapes import Body, box_mesh, create_body, create_visual, letter_outline
from gem_lite.simulation.bodies.solids import join, slab

LETTERS = tuple(f"letter {letter}" for letter in ascii_uppercase)
DIGITS = tuple(f"digit {digit}" for digit in digits)
TILES = LETTERS + DIGITS
"""The names of all tiles."""

GLYPH = (0.042, 0.034)
"""The largest width and height (m) of a glyph on its tile."""
BAR = (0.018, 0.004)
"""Width and height (m) of the bar below a glyph. It tells 6 from 9, and M from W."""
BAR_GAP = 0.0035
SUNK = 0.0004
"""The solid core lies this deep (m) below the cut faces, so that nothing shows through their seams."""

DARK_INK: RGBA = (0.06, 0.06, 0.06, 1.0)
WHITE_INK: RGBA = (0.95, 0.95, 0.95, 1.0)


def ink_on(color: RGBA) -> RGBA:
    """The ink that is easy to see on a colour: dark on light colours, white on dark ones."""
    red, green, blue = color[:3]
    return DARK_INK if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else WHITE_INK


@cache
def tile_ink(name: str) -> Area:
    """The area (metres, centred) of the glyph and the bar on a tile, upright along +y.

    Raises:
        ValueError: the name is unknown.
    """
    if name not in TILES:
        raise ValueError(f"name must be 'letter A' to 'letter Z' or 'digit 0' to 'digit 9', got {name!r}")
    glyph = letter_outline(name.split()[1], GLYPH[1])
    shrink = min(1.0, GLYPH[0] / np.ptp(glyph.bounds[::2]))
    glyph = affinity.scale(glyph, shrink, shrink, origin=(0, 0))
    low = -(GLYPH[1] + BAR_GAP + BAR[1]) / 2
    glyph = affinity.translate(glyph, 0, low + BAR[1] + BAR_GAP + GLYPH[1] / 2)
    return union_all([glyph, box(-BAR[0] / 2, low, BAR[0] / 2, low + BAR[1])])


def add_printed(
    client: int, meshes: Sequence[trimesh.Trimesh], inks: Sequence[RGBA], size: tuple[float, float, float], pose: Pose2,
    mass: float, movable: bool = True,
) -> Body:  # fmt: skip
    """Meshes of several colours as one body, whose contact shape is one box of ``size`` (x, y, z metres).

    Args:
        meshes: centred on the box.
        inks: the colour of each mesh.
    """
    half = [side / 2 for side in size]
    collision = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    visuals = [create_visual(client, mesh, rgba, lower=0.0) for mesh, rgba in zip(meshes, inks, strict=True)]
    parts = [Part("", box_mesh(size))]
    return create_body(client, collision, visuals, pose, half[2], mass, movable, parts=parts)


def upper_face(area: Area, z: float) -> trimesh.Trimesh:
    """An area as a flat sheet at a height, to be seen from above."""
    mesh = slab(area, z - SUNK, z)
    mesh.update_faces(mesh.face_normals[:, 2] > 0.5)
    return mesh


def printed_plate(outline: Polygon, inks: Sequence[Area], thickness: float) -> list[trimesh.Trimesh]:
    """The meshes of a plate with printed areas on its upper face, centred on the plate's origin.

    Args:
        inks: areas (metres) that do not overlap; what lies outside the outline is cut off.

    Returns:
        What has the plate's own colour, then one mesh for each ink.
    """
    top = thickness / 2
    sides = slab(outline, -top, top)
    sides.update_faces(sides.face_normals[:, 2] < 0.5)
    core = upper_face(outline, top - SUNK)
    inside = [ink.intersection(outline) for ink in inks]
    rest = outline
    for ink in inside:
        rest = rest.difference(ink)
    return [join(sides, core, upper_face(rest, top)), *(upper_face(ink, top) for ink in inside)]
