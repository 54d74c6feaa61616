"""A floating body that a constraint moves: the motion of every tool. The tools' actions are in `effectors`.

Time is counted in simulation steps.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np
import pybullet as p

from gem_lite.actions import GripperState
from gem_lite.se2 import Pose2, quaternion, wrap

RATE = 240
"""Simulation steps per second."""
PARKED = (0.0, 0.0, 0.6)
"""The position (m) where the tool of a single table waits: no camera sees it there."""
CLEARANCE = 0.2
"""Height (m) at which the tool travels."""
STRIDE = 0.003
"""Metres per simulation step. With a larger stride, the tool lags behind its target by centimetres."""
TURN = 0.03
"""Radians per simulation step."""
FORCE = 200.0
LOG_EVERY = 8
"""Simulation steps between two states in the log: 30 a second."""
Log = Callable[[GripperState], None]
"""Called with a state of a gripper."""


class FloatingTool(ABC):
    """A body that a strong constraint pulls to its target pose.

    Attributes:
        reach: the distance (m) from the tool's centre down to its lower end.
        id: the id of its body.
        held: the id of the body that it carries, or None.
        travel_height: height (m) at which it travels now.
        stride: metres per simulation step at which it travels now.

    Args:
        client: the physics client.
        parked: the position (m) where it waits.
        log: called with its state during its motions, every `LOG_EVERY` simulation steps.
    """

    reach: ClassVar[float]

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None:
        self._client = client
        self._parked = parked
        self._log = log
        self.id = p.createMultiBody(0.5, *self.make_shapes(client), parked, physicsClientId=client)
        self._drive = p.createConstraint(
            self.id, -1, -1, -1, p.JOINT_FIXED, (0, 0, 0), (0, 0, 0), parked, physicsClientId=client
        )
        self._target = np.array(parked)
        self._yaw = 0.0
        self.held: int | None = None
        self.travel_height = CLEARANCE
        self.stride = STRIDE
        self._clock = 0

    @staticmethod
    @abstractmethod
    def make_shapes(client: int) -> tuple[int, int]:
        """The tool's collision shape and visual shape, centred on the tool."""

    @property
    def yaw(self) -> float:
        """The tool's yaw in the world (radians)."""
        return planar(self._client, self.id).yaw

    def carry(self, pose: Pose2) -> None:
        """Travel above ``pose``, with the held body if there is one."""
        self._rise()
        # The shorter of the two turns; the tool turns while it travels.
        yaw = self._yaw + wrap(pose.yaw - self._yaw)
        self._move(np.array([pose.x, pose.y, self.travel_height]), yaw, self.stride)

    def park(self) -> None:
        """Leave the view of the cameras."""
        self._move(np.array(self._parked), 0.0)

    def _touching(self, body: int, without: set[int]) -> set[int]:
        contacts = p.getContactPoints(bodyA=body, physicsClientId=self._client)
        other_body, distance = 2, 8  # PyBullet's places in a contact
        return {contact[other_body] for contact in contacts if contact[distance] <= 0} - without

    def _rise(self) -> None:
        self._move(np.array([*self._target[:2], self.travel_height]), self._yaw, self.stride)

    def _descend(self, touching: Callable[[], set[int]], above: float = 0.0) -> set[int]:
        """Go down in strides of 1 mm until the tool touches a body or its lower end is ``above`` (m) the table.

        Returns:
            The ids of the bodies that it touches, from ``touching()``.
        """
        touched = touching()
        while not touched and self._target[2] > self.reach + above:
            self._advance(self._target - [0, 0, 0.001], self._yaw)
            touched = touching()
        return touched

    def _move(self, goal: np.ndarray, yaw: float, stride: float = STRIDE) -> None:
        steps = max(float(np.linalg.norm(goal - self._target)) / stride, abs(yaw - self._yaw) / TURN)
        for _ in range(math.ceil(steps) + 1):
            path = goal - self._target
            turn = yaw - self._yaw
            distance = np.linalg.norm(path)
            if distance < 1e-6 and abs(turn) < 1e-6:
                break
            step = path * min(1.0, stride / max(distance, 1e-9))
            self._advance(self._target + step, self._yaw + float(np.clip(turn, -TURN, TURN)))
        for _ in range(10):
            self._simulate()

    def _advance(self, target: np.ndarray, yaw: float) -> None:
        self._target = target
        self._yaw = yaw
        p.changeConstraint(
            self._drive, target.tolist(), jointChildFrameOrientation=quaternion(yaw), maxForce=FORCE,
            physicsClientId=self._client,
        )  # fmt: skip
        self._simulate()

    def _simulate(self) -> None:
        p.stepSimulation(physicsClientId=self._client)
        self._clock += 1
        if self._clock % LOG_EVERY == 0:
            pose = planar(self._client, self.id)
            self._log(GripperState(pose.x, pose.y, pose.yaw, self.held is not None))


def planar(client: int, body: int) -> Pose2:
    """The pose of a body, seen from above."""
    (x, y, _), turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
    return Pose2(x, y, p.getEulerFromQuaternion(turn)[2])
