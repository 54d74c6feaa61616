"""Bodies for the table: meshes made with trimesh, bodies made with PyBullet.

Every body's origin is its centre in x and y; its lowest point is at z = 0 of the mesh frame.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import pybullet as p
import trimesh
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from shapely import Polygon, affinity, box, union_all

from gem_lite.se2 import Pose2, quaternion
from gem_lite.simulation.bodies.parts import Part
from gem_lite.simulation.bodies.solids import join, moved

Bounds = Sequence[Sequence[Sequence[float]]] | np.ndarray
"""The lowest and the highest corners of boxes (N, 2, 3) (m)."""
BLOCK_SIZE = 0.04
PIECE_SIZE = 0.06
PIECE_HEIGHT = 0.02
TEXTURE_SIDE = 0.32
"""A picture that a body wears (PyBullet calls it a texture) covers a square of this side (m), and then begins again."""


@dataclass(frozen=True)
class BowlProfile:
    """The outline of a bowl in metres: outer radii at rim and base, height, thickness of wall and floor.

    ``bend`` shapes the wall. At the share s of the height, the radius is base + (rim - base) * s**bend. The wall is
    straight if bend is 1, and round if it is less.
    """

    rim: float = 0.058
    base: float = 0.045
    height: float = 0.035
    wall: float = 0.006
    floor: float = 0.01
    bend: float = 1.0

    def scaled(self, factor: float) -> BowlProfile:
        """The outline of a similar bowl, whose lengths are multiplied by ``factor``."""
        lengths = {name: factor * length for name, length in vars(self).items() if name != "bend"}
        return BowlProfile(**lengths, bend=self.bend)


BOWL = BowlProfile()
"""The default bowl."""


@cache
def bowl_mesh(profile: BowlProfile = BOWL) -> trimesh.Trimesh:
    """An open bowl, round about the z axis."""
    share = np.linspace(0, 1, 2 if profile.bend == 1 else 9)
    radius = profile.base + (profile.rim - profile.base) * share**profile.bend
    outer = np.stack([radius, share * profile.height], axis=1)
    inner = np.stack([radius - profile.wall, profile.floor + share * (profile.height - profile.floor)], axis=1)[::-1]
    return trimesh.creation.revolve(np.concatenate([[(0, 0)], outer, inner, [(0, profile.floor)]]), sections=32)


def _polar(angles: np.ndarray, radii: np.ndarray | float) -> Polygon:
    return Polygon(np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1))


def _regular(count: int, radius: float) -> Polygon:
    return _polar(np.pi / 2 + 2 * np.pi * np.arange(count) / count, radius)


def _heart() -> Polygon:
    t = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    x = 16 * np.sin(t) ** 3
    y = 13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t)
    return Polygon(np.stack([x, y], axis=1) * 0.06 / 34)


_OF_STAR = np.arange(10)
_OF_FLOWER = 2 * np.pi * np.arange(96) / 96
_OUTLINES: dict[str, Polygon] = {
    "triangle": _regular(3, 0.035),
    "square": box(-0.03, -0.03, 0.03, 0.03),
    "plus": union_all([box(-0.03, -0.01, 0.03, 0.01), box(-0.01, -0.03, 0.01, 0.03)]),
    "diamond": Polygon([(0.0375, 0), (0, 0.03), (-0.0375, 0), (0, -0.03)]),
    "pentagon": _regular(5, 0.03),
    "rectangle": box(-0.0375, -0.0225, 0.0375, 0.0225),
    "flower": _polar(_OF_FLOWER, 0.026 + 0.004 * np.cos(4 * _OF_FLOWER)),
    "star": _polar(np.pi / 2 + np.pi * _OF_STAR / 5, np.where(_OF_STAR % 2 == 0, 0.0318, 0.0159)),
    "circle": _regular(48, 0.03),
    "ring": _regular(48, 0.03).difference(_regular(48, 0.0126)),
    "hexagon": _regular(6, 0.03),
    "heart": _heart(),
}


FONT = "DejaVu Sans"


@dataclass(frozen=True)
class PieceForm:
    """The form of a flat piece, besides its name.

    Attributes:
        stretch: factors of its length along x and along y.
        font: of a letter or a digit.
    """

    stretch: tuple[float, float] = (1.0, 1.0)
    font: str = FONT


USUAL_FORM = PieceForm()


def letter_outline(letter: str, height: float = PIECE_SIZE, font: str = FONT) -> Polygon:
    """The outline of a capital letter or digit, ``height`` metres tall, upright along +y."""
    bold = FontProperties(family=font, weight="bold")
    rings = [Polygon(ring) for ring in TextPath((0, 0), letter, size=1, prop=bold).to_polygons()]
    shape = rings[0]
    for ring in rings[1:]:
        shape = shape.symmetric_difference(ring)
    x0, y0, x1, y1 = shape.bounds
    factor = height / (y1 - y0)
    return affinity.scale(affinity.translate(shape, -(x0 + x1) / 2, -(y0 + y1) / 2), factor, factor, origin=(0, 0))


def outline(name: str, form: PieceForm = USUAL_FORM) -> Polygon:
    """The outline (metres, centred) of a flat piece, by its name in a sentence.

    The pieces are CLIPort's 20 kitting shapes, and any other "letter X shape" or "digit 4 shape".
    """
    if name.startswith(("letter ", "digit ")) and name.endswith(" shape"):
        return affinity.scale(letter_outline(name.split()[1], font=form.font), *form.stretch, origin=(0, 0))
    if name in _OUTLINES:
        return affinity.scale(_OUTLINES[name], *form.stretch, origin=(0, 0))
    raise ValueError(f"no outline is named {name!r}; the names are {', '.join(SEEN_SHAPES + UNSEEN_SHAPES)}")


SEEN_SHAPES = (
    "letter R shape", "letter A shape", "triangle", "square", "plus", "letter T shape", "diamond",
    "pentagon", "rectangle", "flower", "star", "circle", "letter G shape", "letter V shape",
)  # fmt: skip
UNSEEN_SHAPES = ("letter E shape", "letter L shape", "ring", "hexagon", "heart", "letter M shape")


@lru_cache(maxsize=256)
def piece_mesh(name: str, form: PieceForm = USUAL_FORM) -> trimesh.Trimesh:
    """A kitting shape as a 20 mm thick piece."""
    return trimesh.creation.extrude_polygon(outline(name, form), PIECE_HEIGHT)


@cache
def l_block_mesh() -> trimesh.Trimesh:
    """An L of two arms with its corner at the lower left. No turn but a full one leaves it unchanged.

    Its arms are equally long, so its mirror image across its diagonal is the same L.
    """
    shape = union_all([box(0, 0, 0.1, 0.04), box(0, 0, 0.04, 0.1)])
    return moved(trimesh.creation.extrude_polygon(shape, 0.04), -0.05, -0.05, 0)


@dataclass(frozen=True)
class Body:
    """A body on the table.

    Attributes:
        id: of PyBullet.
        rest_height: the height (m) of its origin when it rests.
        movable: whether it moves.
        parts: what it is made of, for tools that grasp by geometry. Their z = 0 lies ``rest_height`` below its origin.
            A body without parts has no surface for such a tool.
    """

    id: int
    rest_height: float
    movable: bool
    parts: tuple[Part, ...] = field(default=(), compare=False, repr=False)


@lru_cache(maxsize=256)
def triangles(mesh: trimesh.Trimesh, lower: float) -> dict[str, list]:
    """A mesh in PyBullet's form, with flat shading: every triangle has its own corners and normal.

    The result is cached: converting arrays to lists would take most of the time of laying out a scene.
    """
    corners = mesh.triangles.reshape(-1, 3) - [0, 0, lower]
    return {
        "vertices": corners.tolist(),
        "indices": list(range(len(corners))),
        "normals": np.repeat(mesh.face_normals, 3, axis=0).tolist(),
        "uvs": _picture_coordinates(mesh).tolist(),
    }


def _picture_coordinates(mesh: trimesh.Trimesh) -> np.ndarray:
    """(3 * triangles, 2): where each corner lies in a picture that is projected along the nearest axis of its face.

    The middle of the picture lies in the origin. A body without a picture does not read them.
    """
    axes = np.abs(mesh.face_normals).argmax(axis=1)
    other_axes = np.array([(1, 2), (0, 2), (0, 1)])[axes]
    corners = np.take_along_axis(mesh.triangles, other_axes[:, None, :], axis=2)
    return corners.reshape(-1, 2) / TEXTURE_SIDE + 1.5  # The renderer repeats a picture, but not below 0.


def create_visual(client: int, mesh: trimesh.Trimesh, color: tuple[float, ...], lower: float) -> int:
    """PyBullet's visual shape of a mesh, moved down by ``lower`` metres."""
    return p.createVisualShape(p.GEOM_MESH, **triangles(mesh, lower), rgbaColor=color, physicsClientId=client)


def create_body(
    client: int, collision: int, visuals: int | Sequence[int], pose: Pose2, z: float, mass: float, movable: bool,
    friction: float = 1.0, rolling: float = 1e-4, parts: Sequence[Part] = (),
) -> Body:  # fmt: skip
    """Put PyBullet's shapes on the table as one body, its origin at height ``z`` (metres).

    The first visual shape is the body's base, the others are its links, in the same frame. ``parts`` is what they show,
    see `Body`.
    """
    base, *others = [visuals] if isinstance(visuals, int) else visuals
    links = len(others)
    body = p.createMultiBody(
        baseMass=mass if movable else 0.0,
        baseCollisionShapeIndex=collision,
        baseVisualShapeIndex=base,
        basePosition=(pose.x, pose.y, z),
        baseOrientation=quaternion(pose.yaw),
        linkMasses=[0.0] * links,
        linkCollisionShapeIndices=[-1] * links,
        linkVisualShapeIndices=others,
        linkPositions=[(0, 0, 0)] * links,
        linkOrientations=[(0, 0, 0, 1)] * links,
        linkInertialFramePositions=[(0, 0, 0)] * links,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * links,
        linkParentIndices=[0] * links,
        linkJointTypes=[p.JOINT_FIXED] * links,
        linkJointAxis=[(0, 0, 1)] * links,
        physicsClientId=client,
    )
    p.changeDynamics(body, -1, lateralFriction=friction, rollingFriction=rolling, physicsClientId=client)
    return Body(body, z, movable, tuple(parts))


def add_print(client: int, mesh: trimesh.Trimesh, color: tuple[float, ...], pose: Pose2, lower: float = 0.0) -> Body:
    """Print a flat mesh on the table, or on what is ``lower`` metres high. Other bodies do not touch it."""
    half = mesh.extents[2] / 2
    return create_body(client, -1, create_visual(client, mesh, color, half), pose, lower + half, 0.0, movable=False)


def collide_boxes(client: int, half: Sequence, middles: Sequence, turns: Sequence | None = None) -> int:
    """PyBullet's contact shape of several boxes: half their sides, their middles (m), and their quaternions."""
    turned = {} if turns is None else {"collisionFrameOrientations": turns}
    return p.createCollisionShapeArray(
        [p.GEOM_BOX] * len(half), halfExtents=half, collisionFramePositions=middles, physicsClientId=client, **turned
    )


def collide_hulls(client: int, meshes: Sequence[trimesh.Trimesh], lower: float) -> int:
    """PyBullet's contact shape of the convex hulls of several meshes, ``lower`` (m) than their frame."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "hulls.obj")  # PyBullet makes a hull of each object in a file.
        lines, first = [], 1
        for number, mesh in enumerate(meshes):
            hull = mesh.convex_hull
            lines += [f"o {number}", *(f"v {x} {y} {z}" for x, y, z in hull.vertices - [0, 0, lower])]
            lines += [f"f {a} {b} {c}" for a, b, c in hull.faces + first]
            first += len(hull.vertices)
        file.write_text("\n".join(lines))
        return p.createCollisionShape(p.GEOM_MESH, fileName=str(file), physicsClientId=client)


def boxes_mesh(bounds: Bounds) -> trimesh.Trimesh:
    """Several boxes as one mesh, from their lowest and highest corners (N, 2, 3) (m)."""
    return join(*[trimesh.creation.box(bounds=box) for box in bounds])


def create_boxes(client: int, bounds: Bounds) -> tuple[int, trimesh.Trimesh, float]:
    """Several boxes in one frame, from their lowest and highest corners (N, 2, 3) (m).

    Returns:
        Their contact shape, their mesh, and by how much (m) the shape is moved down: half of the boxes' height.
    """
    corners = np.array(bounds, float)
    lower = float(corners[..., 2].max()) / 2
    half = (corners[:, 1] - corners[:, 0]) / 2
    middles = corners.mean(axis=1) - [0, 0, lower]
    return collide_boxes(client, half.tolist(), middles.tolist()), boxes_mesh(corners), lower


def add_box(
    client: int, size: tuple[float, float, float], color: tuple[float, ...], pose: Pose2,
    mass: float = 0.01, movable: bool = True, friction: float = 1.0,
) -> Body:  # fmt: skip
    """A box of ``size`` (x, y, z metres), resting on the table at ``pose``."""
    half = [side / 2 for side in size]
    collision = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    visual = p.createVisualShape(p.GEOM_BOX, halfExtents=half, rgbaColor=color, physicsClientId=client)
    parts = [Part("", box_mesh(size))]
    return create_body(client, collision, visual, pose, half[2], mass, movable, friction, parts=parts)


@lru_cache(maxsize=256)
def box_mesh(size: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box of ``size`` (x, y, z metres) that rests on z = 0."""
    return moved(trimesh.creation.box(size), 0, 0, size[2] / 2)


def add_block(client: int, color: tuple[float, ...], pose: Pose2) -> Body:
    """CLIPort's 40 mm cube."""
    return add_box(client, (BLOCK_SIZE,) * 3, color, pose)


def add_mesh(
    client: int, mesh: trimesh.Trimesh, color: tuple[float, ...], pose: Pose2,
    mass: float = 0.02, movable: bool = True,
) -> Body:  # fmt: skip
    """A mesh whose contact shape is its convex hull; it rests on the table at ``pose``."""
    return add_hull(client, mesh, [Part("", mesh, color)], pose, mass, movable)


def add_hull(
    client: int, whole: trimesh.Trimesh, parts: Sequence[Part], pose: Pose2, mass: float, movable: bool,
    by_part: bool = False,
) -> Body:  # fmt: skip
    """Coloured parts as one body. Its contact shape is the hull of the ``whole``, or of each part (``by_part``)."""
    lower = whole.extents[2] / 2
    visuals = [create_visual(client, part.mesh, part.rgba, lower) for part in parts]
    if by_part:
        collision = collide_hulls(client, [part.mesh for part in parts], lower)
    else:
        hull = whole.convex_hull.vertices - [0, 0, lower]
        collision = p.createCollisionShape(p.GEOM_MESH, vertices=hull.tolist(), physicsClientId=client)
    return create_body(client, collision, visuals, pose, lower, mass, movable, parts=parts)


def add_l_block(client: int, color: tuple[float, ...], pose: Pose2) -> Body:
    """The L-block of `l_block_mesh`. Its contact shape is two boxes, so other bodies can enter its notch."""
    half = [[0.05, 0.02, 0.02], [0.02, 0.03, 0.02]]
    collision = collide_boxes(client, half, [[0, -0.03, 0], [-0.03, 0.02, 0]])
    visual = create_visual(client, l_block_mesh(), color, 0.02)
    parts = [Part("", l_block_mesh())]
    return create_body(client, collision, visual, pose, 0.02, 0.03, True, parts=parts)


def bowl_boxes(profile: BowlProfile, sides: int = 15) -> tuple[list, list, list]:
    """The slanted walls and the floor of a bowl, for `collide_boxes`; z = 0 is in the middle of its height."""
    slant = np.arctan2(profile.rim - profile.base, profile.height)
    radius = (profile.rim + profile.base) / 2 - profile.wall / 2
    half = [[profile.wall / 2, radius * np.tan(np.pi / sides) * 1.1, profile.height / 2 / np.cos(slant)]] * sides
    positions, turns = [], []
    for angle in 2 * np.pi * np.arange(sides) / sides:
        positions.append([radius * np.cos(angle), radius * np.sin(angle), 0.0])
        turns.append(p.getQuaternionFromEuler([0, slant, angle]))
    disc = profile.base * 0.7
    half.append([disc, disc, profile.floor / 2])
    positions.append([0, 0, (profile.floor - profile.height) / 2])
    turns.append([0, 0, 0, 1])
    return half, positions, turns


def add_bowl(
    client: int, color: tuple[float, ...], pose: Pose2, movable: bool, profile: BowlProfile = BOWL
) -> Body:  # fmt: skip
    """A bowl that really holds things: 15 slanted wall boxes and a floor.

    PyBullet keeps at most 16 shapes for each body and drops the others without a warning.
    """
    collision = collide_boxes(client, *bowl_boxes(profile))
    visual = create_visual(client, bowl_mesh(profile), color, profile.height / 2)
    parts = [Part("", bowl_mesh(profile))]
    return create_body(client, collision, visual, pose, profile.height / 2, 0.1, movable, parts=parts)
