"""Lens distortion: pictures as a camera without it would have taken them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gem_lite.rgbd.camera import Matrix

COUNTS = (4, 5, 8, 12, 14)
"""How many numbers a distortion has: k1 k2 p1 p2, k3, k4 to k6, s1 to s4, two tilts (OpenCV's order and ROS's)."""


def checked_distortion(value: Sequence[float], name: str) -> np.ndarray:
    """A distortion as an array. Raises ValueError, whose message begins with ``name``, for anything else."""
    numbers = np.asarray(value, float).ravel()
    if numbers.size not in (0, *COUNTS) or not np.isfinite(numbers).all():
        raise ValueError(
            f"{name} must be {', '.join(map(str, COUNTS))} finite numbers in OpenCV's order, got {value!r:.100}"
        )
    return numbers


def without_distortion(picture: np.ndarray, intrinsics: Matrix, distortion: np.ndarray) -> np.ndarray:
    """A picture without its lens's distortion, for the same intrinsics (OpenCV's model).

    Colours are interpolated; depth takes the nearest pixel, since the mean of a thing and of what is behind it is
    neither. What the lens did not see is 0.

    Args:
        picture: (H, W, 3) uint8 colours, or (H, W) depth.
        intrinsics: (3, 3), see `gem_lite.rgbd.camera.Camera`.
        distortion: of `checked_distortion`.
    """
    if not distortion.any():
        return picture
    matrix = np.array(intrinsics, float)
    matrix[:2, 2] -= 0.5  # For OpenCV, the middle of the first pixel is (0, 0).
    size = (picture.shape[1], picture.shape[0])
    columns, rows = cv2.initUndistortRectifyMap(matrix, distortion, np.eye(3), matrix, size, cv2.CV_32FC1)
    interpolation = cv2.INTER_LINEAR if picture.ndim == 3 else cv2.INTER_NEAREST
    return cv2.remap(picture, columns, rows, interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
