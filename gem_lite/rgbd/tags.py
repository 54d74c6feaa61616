"""AprilTags (36h11): which a picture shows, and where one's table is in the frame of the camera's base (A.12)."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
COUNT = 587
CELLS = 8
"""Cells along a tag's side, its black border included."""
TAG_SIDE = 0.14
"""Length (m) of a tag's black square; a white margin of one cell surrounds it."""

CORNERS = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * TAG_SIDE / 2
"""(4, 3) metres in a tag's frame, in OpenCV's order: the picture's upper left, then clockwise.

The frame is that of a height map: x to the picture's right, y to its top, z towards the viewer."""


class LocalisationError(RuntimeError):
    """A table's tag was not found; the message says what was seen instead."""


def find_tags(view: View) -> dict[int, np.ndarray]:
    """The 36h11 tags in a picture: each one's number and its corners (4, 2), (x, y) from its upper left edge."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    corners, numbers, _ = cv2.aruco.ArucoDetector(DICTIONARY, parameters).detectMarkers(view.rgb)
    found = [] if numbers is None else numbers.ravel()
    return {int(number): quad[0].astype(float) for number, quad in zip(found, corners, strict=True)}


def table_in_base(view: View, number: int, tag: Pose2) -> Pose2:
    """Where a table's frame is in the base's, from one picture of its tag (Perspective-n-Point).

    Args:
        view: by the body camera, in the base's frame.
        number: the table's tag.
        tag: the tag in the table's frame.

    Raises:
        LocalisationError: the tag is not in the picture; another one, or a half-hidden one, does not count.
    """
    seen = find_tags(view)
    if number not in seen:
        others = f"only tag {', '.join(map(str, sorted(seen)))}" if seen else "no tag at all"
        raise LocalisationError(f"tag {number} is not in the picture, {others}")
    camera = view.camera
    _, turn, at = cv2.solvePnP(CORNERS, seen[number], camera.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    # The tag in the camera's frame, then in the base's: both stand level, so three numbers are left.
    rotation = camera.rotation @ Rotation.from_rotvec(turn.ravel()).as_matrix()
    x, y, _ = camera.rotation @ at.ravel() + camera.position
    return Pose2(x, y, float(np.arctan2(rotation[1, 0], rotation[0, 0]))) @ tag.inverse()
