"""Errors of poses that a flat table shows, and their correction.

The table is flat and lies at z = 0 (`camera_check` uses the same). A view whose pose is a little wrong sees it tilted,
or too high. So the table's plane is found in what the view shows (`planes`). Then the camera is turned about its own
centre and lifted, until the plane is the table. Of the six numbers of a pose this corrects three: two tilts and the
height. A turn about the vertical and a shift along the table leave the table where it is, so nothing shows them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.camera import View, as_pose
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.planes import find_planes, tilt

LARGEST_TILT = 15.0
"""A plane that is tilted more (degrees) is not taken for the table."""
LARGEST_LIFT = 0.2
"""A plane whose seen part lies farther from z = 0 (m) is not taken for the table."""
POINTS = 20_000
"""About as many points of a view are enough."""


def levelled(observation: Observation) -> Observation:
    """The observation with the poses corrected so that every view sees the table level and at z = 0.

    It is for errors of some degrees and centimetres: the plane nearest to z = 0 is taken for the table. For others
    see `gem_lite.rgbd.camera_check`.

    Raises:
        ValueError: a view shows no plane near z = 0. The message says which planes it shows.
    """
    return Observation(tuple(_levelled(view) for view in observation.views))


def _levelled(view: View) -> View:
    points = view.points()[view.depth > 0]
    points = points[:: max(1, len(points) // POINTS)].astype(np.float64)
    position = view.camera.position
    planes = find_planes(points, position) if len(points) else []
    heights = [float(plane.middle(points)[2]) for plane in planes]
    tables = [
        (abs(height), number)
        for number, (plane, height) in enumerate(zip(planes, heights, strict=True))
        if tilt(plane.normal) <= LARGEST_TILT and abs(height) <= LARGEST_LIFT
    ]
    if not tables:
        pairs = zip(planes, heights, strict=True)
        seen = [f"tilted by {tilt(plane.normal):.0f} degrees and {1000 * z:.0f} mm from z = 0" for plane, z in pairs]
        shown = "; ".join(seen) or "none at all"
        raise ValueError(f"camera {view.camera.name!r} shows no table near z = 0; the planes that it shows: {shown}")
    plane = planes[min(tables)[1]]
    turn, _ = Rotation.align_vectors((0, 0, 1), plane.normal)  # the shortest: it makes the normal vertical
    # After the turn about the camera's centre, the plane is level, as far below the camera as before.
    pose = as_pose(turn.as_matrix() @ view.camera.rotation, [*position[:2].tolist(), float(plane.height(position))])
    return replace(view, camera=replace(view.camera, pose=pose))
