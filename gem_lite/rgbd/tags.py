"""AprilTags (36h11): find them in a picture, and compute the pose of a table from its tag (A.12)."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
TAG_COUNT = 587
"""How many tags the family 36h11 has."""
SQUARES = 8
"""Squares along the side of a tag, with its black border."""
TAG_SIDE = 0.14
"""Length (m) of the side of a tag. A white margin, one square wide, surrounds it."""

CORNERS = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * TAG_SIDE / 2
"""(4, 3) corners of a tag in its own frame (m), in OpenCV's order: the upper left corner first, then clockwise.

The frame is like that of a height map: x to the picture's right, y to its top, z towards the viewer."""


class LocalisationError(ValueError):
    """The tag of a table was not found. The message names the tags that were found."""


def find_tags(rgb: np.ndarray) -> dict[int, np.ndarray]:
    """The 36h11 tags in a picture (H, W, 3) uint8: (4, 2) corners (x, y) from its upper left edge, by tag number."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    corners, numbers, _ = cv2.aruco.ArucoDetector(DICTIONARY, parameters).detectMarkers(rgb)
    if numbers is None:  # OpenCV returns None if there is no tag.
        return {}
    return {int(number): quad[0].astype(float) for number, quad in zip(numbers.ravel(), corners, strict=True)}


def tag_corners(rgb: np.ndarray, number: int) -> np.ndarray:
    """(4, 2): the corners of one tag, as `find_tags` gives them.

    Raises:
        LocalisationError: the tag is not fully visible in the picture.
    """
    corners = find_tags(rgb)
    if number not in corners:
        others = f"only tag {', '.join(map(str, sorted(corners)))}" if corners else "no tag at all"
        raise LocalisationError(f"tag {number} is not in the picture, {others}")
    return corners[number]


def table_in_base(view: View, number: int, tag: Pose2) -> Pose2:
    """The pose of a table in the base's frame, from one picture of its tag (Perspective-n-Point).

    Args:
        view: the picture of the body camera, in the base's frame.
        number: the number of the table's tag.
        tag: the tag's pose in the table's frame.

    Raises:
        LocalisationError: the tag is not fully visible in the picture.
    """
    camera = view.camera
    _, turn, position = cv2.solvePnP(
        CORNERS, tag_corners(view.rgb, number), camera.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    # From the camera's frame to the base's frame. Tag and base are level, so x, y and yaw are enough.
    rotation = camera.rotation @ Rotation.from_rotvec(turn.ravel()).as_matrix()
    x, y, _ = camera.rotation @ position.ravel() + camera.position
    return Pose2(x, y, float(np.arctan2(rotation[1, 0], rotation[0, 0]))) @ tag.inverse()
