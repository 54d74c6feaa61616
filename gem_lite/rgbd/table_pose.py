"""A camera's pose from what is in its picture: the table's plane, and points of the table that somebody names.

Two tilts and the height of a pose come from the plane that the depth picture shows (`planes`). The other three numbers,
a place and a turn on the table, come from points in the picture whose coordinates on the table are known: clicks, the
corners of a rectangle, of an AprilTag or of a ChArUco board. Rays through these pixels meet the plane, and the best
turn and shift on the plane bring them to their coordinates (Umeyama 1991, in two dimensions, without a scale).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.camera import Matrix, as_pose, checked_intrinsics, measured_points, rays
from gem_lite.rgbd.planes import Plane, find_planes, tilt
from gem_lite.rgbd.tags import CORNERS, DICTIONARY, TAG_COUNT, TAG_SIDE, LocalisationError, tag_corners
from gem_lite.se2 import Pose2

UPRIGHT = 20.0
"""The table of a robot is level within this angle (degrees) in the frame of the robot's base."""
CLICKED = 0.03
"""A click lies on the table if what is measured there is at most this far (m) from the plane."""
AROUND = 10
"""Where a click has no depth, the nearest measured pixel counts, if it is at most as far away (pixels)."""
LARGEST_RESIDUAL = 0.05
"""A point may be off by this share of the points' spread (root mean square)."""
LARGEST_TURN = 5.0
"""A pixel's error may turn the table by as much (degrees)."""
LARGEST_SIDE = 2.0
"""The side (m) of a tag or of a board's square is smaller."""


@dataclass(frozen=True)
class TablePose:
    """A camera's pose on the table, and how well it is known.

    Attributes:
        pose: (4, 4) from the camera's axes to the table's frame (m).
        plane: the table in the camera's axes.
        points: (N, 2) where the given pixels lie in the table's frame (m).
        residuals: (N,) how far that is from their given coordinates (m).
        spread: the root mean square of the points' distances from their middle (m).
        pixel: how long one pixel is on the table (m), at the middle of the points: the longer one of its two sides.
        turn: by how much one pixel's error turns the table (degrees).
    """

    pose: Matrix
    plane: Plane
    points: np.ndarray
    residuals: np.ndarray
    spread: float
    pixel: float
    turn: float

    def refuse_if_wrong(self) -> None:
        """Raises ValueError if the points contradict their places, or are too near to each other."""
        worst = int(self.residuals.argmax())
        if self.residuals[worst] > LARGEST_RESIDUAL * self.spread:
            raise ValueError(
                f"the points contradict their places: point {worst + 1} is {1000 * self.residuals[worst]:.0f} mm off; "
                "is a number, a unit or the order wrong?"
            )
        if self.turn > LARGEST_TURN:
            raise ValueError(
                f"the points are too near to each other: a pixel's error turns the table by {self.turn:.0f} degrees"
            )


def table_planes(depth: np.ndarray, intrinsics: Matrix, clicks: Sequence[Sequence[float]] = ()) -> list[Plane]:
    """The planes that may be the table, in the camera's axes: the likeliest first.

    The largest plane comes first; with clicks, the largest of those on which most of the clicks lie.

    Args:
        depth: (H, W) metres along the camera's axis, 0 where nothing was measured.
        clicks: (N, 2) pixels x, y on the table, from the picture's upper left edge.

    Raises:
        ValueError: the picture has no plane; a click lies outside it; or fewer than two clicks lie on the same plane.
    """
    intrinsics = checked_intrinsics(intrinsics, "intrinsics")
    height, width = depth.shape
    points = measured_points(depth, intrinsics)
    planes = find_planes(points, np.zeros(3)) if len(points) >= 100 else []
    if not planes:
        raise ValueError(f"no plane is seen: {len(points)} measured points, and no flat part holds 8 % of them")
    on_plane = np.zeros(len(planes))
    for x, y in clicks:
        if not (0 <= x < width and 0 <= y < height):
            raise ValueError(f"points must lie in the picture of {width} x {height} pixels, got ({x:g}, {y:g})")
        point = _measured_near(depth, x, y, intrinsics)
        if point is not None:
            on_plane += np.array([abs(plane.height(point)) < CLICKED for plane in planes])
    if len(clicks) and on_plane.max() < 2:
        raise ValueError("the points lie on no plane, or no depth is measured there: take others, on the bare table")
    return [planes[number] for number in np.argsort(-on_plane, kind="stable")]


def _measured_near(depth: np.ndarray, x: float, y: float, intrinsics: Matrix) -> np.ndarray | None:
    """The point (3,) in the camera's axes that is measured at or near a pixel, if there is one."""
    top, left = max(0, int(y) - AROUND), max(0, int(x) - AROUND)
    rows, cols = np.nonzero(depth[top : int(y) + AROUND + 1, left : int(x) + AROUND + 1] > 0)
    if not len(rows):
        return None
    nearest = int(np.hypot(rows + top - y, cols + left - x).argmin())
    row, col = int(rows[nearest]) + top, int(cols[nearest]) + left
    return rays(np.array([[col + 0.5, row + 0.5]]), intrinsics)[0] * depth[row, col]


def pose_from_points(plane: Plane, pixels: np.ndarray, table: np.ndarray, intrinsics: Matrix) -> TablePose:
    """The pose of a camera that sees the table as a plane, and points of it at known coordinates.

    Args:
        plane: in the camera's axes; its normal points to the camera.
        pixels: (N, 2), at least two.
        table: (N, 2) their coordinates in the table's frame (m).

    Raises:
        ValueError: there are fewer than two points or all lie at one place; a pixel looks past the table.
    """
    intrinsics = checked_intrinsics(intrinsics, "intrinsics")
    pixels, table = np.asarray(pixels, float), np.asarray(table, float)
    if len(pixels) < 2 or pixels.shape != table.shape:
        raise ValueError(f"points must be two or more, each with its place, got {len(pixels)} and {len(table)}")
    if not np.isfinite(table).all():
        raise ValueError(f"places must be finite numbers, got {table.tolist()!r:.100}")
    met = _on_plane(plane, pixels, intrinsics)
    flat, basis = _coordinates(plane, met)
    middle, target = flat.mean(axis=0), table.mean(axis=0)
    # Complex numbers: the turn that brings the centred points to their coordinates.
    turned = np.sum(np.conj(_complex(flat - middle)) * _complex(table - target))
    if abs(turned) < 1e-9:
        raise ValueError("points must lie at different places of the table")
    cos, sin = turned.real / abs(turned), turned.imag / abs(turned)
    rotation = np.array([[cos, -sin], [sin, cos]])
    placed = (flat - middle) @ rotation.T + target
    axes = np.vstack([rotation @ basis, plane.normal])  # the table's axes in the camera's
    origin = axes @ met.mean(axis=0)
    pose = as_pose(axes, np.array([*target, 0.0]) - origin)
    spread = math.sqrt(((placed - placed.mean(axis=0)) ** 2).sum(axis=1).mean())
    residuals = np.linalg.norm(placed - table, axis=1)
    pixel = _length_of_pixel(plane, pixels.mean(axis=0), intrinsics)
    return TablePose(pose, plane, placed, residuals, spread, pixel, math.degrees(math.atan2(pixel, 2 * spread)))


def _length_of_pixel(plane: Plane, at: np.ndarray, intrinsics: Matrix) -> float:
    """The longer one of a pixel's two sides on a plane (m)."""
    here, beside, below = _on_plane(plane, at + np.array([[0, 0], [0.1, 0], [0, 0.1]]), intrinsics)
    return 10 * float(max(np.linalg.norm(beside - here), np.linalg.norm(below - here)))


def from_clicks(
    plane: Plane, middle: Sequence[float], right: Sequence[float], intrinsics: Matrix, at: Pose2
) -> TablePose:
    """The pose from two clicks: where ``at`` shall lie on the table, and anything in its direction of +x.

    Raises: as `pose_from_points`.
    """
    pixels = np.array([middle, right], float)
    met = _on_plane(plane, pixels, checked_intrinsics(intrinsics, "intrinsics"))
    ahead = at @ Pose2(float(np.linalg.norm(met[1] - met[0])), 0.0)
    return pose_from_points(plane, pixels, np.array([[at.x, at.y], [ahead.x, ahead.y]]), intrinsics)


def from_rectangle(plane: Plane, corners: Sequence[Sequence[float]], intrinsics: Matrix, middle: Pose2) -> TablePose:
    """The pose from four clicks on the corners of a rectangle whose middle shall lie at ``middle``.

    Its sides are measured. The residuals say how far the clicks are from a rectangle.

    Args:
        corners: pixels in the order of a map seen from above: lower left, lower right, upper right, upper left.

    Raises: as `pose_from_points`; ValueError if the corners go clockwise.
    """
    pixels = np.asarray(corners, float).reshape(4, 2)
    met = _on_plane(plane, pixels, checked_intrinsics(intrinsics, "intrinsics"))
    across = np.cross(met[2] - met[0], met[3] - met[1]) @ plane.normal
    if across <= 0:
        raise ValueError("corners must go counter-clockwise: lower left, lower right, upper right, upper left")
    sides = np.linalg.norm(np.roll(met, -1, axis=0) - met, axis=1)
    half_x, half_y = (sides[0] + sides[2]) / 4, (sides[1] + sides[3]) / 4
    signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    places = [middle @ Pose2(float(half_x * x), float(half_y * y)) for x, y in signs]
    return pose_from_points(plane, pixels, np.array([[place.x, place.y] for place in places]), intrinsics)


def from_picture(plane: Plane, intrinsics: Matrix, size: tuple[int, int], middle: Pose2) -> TablePose:
    """A proposal without any click: the point in the picture's middle is ``middle``, and the picture's right is +x.

    Raises: as `pose_from_points`.
    """
    height, width = size
    return from_clicks(plane, (width / 2, height / 2), (0.6 * width, height / 2), intrinsics, middle)


def tag_points(rgb: np.ndarray, number: int, side: float, tag: Pose2) -> tuple[np.ndarray, np.ndarray]:
    """The corners of an AprilTag (36h11) that lies flat on the table: (4, 2) pixels and (4, 2) coordinates (m).

    Args:
        side: length (m) of the black square.
        tag: its middle on the table, and its yaw (0 if its upper edge points to +y).

    Raises:
        ValueError: there is no such tag.
        LocalisationError: the tag is not fully in the picture.
    """
    if not (0 < side < LARGEST_SIDE and 0 <= number < TAG_COUNT):
        raise ValueError(
            f"tag must be one of 0 to {TAG_COUNT - 1} with a side above 0 and below {LARGEST_SIDE} m, got tag {number} "
            f"with {side} m"
        )
    return tag_corners(rgb, number), _placed(CORNERS[:, :2] * side / TAG_SIDE, tag)


def board_points(
    rgb: np.ndarray, squares: tuple[int, int], square: float, marker: float, board: Pose2
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The inner corners of a ChArUco board with tags 36h11 that lies flat on the table: pixels and coordinates (m).

    Args:
        squares: how many squares the board has along x and along y.
        square, marker: the sides (m) of a square and of a tag in it.
        board: its lower left corner as printed, and its yaw (0 if its lower edge points to +x).

    Raises:
        ValueError: there is no such board.
        LocalisationError: fewer than four corners are in the picture.
    """
    columns, rows = squares
    enough = min(squares) >= 2 and (columns - 1) * (rows - 1) >= 4 and columns * rows // 2 <= TAG_COUNT
    if not (enough and 0 < marker < square < LARGEST_SIDE):
        raise ValueError(
            "board must have four inner corners or more, tags for all its white squares, and squares larger than its "
            f"tags, got {columns} x {rows} squares of {square} m with tags of {marker} m"
        )
    pattern = cv2.aruco.CharucoBoard(squares, square, marker, DICTIONARY)
    pixels, numbers, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(rgb)
    if pixels is None or len(pixels) < 4:
        seen = 0 if pixels is None else len(pixels)
        raise LocalisationError(
            f"the board shows {seen} of its corners, and four are needed: are its tags those of the family 36h11, and "
            "its squares as many as you say?"
        )
    local = np.array(pattern.getChessboardCorners(), float)[numbers.ravel(), :2]
    local[:, 1] = squares[1] * square - local[:, 1]  # OpenCV counts rows from the top.
    # For OpenCV's boards, the middle of the first pixel is (0, 0).
    return pixels.reshape(-1, 2).astype(float) + 0.5, _placed(local, board)


def level_planes(clouds: Sequence[np.ndarray], positions: Sequence[np.ndarray]) -> list[Plane]:
    """The planes that may be the table of a robot, in the frame of its base: the largest first.

    Args:
        clouds: of each camera, points (N, 3) in the base's frame (m).
        positions: of each camera, (3,) in the base's frame (m).

    Raises:
        ValueError: no plane is level within `UPRIGHT` degrees.
    """
    planes = find_planes(np.concatenate(list(clouds)), np.mean(positions, axis=0))
    level = [plane for plane in planes if tilt(plane.normal) <= UPRIGHT]
    if not level:
        seen = ", ".join(f"{tilt(plane.normal):.0f}" for plane in planes) or "none"
        raise ValueError(f"no plane is level within {UPRIGHT:.0f} degrees in the base's frame; tilts seen: {seen}")
    return level


def base_from_table(table: Plane) -> np.ndarray:
    """(4, 4): from the table's frame to that of a robot's base (m).

    The table's origin lies where the base's z axis meets it. Its x axis is the base's without the tilt.

    Args:
        table: in the base's frame.
    """
    turn, _ = Rotation.align_vectors(table.normal, (0, 0, 1))  # the shortest turn
    found = np.eye(4)
    found[:3, :3] = turn.as_matrix()
    found[2, 3] = -table.offset / table.normal[2]
    return found


def _placed(local: np.ndarray, frame: Pose2) -> np.ndarray:
    """Points (N, 2) of a thing that lies at a pose on the table, in the table's frame (m)."""
    cos, sin = math.cos(frame.yaw), math.sin(frame.yaw)
    return local @ np.array([[cos, sin], [-sin, cos]]) + [frame.x, frame.y]


def _on_plane(plane: Plane, pixels: np.ndarray, intrinsics: Matrix) -> np.ndarray:
    """(N, 3): the points of the plane at pixels, in the camera's axes. Raises ValueError if a pixel looks past it."""
    met = plane.met_by(np.zeros(3), rays(pixels, intrinsics))
    for (x, y), point in zip(pixels, met, strict=True):
        if not np.isfinite(point).all():
            raise ValueError(f"pixel ({x:g}, {y:g}) looks past the table: its ray never meets the plane")
    return met


def _coordinates(plane: Plane, met: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a plane in two axes of it: (N, 2), and these axes (2, 3), right-handed with the normal."""
    first = np.cross(plane.normal, np.eye(3)[np.abs(plane.normal).argmin()])
    first /= np.linalg.norm(first)
    basis = np.stack([first, np.cross(plane.normal, first)])
    return met @ basis.T, basis


def _complex(points: np.ndarray) -> np.ndarray:
    return points[:, 0] + 1j * points[:, 1]
