"""AprilTags as bodies: plates with a white and a black part."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import trimesh
from shapely import box, union_all

from gem_lite.rgbd.tags import DICTIONARY, SQUARES, TAG_COUNT, TAG_SIDE
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.shapes import create_body, create_visual
from gem_lite.simulation.bodies.solids import slab

PLATE = TAG_SIDE * (SQUARES + 2) / SQUARES
"""Length (m) of the side of a plate: a tag and its white margin."""
WHITE, BLACK = (0.95, 0.95, 0.95, 1.0), (0.05, 0.05, 0.05, 1.0)


@cache
def _meshes(number: int) -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """The white and the black part of a tag's plate, 1 mm thick. Meshes replace textures, which are not smoothed."""
    bitmap = cv2.aruco.generateImageMarker(DICTIONARY, number, SQUARES)
    side = TAG_SIDE / SQUARES
    rows, cols = np.nonzero(bitmap == 0)
    x = -TAG_SIDE / 2 + cols * side
    y = TAG_SIDE / 2 - rows * side
    black = union_all([box(left, top - side, left + side, top) for left, top in zip(x, y, strict=True)])
    white = box(-PLATE / 2, -PLATE / 2, PLATE / 2, PLATE / 2).difference(black)
    return slab(white, 0, 0.001), slab(black, 0, 0.001)


def add_tag(client: int, number: int, pose: Pose2) -> None:
    """Put a tag flat on the height 0, with its face up.

    Raises:
        ValueError: no tag has that number.
    """
    if not 0 <= number < TAG_COUNT:
        raise ValueError(f"number must be in [0, {TAG_COUNT}), got {number}")
    for mesh, color in zip(_meshes(number), (WHITE, BLACK), strict=True):
        create_body(client, -1, create_visual(client, mesh, color, 0.001), pose, 0.0, 0.0, False)
