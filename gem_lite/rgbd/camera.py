"""A camera and its view: the model for points, rendering and localisation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

Matrix = Sequence[Sequence[float]] | np.ndarray
"""A matrix by its rows."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. Its axes: +z forward, +x to the image's right, +y down.

    Attributes:
        name: the label of its pictures.
        intrinsics: (3, 3). A point (X, Y, Z) in the camera's axes appears at (x, y) pixels from the upper left
            edge of the picture, with (x, y, 1) = intrinsics (X, Y, Z) / Z; pixel (row, col) has its centre at
            (col + 1/2, row + 1/2).
        pose: (4, 4), from the camera's axes to the reference frame, usually the world's (metres).
        size: (H, W) in pixels.
        near, far: the camera sees only what lies between these distances (metres along the axis).

    Raises:
        ValueError: see `checked_intrinsics` and `checked_pose`.
    """

    name: str
    intrinsics: Matrix
    pose: Matrix
    size: tuple[int, int] = (480, 640)
    near: float = 0.01
    far: float = 10.0

    def __post_init__(self) -> None:
        pose = checked_pose(self.pose, f"pose of camera {self.name!r}")
        intrinsics = checked_intrinsics(self.intrinsics, f"intrinsics of camera {self.name!r}")
        object.__setattr__(self, "pose", _as_tuples(pose))
        object.__setattr__(self, "intrinsics", _as_tuples(intrinsics))

    @classmethod
    def pinhole(
        cls, name: str, position: Sequence[float], quaternion: Sequence[float], size: tuple[int, int] = (480, 640),
        focal: float = 450.0, near: float = 0.01, far: float = 10.0,
    ) -> Camera:  # fmt: skip
        """A camera whose axis goes through the middle of its picture.

        Args:
            position: (x, y, z) in metres.
            quaternion: (x, y, z, w), camera to world.
            focal: focal length in pixels.
        """
        intrinsics = ((focal, 0.0, size[1] / 2), (0.0, focal, size[0] / 2), (0.0, 0.0, 1.0))
        rotation = Rotation.from_quat(quaternion).as_matrix()
        return cls(name, intrinsics, as_pose(rotation, position), size, near, far)

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) camera-to-world rotation."""
        return np.array(self.pose)[:3, :3]

    @property
    def position(self) -> np.ndarray:
        """(3,) position in metres."""
        return np.array(self.pose)[:3, 3]

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) ``intrinsics`` as an array."""
        return np.array(self.intrinsics)

    @property
    def focal(self) -> float:
        """The focal length in pixels, along the picture's rows."""
        return self.intrinsics[0][0]


def as_pose(rotation: np.ndarray, position: Sequence[float]) -> Matrix:
    """A (3, 3) rotation and a position (m) as the (4, 4) ``pose`` of a `Camera`."""
    return (*_as_tuples(np.column_stack([rotation, position])), (0.0, 0.0, 0.0, 1.0))


def _as_tuples(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def checked_intrinsics(value: object, name: str) -> np.ndarray:
    """Intrinsics as a (3, 3) array.

    Raises:
        ValueError: ``value`` is not (3, 3) finite numbers, a focal length is not positive, the first entry of the
            second row is not 0, or the last row is not 0 0 1. The message begins with ``name``.
    """

    def is_right(matrix: np.ndarray) -> bool:
        return min(matrix[0, 0], matrix[1, 1]) > 0 and abs(matrix[1, 0]) < 1e-6 and matrix[2].tolist() == [0, 0, 1]

    wanted = "(3, 3) finite numbers with positive focal lengths, 0 in row 2, column 1, and the last row 0 0 1"
    return _checked(value, name, 3, is_right, wanted)


def checked_pose(value: object, name: str, mirrored: bool = False) -> np.ndarray:
    """A pose as a (4, 4) array.

    Args:
        mirrored: whether the rotation may be a reflection, which is left-handed.

    Raises:
        ValueError: ``value`` is not (4, 4) finite numbers, its rotation is none, or its last row is not 0 0 0 1. The
            message begins with ``name``.
    """

    def is_right(pose: np.ndarray) -> bool:
        return np.allclose(pose[3], (0, 0, 0, 1), atol=1e-6) and _is_rotation(pose[:3, :3], mirrored)

    rotation = "rotation" if mirrored else "rotation (no reflection)"
    return _checked(value, name, 4, is_right, f"a (4, 4) pose: a {rotation}, a position and the last row 0 0 0 1")


def checked_rotation(value: object, name: str) -> np.ndarray:
    """A rotation as a (3, 3) array. Raises ValueError for anything else, such as a reflection."""
    return _checked(value, name, 3, _is_rotation, "a (3, 3) rotation, and no reflection")


def _checked(
    value: object, name: str, size: int, is_right: Callable[[np.ndarray], bool], wanted: str
) -> np.ndarray:  # fmt: skip
    """A (size, size) matrix of finite numbers. Raises ValueError for anything else, or if it is not right."""
    try:
        matrix = np.asarray(value, float)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (size, size) or not np.isfinite(matrix).all() or not is_right(matrix):
        shown = value.tolist() if isinstance(value, np.ndarray) else value
        raise ValueError(f"{name} must be {wanted}, got {shown!r:.200}")
    return matrix


def _is_rotation(matrix: np.ndarray, mirrored: bool = False) -> bool:
    return np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3) and (mirrored or np.linalg.det(matrix) > 0)


@dataclass(frozen=True)
class View:
    """The picture of one camera: ``rgb`` (H, W, 3) uint8, ``depth`` (H, W) float32 metres along the axis."""

    camera: Camera
    rgb: np.ndarray
    depth: np.ndarray

    def __post_init__(self) -> None:
        size = self.camera.size
        for name, kind, shape in (("rgb", "uint8", (*size, 3)), ("depth", "float32", size)):
            image = getattr(self, name)
            if image.dtype != kind or image.shape != shape:
                raise ValueError(
                    f"{name} of camera {self.camera.name!r} must be {kind} of shape {shape}, "
                    f"got {image.dtype} of shape {image.shape}"
                )

    def points(self) -> np.ndarray:
        """(H, W, 3) float32: the world position of every pixel, in metres."""
        return _rays(self.camera) * self.depth[..., None] + self.camera.position.astype(np.float32)


@lru_cache(maxsize=16)
def _rays(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32: from the camera to each pixel's point at depth 1, in the world's directions."""
    height, width = camera.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)  # the pixels' centres, each (H, W)
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    return (pixels @ np.linalg.inv(camera.matrix).T @ camera.rotation.T).astype(np.float32)


def rays(pixels: np.ndarray, intrinsics: Matrix) -> np.ndarray:
    """(N, 3): the points at depth 1, in the camera's axes, of pixels (N, 2): x and y from the upper left edge."""
    return np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(np.asarray(intrinsics, float)).T


def measured_points(depth: np.ndarray, intrinsics: Matrix, count: int = 20_000) -> np.ndarray:
    """(N, 3): about ``count`` of a depth picture's pixels as points in the camera's axes (m).

    Args:
        depth: (H, W) metres along the axis, 0 where nothing was measured.
        intrinsics: (3, 3), of pixels of this size.
    """
    step = max(1, round(math.sqrt(depth.size / count)))
    some = depth[::step, ::step]
    rows, cols = np.nonzero(some > 0)
    return rays(np.column_stack([cols, rows]) * step + 0.5, intrinsics) * some[rows, cols, None]


def camera_looking_at(name: str, position: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    """An upright camera at ``position`` that looks at ``target`` (m). It cannot look straight down."""
    forward = np.subtract(target, position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    rotation = Rotation.from_matrix(np.stack([right, np.cross(forward, right), forward], axis=1))
    return Camera.pinhole(name, position, rotation.as_quat())
