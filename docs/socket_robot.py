"""A driver for a robot behind a socket, with the names of `gem_lite.simulation.effectors.Effector`. Copy and change it.

Each command is a line of JSON. The robot answers each with a line: "done", or the value of another `Outcome`.
"""

import json
import socket
from dataclasses import dataclass

import numpy as np

from gem_lite.actions import Outcome
from gem_lite.policies.robot_plan import pose_at
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2


@dataclass
class SocketRobot:
    """A dry run prints all commands and sends none. If an answer takes longer than ``timeout`` (s), the robot stops."""

    address: tuple[str, int]
    base_from_table: np.ndarray
    timeout: float = 10.0
    dry_run: bool = False
    held: float | None = None  # how high (m) above its lower side the robot holds a thing
    outcome: Outcome = Outcome.NOTHING_HELD

    def pick(self, pose: Pose2, heightmap: HeightMap) -> bool:
        """Grasp what lies at a pose. Returns whether something is held."""
        height = self._act("close", pose, heightmap, Outcome.HELD)
        self.held = height if self.outcome is Outcome.HELD else None
        return self.held is not None

    def place(self, pose: Pose2, heightmap: HeightMap) -> None:
        """Put the held thing on what lies at a pose."""
        self._act("open", pose, heightmap, Outcome.PLACED)
        self.held = None if self.outcome is Outcome.PLACED else self.held

    def stop(self) -> bool:
        """Stop at once: from any thread, over a connection of its own. Returns whether the robot confirms it."""
        return self.ask("stop") == "done"

    def _act(self, grip: str, pose: Pose2, heightmap: HeightMap, success: Outcome) -> float:
        answer = Outcome.OUT_OF_REACH.value
        height = 0.0
        if heightmap.workspace.contains(pose.x, pose.y):
            table_pose = pose_at(pose, heightmap)
            height = float(table_pose[2, 3])
            for command, above in (("move", 0.2), ("move", 0.0), (grip, 0.0), ("move", 0.2)):  # m
                table_pose[2, 3] = height + (self.held or 0.0) + above
                answer = self.ask(command, self.base_from_table @ table_pose)
                if answer != "done":
                    self.stop()
                    break
        self.outcome = success if answer == "done" else Outcome(answer)
        return height

    def ask(self, command: str, pose: np.ndarray | None = None) -> str:
        """The answer to a command; to an unknown answer or none, "no answer"."""
        line = json.dumps({"do": command, "pose": None if pose is None else pose.round(4).tolist()})
        if self.dry_run:
            print(line)
            return "done"
        try:
            with socket.create_connection(self.address, self.timeout) as link, link.makefile("rw") as stream:
                print(line, file=stream, flush=True)
                answer = stream.readline().strip()
        except OSError:  # Nobody listens, or there is no answer in time.
            answer = ""
        return answer if answer in {"done", *(outcome.value for outcome in Outcome)} else Outcome.NO_ANSWER.value
