"""What lies on the tables of the four tasks, as shapes of MuJoCo. No mesh and no outline is of gem_lite."""

from __future__ import annotations

import math

import numpy as np
import trimesh
from foreign_world.tables import COLORS, HIDDEN
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from shapely import Point, Polygon, affinity, box, union_all
from shapely.ops import nearest_points

from experiments.foreign_tasks.table import TaskTable
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.shapes import Body

PAINTS = COLORS | {"gray": (0.43, 0.43, 0.44)}
"""The colours of things. The lamps are bright: the gray of the other tables looks white."""
BROWNS = ((0.80, 0.60, 0.44), (0.50, 0.33, 0.20), (0.22, 0.13, 0.08))
"""Three plates, from light to dark."""
WOOD, DARK = (0.50, 0.33, 0.20), (0.10, 0.10, 0.10)
"""The colours of a board and of the holes in it."""
ONLY_DRAWN = 'contype="0" conaffinity="0" mass="0"'
FONTS = (("DejaVu Sans Mono", "bold"), ("DejaVu Serif", "bold"))
"""Family and weight of the letters."""
SIZE = 0.056
"""The longer side (m) of a piece before its proportions change."""
STRETCH = (0.8, 1.25)
"""Each side of a piece is multiplied by a number of this range."""
PIECE_HEIGHT = 0.018
PRINT = 0.001
"""Height (m) of what is printed."""
ALIKE = 0.9
"""A turned outline that shares this part of its area with itself looks the same."""
MASS = 0.02
RING_BOXES = 8

Color = str | tuple[float, ...]


def paint(color: Color) -> str:
    """The attributes of a shape of a colour: a name, or (r, g, b)."""
    red, green, blue = PAINTS[color] if isinstance(color, str) else color
    return f'rgba="{red} {green} {blue} 1" material="plastic"'


def solid_box(sides: tuple[float, ...], color: Color, more: str = "") -> str:
    """A box (x, y, z metres) that stands on z = 0."""
    x, y, z = (side / 2 for side in sides)
    return f'<geom type="box" size="{x} {y} {z}" pos="0 0 {z}" {paint(color)} {more}/>'


def drawn(table: TaskTable, outline: Polygon, height: float, color: Color) -> str:
    """An extruded outline that only the cameras meet."""
    name = table.mesh(trimesh.creation.extrude_polygon(outline, height))
    return f'<geom type="mesh" mesh="{name}" {paint(color)} {ONLY_DRAWN}/>'


# Outlines of pieces


def polygon(corners: int, radii: tuple[float, ...] = (1.0,)) -> Polygon:
    """A polygon round the origin, one corner at the top; the radii take turns."""
    angles = math.pi / 2 + 2 * math.pi * np.arange(corners) / corners
    lengths = np.resize(radii, corners)
    return Polygon(np.stack([lengths * np.cos(angles), lengths * np.sin(angles)], axis=1))


def heart() -> Polygon:
    """Two discs above a corner."""
    discs = union_all([Point(side * 0.5, 0.3).buffer(0.56) for side in (-1, 1)])
    return union_all([discs, Polygon([(-0.93, -0.05), (0, -1.0), (0.93, -0.05), (0, 0.5)])])


def letter(character: str, font: tuple[str, str]) -> Polygon:
    """A letter of a font, upright along +y."""
    family, weight = font
    path = TextPath((0, 0), character, size=1, prop=FontProperties(family=family, weight=weight))
    whole = Polygon()
    for corners in path.to_polygons():
        whole = whole.symmetric_difference(Polygon(corners))
    return whole


def piece_outline(shape: str, rng: np.random.Generator) -> Polygon:
    """The outline (metres, its middle at the origin) of a piece by its name, in random proportions."""
    forms = {
        "ring": lambda: polygon(48).difference(polygon(48, (rng.uniform(0.35, 0.5),))), "hexagon": lambda: polygon(6),
        "heart": heart,
    }  # fmt: skip
    if shape.startswith("letter "):
        outline = letter(shape.split()[1], FONTS[rng.integers(len(FONTS))])
    else:
        outline = forms[shape]()
    x0, y0, x1, y1 = outline.bounds
    centred = affinity.translate(outline, -(x0 + x1) / 2, -(y0 + y1) / 2)
    stretch_x, stretch_y = SIZE / max(x1 - x0, y1 - y0) * rng.uniform(*STRETCH, 2)
    return affinity.scale(centred, stretch_x, stretch_y, origin=(0, 0))


def symmetry(outline: Polygon) -> float:
    """The smallest turn (radians) after which an outline looks the same; 0 if it does so after each."""
    for parts in (36, 6, 5, 4, 3, 2):
        turned = [affinity.rotate(outline, 360 * part / parts, origin=(0, 0)) for part in range(1, parts)]
        if all(outline.intersection(other).area >= ALIKE * outline.union(other).area for other in turned):
            return 0.0 if parts == 36 else 2 * math.pi / parts
    return 2 * math.pi


def grasp(outline: Polygon) -> Pose2:
    """The point of the material that is nearest to a piece's middle."""
    inside = outline.buffer(-0.004)
    point = nearest_points(outline if inside.is_empty else inside, Point(0, 0))[0]
    return Pose2(point.x, point.y)


def radius(outline: Polygon) -> float:
    """The radius (m) of a circle round an outline."""
    return float(max(math.hypot(x, y) for x, y in outline.convex_hull.exterior.coords))


# Things


def add_piece(table: TaskTable, outline: Polygon, color: str, pose: Pose2) -> Body:
    """A flat piece. It collides as a box whose sides are 70 % of its outline's."""
    x0, y0, x1, y1 = (0.7 * side for side in outline.bounds)
    half = f"{(x1 - x0) / 2} {(y1 - y0) / 2} {PIECE_HEIGHT / 2}"
    hidden = f'<geom type="box" size="{half}" pos="0 0 {PIECE_HEIGHT / 2}" mass="{MASS}" {HIDDEN}/>'
    return table.put(drawn(table, outline, PIECE_HEIGHT, color) + hidden, pose)


def add_block(table: TaskTable, side: float, color: str, pose: Pose2, mass: float = MASS) -> Body:
    """A cube."""
    return table.put(solid_box((side,) * 3, color, f'mass="{mass}"'), pose)


def add_ring(
    table: TaskTable, radii: tuple[float, float], thickness: float, color: str, pose: Pose2, height: float
) -> Body:  # fmt: skip
    """A flat ring, its lower side at ``height`` (m). It collides as a ring of boxes, so a peg fits into it."""
    inner, outer = radii
    outline = Point(0, 0).buffer(outer).difference(Point(0, 0).buffer(inner))
    middle = (inner + outer) / 2
    half = f"{(outer - inner) / 2} {middle * math.tan(math.pi / RING_BOXES)} {thickness / 2}"
    one = f'<geom type="box" size="{half}" pos="{middle} 0 {thickness / 2}" mass="{MASS / RING_BOXES}" group="3"/>'
    boxes = f'<replicate count="{RING_BOXES}" euler="0 0 {360 / RING_BOXES}">{one}</replicate>'
    return table.put(drawn(table, outline, thickness, color) + boxes, pose, height)


def add_square(table: TaskTable, side: float, line: float, color: str, pose: Pose2) -> None:
    """Draw the outline of a square on the table."""
    outer, inner = (box(-half, -half, half, half) for half in (side / 2, side / 2 - line))
    table.fix(drawn(table, outer.difference(inner), PRINT, color), pose)


def add_plate(
    table: TaskTable, sides: tuple[float, float], thickness: float, color: Color, pose: Pose2
) -> None:  # fmt: skip
    """A fixed plate with cut corners."""
    x, y = sides
    cut = 0.2 * y
    outline = box(-x / 2, -y / 2, x / 2, y / 2).intersection(
        affinity.scale(polygon(4), (x + y) / 2 - cut, (x + y) / 2 - cut, origin=(0, 0))
    )
    contact = f'<geom type="box" size="{x / 2} {y / 2} {thickness / 2}" pos="0 0 {thickness / 2}" group="3"/>'
    table.fix(drawn(table, outline, thickness, color) + contact, pose)


def add_peg(
    table: TaskTable, side: float, thickness: float, peg: tuple[float, float], color: Color, pose: Pose2
) -> None:  # fmt: skip
    """A fixed square plate with a peg in its middle; ``peg`` is its radius and the height of its upper end (m)."""
    radius, top = peg
    half = (top - thickness) / 2
    rod = f'<geom type="cylinder" size="{radius} {half}" pos="0 0 {thickness + half}" {paint(color)}/>'
    table.fix(solid_box((side, side, thickness), color) + rod, pose)


def add_hole(table: TaskTable, outline: Polygon, pose: Pose2, height: float) -> None:
    """Print a hole on a board that is ``height`` (m) high."""
    table.fix(drawn(table, outline, PRINT, DARK), pose, height)
