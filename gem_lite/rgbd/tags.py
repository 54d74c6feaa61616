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
    tag_in_camera = _tag_in_camera(view.rgb, camera.matrix, number, TAG_SIDE)
    # From the camera's frame to the base's frame. Tag and base are level, so x, y and yaw are enough.
    rotation = camera.rotation @ tag_in_camera[:3, :3]
    x, y, _ = camera.rotation @ tag_in_camera[:3, 3] + camera.position
    return Pose2(x, y, float(np.arctan2(rotation[1, 0], rotation[0, 0]))) @ tag.inverse()


def camera_in_table(
    rgb: np.ndarray, intrinsics: np.ndarray, number: int, tag: Pose2, side: float = TAG_SIDE
) -> np.ndarray:  # fmt: skip
    """The pose (4, 4) of a camera in the table's frame, from its picture of a tag that lies flat on the table (z = 0).

    Args:
        rgb: (H, W, 3) uint8.
        intrinsics: (3, 3), see `Camera`.
        number: the number of the tag.
        tag: where the tag lies on the table: its middle, and its yaw (0 if its upper edge points to +y).
        side: length (m) of a side of the tag, without its white margin.

    Raises:
        LocalisationError: the tag is not fully visible in the picture.
    """
    tag_in_table = np.eye(4)
    tag_in_table[:3, :3] = Rotation.from_euler("z", tag.yaw).as_matrix()
    tag_in_table[:2, 3] = tag.x, tag.y
    return tag_in_table @ np.linalg.inv(_tag_in_camera(rgb, np.asarray(intrinsics), number, side))


def _tag_in_camera(rgb: np.ndarray, intrinsics: np.ndarray, number: int, side: float) -> np.ndarray:
    """The pose (4, 4) of a tag in the camera's frame (Perspective-n-Point)."""
    _, rotation_vector, position = cv2.solvePnP(
        CORNERS * side / TAG_SIDE, tag_corners(rgb, number), intrinsics, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rotation_vector.ravel()).as_matrix()
    pose[:3, 3] = position.ravel()
    return pose
