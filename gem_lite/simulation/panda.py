"""Franka's Panda with its two-finger gripper, as an end effector: it reaches, closes, and holds by friction alone.

What a floating tool cannot show happens here: a pose may be out of reach, a grasp may miss, and what is held may slip.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pybullet as p
import pybullet_data

from gem_lite.actions import Action, GripperState, Outcome, PickPlace
from gem_lite.se2 import Pose2, wrap
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.effectors import CLEARANCE, EFFECTORS, LOG_EVERY, Log
from gem_lite.simulation.grips import Grip, Surfaces

BASE = (0.02, 0.0, 0.0)
"""Where the arm stands (m): in front of the table, at the middle of its long side."""
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
OPENINGS = (0.04, 0.03, 0.0235, 0.0175, 0.0125, 0.0075)
"""How far (m) each finger is from the middle when the gripper is open. The arm takes the first with which no finger
rests on something."""
FINGER = (0.006, 0.003, 0.0481)
"""Width, thickness and length (m) of a finger. Franka's own are 20 mm wide: neighbours leave no room for them."""
JOINT_STRIDE = 0.008
"""Radians per simulation step of the fastest joint: about 1.9 radians a second."""
LINE_STRIDE = 0.001
"""Metres per simulation step of a straight motion."""
FINGER_END = 0.0541
"""How far (m) below its joint a finger ends."""
ABOVE_TABLE = 0.001
"""The fingers' ends stay so far (m) above the table."""
END_BELOW_TIP = 0.0075
"""How far (m) the fingers' ends are below the tip."""
LOWEST = END_BELOW_TIP + ABOVE_TABLE
"""The lowest height (m) of the tip: then the fingers' ends are `ABOVE_TABLE` (m) above the table."""
DEPTH = 0.012
"""The fingers' ends go so far (m) below the top of what lies in the middle, as those of the floating jaw (`grips`)."""
GRASP_FORCE = 30.0
"""The force (N) of each finger."""
FRICTION = 1.0
SOLVER_ITERATIONS = 150
"""With PyBullet's 50, what is held turns between the fingers while the arm turns."""
GAIN = 0.3
"""The share of a joint's error that its motor corrects in one simulation step."""
SETTLING = 20
"""Simulation steps after which the arm has arrived where its joints were sent."""
RETREAT = np.array([0.0, 0.0, 0.01])
"""How far (m) the fingers rise before the next, narrower try."""
LETTING_GO = 0.002
"""How far (m) each finger moves at a time from what it lets go."""
RELEASING = 25
"""Simulation steps that the fingers get for each such move."""
CLOSING = 120
"""Simulation steps that the gripper gets to close or to open."""
REACHED = 0.0005
"""Joints are right if the tip is at most this far (m) from its goal."""
OTHER_BODY, NORMAL, DISTANCE, FORCE = 2, 7, 8, 9
"""PyBullet's places in a contact; the normal points to the first body."""
PRESSED = 2.0
"""An upward force (N) on a finger that ends the way down."""


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
            reached, orientation = self._tip(solution)
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

    def turned(self, joints: np.ndarray, yaw: float) -> np.ndarray:
        """Joints (7,) whose last one, in [-pi, pi), brings the tip to a yaw: where a search begins."""
        _, orientation = self._tip(joints)
        last = joints[-1] - (yaw - p.getEulerFromQuaternion(orientation)[2])
        return np.array([*joints[:-1], wrap(last)])

    def _tip(self, joints: np.ndarray) -> tuple[Sequence[float], Sequence[float]]:
        """The position (m) and the quaternion of the tip at joints (7,)."""
        for joint, value in zip(ARM, joints, strict=True):
            p.resetJointState(self._arm, joint, float(value), physicsClientId=self._client)
        return p.getLinkState(self._arm, TIP, computeForwardKinematics=True, physicsClientId=self._client)[4:6]


@cache
def kinematics() -> Kinematics:
    """The one that all arms of a process share: PyBullet has a limited number of clients."""
    return Kinematics()


def load_arm(client: int) -> int:
    """Add the arm with slim fingers to a physics client. Returns the id of its body."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "panda.urdf")
        file.write_text(_with_slim_fingers())
        return p.loadURDF(str(file), BASE, useFixedBase=True, physicsClientId=client)


@cache
def _with_slim_fingers() -> str:
    """The arm's URDF with a box in the place of each finger, its inner face at the middle of the closed gripper."""
    path = Path(pybullet_data.getDataPath(), "franka_panda", "panda.urdf")
    urdf = ElementTree.fromstring(path.read_text().replace("package:/", str(path.parent)))
    width, thickness, length = FINGER
    for name, side in (("panda_leftfinger", 1), ("panda_rightfinger", -1)):
        for kind in ("visual", "collision"):
            (shape,) = urdf.findall(f"link[@name='{name}']/{kind}")
            for part in (*shape.findall("origin"), *shape.findall("geometry")):
                shape.remove(part)
            middle = f"0 {side * thickness / 2} {FINGER_END - length / 2}"
            ElementTree.SubElement(shape, "origin", xyz=middle)
            box = ElementTree.SubElement(ElementTree.SubElement(shape, "geometry"), "box")
            box.set("size", f"{width} {thickness} {length}")
    return ElementTree.tostring(urdf, "unicode")


@EFFECTORS.register("panda")
class Panda:
    """The arm with its gripper. See `Effector`; a pose's yaw is that of the tool, whose fingers close along its y axis.

    Half a turn more is the same grasp, so the arm takes the one that it can reach. The fingers go `DEPTH` below the top
    of what lies in the middle, but not below `ABOVE_TABLE`. If a finger rests on something, the arm rises a little, and
    tries again with the next of `OPENINGS`.

    Attributes:
        id: the id of the arm's body.
        held: the id of the body that it holds, or None.
        grip: what the last pick took, also after it is released; None if it took nothing.
    """

    actions: ClassVar[tuple[type[Action], ...]] = (PickPlace,)

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None:
        self._client = client  # ``parked`` is for tools that float: the arm folds beside the table.
        self._log = log
        self._kinematics = kinematics()
        p.setPhysicsEngineParameter(numSolverIterations=SOLVER_ITERATIONS, physicsClientId=client)
        self.id = load_arm(client)
        self.held: int | None = None
        self.grip: Grip | None = None
        self.outcome = Outcome.NOTHING_HELD
        self._bodies: tuple[Body, ...] = ()  # those that it may hold
        self._half_turn = 0.0  # what is added to an action's yaw
        self._clock = 0
        self._opening = OPENINGS[0]
        self._joints = np.array(FOLDED)
        for joint, value in (*zip(ARM, FOLDED, strict=True), *((finger, self._opening) for finger in FINGERS)):
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
        self.grip = None
        joints = self._reach(pose, (0.0, math.pi))
        if joints is None:
            self.outcome = Outcome.OUT_OF_REACH
            return False
        self._move_fingers(OPENINGS[0])
        self._travel(joints)
        self._bodies = tuple(body for body in bodies if body.movable)
        self._grasp(pose)
        return self.held is not None

    def place(self, pose: Pose2) -> None:
        """Carry the held body above ``pose``, go down until it touches something, open, and rise.

        What cannot be placed there, because ``pose`` is out of reach, is put down where the arm is.
        """
        if self.held is None:
            self.outcome = Outcome.NOTHING_HELD
            return
        joints = self._reach(pose, (self._half_turn,))
        if joints is None:
            joints = self._turn_over(pose)
        if joints is None:
            self._put_down(self._here())
            self.outcome = Outcome.OUT_OF_REACH
            return
        self._travel(joints)
        self._notice_a_loss()
        if self.held is not None and self._put_down(pose):
            self.outcome = Outcome.PLACED

    def push(self, start: Pose2, end: Pose2) -> None:
        """It cannot push: `actions` has no push."""
        raise NotImplementedError("the Panda of this simulator picks and places; it does not push")

    def carry(self, pose: Pose2) -> None:
        """It stands on no mobile base."""
        raise NotImplementedError("the Panda of this simulator stands before one table")

    def park(self) -> None:
        """Open the gripper if it holds a body, and turn away from the table."""
        if self.held is not None:
            self._move_fingers(OPENINGS[0])
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
            above = self._kinematics.joints(_point(pose, CLEARANCE), yaw, self._kinematics.turned(start, yaw))
            if above is not None and self._kinematics.joints(_point(pose, LOWEST), yaw, above) is not None:
                self._half_turn = half_turn
                return above
        return None

    def _grasp(self, pose: Pose2) -> None:
        """Go down, opened as wide as there is room for the fingers, close, and lift."""
        height = LOWEST + max(0.0, self._height_below() - DEPTH)
        for opening in OPENINGS:
            self._move_fingers(opening)
            if self._go_down(pose, self._rests, height):
                break
            self._straight(self._tip() + RETREAT, pose.yaw + self._half_turn, lambda: False)
        else:
            self._go_down(pose, self._rests, height)
        self._move_fingers(0.0)
        first, second = self._touched()
        self.held = min(first & second & {body.id for body in self._bodies}, default=None)
        self.outcome = Outcome.NOTHING_HELD if self.held is None else Outcome.HELD
        if self.held is None:
            self._let_go()
        else:
            self.grip = self._grip(next(body for body in self._bodies if body.id == self.held))
        self._go_up(pose)
        self._notice_a_loss()

    def _turn_over(self, place: Pose2) -> np.ndarray | None:
        """Put the held body down and grasp it again after half a turn, if ``place`` can be reached so.

        Returns:
            The joints (7,) above ``place``; None if that does not help.
        """
        here = self._here()
        half_turn = math.pi - self._half_turn
        above_place = self._reach(place, (half_turn,))
        above_here = self._reach(here, (half_turn,))
        if above_place is None or above_here is None or self.held is None:
            return None
        self._half_turn = math.pi - half_turn
        self._put_down(here)
        self._half_turn = half_turn
        self._travel(above_here)
        self._grasp(here)
        return above_place

    def _put_down(self, pose: Pose2) -> bool:
        """Put the held body down. Returns whether it was still held at the lowest point."""
        self._go_down(pose, self._held_touches)
        self._notice_a_loss()
        still_held = self.held is not None
        self._let_go()
        self.held = None
        self._go_up(pose)
        return still_held

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
        self._wait(SETTLING)

    def _straight(self, goal: np.ndarray, yaw: float, ends: Callable[[], bool]) -> bool:
        """Move the tip on a straight line to a goal (3,) (m), until ``ends`` says so or there are no joints.

        Returns:
            Whether it went the whole way.
        """
        start = self._tip()
        steps = max(1, math.ceil(float(np.linalg.norm(goal - start)) / LINE_STRIDE))
        for step in range(1, steps + 1 + SETTLING):
            share = min(1.0, step / steps)
            joints = self._kinematics.joints(start + (goal - start) * share, yaw, self._joints)
            if joints is None:
                return False
            self._joints = joints
            self._simulate()
            if ends():
                return False
        return True

    def _go_down(self, pose: Pose2, ends: Callable[[], bool], height: float = LOWEST) -> bool:
        return self._straight(_point(pose, height), pose.yaw + self._half_turn, ends)

    def _go_up(self, pose: Pose2) -> None:
        self._straight(_point(pose, CLEARANCE), pose.yaw + self._half_turn, lambda: False)

    def _let_go(self) -> None:
        """Open the fingers, no farther than until they touch nothing that can move."""
        movable = {body.id for body in self._bodies}
        spread = self._spread()
        touching = True
        while touching and spread < OPENINGS[0]:
            spread = min(spread + LETTING_GO, OPENINGS[0])
            self._move_fingers(spread, RELEASING)
            touching = any(touched & movable for touched in self._touched())

    def _move_fingers(self, opening: float, steps: int = CLOSING) -> None:
        self._opening = opening
        self._wait(steps)

    def _wait(self, steps: int) -> None:
        for _ in range(steps):
            self._simulate()

    def _hold_joints(self) -> None:
        p.setJointMotorControlArray(
            self.id, list(ARM), p.POSITION_CONTROL, self._joints.tolist(), forces=[87.0] * 4 + [12.0] * 3,
            positionGains=[GAIN] * 7, physicsClientId=self._client,
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
            here = self._here()
            self._log(GripperState(here.x, here.y, here.yaw, self.held is not None))

    # What the gripper feels

    def _tip(self) -> np.ndarray:
        return np.array(p.getLinkState(self.id, TIP, physicsClientId=self._client)[4])

    def _here(self) -> Pose2:
        """The pose of the tool now."""
        x, y, _ = self._tip()
        return Pose2(float(x), float(y), wrap(self._yaw() - self._half_turn))

    def _yaw(self) -> float:
        return float(p.getEulerFromQuaternion(p.getLinkState(self.id, TIP, physicsClientId=self._client)[5])[2])

    def _height_below(self) -> float:
        """How high (m) the scene is below the middle of the gripper, as a range finder in its palm measures it."""
        tip = self._tip()
        ((_, _, share, _, _),) = p.rayTest(tip, tip * (1, 1, 0), physicsClientId=self._client)
        return float(tip[2]) * (1 - share)

    def _spread(self) -> float:
        """How far (m) the fingers are from the middle, as a mean."""
        return float(np.mean([p.getJointState(self.id, finger, physicsClientId=self._client)[0] for finger in FINGERS]))

    def _contacts(self, link: int) -> list[tuple]:
        contacts = p.getContactPoints(bodyA=self.id, linkIndexA=link, physicsClientId=self._client)
        return [contact for contact in contacts if contact[OTHER_BODY] != self.id]

    def _touched(self) -> list[set[int]]:
        """For each finger, the bodies that it touches."""
        return [{contact[OTHER_BODY] for contact in self._contacts(finger)} for finger in FINGERS]

    def _grip(self, body: Body) -> Grip:
        """What the closed fingers hold of a body."""
        end = float(self._tip()[2]) - END_BELOW_TIP
        surfaces = Surfaces.of(self._client, [body])
        part = surfaces.part_between(self._here(), 2 * self._spread(), FINGER[0], end)
        return Grip(body.id, part, end, 0.0)

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
