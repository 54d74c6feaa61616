"""The PyBullet world: reset a task, observe it with three cameras, act in it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import pybullet as p

from gem_lite.demonstrations import GripperState
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Action, Pose2, Workspace, quaternion
from gem_lite.simulation.gripper import PARKED, Gripper
from gem_lite.simulation.rendering import cameras_around, render
from gem_lite.simulation.shapes import Body
from gem_lite.simulation.task import Task
from gem_lite.simulation.worlds import HOME, RGBA, TABLE_COLOR, WorldStyle

RATE = 240
"""Simulation steps per second."""
SETTLE_STEPS = 4800
"""Budget for the scene to come to rest, in simulation steps."""
SETTLED_SPEED = 0.005
"""A body slower than this (m/s) is at rest, as in CLIPort."""


@dataclass(frozen=True)
class Step:
    """What an action led to.

    ``reward`` is the change of the task's score, in [-1, 1]; ``trace`` what the gripper logged of itself.
    """

    observation: Observation
    reward: float
    done: bool
    grasped: bool
    trace: tuple[GripperState, ...]


class Simulation(ABC):
    """Bodies, a gripper and a task on one or several tables, in a physics client of its own.

    Use as a context manager, or call `close`.

    Attributes:
        workspace: what actions may touch of a table, in the table's own frame.
        tables: where the tables' frames are in the world.
        parked: where the tool waits (m).

    Args:
        gui: open PyBullet's window; headless by default.
        style: how scenes look and lie.
    """

    tables: tuple[Pose2, ...] = (Pose2(0.0, 0.0),)
    parked: tuple[float, float, float] = PARKED

    def __init__(self, gui: bool = False, style: WorldStyle = HOME) -> None:
        self.style = style
        self.workspace = Workspace()
        self.client = p.connect(p.GUI if gui else p.DIRECT)
        self.bodies: list[Body] = []
        self.steps_taken = 0
        self._task: Task | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect the physics client. Safe to call twice."""
        if self.client >= 0:
            p.disconnect(self.client)
            self.client = -1

    @property
    def task(self) -> Task:
        """The task of the last `reset`. Raises RuntimeError before it."""
        if self._task is None:
            raise RuntimeError("the world has no task yet: call world.reset(task, seed) first")
        return self._task

    def clear(self) -> None:
        """Empty the world but for tables, floor and gripper."""
        p.resetSimulation(physicsClientId=self.client)
        p.setGravity(0, 0, -9.8, physicsClientId=self.client)
        p.setTimeStep(1 / RATE, physicsClientId=self.client)
        self.bodies = []
        self.furnish()
        self.gripper = Gripper(self.client, self.parked)

    def begin(self, task: Task, seed: int) -> None:
        """Lay out an episode of ``task``; everything random in it comes from ``seed``."""
        self.workspace = task.workspace
        self.clear()
        self._task, self.steps_taken, self.gripper.jaw = task, 0, task.jaw
        task.seed = seed
        task.reset(self, np.random.default_rng(seed))
        self.settle()
        self._score = task.score(self)

    def conclude(self) -> tuple[float, bool]:
        """End an action: park the tool, settle, score; then the task may go on to its next instruction.

        Returns:
            The change of the task's score since the last action, in [-1, 1], and whether the episode is over.
        """
        self.gripper.park()
        self.settle()
        self.steps_taken += 1
        before = self._score
        self._score = self.task.score(self)
        self.task.advance(self)
        done = self._score > 0.99 or self.steps_taken >= self.task.max_steps
        return self._score - before, done

    @abstractmethod
    def furnish(self) -> None:
        """Put up tables and floor."""

    def add_slab(self, pose: Pose2, half: tuple[float, float, float], top: float, color: RGBA, solid: bool) -> None:
        """A fixed box with its upper face at the height ``top``; one that is not solid is only seen."""
        common = dict(halfExtents=half, physicsClientId=self.client)
        visual = p.createVisualShape(p.GEOM_BOX, rgbaColor=color, **common)
        collision = p.createCollisionShape(p.GEOM_BOX, **common) if solid else -1
        at = (pose.x, pose.y, top - half[2])
        body = p.createMultiBody(0, collision, visual, at, quaternion(pose.yaw), physicsClientId=self.client)
        p.changeDynamics(body, -1, lateralFriction=1.0, physicsClientId=self.client)

    def add(self, body: Body) -> Body:
        """Register a body that was made in this world's client."""
        self.bodies.append(body)
        return body

    @property
    def movable(self) -> set[int]:
        """The ids of all bodies that can be moved."""
        return {body.id for body in self.bodies if body.movable}

    def pose(self, body: Body) -> tuple[Pose2, float]:
        """Ground truth for experts, rewards and tests: planar pose and the height z of the origin."""
        (x, y, z), quat = p.getBasePositionAndOrientation(body.id, physicsClientId=self.client)
        return Pose2(x, y, p.getEulerFromQuaternion(quat)[2]), z

    def settle(self) -> bool:
        """Simulate until every movable body rests, within a budget of steps. True if all rest."""
        for _ in range(SETTLE_STEPS // 10):
            for _ in range(10):
                p.stepSimulation(physicsClientId=self.client)
            speeds = [p.getBaseVelocity(body, physicsClientId=self.client)[0] for body in self.movable]
            if all(np.linalg.norm(speed) < SETTLED_SPEED for speed in speeds):
                return True
        return False

    def wait(self, seconds: float) -> None:
        """Simulate for so long, whatever moves: what slowly begins to fall seems to `settle` to rest."""
        for _ in range(round(RATE * seconds)):
            p.stepSimulation(physicsClientId=self.client)

    def check(self, name: str, pose: Pose2) -> None:
        """Refuse a pose in a table's frame that no action may have.

        Raises:
            ValueError: it lies outside the task's workspace, or its yaw is not finite.
            RuntimeError: there is no task yet.
        """
        workspace = self.task.workspace
        if not workspace.contains(pose.x, pose.y):
            raise ValueError(f"{name} = {pose} lies outside the workspace {workspace}")
        if not math.isfinite(pose.yaw):
            raise ValueError(f"{name} = {pose} has a yaw that is not a finite number of radians")


class World(Simulation):
    """One table, its frame the world's."""

    def furnish(self) -> None:
        """See `Simulation`."""
        w = self.workspace
        centre = Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)
        half = ((w.x_max - w.x_min) / 2, (w.y_max - w.y_min) / 2, 0.0005)
        self.add_slab(centre, half, 0.0, TABLE_COLOR, solid=False)
        self.add_slab(centre, (3.0, 3.0, 0.05), 0.0, (0, 0, 0, 0), solid=True)
        self.add_slab(centre, (3.0, 3.0, 0.0005), -0.1, self.style.floor, solid=False)

    def reset(self, task: Task, seed: int) -> Observation:
        """Lay out an episode of ``task``; everything random in it comes from ``seed``."""
        self.begin(task, seed)
        return self.observe()

    def observe(self) -> Observation:
        """Take the three pictures."""
        cameras = cameras_around(self.workspace)
        return Observation(tuple(render(self.client, camera, self.style.light)[0] for camera in cameras))

    def step(self, action: Action, watch: Callable[[str], None] | None = None) -> Step:
        """Pick, place, and `conclude`.

        Args:
            action: poses in the workspace; one outside, or a yaw that is not finite, raises ValueError.
            watch: called with "picked" and "placed" at those moments, for pictures.
        """
        self.check("action.pick", action.pick)
        self.check("action.place", action.place)
        self.gripper.trace.clear()
        grasped = self.gripper.pick(action.pick, self.movable)
        if watch:
            watch("picked")
        if grasped:
            self.gripper.place(action.place)
        reward, done = self.conclude()
        if watch:
            watch("placed")
        return Step(self.observe(), reward, done, grasped, tuple(self.gripper.trace))


def body_at(simulation: Simulation, pose: Pose2) -> int:
    """The id of the body that lies topmost at a pose in the world, -1 if none: the simulator's truth."""
    hit, *_ = p.rayTest((pose.x, pose.y, 0.5), (pose.x, pose.y, -0.01), physicsClientId=simulation.client)
    return hit[0]
