"""Simple solids, and the named parts of everyday objects. Lengths are in metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from shapely import affinity
from shapely.geometry import Point, Polygon
from trimesh import Trimesh

RGBA = tuple[float, float, float, float]
METAL: RGBA = (0.66, 0.67, 0.70, 1.0)
DARK: RGBA = (0.14, 0.14, 0.15, 1.0)
PALE: RGBA = (0.93, 0.90, 0.84, 1.0)
LEAF: RGBA = (0.25, 0.50, 0.22, 1.0)
WOOD: RGBA = (0.50, 0.36, 0.25, 1.0)


@dataclass(frozen=True)
class Part:
    """One part: its ``name`` ("" if it has none), its mesh, and its own RGBA (None: the object's colour)."""

    name: str
    mesh: Trimesh
    rgba: RGBA | None = None


Vary = Callable[[], float]
"""Returns a random factor near 1. The factors differ from variant to variant."""
Maker = Callable[[Vary], list[Part]]
"""Makes the parts of one variant of an object."""


def bar(x0: float, x1: float, width: float, z0: float, z1: float, y: float = 0.0) -> Trimesh:
    """A box along x with its middle at ``y``."""
    return trimesh.creation.box(bounds=[[x0, y - width / 2, z0], [x1, y + width / 2, z1]])


def rod(a: tuple, b: tuple, radius: float) -> Trimesh:
    """A cylinder from one point to another."""
    return trimesh.creation.cylinder(radius, segment=[a, b], sections=14)


def ball(centre: tuple, radii: float | tuple) -> Trimesh:
    """A ball, or an ellipsoid with radii along x, y and z."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    mesh.apply_scale(np.broadcast_to(radii, 3))
    mesh.apply_translation(centre)
    return mesh


def slab(outline: Polygon, z0: float, z1: float) -> Trimesh:
    """One or several outlines, extruded from the height z0 to z1."""
    return trimesh.util.concatenate(
        [
            trimesh.creation.extrude_polygon(piece, z1 - z0).apply_translation([0, 0, z0])
            for piece in getattr(outline, "geoms", [outline])
        ]
    )


def turned(profile: list, lying: bool = False) -> Trimesh:
    """A solid of revolution from (radius, height) points; ``lying`` puts its axis along x."""
    mesh = trimesh.creation.revolve(np.array(profile), sections=20)
    if lying:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    return mesh


def tube(points: np.ndarray, radius: float | np.ndarray) -> Trimesh:
    """Rods along (N, 3) points, with one radius for all points or one for each."""
    radii = np.broadcast_to(radius, len(points))
    ends = zip(points, points[1:], radii, radii[1:], strict=False)
    return trimesh.util.concatenate([rod(start, end, (first + second) / 2) for start, end, first, second in ends])


def arc(radius: float, start: float, stop: float, centre: tuple, upright: bool = False, count: int = 9) -> np.ndarray:
    """Points on a circle in the table's plane or, ``upright``, in the x-z plane."""
    t = np.linspace(start, stop, count)
    flat = np.stack([np.cos(t), np.sin(t), np.zeros(count)], axis=1)
    return np.array(centre) + radius * (flat[:, [0, 2, 1]] if upright else flat)


def disc(x: float, y: float, radius: float, hole: float = 0.0) -> Polygon:
    """The outline of a circle. With ``hole``, the radius of a round hole, it is a ring."""
    circle = Point(x, y).buffer(radius, 12)
    return circle.difference(Point(x, y).buffer(hole, 12)) if hole else circle


def join(meshes: list[Trimesh]) -> Trimesh:
    """Several meshes as one."""
    return trimesh.util.concatenate(meshes)


def bead(centre: tuple, radii: float | tuple, detail: int = 1) -> Trimesh:
    """A small ball of few triangles: 20 for ``detail`` 0, 80 for 1."""
    mesh = trimesh.creation.icosphere(subdivisions=detail, radius=1.0)
    mesh.apply_scale(np.broadcast_to(radii, 3))
    return mesh.apply_translation(centre)


def tilted(mesh: Trimesh, degrees: float, axis: tuple, point: tuple = (0, 0, 0)) -> Trimesh:
    """A mesh turned by an angle in degrees about an axis through a point. The mesh itself is turned."""
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), axis, point))


def oval(x: float, y: float, length: float, width: float, degrees: float = 0.0) -> Polygon:
    """The outline of an ellipse, with its length along x before it is turned."""
    return affinity.rotate(affinity.scale(disc(x, y, 1).simplify(0.02), length / 2, width / 2), degrees)
