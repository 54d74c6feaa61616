"""What a robot's own program needs beside an action: poses in three dimensions, how sure the policy is, the runner-up.

Also the bridge for environments that speak CLIPort's dictionaries, `from_cliport` and `to_cliport`::

    choice = policy.decide(from_cliport(observation, cameras), sentence, empty_picks)
    action = to_cliport(choice.action, choice.heightmap)

Three things differ there. CLIPort's poses have a height, so `to_cliport` needs the height map, and only `decide` gives
it. CLIPort's blade stops 5 cm before the second pose of a push, so `to_cliport` moves that pose on by 5 cm. And CLIPort
does not return its log of grasps: the caller has to keep the ``empty_picks`` of `Policy.act`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.actions import Action, PickPlace
from gem_lite.foundations.files import as_number
from gem_lite.policies.choosing import Choice
from gem_lite.rgbd.camera import as_pose, checked_pose, checked_rotation
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins, quaternion

TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
"""The rotation of a tool whose z axis points down to the table and whose x axis is the table's, at yaw 0."""
SAME_PICK = 0.02
"""Picks at most this far (m) apart take the same thing."""
OTHER_PICK = 0.05
"""The runner-up is at least this far (m) from the pick."""
CLIPORT_STOPS_BEFORE = 0.05
"""CLIPort's blade stops this far (m) before the second pose of a push."""
LARGEST_LEAD = 700.0
"""A larger difference of logits is cut, since its exponential is no number."""


@dataclass(frozen=True)
class RobotPlan:
    """A pick and a place for a robot.

    Attributes:
        pick, place: (4, 4), the tool's poses in the base's frame (m). The height is that of the map: of the top surface
            at the pick, and of what is below the thing at the place.
        confidence: the policy's probability, in [0, 1], of a pick at most `SAME_PICK` from the chosen one, before the
            rules that forbid picks.
        runner_up: the most probable pick that is at least `OTHER_PICK` away, in the table's frame.
        lead: how many times as probable the pick is as the runner-up. Below 1, a rule forbade the runner-up: a pick
            must lie near the peak of its map, and away from empty picks.
    """

    pick: np.ndarray
    place: np.ndarray
    confidence: float
    runner_up: Pose2
    lead: float


def plan(choice: Choice, base_from_table: np.ndarray | None = None, tool: np.ndarray = TOOL_DOWN) -> RobotPlan:
    """The plan for a choice of `Policy.decide`.

    Args:
        base_from_table: (4, 4), from the table's frame to the base's (m); by default they are the same.
        tool: (3, 3), the tool's rotation on the table at yaw 0.

    Raises:
        ValueError: the choice is a push; ``base_from_table`` is no pose, or ``tool`` no rotation; a reflection is none.
    """
    if not isinstance(choice.action, PickPlace):
        raise ValueError(f"the choice must be a pick and place, got {choice.action}")
    base = np.eye(4) if base_from_table is None else checked_pose(base_from_table, "base_from_table")
    workspace = choice.heightmap.workspace
    rows, cols = np.indices(workspace.shape)
    x, y = workspace.to_world(rows, cols)
    distance = np.hypot(x - choice.action.pick.x, y - choice.action.pick.y)
    probabilities = np.exp(choice.pick_logits - choice.pick_logits.max())  # (R, H, W), not normalised
    elsewhere = np.where(distance >= OTHER_PICK, choice.pick_logits, -np.inf)
    angle, row, col = np.unravel_index(int(elsewhere.argmax()), elsewhere.shape)
    yaw = float(angle_bins(len(elsewhere))[angle])
    return RobotPlan(
        base @ pose_at(choice.action.pick, choice.heightmap, tool),
        base @ pose_at(choice.action.place, choice.heightmap, tool),
        float(probabilities[:, distance <= SAME_PICK].sum() / probabilities.sum()),
        Pose2(float(x[row, col]), float(y[row, col]), yaw),
        math.exp(min(float(choice.pick_logits[choice.pick_cell] - elsewhere[angle, row, col]), LARGEST_LEAD)),
    )


def pose_at(pose: Pose2, heightmap: HeightMap, tool: np.ndarray = TOOL_DOWN) -> np.ndarray:
    """(4, 4): a tool's pose in the table's frame, at the height (m) of the map below it.

    Raises:
        ValueError: ``pose`` lies outside the map, or ``tool`` is no rotation.
    """
    row, col = heightmap.workspace.nearest_cell(pose.x, pose.y)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("z", pose.yaw).as_matrix() @ checked_rotation(tool, "tool")
    matrix[:3, 3] = pose.x, pose.y, heightmap.height[row, col]
    return matrix


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


def _numbers(camera: Mapping[str, Any], key: str, count: int, number: int) -> np.ndarray:
    """An entry of a camera's configuration, as finite numbers."""
    try:
        values = np.asarray([as_number(value) for value in np.ravel(camera[key]).tolist()], float)
    except (KeyError, ValueError):
        values = np.empty(0)
    if len(values) != count:
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
