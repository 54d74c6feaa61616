"""Simple solids and outlines. Lengths are in metres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from shapely import Point, Polygon, affinity
from shapely.geometry.base import BaseGeometry
from trimesh import Trimesh

SIDES = (-1, 1)
"""Signs of the two sides of what is symmetric."""


def bar(x0: float, x1: float, width: float, z0: float, z1: float, y: float = 0.0) -> Trimesh:
    """A box along x with its middle at ``y``."""
    return trimesh.creation.box(bounds=[[x0, y - width / 2, z0], [x1, y + width / 2, z1]])


def rod(a: Sequence[float], b: Sequence[float], radius: float, sections: int = 14) -> Trimesh:
    """A cylinder from one point to another."""
    return trimesh.creation.cylinder(radius, segment=[a, b], sections=sections)


def ball(centre: tuple, radii: float | tuple, detail: int = 2) -> Trimesh:
    """A ball, or an ellipsoid with radii along x, y and z, of 20 triangles for ``detail`` 0, 80 for 1, 320 for 2."""
    mesh = trimesh.creation.icosphere(subdivisions=detail, radius=1.0)
    mesh.apply_scale(np.broadcast_to(radii, 3))
    return mesh.apply_translation(centre)


def slab(outline: BaseGeometry, z0: float, z1: float) -> Trimesh:
    """One or several outlines, extruded from the height z0 to z1."""
    pieces = [trimesh.creation.extrude_polygon(piece, z1 - z0) for piece in getattr(outline, "geoms", [outline])]
    return join(*[piece.apply_translation([0, 0, z0]) for piece in pieces])


def turned(profile: Sequence[tuple[float, float]], lying: bool = False, sections: int = 20) -> Trimesh:
    """A solid of revolution from (radius, height) points; ``lying`` puts its axis along x."""
    mesh = trimesh.creation.revolve(np.array(profile), sections=sections)
    return tilted(mesh, np.pi / 2, "y") if lying else mesh


def tube(points: Sequence[Sequence[float]], radius: float | Sequence[float], sections: int = 14) -> Trimesh:
    """Rods along (N, 3) points, with one radius for all points or one for each."""
    radii = np.broadcast_to(radius, len(points))
    ends = zip(points, points[1:], radii, radii[1:], strict=False)
    return join(*[rod(start, end, (first + second) / 2, sections) for start, end, first, second in ends])


def arc(radius: float, start: float, stop: float, centre: tuple, upright: bool = False, count: int = 9) -> np.ndarray:
    """Points on a circle in the table's plane or, ``upright``, in the x-z plane."""
    t = np.linspace(start, stop, count)
    flat = np.stack([np.cos(t), np.sin(t), np.zeros(count)], axis=1)
    return np.array(centre) + radius * (flat[:, [0, 2, 1]] if upright else flat)


def disc(x: float, y: float, radius: float, hole: float = 0.0) -> Polygon:
    """The outline of a circle. With ``hole``, the radius of a round hole, it is a ring."""
    circle = Point(x, y).buffer(radius, 12)
    return circle.difference(Point(x, y).buffer(hole, 12)) if hole else circle


def oval(x: float, y: float, length: float, width: float, degrees: float = 0.0) -> Polygon:
    """The outline of an ellipse, with its length along x before it is turned."""
    return affinity.rotate(affinity.scale(disc(x, y, 1).simplify(0.02), length / 2, width / 2), degrees)


def join(*meshes: Trimesh) -> Trimesh:
    """Several meshes as one."""
    return trimesh.util.concatenate(list(meshes))


def moved(mesh: Trimesh, x: float, y: float, z: float) -> Trimesh:
    """The mesh, moved in place."""
    return mesh.apply_translation([x, y, z])


def tilted(mesh: Trimesh, angle: float, axis: str = "x") -> Trimesh:
    """The mesh, turned in place by an angle (radians) about the x, y or z axis."""
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, np.eye(3)["xyz".index(axis)]))
