"""Mistakes that are often made with cameras, and what undoes each: `gem_lite.rgbd.camera_check` tries them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.observation import RawView

PIXELS = 12_000
"""About as many pixels of a view are looked at."""
MILLIMETRES = 1000.0
LARGEST_TILT = 8.0
"""A smaller turn (degrees) is a matter of calibration."""


@dataclass(frozen=True)
class Cloud:
    """Some measured pixels of a view as points (N, 3) in the camera's axes, and the camera's pose (4, 4)."""

    local: np.ndarray
    pose: np.ndarray

    @property
    def points(self) -> np.ndarray:
        """(N, 3): in the table's frame (m)."""
        return self.local @ self.pose[:3, :3].T + self.pose[:3, 3]

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): of the pose."""
        return self.pose[:3, :3]

    def with_rotation(self, rotation: np.ndarray) -> Cloud:
        """The same with another (3, 3) rotation of the pose."""
        pose = self.pose.copy()
        pose[:3, :3] = rotation
        return Cloud(self.local, pose)


def cloud(view: RawView) -> Cloud:
    """The points of a view. If depth has another size than colour, the intrinsics are scaled to it."""
    height, width = view.depth.shape
    step = max(1, round(math.sqrt(view.depth.size / PIXELS)))
    x, y = np.meshgrid(np.arange(0, width, step) + 0.5, np.arange(0, height, step) + 0.5)
    shares = np.array([view.rgb.shape[1] / width, view.rgb.shape[0] / height])
    pixels = np.stack([x * shares[0], y * shares[1], np.ones_like(x)], axis=-1)
    depth = view.depth[::step, ::step]
    local = pixels @ np.linalg.inv(np.array(view.intrinsics)).T * depth[..., None]
    return Cloud(local[depth > 0], np.array(view.pose))


Correction = Callable[[Cloud], Iterator[Cloud]]
"""From a cloud to the clouds that it may have been before a mistake."""


def inverted_pose(given: Cloud) -> Iterator[Cloud]:
    """The pose was given from the table to the camera."""
    yield Cloud(given.local, np.linalg.inv(given.pose))


def flipped_axes(given: Cloud) -> Iterator[Cloud]:
    """The camera's axes point the other way, such as OpenGL's (y up, z backwards)."""
    for signs in itertools.product((1, -1), repeat=3):
        if signs != (1, 1, 1):
            yield given.with_rotation(given.rotation @ np.diag(signs))


def swapped_axes(given: Cloud) -> Iterator[Cloud]:
    """The camera's axes come in another order, and may be flipped, too."""
    for order in itertools.permutations(range(3)):
        if order == (0, 1, 2):
            continue
        for signs in itertools.product((1, -1), repeat=3):
            yield given.with_rotation(given.rotation @ (np.eye(3)[list(order)] * signs))


def pose_in_millimetres(given: Cloud) -> Iterator[Cloud]:
    """The position was given in millimetres."""
    pose = given.pose.copy()
    pose[:3, 3] /= MILLIMETRES
    yield Cloud(given.local, pose)


def depth_along_ray(given: Cloud) -> Iterator[Cloud]:
    """The depth was measured along each pixel's ray instead of along the camera's axis."""
    distances = np.linalg.norm(given.local, axis=1, keepdims=True)
    yield Cloud(given.local * (given.local[:, 2:] / distances), given.pose)


def degrees_for_radians(given: Cloud) -> Iterator[Cloud]:
    """The rotation was made from a rotation vector in degrees that was read as radians.

    A turn by θ became one by 180 θ / π. From it, θ is known up to multiples of a full turn.
    """
    if np.linalg.det(given.rotation) < 0:
        return
    vector = Rotation.from_matrix(given.rotation).as_rotvec()
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 1e-9 else np.array([0.0, 0.0, 1.0])
    for turns in range(-30, 31):
        true = math.radians(angle + 2 * math.pi * turns)
        changed = abs(true - angle) > math.radians(LARGEST_TILT)  # a smaller change is one of calibration
        if abs(true) <= math.pi and changed:
            yield given.with_rotation(Rotation.from_rotvec(true * axis).as_matrix())


def quaternion_in_another_order(given: Cloud) -> Iterator[Cloud]:
    """The rotation was made from a quaternion whose w was read as x, or the reverse."""
    if np.linalg.det(given.rotation) < 0:
        return
    quaternion = Rotation.from_matrix(given.rotation).as_quat()
    for shift in (1, -1):
        yield given.with_rotation(Rotation.from_quat(np.roll(quaternion, shift)).as_matrix())


def depth_scaled(given: Cloud) -> Iterator[Cloud]:
    """The scale of the depth is wrong by some factor: the one that brings most points to the table."""
    yield Cloud(given.local * depth_factor(given), given.pose)


def depth_factor(given: Cloud) -> float:
    """By how much to multiply depth so that most points lie at z = 0; 1 if no factor does."""
    fall = -(given.local @ given.pose[2, :3])
    factors = np.log(given.pose[2, 3] / fall[fall > 0]) if given.pose[2, 3] > 0 else np.zeros(0)
    if not len(factors):
        return 1.0
    counts, edges = np.histogram(factors, np.arange(factors.min() - 0.02, factors.max() + 0.04, 0.02))
    highest = int(counts.argmax())
    near = (factors >= edges[highest]) & (factors <= edges[highest + 1])
    return float(np.exp(np.median(factors[near])))


CORRECTIONS: dict[str, tuple[Correction, str]] = {
    "inverse pose": (inverted_pose, "the pose is inverted: it must lead from the camera's axes to the table's frame"),
    "axes flipped": (
        flipped_axes, "the camera's axes are flipped: x must point to the right, y down and z forward (OpenGL's y "
        "and z point the other way)",
    ),
    "axes swapped": (
        swapped_axes, "the camera's axes come in another order: x must point to the right, y down and z forward",
    ),
    "millimetres (pose)": (pose_in_millimetres, "the position in the pose is in millimetres: it must be in metres"),
    "depth scale": (depth_scaled, "depth_scale is wrong"),
    "quaternion order": (
        quaternion_in_another_order,
        "the rotation was made from a quaternion in another order: is w the first or the last number?",
    ),
    "depth along the ray": (
        depth_along_ray, "depth is the distance along each pixel's ray: it must be that along the camera's axis",
    ),
    "degrees for radians": (
        degrees_for_radians, "the pose's rotation was made from degrees that were read as radians",
    ),
}  # fmt: skip
"""By the name of a mistake: what undoes it, and what it is."""
