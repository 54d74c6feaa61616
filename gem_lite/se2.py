"""Planar poses, pixels and angles. All signs of angles are decided here and nowhere else.

Conventions (they hold in the whole library):

* Angles are radians, counter-clockwise seen from above (about world +z).
* A pixel is ``(row, col)``. Rows of a height map grow with world -y, columns with world +x, so the
  picture is the table seen from above and *not* mirrored: counter-clockwise in the picture is
  counter-clockwise in the world.
* Cell ``(i, j)`` has its centre at ``(i + 1/2, j + 1/2)`` pixels from the corner of the map. Functions
  that take a *pixel* count from the centre of cell (0, 0), so the centre of cell (i, j) is ``(i, j)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    import torch

Length = TypeVar("Length", float, np.ndarray)
CELLS_MULTIPLE = 16
"""A U-Net halves a map four times, so the sides of a map must be multiples of this number of cells."""
LONGEST_SIDE = 5.0
"""The longest side (m) of a rectangle: a longer one was probably given in other units than metres."""


def wrap(angle: float) -> float:
    """The equivalent of ``angle`` (radians) in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


@dataclass(frozen=True)
class Pose2:
    """An element of SE(2): position in metres, ``yaw`` in radians counter-clockwise from above."""

    x: float
    y: float
    yaw: float = 0.0

    def __matmul__(self, other: Pose2) -> Pose2:
        """Composition: ``(a @ b)`` applies b in the frame of a."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y, self.yaw + other.yaw)

    def inverse(self) -> Pose2:
        """The pose that undoes this one: ``p @ p.inverse()`` is the identity."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)


@dataclass(frozen=True)
class Workspace:
    """The rectangle of the table that a height map covers, and the size of its cells (metres).

    The default is CLIPort's table at 6.25 mm per pixel: 160 rows (y) by 80 columns (x).
    """

    x_min: float = 0.25
    x_max: float = 0.75
    y_min: float = -0.5
    y_max: float = 0.5
    z_max: float = 0.28
    pixel: float = 0.00625

    @classmethod
    def of_length(cls, length: float, pixel: float = pixel) -> Workspace:
        """A table ``length`` metres long (y) and half as wide (x). Its middle is that of the default workspace."""
        return cls(0.5 - length / 4, 0.5 + length / 4, -length / 2, length / 2, pixel=pixel)

    @classmethod
    def covering(cls, x_min: float, x_max: float, y_min: float, y_max: float, pixel: float = pixel) -> Workspace:
        """The smallest workspace with the same middle that holds a rectangle (m) and has the shape that networks need.

        Its height and its width are multiples of `CELLS_MULTIPLE` cells.

        Raises:
            ValueError: a limit is not below the other; a side is longer than `LONGEST_SIDE`.
        """
        sides = {"x": (x_min, x_max), "y": (y_min, y_max)}
        limits: list[float] = []
        for axis, (low, high) in sides.items():
            if not 0 < high - low <= LONGEST_SIDE:
                raise ValueError(
                    f"the rectangle's {axis} must go from a smaller number to a larger one, over at most "
                    f"{LONGEST_SIDE} m, got {low} to {high}"
                )
            # The small number keeps 0.5 m / 0.00625 m at 80 cells, in spite of rounding.
            steps = math.ceil((high - low) / (CELLS_MULTIPLE * pixel) - 1e-6)
            half = steps * CELLS_MULTIPLE * pixel / 2
            limits += [(low + high) / 2 - half, (low + high) / 2 + half]
        return cls(limits[0], limits[1], limits[2], limits[3], pixel=pixel)

    @property
    def length(self) -> float:
        """The extent in y (m)."""
        return self.y_max - self.y_min

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max (m)."""
        return self.x_min, self.x_max, self.y_min, self.y_max

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of the height map."""
        return round((self.y_max - self.y_min) / self.pixel), round((self.x_max - self.x_min) / self.pixel)

    def to_pixel(self, x: Length, y: Length) -> tuple[Length, Length]:
        """World metres to a continuous ``(row, col)``. A cell's centre becomes whole numbers."""
        return (self.y_max - y) / self.pixel - 0.5, (x - self.x_min) / self.pixel - 0.5

    def to_world(self, row: Length, col: Length) -> tuple[Length, Length]:
        """``(row, col)`` to world ``(x, y)`` in metres; the inverse of `to_pixel`."""
        return self.x_min + (col + 0.5) * self.pixel, self.y_max - (row + 0.5) * self.pixel

    def contains(self, x: Length, y: Length, margin: float = 0.0) -> Any:  # noqa: ANN401 (a bool, or an array of them)
        """Whether ``(x, y)`` lies at least ``margin`` metres inside: x_min <= x < x_max, y_min < y <= y_max."""
        inside_x = (x >= self.x_min + margin) & (x < self.x_max - margin)
        return inside_x & (y > self.y_min + margin) & (y <= self.y_max - margin)

    def nearest_pose(self, pose: Pose2) -> Pose2:
        """The pose nearest to ``pose``, with the same yaw, that lies at least half a cell inside."""
        border = self.pixel / 2
        x = min(max(pose.x, self.x_min + border), self.x_max - border)
        y = min(max(pose.y, self.y_min + border), self.y_max - border)
        return Pose2(x, y, pose.yaw)

    def nearest_cell(self, x: float, y: float) -> tuple[int, int]:
        """The cell whose centre is nearest to ``(x, y)``. Raises ValueError outside the workspace."""
        if not self.contains(x, y):
            raise ValueError(f"x, y = {x:.3f}, {y:.3f} m lies outside the workspace {self}")
        row, col = divmod(int(self.cells(np.array(x), np.array(y))), self.shape[1])
        return row, col

    def cells(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The flat indices of the cells whose centres are nearest to points inside the workspace."""
        row, col = self.to_pixel(x, y)
        # round() would send halves to even cells. The result is clipped, because rounding errors may push a point
        # over an edge.
        rows, cols = self.shape
        row = np.clip(np.floor(row + 0.5).astype(np.int64), 0, rows - 1)
        return row * cols + np.clip(np.floor(col + 0.5).astype(np.int64), 0, cols - 1)


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """The quaternion (x, y, z, w) of a turn by ``yaw`` about world +z."""
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def angle_off(angle: float, symmetry: float) -> float:
    """The distance (radians) of an angle from the nearest multiple of ``symmetry``.

    It is 0 for every angle if ``symmetry`` is 0.
    """
    if symmetry == 0:
        return 0.0
    return abs(wrap(angle * 2 * math.pi / symmetry)) * symmetry / (2 * math.pi)


def angle_bins(count: int) -> np.ndarray:
    """The ``count`` sampled angles 2 pi i / count, in radians."""
    return 2 * math.pi * np.arange(count) / count


def rotation_matrix(angle: float) -> np.ndarray:
    """(2, 2): turns a pixel offset ``(row, col)`` counter-clockwise *in the picture* by ``angle``.

    Rows point down, so in (row, col) order this is the familiar ``[[cos, -sin], [sin, cos]]``: a
    quarter turn takes "right" (0, 1) to "up" (-1, 0).
    """
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


@dataclass(frozen=True)
class ImageMotion:
    """A rigid motion of a whole picture: turn by ``angle`` about its centre, then shift (rows, cols).

    It moves images (`warp`), pixels (`move`) and yaws (``yaw + angle``) together; a relative place
    angle does not change under it.
    """

    angle: float
    shift: tuple[float, float]

    def move(self, pixel: tuple[float, float], shape: tuple[int, int]) -> tuple[float, float]:
        """The pixel to which the content of ``pixel`` moves, in a picture of ``shape`` (H, W)."""
        centre = (np.array(shape) - 1) / 2
        row, col = rotation_matrix(self.angle) @ (np.array(pixel) - centre) + centre + np.array(self.shift)
        return float(row), float(col)

    def warp(self, image: torch.Tensor, mode: str = "bilinear") -> torch.Tensor:
        """Move a ``(B, C, H, W)`` image. Pixels from outside the image are 0."""
        import torch

        return rotate_image(image, torch.tensor([self.angle]), self.shift, mode)


def rotate_image(
    image: torch.Tensor, angles: torch.Tensor, shift: tuple[float, float] = (0.0, 0.0), mode: str = "bilinear"
) -> torch.Tensor:
    """Turn pictures counter-clockwise about their centre, then shift them by (rows, cols).

    Args:
        image: (B, C, H, W), or (1, C, H, W), which is turned by every angle.
        angles: (B,) radians. A quarter turn equals ``torch.rot90(k=1)`` on square maps.
        shift: (rows, cols) in pixels, the same for all images.
        mode: ``grid_sample`` interpolation.

    Returns:
        (B, C, H, W). Pixels from outside the image are 0.
    """
    import torch  # Here, since it takes seconds, and programs that look at cameras need none of it.
    import torch.nn.functional as F

    batch = max(len(image), len(angles))
    _, channels, height, width = image.shape
    angles = angles.to(image).expand(batch)
    c, s = angles.cos()[:, None, None], angles.sin()[:, None, None]
    # Offsets from the centre in pixels: normalised units would be wrong, because maps are not square.
    row = torch.arange(height, device=image.device, dtype=image.dtype)[:, None] - (height - 1) / 2 - shift[0]
    col = torch.arange(width, device=image.device, dtype=image.dtype)[None, :] - (width - 1) / 2 - shift[1]
    # grid_sample needs the source of each output pixel, so this is the inverse turn.
    from_row = c * row + s * col  # (B, H, W)
    from_col = -s * row + c * col
    scale = [2 / max(n - 1, 1) for n in (width, height)]
    grid = torch.stack([from_col * scale[0], from_row * scale[1]], dim=-1)
    return F.grid_sample(
        image.expand(batch, channels, height, width), grid, mode=mode, padding_mode="zeros", align_corners=True
    )
