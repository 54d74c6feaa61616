"""What a robot needs beside an action: poses in three dimensions, how sure the policy is, the runner-up."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.actions import PickPlace
from gem_lite.policies.choosing import Choice
from gem_lite.rgbd.camera import checked_pose, checked_rotation
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, angle_bins

TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
"""The rotation of a tool whose z axis points down to the table and whose x axis is the table's, at yaw 0."""
SAME_PICK = 0.02
"""Picks at most this far (m) apart take the same thing."""
OTHER_PICK = 0.05
"""The runner-up is at least this far (m) from the pick."""
WANTED_ELSEWHERE = 0.3
"""A forbidden choice is reported from this probability on."""
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
        seen: the share of the table's cells that a camera saw.
        unseen_pick, unseen_place: the policy's probabilities of a pick, and of a place, where no camera saw. Both are
            forbidden there. If one is high, look from another side, or at a smaller rectangle.
    """

    pick: np.ndarray
    place: np.ndarray
    confidence: float
    runner_up: Pose2
    lead: float
    seen: float
    unseen_pick: float
    unseen_place: float

    def forbidden_in_words(self) -> list[str]:
        """A sentence for the pick, and one for the place, if the policy wanted another one where no camera saw."""
        return [
            f"with probability {chance:.2f}, the policy wanted another {part}, where no camera sees; this is forbidden"
            for part, chance in (("pick", self.unseen_pick), ("place", self.unseen_place))
            if chance >= WANTED_ELSEWHERE
        ]


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
    probabilities, places = (_probabilities(logits) for logits in (choice.pick_logits, choice.place_logits))  # (H, W)
    seen = choice.heightmap.seen
    elsewhere = np.where(distance >= OTHER_PICK, choice.pick_logits, -np.inf)
    angle, row, col = np.unravel_index(int(elsewhere.argmax()), elsewhere.shape)
    yaw = float(angle_bins(len(elsewhere))[angle])
    return RobotPlan(
        base @ pose_at(choice.action.pick, choice.heightmap, tool),
        base @ pose_at(choice.action.place, choice.heightmap, tool),
        float(probabilities[distance <= SAME_PICK].sum()),
        Pose2(float(x[row, col]), float(y[row, col]), yaw),
        math.exp(min(float(choice.pick_logits[choice.pick_cell] - elsewhere[angle, row, col]), LARGEST_LEAD)),
        float(seen.mean()),
        float(probabilities[~seen].sum()),
        float(places[~seen].sum()),
    )


def _probabilities(logits: np.ndarray) -> np.ndarray:
    """(H, W): the probability of each cell, whatever the angle, from logits (R, H, W)."""
    shares = np.exp(logits - logits.max())
    return shares.sum(axis=0) / shares.sum()


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
