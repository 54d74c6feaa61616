"""Small errors of poses that a flat table shows, and their correction.

The table is flat and lies at z = 0 (`camera_check` uses the same). A view whose pose is a little wrong sees it tilted,
or too high. So a plane is fitted to what the view shows near z = 0. Then the camera is turned about its own centre and
lifted, until the plane is the table. Of the six numbers of a pose this corrects three: two tilts and the height. A turn
about the vertical and a shift along the table leave the table where it is, so nothing shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.camera import View, as_pose
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Workspace

REACH = 0.06
"""A point at most this far (m) from z = 0 may be one of the table."""
BANDS = (0.03, 0.015, 0.008, 0.008)
"""See `plane`."""


def levelled(observation: Observation, workspace: Workspace) -> Observation:
    """The observation with the poses corrected so that every view sees the table level and at z = 0.

    It is for errors of a few degrees and centimetres. For larger ones see `gem_lite.rgbd.camera_check`. Most of the
    points that a view shows near z = 0 should be the table's; with fewer than 500 it keeps its pose.
    """
    return Observation(tuple(_levelled(view, workspace) for view in observation.views))


def _levelled(view: View, workspace: Workspace) -> View:
    points = view.points().reshape(-1, 3)
    measured = view.depth.reshape(-1) > 0
    x, y, z = points.T
    near = points[workspace.contains(x, y) & (np.abs(z) < REACH) & measured]
    near = near[:: max(1, len(near) // 20_000)].astype(np.float64)  # About as many points are enough.
    if len(near) < 500:
        return view
    slope_x, slope_y, height = plane(near)
    turn, _ = Rotation.align_vectors((0, 0, 1), (-slope_x, -slope_y, 1))  # the shortest: it makes the normal vertical
    position = view.camera.position
    below = np.array([position[0], position[1], slope_x * position[0] + slope_y * position[1] + height])
    # After the turn about the camera's centre, the plane is level, at the height of this point of it.
    level = turn.apply(below - position)[2] + position[2]
    pose = as_pose(turn.as_matrix() @ view.camera.rotation, position - [0.0, 0.0, level])
    return replace(view, camera=replace(view.camera, pose=pose))


def plane(points: np.ndarray, bands: Sequence[float] = BANDS) -> tuple[float, float, float]:
    """The plane z = a x + b y + c that most of the points (N, 3) lie near: (a, b, c).

    It begins with the level plane at the points' median height, and is fitted again and again to the points that are
    near it: once for each of the ``bands``, a distance in metres.
    """
    coefficients = np.array([0.0, 0.0, float(np.median(points[:, 2]))])
    design = np.column_stack([points[:, :2], np.ones(len(points))])
    for band in bands:
        close = np.abs(points[:, 2] - design @ coefficients) < band
        if close.sum() < 3:
            break
        coefficients = np.linalg.lstsq(design[close], points[close, 2], rcond=None)[0]
    a, b, c = coefficients.tolist()
    return a, b, c
