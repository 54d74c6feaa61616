"""The bridge for environments that speak CLIPort's dictionaries. Copy it into your program.

    choice = policy.decide(from_cliport(observation, cameras), read_cliport(sentence), empty_picks)
    action = to_cliport(choice.action, choice.heightmap)

Four things differ there. CLIPort names the holes of a kit in another frame, and two corners of the rope's guide in
another order than our demonstrations; `read_cliport` says them in our words. CLIPort's poses have a height, so
`to_cliport` needs the height map, and only `decide` gives it. CLIPort's blade stops 5 cm before the second pose of a
push, so `to_cliport` moves that pose on by 5 cm. And CLIPort does not return its log of grasps: the caller has to keep
the ``empty_picks`` of `Policy.act`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.actions import Action, PickPlace
from gem_lite.rgbd.camera import as_pose
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, quaternion

CLIPORT_STOPS_BEFORE = 0.05
"""CLIPort's blade stops this far (m) before the second pose of a push."""
HOLES = {"top": "left", "bottom": "right", "left": "bottom", "right": "top"}
"""CLIPort's word for the place of a hole, and ours: there, top is towards smaller x and left towards smaller y."""


def from_cliport(observation: Mapping[str, Sequence[np.ndarray]], cameras: Sequence[Mapping[str, Any]]) -> Observation:
    """CLIPort's observation as ours.

    Args:
        observation: "color", (H, W, 3) uint8 for each camera, and "depth", (H, W) metres along the camera's axis.
        cameras: CLIPort's configurations, with "intrinsics" (9 numbers), "position" (m) and "rotation", the quaternion
            (x, y, z, w) of length 1 from the camera's axes to the world.

    Raises:
        ValueError: a configuration lacks an entry or has a wrong one; or see `Observation.from_arrays`.
    """
    intrinsics = []
    poses = []
    for number, camera in enumerate(cameras):
        matrix, position, rotation = (
            _numbers(camera, key, count, number) for key, count in (("intrinsics", 9), ("position", 3), ("rotation", 4))
        )
        if abs(np.linalg.norm(rotation) - 1) > 1e-3:
            raise ValueError(f"rotation of camera {number} must be a quaternion of length 1, got {rotation.tolist()}")
        intrinsics.append(matrix.reshape(3, 3))
        poses.append(np.array(as_pose(Rotation.from_quat(rotation).as_matrix(), position.tolist())))
    colors = [np.asarray(color)[..., :3] for color in observation["color"]]
    return Observation.from_arrays(colors, observation["depth"], intrinsics, poses)


def read_cliport(sentence: str) -> str:
    """A sentence of CLIPort, with the words that our demonstrations use for the same places; others stay as they are.

    Holes of a kit have other words (`HOLES`). The rope's two ends are alike, so the order of two corners says nothing.
    """
    sentence = re.sub(r"(?<= in the )(top|bottom|left|right)(?= .* hole$)", lambda word: HOLES[word[0]], sentence)
    return sentence.replace("back right corner to back left corner", "back left corner to back right corner")


def _numbers(camera: Mapping[str, Any], key: str, count: int, number: int) -> np.ndarray:
    """An entry of a camera's configuration, as finite numbers."""
    try:
        values = np.asarray(camera[key], float).ravel()
    except (KeyError, TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"{key} of camera {number} must be {count} finite numbers, got {camera.get(key)!r:.200}")
    return values


def to_cliport(action: Action, heightmap: HeightMap) -> dict[str, tuple]:
    """An action as CLIPort's pair of poses: "pose0" and "pose1", each a position (m) and a quaternion (x, y, z, w).

    CLIPort's tool picks at yaw 0, and the place's yaw is the turn of the thing. A push ends where the action says: its
    second pose lies `CLIPORT_STOPS_BEFORE` further, and CLIPort turns the blade itself. World coordinates are the same
    in both; only the rows of CLIPort's own height maps grow the other way.

    Args:
        heightmap: of the observation, from `Policy.decide`; it gives the heights of the positions.

    Raises:
        ValueError: a pose lies outside the map, or a push ends where it starts.
    """

    def position(pose: Pose2) -> tuple[float, float, float]:
        row, col = heightmap.workspace.nearest_cell(pose.x, pose.y)
        return pose.x, pose.y, float(heightmap.height[row, col])

    if isinstance(action, PickPlace):
        return {
            "pose0": (position(action.pick), quaternion(0.0)),
            "pose1": (position(action.place), quaternion(action.delta)),
        }
    start, end = np.array(position(action.start)), np.array(position(action.end))
    path = (end - start) * (1, 1, 0)
    if not path.any():
        raise ValueError(f"a push must end elsewhere than it starts, got {action}")
    beyond = end + CLIPORT_STOPS_BEFORE * path / np.linalg.norm(path)
    return {"pose0": (tuple(start.tolist()), quaternion(0.0)), "pose1": (tuple(beyond.tolist()), quaternion(0.0))}
