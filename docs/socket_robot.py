"""A driver for a robot behind a socket. Copy it and change it.

To a line of JSON the robot answers "done", "nothing held", "out of reach" or "dropped"; to a stop also while it moves.
"""

import json
import socket
import threading

import numpy as np

from gem_lite.actions import Outcome
from gem_lite.policies.robot_plan import pose_at
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2

ABOVE, DEPTH, LOWEST = 0.2, 0.012, 0.002  # m: over a pose it travels; below a top it grasps; but not below this


class SocketRobot:
    """In a dry run, nothing is sent. Without an answer in ``timeout`` (s), the robot is told to stop."""

    def __init__(self, address: tuple[str, int], base_from_table: np.ndarray, timeout: float = 10.0) -> None:
        self.address, self.base_from_table, self.timeout, self.dry_run = address, base_from_table, timeout, False
        self.outcome, self.stopped, self.height = Outcome.NOTHING_HELD, threading.Event(), 0.0
        self.held: float | None = None  # the height (m) of the grasp: the tool lets go so far above a surface

    def pick(self, pose: Pose2, heightmap: HeightMap) -> bool:
        """Grasp what lies at a pose, unless something is held already. Returns whether something is held."""
        if self.held is None:
            self.outcome = self._act(("open", "above", "down", "close", "above"), pose, heightmap, -DEPTH, Outcome.HELD)
            self.held = self.height if self.outcome is Outcome.HELD else None
        return self.held is not None

    def place(self, pose: Pose2, heightmap: HeightMap) -> None:
        """Put the held thing on what lies at a pose."""
        if self.held is not None:
            self.outcome = self._act(("above", "down", "open", "above"), pose, heightmap, self.held, Outcome.PLACED)
            self.held = self.held if self.outcome is Outcome.OUT_OF_REACH else None

    def stop(self) -> bool:
        """Stop, from any thread. Nothing more is sent until ``stopped.clear()``. Returns whether the robot confirms."""
        self.stopped.set()
        return self._ask({"do": "stop"}) == "done"

    def _act(self, steps: tuple, pose: Pose2, heightmap: HeightMap, lift: float, success: Outcome) -> Outcome:
        if not heightmap.workspace.contains(pose.x, pose.y):
            return Outcome.OUT_OF_REACH
        target = pose_at(pose, heightmap)
        self.height = max(LOWEST, float(target[2, 3]) + lift)
        for step in steps:
            target[2, 3] = self.height + ABOVE * (step == "above")
            answer = self._ask({"do": step, "pose": (self.base_from_table @ target).round(4).tolist()})
            if step == "close" and answer == "nothing held":
                self._act(("open", "above"), pose, heightmap, lift, success)
            elif answer == "no answer":
                self.stop()
            if answer != "done":
                return Outcome(answer)
        return success

    def _ask(self, command: dict) -> str:
        if self.stopped.is_set() and command["do"] != "stop":
            return "stopped"
        if self.dry_run:
            print(json.dumps(command))
            return "done"
        try:
            with socket.create_connection(self.address, self.timeout) as link, link.makefile("rw") as stream:
                print(json.dumps(command), file=stream, flush=True)
                answer = stream.readline().strip()
        except (OSError, ValueError):  # Nobody listens, there is no answer in time, or it is no text.
            answer = ""
        return answer if answer in {"done", "nothing held", "out of reach", "dropped"} else "no answer"
