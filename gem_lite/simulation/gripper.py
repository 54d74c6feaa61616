"""A floating tool, driven by a constraint: it collides, and really carries what it holds.

By default it is a suction cup, which holds whatever its tip touches, at any yaw. As a parallel *jaw* it
holds a bar only if it closes across it. The two fingers, which are not modelled, close along the tool's y
axis: at yaw 0 they come from -y and +y of the world, and the jaw's yaw is that of a bar which it grasps
squarely (half a turn more is the same grasp).

All motions are counted in simulation steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pybullet as p

from gem_lite.demonstrations import GripperState
from gem_lite.se2 import Pose2, quaternion, wrap

TIP_RADIUS, TIP_LENGTH = 0.005, 0.03
PARKED = (0.0, 0.0, 0.6)
"""Where the tool of a single table waits (m): outside every camera's line of sight to the table."""
CLEARANCE = 0.2
"""Height (m) at which the tool travels."""
STRIDE = 0.003
"""Metres per simulation step: faster, and the constraint lags behind by centimetres."""
TURN = 0.03
"""Radians per simulation step."""
JAW_ANGLE = np.radians(20)
"""A jaw turned further (radians) from a bar's yaw slips off it."""
JAW_REACH = 1 / 6
"""A jaw grasps the middle third of a bar: at most this share of its length off its centre."""
FORCE = 200.0
LOG_EVERY = 8
"""Simulation steps between two states in the log: 30 a second."""


class Gripper:
    """The tool of one world.

    ``jaw`` tells whether it grasps as a parallel jaw does, see above; ``held`` is the id of the body it
    carries, or None; ``trace`` the states it went through since its owner last cleared it, one every
    `LOG_EVERY` simulation steps of a motion.
    """

    def __init__(self, client: int, parked: tuple[float, float, float] = PARKED) -> None:
        self._client, self._parked = client, parked
        shape = dict(radius=TIP_RADIUS, physicsClientId=client)
        collision = p.createCollisionShape(p.GEOM_CYLINDER, height=TIP_LENGTH, **shape)
        visual = p.createVisualShape(p.GEOM_CYLINDER, length=TIP_LENGTH, rgbaColor=(0.1, 0.1, 0.1, 1), **shape)
        self.id = p.createMultiBody(0.5, collision, visual, parked, physicsClientId=client)
        self._drive = p.createConstraint(
            self.id, -1, -1, -1, p.JOINT_FIXED, (0, 0, 0), (0, 0, 0), parked, physicsClientId=client
        )
        self._target, self._yaw = np.array(parked), 0.0
        self._suction: int | None = None
        self.jaw = False
        self.held: int | None = None
        self.trace: list[GripperState] = []
        self._clock = 0

    @property
    def yaw(self) -> float:
        """The tool's yaw in the world (radians)."""
        return _planar(self._client, self.id).yaw

    def pick(self, pose: Pose2, movable: set[int]) -> bool:
        """Reach above ``pose``, go down until the tip touches, grasp, lift. True if something is held."""
        self._travel(pose)
        touched = self._descend(lambda: self._touching(self.id, without=set()))
        for body in touched & movable:
            if not self.jaw or self._closes_across(body):
                self._attach(body)
                break
        self._rise()
        return self.held is not None

    def carry(self, pose: Pose2) -> None:
        """Travel above ``pose`` with what is held."""
        self._travel(pose)

    def place(self, pose: Pose2) -> None:
        """Carry what is held above ``pose``, go down until it touches something, let go, rise."""
        self._travel(pose)
        self._descend(lambda: self._touching(self.held, without={self.id}))
        self._release()
        self._rise()

    def park(self) -> None:
        """Let go of everything and leave the cameras' sight."""
        self._release()
        self._move(np.array(self._parked), 0.0)

    def _closes_across(self, body: int) -> bool:
        """Whether a jaw where the tool is would hold a bar: a box that is longest along its own x."""
        length = p.getCollisionShapeData(body, -1, physicsClientId=self._client)[0][3][0]
        bar, tool = (_planar(self._client, one) for one in (body, self.id))
        off = bar.inverse() @ tool
        return abs(wrap(2 * off.yaw) / 2) <= JAW_ANGLE and abs(off.x) <= JAW_REACH * length

    def _attach(self, body: int) -> None:
        tip = p.getBasePositionAndOrientation(self.id, physicsClientId=self._client)
        thing = p.getBasePositionAndOrientation(body, physicsClientId=self._client)
        position, turn = p.multiplyTransforms(*p.invertTransform(*tip), *thing)
        self._suction = p.createConstraint(
            self.id, -1, body, -1, p.JOINT_FIXED, (0, 0, 0), position, (0, 0, 0), turn, physicsClientId=self._client
        )
        p.changeConstraint(self._suction, maxForce=50, physicsClientId=self._client)
        self.held = body

    def _release(self) -> None:
        if self._suction is not None:
            p.removeConstraint(self._suction, physicsClientId=self._client)
        self._suction = self.held = None

    def _touching(self, body: int, without: set[int]) -> set[int]:
        contacts = p.getContactPoints(bodyA=body, physicsClientId=self._client)
        return {c[2] for c in contacts if c[8] <= 0} - without

    def _travel(self, pose: Pose2) -> None:
        self._rise()
        # The shorter way round; the tool turns while it travels.
        yaw = self._yaw + wrap(pose.yaw - self._yaw)
        self._move(np.array([pose.x, pose.y, CLEARANCE]), yaw)

    def _rise(self) -> None:
        self._move(np.array([*self._target[:2], CLEARANCE]), self._yaw)

    def _descend(self, touching: Callable[[], set[int]]) -> set[int]:
        """Down in 1 mm strides until ``touching()`` names a body or the tip is on the table."""
        while not (found := touching()) and self._target[2] > TIP_LENGTH / 2:
            self._advance(self._target - [0, 0, 0.001], self._yaw)
        return found

    def _move(self, goal: np.ndarray, yaw: float) -> None:
        away = max(float(np.linalg.norm(goal - self._target)) / STRIDE, abs(yaw - self._yaw) / TURN)
        for _ in range(math.ceil(away) + 1):
            rest, turn = goal - self._target, yaw - self._yaw
            distance = np.linalg.norm(rest)
            if distance < 1e-6 and abs(turn) < 1e-6:
                break
            step = rest * min(1.0, STRIDE / max(distance, 1e-9))
            self._advance(self._target + step, self._yaw + float(np.clip(turn, -TURN, TURN)))
        for _ in range(10):
            self._simulate()

    def _advance(self, target: np.ndarray, yaw: float) -> None:
        self._target, self._yaw = target, yaw
        p.changeConstraint(
            self._drive, target.tolist(), jointChildFrameOrientation=quaternion(yaw), maxForce=FORCE,
            physicsClientId=self._client,
        )  # fmt: skip
        self._simulate()

    def _simulate(self) -> None:
        p.stepSimulation(physicsClientId=self._client)
        self._clock += 1
        if self._clock % LOG_EVERY == 0:
            pose = _planar(self._client, self.id)
            self.trace.append(GripperState(pose.x, pose.y, pose.yaw, self.held is not None))


def _planar(client: int, body: int) -> Pose2:
    (x, y, _), turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
    return Pose2(x, y, p.getEulerFromQuaternion(turn)[2])
