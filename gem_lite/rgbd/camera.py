"""A camera and its view: the model for points, rendering and localisation."""

from __future__ import annotations

from collections.abc import Sequence
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
        ValueError: ``value`` is not (3, 3) finite numbers, a focal length is not positive, or the last row is not
            0 0 1. The message begins with ``name``.
    """
    matrix = _array(value, 3)
    if matrix is None or min(matrix[0, 0], matrix[1, 1]) <= 0 or matrix[2].tolist() != [0, 0, 1]:
        raise ValueError(
            f"{name} must be (3, 3) finite numbers with positive focal lengths and the last row 0 0 1, got "
            f"{_shown(value)}"
        )
    return matrix


def checked_pose(value: object, name: str, mirrored: bool = False) -> np.ndarray:
    """A pose as a (4, 4) array.

    Args:
        mirrored: whether the rotation may be a reflection, which is left-handed.

    Raises:
        ValueError: ``value`` is not (4, 4) finite numbers, its rotation is none, or its last row is not 0 0 0 1. The
            message begins with ``name``.
    """
    pose = _array(value, 4)
    if pose is None or not np.allclose(pose[3], (0, 0, 0, 1), atol=1e-6) or not _is_rotation(pose[:3, :3], mirrored):
        raise ValueError(
            f"{name} must be a (4, 4) pose: a rotation{'' if mirrored else ' (no reflection)'}, a position and the "
            f"last row 0 0 0 1, got {_shown(value)}"
        )
    return pose


def checked_rotation(value: object, name: str) -> np.ndarray:
    """A rotation as a (3, 3) array. Raises ValueError for anything else, such as a reflection."""
    rotation = _array(value, 3)
    if rotation is None or not _is_rotation(rotation):
        raise ValueError(f"{name} must be a (3, 3) rotation, and no reflection, got {_shown(value)}")
    return rotation


def _array(value: object, size: int) -> np.ndarray | None:
    """A square matrix of finite numbers; None for anything else."""
    try:
        matrix = np.asarray(value, float)
    except (TypeError, ValueError, OverflowError):
        return None
    return matrix if matrix.shape == (size, size) and np.isfinite(matrix).all() else None


def _is_rotation(matrix: np.ndarray, mirrored: bool = False) -> bool:
    return np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3) and (mirrored or np.linalg.det(matrix) > 0)


def _shown(value: object) -> str:
    """A matrix in one line."""
    return f"{value.tolist() if isinstance(value, np.ndarray) else value!r:.200}"


@dataclass(frozen=True)
class View:
    """The picture of one camera: ``rgb`` (H, W, 3) uint8, ``depth`` (H, W) float32 metres along the axis."""

    camera: Camera
    rgb: np.ndarray
    depth: np.ndarray

    def __post_init__(self) -> None:
        if self.rgb.dtype != np.uint8 or self.rgb.shape != (*self.camera.size, 3):
            raise ValueError(
                f"rgb of camera {self.camera.name!r} must be uint8 of shape {(*self.camera.size, 3)}, "
                f"got {self.rgb.dtype} of shape {self.rgb.shape}"
            )
        if self.depth.dtype != np.float32 or self.depth.shape != self.camera.size:
            raise ValueError(
                f"depth of camera {self.camera.name!r} must be float32 of shape {self.camera.size}, "
                f"got {self.depth.dtype} of shape {self.depth.shape}"
            )

    def points(self) -> np.ndarray:
        """(H, W, 3) float32: the world position of every pixel, in metres."""
        points = _rays(self.camera) * self.depth[..., None]
        points += self.camera.position.astype(np.float32)
        return points


@lru_cache(maxsize=16)
def _rays(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32: from the camera to each pixel's point at depth 1, in the world's directions."""
    height, width = camera.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)  # the pixels' centres, each (H, W)
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    return (pixels @ np.linalg.inv(camera.matrix).T @ camera.rotation.T).astype(np.float32)


def camera_looking_at(name: str, position: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    """An upright camera at ``position`` that looks at ``target`` (m). It cannot look straight down."""
    forward = np.subtract(target, position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    rotation = Rotation.from_matrix(np.stack([right, np.cross(forward, right), forward], axis=1))
    return Camera.pinhole(name, position, rotation.as_quat())
