"""End effectors by name: what a pick, a place and a push do to the world.

A task names its effector. One that comes from outside the library is registered in the same way:

    @effectors.EFFECTORS.register("hook")
    class Hook(Effector): ...
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import pybullet as p
from typing_extensions import override

from gem_lite.actions import Action, PickPlace, Push
from gem_lite.registry import Registry
from gem_lite.se2 import Pose2, wrap
from gem_lite.simulation.floating_tool import PARKED, STRIDE, FloatingTool, planar

TIP_RADIUS, TIP_LENGTH = 0.005, 0.03
JAW_ANGLE = np.radians(20)
"""A jaw turned further (radians) from a bar's yaw slips off it."""
JAW_REACH = 1 / 6
"""A jaw grasps the middle third of a bar: at most this share of its length off its centre."""
HOLD = 50.0
"""The force with which a held body is held."""
BLADE = (0.005, 0.05, 0.11)
"""Thickness, width and height (m) of the spatula's blade, as in CLIPort."""
BLADE_ABOVE = 0.003
"""Height (m) of the blade's lower edge over the table when it pushes."""
RUN_UP = 0.02
"""A push begins so far (m) behind its start, so that the blade does not come down on what it is to push."""
PUSH_STRIDE = STRIDE / 3
"""Metres per simulation step while it pushes."""
DARK = (0.1, 0.1, 0.1, 1)


class Effector(FloatingTool, ABC):
    """A tool in a world. It refuses what it cannot do.

    Attributes:
        actions: the kinds of action that it can carry out.
        reach: how far (m) its lower end is below its centre.

    Args:
        client: the physics client.
        parked: where it waits (m).
    """

    actions: ClassVar[tuple[type[Action], ...]]
    reach: ClassVar[float]

    def __init__(self, client: int, parked: tuple[float, float, float] = PARKED) -> None:
        super().__init__(client, self.make_shapes(client), self.reach, parked)

    @staticmethod
    @abstractmethod
    def make_shapes(client: int) -> tuple[int, int]:
        """The tool's collision and visual shape, centred on the tool."""

    def check(self, action: Action) -> None:
        """Raises ValueError for an action that this tool cannot carry out."""
        if not isinstance(action, self.actions):
            allowed = " or ".join(kind.__name__ for kind in self.actions)
            raise ValueError(
                f"action must be a {allowed} for the tool {type(self).__name__}, got a {type(action).__name__}"
            )

    def pick(self, pose: Pose2, movable: set[int]) -> bool:
        """Grasp at ``pose``; True if something is held then. Raises ValueError if this tool cannot."""
        raise ValueError(f"the tool {type(self).__name__} cannot pick")

    def place(self, pose: Pose2) -> None:
        """Put what is held at ``pose``. Raises ValueError if this tool cannot."""
        raise ValueError(f"the tool {type(self).__name__} cannot place")

    def push(self, start: Pose2, end: Pose2) -> None:
        """Push along the table from ``start`` to ``end``. Raises ValueError if this tool cannot."""
        raise ValueError(f"the tool {type(self).__name__} cannot push")


EFFECTORS: Registry[type[Effector]] = Registry("end effector")


@EFFECTORS.register("suction")
class Suction(Effector):
    """A suction cup: it holds whatever movable body its tip touches, at any yaw, and really carries it."""

    actions = (PickPlace,)
    reach = TIP_LENGTH / 2
    _hold: int | None = None
    """The constraint by which it holds a body."""

    @staticmethod
    @override
    def make_shapes(client: int) -> tuple[int, int]:
        shape = dict(radius=TIP_RADIUS, physicsClientId=client)
        collision = p.createCollisionShape(p.GEOM_CYLINDER, height=TIP_LENGTH, **shape)
        visual = p.createVisualShape(p.GEOM_CYLINDER, length=TIP_LENGTH, rgbaColor=DARK, **shape)
        return collision, visual

    @override
    def pick(self, pose: Pose2, movable: set[int]) -> bool:
        """Reach above ``pose``, go down until the tip touches, grasp, lift. True if something is held."""
        self.carry(pose)
        touched = self._descend(lambda: self._touching(self.id, without=set()))
        for body in touched & movable:
            if self.grasps(body):
                self._attach(body)
                break
        self._rise()
        return self.held is not None

    @override
    def place(self, pose: Pose2) -> None:
        """Carry what is held above ``pose``, go down until it touches something, let go, rise.

        Raises:
            RuntimeError: nothing is held.
        """
        held = self.held
        if held is None:
            raise RuntimeError("nothing is held, so that there is nothing to place")
        self.carry(pose)
        self._descend(lambda: self._touching(held, without={self.id}))
        self._release()
        self._rise()

    @override
    def park(self) -> None:
        """Let go of everything and leave the cameras' sight."""
        self._release()
        super().park()

    def grasps(self, body: int) -> bool:
        """Whether the tool holds a body that its tip touches."""
        return True

    def _attach(self, body: int) -> None:
        tip = p.getBasePositionAndOrientation(self.id, physicsClientId=self._client)
        thing = p.getBasePositionAndOrientation(body, physicsClientId=self._client)
        position, turn = p.multiplyTransforms(*p.invertTransform(*tip), *thing)
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


@EFFECTORS.register("jaw")
class Jaw(Suction):
    """A parallel jaw: it holds a bar only if it closes across it.

    The two fingers, which are not modelled, close along the tool's y axis: at yaw 0 they come from -y and +y of the
    world, and the jaw's yaw is that of a bar which it grasps squarely (half a turn more is the same grasp).
    """

    @override
    def grasps(self, body: int) -> bool:
        """Whether the jaw, where it is, would hold a bar: a box that is longest along its own x."""
        length = p.getCollisionShapeData(body, -1, physicsClientId=self._client)[0][3][0]
        bar, tool = (planar(self._client, one) for one in (body, self.id))
        off = bar.inverse() @ tool
        return abs(wrap(2 * off.yaw) / 2) <= JAW_ANGLE and abs(off.x) <= JAW_REACH * length


@EFFECTORS.register("spatula")
class Spatula(Effector):
    """A flat upright blade, which pushes and holds nothing (CLIPort's tool for piles)."""

    actions = (Push,)
    reach = BLADE[2] / 2

    @staticmethod
    @override
    def make_shapes(client: int) -> tuple[int, int]:
        common = dict(halfExtents=[side / 2 for side in BLADE], physicsClientId=client)
        collision = p.createCollisionShape(p.GEOM_BOX, **common)
        visual = p.createVisualShape(p.GEOM_BOX, rgbaColor=DARK, **common)
        return collision, visual

    @override
    def push(self, start: Pose2, end: Pose2) -> None:
        """Come down `RUN_UP` behind ``start`` until the blade touches something, move to ``end``, rise.

        The blade stands square to the way. One that came down on a body passes over what is lower.
        """
        yaw = math.atan2(end.y - start.y, end.x - start.x)
        behind = Pose2(start.x, start.y, yaw) @ Pose2(-RUN_UP, 0.0)
        self.carry(behind)
        self._descend(lambda: self._touching(self.id, without=set()), above=BLADE_ABOVE)
        self._move(np.array([end.x, end.y, self._target[2]]), self._yaw, PUSH_STRIDE)
        self._rise()
