"""End effectors by name. They carry out picks, places and pushes. The library's are floating tools.

A task names its effector. A program outside the library registers its own in the same way, such as an arm:

    @effectors.EFFECTORS.register("arm")
    class Arm: ...
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar, Protocol

import numpy as np
import pybullet as p
from typing_extensions import override

from gem_lite.actions import Action, GripperState, Outcome, PickPlace, Push
from gem_lite.foundations.registry import Registry
from gem_lite.se2 import Pose2, quaternion, wrap
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.grips import FINGER, Grip, Surfaces

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
TIP_RADIUS = 0.005
TIP_LENGTH = 0.03
TIP_INERTIA = (4e-5, 4e-5, 4e-5)
"""Of the narrow tip (kg m^2): about that of the usual one across its axis."""
NARROW_TIP_RADIUS = 0.001
"""That of CLIPort's suction tip: what lies beside it is not held."""
JAW_ANGLE = np.radians(20)
"""A jaw slips off a bar if their yaws differ by more than this (radians)."""
JAW_REACH = 1 / 6
"""A jaw grasps the middle third of a bar: at most this share of its length off its centre."""
HOLD = 50.0
"""The maximal force (N) with which the tool holds a body."""
BLADE = (0.005, 0.05, 0.11)
"""Thickness, width and height (m) of the spatula's blade, as in CLIPort."""
BLADE_ABOVE = 0.003
"""Height (m) of the blade's lower edge over the table when it pushes."""
RUN_UP = 0.02
"""A push begins this far (m) behind its start, so that the blade does not come down on the body to push."""
LOW_LIFT = 0.02
"""How far (m) the low suction cup lifts what it carries, as in CLIPort."""
SLOW_STRIDE = STRIDE / 3
"""Metres per simulation step during a push, and of the low suction cup while it carries a body."""
DARK = (0.1, 0.1, 0.1, 1.0)


class Effector(Protocol):
    """What acts in a simulated world: a tool, or an arm with a tool. It needs no base class.

    An environment makes it and calls `park` after each action. It calls `pick` and `place`, or `push`, only if
    `actions` has the kind of action; `carry` only if the effector stands on a mobile base. All poses are in the world.

    Attributes:
        actions: the kinds of action that it can carry out.
        held: the id of the body that it holds, or None.
        outcome: what the last pick, place or push came to.

    Args:
        client: the physics client.
        parked: the position (m) where it waits, out of the cameras' sight.
        log: to be called during all motions with the present state, 30 times per simulated second.
    """

    actions: ClassVar[tuple[type[Action], ...]]
    held: int | None
    outcome: Outcome

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None: ...

    def pick(self, pose: Pose2, bodies: Sequence[Body]) -> bool:
        """Grasp one of the movable ``bodies`` at ``pose``. Returns whether a body is held."""

    def place(self, pose: Pose2) -> None:
        """Put the held body at ``pose``."""

    def push(self, start: Pose2, end: Pose2) -> None:
        """Push along the table from ``start`` to ``end``."""

    def carry(self, pose: Pose2) -> None:
        """Move above ``pose``, with the held body if there is one."""

    def park(self) -> None:
        """Release the held body and leave the view of the cameras."""


EFFECTORS: Registry[type[Effector]] = Registry("end effector")


class FloatingTool:
    """The motion of a tool: a strong constraint pulls its body to the target pose. See `Effector`.

    Attributes:
        form: PyBullet's kind of shape.
        half: half of the tool's sides (m) along x, y and z.
        id: the id of its body.
        travel_height: height (m) at which it travels now.
        stride: metres per simulation step at which it travels now.
    """

    form: ClassVar[int]
    half: ClassVar[tuple[float, float, float]]

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None:
        self._client = client
        self._parked = parked
        self._log = log
        common = dict(radius=self.half[0], halfExtents=self.half, physicsClientId=client)
        collision = p.createCollisionShape(self.form, height=2 * self.half[2], **common)
        visual = p.createVisualShape(self.form, length=2 * self.half[2], rgbaColor=DARK, **common)
        self.id = p.createMultiBody(0.5, collision, visual, parked, physicsClientId=client)
        self._drive = p.createConstraint(
            self.id, -1, -1, -1, p.JOINT_FIXED, (0, 0, 0), (0, 0, 0), parked, physicsClientId=client
        )
        self._target = np.array(parked)
        self._yaw = 0.0
        self.held: int | None = None
        self.outcome = Outcome.NOTHING_HELD
        self.travel_height = CLEARANCE
        self.stride = STRIDE
        self._clock = 0

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
        while not touched and self._target[2] > self.half[2] + above:
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


@EFFECTORS.register("suction")
class Suction(FloatingTool):
    """A suction cup: it holds the movable body that its tip touches, at any yaw, and really carries it."""

    actions = (PickPlace,)
    form = p.GEOM_CYLINDER
    half = (TIP_RADIUS, TIP_RADIUS, TIP_LENGTH / 2)
    _hold: int | None = None
    """The constraint by which it holds a body."""

    def pick(self, pose: Pose2, bodies: Sequence[Body]) -> bool:
        """Move above ``pose``, go down until the tip touches a body, grasp, lift. Returns whether a body is held."""
        self.carry(pose)
        touched = self._descend(lambda: self._touching(self.id, without=set()))
        for body in self.in_order(touched & {body.id for body in bodies if body.movable}):
            if self.grasps(body):
                self._attach(body)
                break
        return self._lift()

    def place(self, pose: Pose2) -> None:
        """Carry the held body above ``pose``, go down until it touches something, release it, and rise.

        Raises:
            RuntimeError: no body is held.
        """
        held = self.held
        if held is None:
            raise RuntimeError("no body is held, so there is nothing to place")
        self.carry(pose)
        self._descend(lambda: self._touching(held, without={self.id}))
        self._release()
        self._rise()
        self.outcome = Outcome.PLACED

    @override
    def park(self) -> None:
        self._release()
        super().park()

    def in_order(self, touched: set[int]) -> Iterable[int]:
        """The touched bodies; the tool tries to hold the first one first."""
        return touched

    def grasps(self, body: int) -> bool:
        """Whether the tool can hold a body that its tip touches."""
        return True

    def _lift(self) -> bool:
        """Rise. Returns whether a body is held."""
        self._rise()
        self.outcome = Outcome.NOTHING_HELD if self.held is None else Outcome.HELD
        return self.held is not None

    def _attach(self, body: int) -> None:
        tip = p.getBasePositionAndOrientation(self.id, physicsClientId=self._client)
        grasped = p.getBasePositionAndOrientation(body, physicsClientId=self._client)
        position, turn = p.multiplyTransforms(*p.invertTransform(*tip), *grasped)
        self._hold = p.createConstraint(
            self.id, -1, body, -1, p.JOINT_FIXED, (0, 0, 0), position, (0, 0, 0), turn, physicsClientId=self._client
        )
        p.changeConstraint(self._hold, maxForce=HOLD, physicsClientId=self._client)
        self.held = body

    def _release(self) -> None:
        if self._hold is not None:
            p.removeConstraint(self._hold, physicsClientId=self._client)
        self._hold = None
        self.held = None


@EFFECTORS.register("narrow-suction")
class NarrowSuction(Suction):
    """A suction cup with a tip of 1 mm, as CLIPort's. Of several bodies that it touches, it holds the nearest."""

    half = (NARROW_TIP_RADIUS, NARROW_TIP_RADIUS, TIP_LENGTH / 2)

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None:
        super().__init__(client, parked, log)
        # A tip as light about its axis as this cylinder lags behind the turns of its drive, by up to 19 degrees.
        p.changeDynamics(self.id, -1, localInertiaDiagonal=TIP_INERTIA, physicsClientId=client)

    @override
    def in_order(self, touched: set[int]) -> Iterable[int]:
        return sorted(touched, key=self._gap)

    def _gap(self, body: int) -> float:
        """The distance (m) of a body from the tool; negative if they overlap."""
        points = p.getClosestPoints(self.id, body, 2 * NARROW_TIP_RADIUS, physicsClientId=self._client)
        distance = 8  # PyBullet's place in a point
        return min((point[distance] for point in points), default=math.inf)


@EFFECTORS.register("low-suction")
class LowSuction(Suction):
    """A suction cup that carries a body slowly and just over the table, as CLIPort does with a rope."""

    @override
    def _attach(self, body: int) -> None:
        super()._attach(body)
        self.travel_height = float(self._target[2]) + LOW_LIFT
        self.stride = SLOW_STRIDE

    @override
    def _release(self) -> None:
        super()._release()
        self.travel_height = CLEARANCE
        self.stride = STRIDE


@EFFECTORS.register("jaw")
class Jaw(Suction):
    """A parallel jaw: it holds a bar only if it closes across the bar.

    The two fingers are not modelled. They close along the tool's y axis. In a perfect grasp, the jaw has the yaw of the
    bar; half a turn more is the same grasp.
    """

    @override
    def grasps(self, body: int) -> bool:
        """Whether the jaw, at its present pose, holds a bar: a box that is longest along its own x axis."""
        length = p.getCollisionShapeData(body, -1, physicsClientId=self._client)[0][3][0]
        jaw_in_bar = planar(self._client, body).inverse() @ planar(self._client, self.id)
        across = abs(wrap(2 * jaw_in_bar.yaw) / 2) <= JAW_ANGLE
        near_middle = abs(jaw_in_bar.x) <= JAW_REACH * length
        return across and near_middle


@EFFECTORS.register("parallel-jaw")
class ParallelJaw(Suction):
    """A parallel jaw for any body that has `Body.parts`: whether it holds one, the surfaces decide (`grips`).

    Its fingers close along the tool's y axis; half a turn more is the same grasp. They push nothing aside: where a
    finger would land on a body, the jaw stays above. A constraint carries the body, as for a suction cup.

    Attributes:
        grip: what the last pick took, also after it is released; None if it took nothing.
    """

    form = p.GEOM_BOX
    half = (FINGER[1] / 2, FINGER[0], TIP_LENGTH / 2)

    def __init__(self, client: int, parked: tuple[float, float, float], log: Log) -> None:
        super().__init__(client, parked, log)
        self.grip: Grip | None = None
        p.setCollisionFilterGroupMask(self.id, -1, 0, 0, physicsClientId=client)  # `grips` decides instead.

    @override
    def pick(self, pose: Pose2, bodies: Sequence[Body]) -> bool:
        """Move above ``pose`` and, if the jaw can hold a body there, go down, grasp it, and rise."""
        self.carry(pose)
        self.grip = Surfaces.of(self._client, bodies).grip(pose)
        if self.grip is not None:
            self._move(np.array([pose.x, pose.y, self.grip.tip + self.half[2]]), self._yaw)
            # Nothing touched the body, so it may sleep.
            p.changeDynamics(
                self.grip.body, -1, activationState=p.ACTIVATION_STATE_WAKE_UP, physicsClientId=self._client
            )
            self._attach(self.grip.body)
        return self._lift()


@EFFECTORS.register("spatula")
class Spatula(FloatingTool):
    """A flat upright blade. It pushes bodies and cannot hold them (CLIPort's tool for piles)."""

    actions = (Push,)
    form = p.GEOM_BOX
    half = (BLADE[0] / 2, BLADE[1] / 2, BLADE[2] / 2)

    def push(self, start: Pose2, end: Pose2) -> None:
        """Go down `RUN_UP` behind ``start`` until the blade touches something, move to ``end``, and rise.

        The blade is perpendicular to the path. If it stopped on a body, it passes over all lower bodies.
        """
        yaw = math.atan2(end.y - start.y, end.x - start.x)
        behind = Pose2(start.x, start.y, yaw) @ Pose2(-RUN_UP, 0.0)
        self.carry(behind)
        self._descend(lambda: self._touching(self.id, without=set()), above=BLADE_ABOVE)
        self._move(np.array([end.x, end.y, self._target[2]]), self._yaw, SLOW_STRIDE)
        self._rise()
        self.outcome = Outcome.PUSHED


def planar(client: int, body: int) -> Pose2:
    """The pose of a body, seen from above."""
    (x, y, _), turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
    return Pose2(x, y, p.getEulerFromQuaternion(turn)[2])
