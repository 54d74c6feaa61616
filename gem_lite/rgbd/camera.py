"""A camera and its view: the model for points, rendering and localisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

Matrix = tuple[tuple[float, ...], ...]


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
    """

    name: str
    intrinsics: Matrix
    pose: Matrix
    size: tuple[int, int] = (480, 640)
    near: float = 0.01
    far: float = 10.0

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
    rows = np.column_stack([rotation, position]).tolist()
    return (*(tuple(row) for row in rows), (0.0, 0.0, 0.0, 1.0))


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
