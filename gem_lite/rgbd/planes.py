"""Flat surfaces among the points of a depth camera: the table is one of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FLAT = 0.012
"""A point at most this far (m) from a plane lies on it."""
TRIPLES = 400
"""So many planes through three random points are tried for each plane that is found."""
BANDS = (0.024, FLAT, 0.008, 0.008)
"""A plane is fitted again to the points that are as near to it (m), one time after the other."""
SMALLEST = 0.08
"""A plane holds at least this share of the points."""


@dataclass(frozen=True)
class Plane:
    """The plane of all p with ``normal`` · p + ``offset`` = 0.

    Attributes:
        normal: (3,), of length 1.
        offset: in metres.
        share: the share of all points, in [0, 1], that are at most `FLAT` from it.
        bend: how many degrees the planes through its two halves differ; NaN with fewer than 100 points. Noise, a curved
            table and a lens with distortion bend it.
    """

    normal: np.ndarray
    offset: float
    share: float
    bend: float

    def height(self, points: np.ndarray) -> np.ndarray:
        """How far points (..., 3) lie above the plane (m), on the side of its normal."""
        return points @ self.normal + self.offset

    def middle(self, points: np.ndarray) -> np.ndarray:
        """(3,): the mean of those points (N, 3) that lie on the plane."""
        return points[np.abs(self.height(points)) < FLAT].mean(axis=0)

    def met_by(self, start: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(N, 3): where rays from a point (3,) along directions (N, 3) meet the plane; NaN where they do not."""
        steepness = directions @ self.normal
        with np.errstate(divide="ignore"):
            reach = -self.height(start) / steepness
        return start + np.where((reach > 0) & np.isfinite(reach), reach, np.nan)[:, None] * directions


def tilt(normal: np.ndarray, other: Sequence[float] | np.ndarray = (0, 0, 1)) -> float:
    """The angle between two directions in degrees, 0 to 180."""
    return math.degrees(math.acos(float(np.clip(np.dot(normal, other), -1, 1))))


def find_planes(points: np.ndarray, viewpoint: np.ndarray, count: int = 3, seed: int = 0) -> list[Plane]:
    """The planes that hold most of the points: the largest first, each without the points of those before it.

    Planes through random triples are tried (RANSAC; Fischler and Bolles 1981), and the best one is fitted by least
    squares. Planes with less than `SMALLEST` of the points are left out.

    Args:
        points: (N, 3) in metres. Some thousands are enough.
        viewpoint: (3,), where the camera is: normals point to this side.
    """
    found: list[Plane] = []
    rng = np.random.default_rng(seed)
    left = np.asarray(points, float)
    while len(found) < count and len(left) >= max(3, SMALLEST * len(points)):
        corner, second, third = left[rng.integers(len(left), size=(3, TRIPLES))]
        normals = np.cross(second - corner, third - corner)
        lengths = np.linalg.norm(normals, axis=1)
        wide = lengths > 1e-9  # three points on a line have no plane
        normals, corner = normals[wide] / lengths[wide, None], corner[wide]
        if not len(normals):
            break
        sample = left[:: max(1, len(left) // 3000)]
        distances = np.abs(sample @ normals.T - (normals * corner).sum(axis=1))  # (about 3000, TRIPLES)
        best = int((distances < FLAT).mean(axis=0).argmax())
        plane = _fitted(left, normals[best], -float(normals[best] @ corner[best]), viewpoint, len(points))
        if plane.share < SMALLEST:
            break
        found.append(plane)
        left = left[np.abs(plane.height(left)) > 2 * FLAT]
    return found


def _fitted(points: np.ndarray, normal: np.ndarray, offset: float, viewpoint: np.ndarray, total: int) -> Plane:
    """The plane by least squares through the points (N, 3) near a first guess, with its share of ``total`` points."""
    for band in BANDS:
        near = points[np.abs(points @ normal + offset) < band]
        if len(near) < 3:
            break
        normal, offset = _through(near)
    near = points[np.abs(points @ normal + offset) < FLAT]
    if viewpoint @ normal + offset < 0:
        normal, offset = -normal, -offset
    return Plane(normal, offset, len(near) / total, _bend(near))


def _through(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The normal and the offset of the plane with the smallest squared distances from points (N, 3)."""
    middle = points.mean(axis=0)
    centred = points - middle
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    return normal, -float(normal @ middle)


def _bend(points: np.ndarray) -> float:
    """The larger one of the angles (degrees) between the planes of two halves, cut along both axes of the points."""
    if len(points) < 100:
        return math.nan
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1][:, 1:]
    angles = []
    for position in (centred @ axes).T:
        one, other = (_through(points[half])[0] for half in (position < 0, position >= 0))
        angles.append(tilt(one, other if one @ other > 0 else -other))
    return max(angles)
