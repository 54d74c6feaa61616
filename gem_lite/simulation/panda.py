"""Franka's Panda with its two-finger gripper, as an end effector: it reaches, closes, and holds by friction alone.

What a floating tool cannot show happens here: a pose may be out of reach, a grasp may miss, and what is held may slip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum
from functools import cache
from typing import ClassVar

import numpy as np
import pybullet as p
import pybullet_data

from gem_lite.actions import Action, GripperState, PickPlace
from gem_lite.se2 import Pose2, wrap
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.effectors import CLEARANCE, EFFECTORS, LOG_EVERY, Log

BASE = (0.02, 0.0, 0.0)
"""Where the arm stands (m): before the table, in the middle of its long side."""
ARM = range(7)
"""The joints of the arm."""
FINGERS = (9, 10)
"""The joints, and the links, of the two fingers."""
HAND, TIP = 8, 11
"""The links of the gripper's body, and between the fingers' ends."""
RESTING = (0.0, -0.6, 0.0, -2.4, 0.0, 1.8, math.pi / 4)
"""The arm's joints (radians) above the middle of the table: where every search for joints begins."""
FOLDED = (math.pi * 0.9, -0.6, 0.0, -2.4, 0.0, 1.8, math.pi / 4)
"""The arm's joints (radians) where it waits, turned away from the table."""
OPEN = 0.04
"""How far (m) each finger is from the middle when the gripper is open."""
JOINT_STRIDE = 0.008
"""Radians per simulation step of the fastest joint: about 1.9 radians a second."""
LINE_STRIDE = 0.001
"""Metres per simulation step of a straight motion."""
LOWEST = 0.0135
"""The lowest height (m) of the tip: then the fingers' ends are 2 mm above the table."""
GRASP_FORCE = 30.0
"""The force (N) of each finger."""
FRICTION = 1.0
CLOSING = 120
"""Simulation steps that the gripper gets to close or to open."""
REACHED = 0.0005
"""Joints are right if the tip is at most this far (m) from its goal."""
OTHER_BODY, NORMAL, DISTANCE, FORCE = 2, 7, 8, 9
"""PyBullet's places in a contact; the normal points to the first body."""
PRESSED = 2.0
"""An upward force (N) on a finger that ends the way down."""


class Outcome(Enum):
    """What the last motion came to."""

    HELD = "a body is held"
    NOTHING_HELD = "the gripper closed and held nothing"
    OUT_OF_REACH = "the arm cannot reach the pose"
    DROPPED = "what was held was lost on the way"
    PLACED = "what was held was put down"


class Kinematics:
    """From poses of the tip to joints. The search moves an arm in a physics client of its own."""

    def __init__(self) -> None:
        self._client = p.connect(p.DIRECT)
        self._arm = load_arm(self._client)
        limits = [p.getJointInfo(self._arm, joint, physicsClientId=self._client)[8:10] for joint in ARM]
        self._lower, self._upper = np.array(limits).T

    def joints(self, position: np.ndarray, yaw: float, start: Sequence[float]) -> np.ndarray | None:
        """Joints (7,) that bring the tip to a position (m), pointing down, at a yaw; None if there are none.

        Args:
            start: (7,), where the search begins: the result is near it.
        """
        turn = p.getQuaternionFromEuler((math.pi, 0.0, yaw))
        solution = np.array(start)
        for _ in range(20):
            for joint, value in zip(ARM, solution, strict=True):
                p.resetJointState(self._arm, joint, float(value), physicsClientId=self._client)
            reached, orientation = p.getLinkState(
                self._arm, TIP, computeForwardKinematics=True, physicsClientId=self._client
            )[4:6]
            off = np.linalg.norm(np.subtract(reached, position))
            turned = p.getAxisAngleFromQuaternion(p.getDifferenceQuaternion(orientation, turn))[1]
            if off < REACHED and abs(wrap(turned)) < 0.01:
                break
            solution = np.array(
                p.calculateInverseKinematics(
                    self._arm, TIP, position.tolist(), turn, maxNumIterations=50, residualThreshold=1e-5,
                    physicsClientId=self._client,
                )[:7]
            )  # fmt: skip
        else:
            return None
        return solution if ((solution >= self._lower) & (solution <= self._upper)).all() else None


@cache
def kinematics() -> Kinematics:
    """The one that all arms of a process share: PyBullet has a limited number of clients."""
    return Kinematics()


def load_arm(client: int) -> int:
    """Add the arm to a physics client. Returns the id of its body."""
    path = f"{pybullet_data.getDataPath()}/franka_panda/panda.urdf"
    return p.loadURDF(path, BASE, useFixedBase=True, physicsClientId=client)


@EFFECTORS.register("panda")
class Panda:
    """The arm with its gripper. See `Effector`; a pose's yaw is that of the tool, whose fingers close along its y axis.

    Half a turn more is the same grasp, so the arm takes the one that it can reach. It comes down until its fingers'
    ends are just above the table, or a finger rests on something.

    Attributes:
        id: the id of the arm's body.
        held: the id of the body that it holds, or None.
        outcome: what the last pick or place came to.
    """

    actions: ClassVar[tuple[type[Action], ...]] = (PickPlace,)

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None:
        self._client = client  # ``parked`` is for tools that float: the arm folds beside the table.
        self._log = log
        self._kinematics = kinematics()
        self.id = load_arm(client)
        self.held: int | None = None
        self.outcome = Outcome.NOTHING_HELD
        self._half_turn = 0.0  # what is added to an action's yaw
        self._clock = 0
        self._opening = OPEN
        self._joints = np.array(FOLDED)
        for joint, value in (*zip(ARM, FOLDED, strict=True), *((finger, OPEN) for finger in FINGERS)):
            p.resetJointState(self.id, joint, value, physicsClientId=client)
        for finger in FINGERS:
            p.changeDynamics(self.id, finger, lateralFriction=FRICTION, physicsClientId=client)
        # The URDF says that one finger follows the other; PyBullet does not read that.
        gear = p.createConstraint(
            self.id, FINGERS[0], self.id, FINGERS[1], p.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0),
            physicsClientId=client,
        )  # fmt: skip
        p.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50, physicsClientId=client)
        self._hold_joints()

    def pick(self, pose: Pose2, bodies: Sequence[Body]) -> bool:
        """Grasp what lies between the fingers at ``pose``, and lift it. Returns whether a body is held."""
        joints = self._reach(pose, (0.0, math.pi))
        if joints is None:
            self.outcome = Outcome.OUT_OF_REACH
            return False
        self._move_fingers(OPEN)
        self._travel(joints)
        self._go_down(pose, self._rests)
        self._move_fingers(0.0)
        first, second = self._touched()
        self.held = min(first & second & {body.id for body in bodies if body.movable}, default=None)
        self.outcome = Outcome.NOTHING_HELD if self.held is None else Outcome.HELD
        self._go_up(pose)
        self._notice_a_loss()
        return self.held is not None

    def place(self, pose: Pose2) -> None:
        """Carry the held body above ``pose``, go down until it touches something, open, and rise.

        What cannot be placed there, because ``pose`` is out of reach, is put down where the arm is.
        """
        joints = self._reach(pose, (self._half_turn,))
        if joints is None:
            x, y, _ = self._tip()
            self._put_down(Pose2(float(x), float(y), self._yaw() - self._half_turn))
            self.outcome = Outcome.OUT_OF_REACH
            return
        self._travel(joints)
        self._notice_a_loss()
        if self.held is not None:
            self._put_down(pose)
            self.outcome = Outcome.PLACED

    def push(self, start: Pose2, end: Pose2) -> None:
        """It cannot push: `actions` has no push."""
        raise NotImplementedError("the Panda of this simulator picks and places; it does not push")

    def carry(self, pose: Pose2) -> None:
        """It stands on no mobile base."""
        raise NotImplementedError("the Panda of this simulator stands before one table")

    def park(self) -> None:
        """Open the gripper and turn away from the table."""
        if self.held is not None:
            self._move_fingers(OPEN)
            self.held = None
        self._travel(np.array(FOLDED))

    # Motions

    def _reach(self, pose: Pose2, half_turns: Sequence[float]) -> np.ndarray | None:
        """The joints (7,) above a pose from which the arm can go down to the table, with the first half turn that does.

        None if there are none.
        """
        start = np.array(RESTING)
        start[0] = math.atan2(pose.y - BASE[1], pose.x - BASE[0])
        for half_turn in half_turns:
            yaw = pose.yaw + half_turn
            above = self._kinematics.joints(_point(pose, CLEARANCE), yaw, start)
            if above is not None and self._kinematics.joints(_point(pose, LOWEST), yaw, above) is not None:
                self._half_turn = half_turn
                return above
        return None

    def _put_down(self, pose: Pose2) -> None:
        self._go_down(pose, self._held_touches)
        self._move_fingers(OPEN)
        self.held = None
        self._go_up(pose)

    def _notice_a_loss(self) -> None:
        """Find out whether the held body is still between the fingers."""
        if self.held is not None and not self._holds():
            self.held = None
            self.outcome = Outcome.DROPPED

    def _travel(self, goal: np.ndarray) -> None:
        """Move all joints evenly to a goal (7,)."""
        start = self._joints.copy()
        steps = max(1, math.ceil(float(np.abs(goal - start).max()) / JOINT_STRIDE))
        for step in range(1, steps + 1):
            self._joints = start + (goal - start) * step / steps
            self._simulate()
        self._wait(20)

    def _straight(self, goal: np.ndarray, yaw: float, ends: Callable[[], bool]) -> None:
        """Move the tip on a straight line to a goal (3,) (m), or until ``ends`` says so."""
        start = self._tip()
        steps = max(1, math.ceil(float(np.linalg.norm(goal - start)) / LINE_STRIDE))
        for step in range(1, steps + 1):
            joints = self._kinematics.joints(start + (goal - start) * step / steps, yaw, self._joints)
            if joints is None:
                return
            self._joints = joints
            self._simulate()
            if ends():
                return
        self._wait(10)

    def _go_down(self, pose: Pose2, ends: Callable[[], bool]) -> None:
        self._straight(_point(pose, LOWEST), pose.yaw + self._half_turn, ends)

    def _go_up(self, pose: Pose2) -> None:
        self._straight(_point(pose, CLEARANCE), pose.yaw + self._half_turn, lambda: False)

    def _move_fingers(self, opening: float) -> None:
        self._opening = opening
        self._wait(CLOSING)

    def _wait(self, steps: int) -> None:
        for _ in range(steps):
            self._simulate()

    def _hold_joints(self) -> None:
        p.setJointMotorControlArray(
            self.id, list(ARM), p.POSITION_CONTROL, self._joints.tolist(), forces=[87.0] * 4 + [12.0] * 3,
            physicsClientId=self._client,
        )  # fmt: skip
        p.setJointMotorControlArray(
            self.id, list(FINGERS), p.POSITION_CONTROL, [self._opening] * 2, forces=[GRASP_FORCE] * 2,
            physicsClientId=self._client,
        )  # fmt: skip

    def _simulate(self) -> None:
        self._hold_joints()
        p.stepSimulation(physicsClientId=self._client)
        self._clock += 1
        if self._clock % LOG_EVERY == 0:
            x, y, _ = self._tip()
            self._log(GripperState(float(x), float(y), wrap(self._yaw() - self._half_turn), self.held is not None))

    # What the gripper feels

    def _tip(self) -> np.ndarray:
        return np.array(p.getLinkState(self.id, TIP, physicsClientId=self._client)[4])

    def _yaw(self) -> float:
        return float(p.getEulerFromQuaternion(p.getLinkState(self.id, TIP, physicsClientId=self._client)[5])[2])

    def _contacts(self, link: int) -> list[tuple]:
        contacts = p.getContactPoints(bodyA=self.id, linkIndexA=link, physicsClientId=self._client)
        return [contact for contact in contacts if contact[OTHER_BODY] != self.id]

    def _touched(self) -> list[set[int]]:
        """For each finger, the bodies that it touches."""
        return [{contact[OTHER_BODY] for contact in self._contacts(finger)} for finger in FINGERS]

    def _holds(self) -> bool:
        """Whether both fingers touch the held body."""
        return all(self.held in touched for touched in self._touched())

    def _rests(self) -> bool:
        """Whether the hand or a finger presses on something from above."""
        contacts = [contact for link in (HAND, *FINGERS) for contact in self._contacts(link)]
        return any(contact[FORCE] * contact[NORMAL][2] > PRESSED for contact in contacts)

    def _held_touches(self) -> bool:
        """Whether the held body touches something else than the arm; or it is lost, and nothing is left to put down."""
        contacts = p.getContactPoints(bodyA=self.held, physicsClientId=self._client)
        touches = any(contact[OTHER_BODY] != self.id and contact[DISTANCE] <= 0 for contact in contacts)
        return touches or not self._holds()


def _point(pose: Pose2, height: float) -> np.ndarray:
    return np.array([pose.x, pose.y, height])
