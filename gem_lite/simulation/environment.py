"""The base of all simulated environments: reset a task, observe each table with its cameras, carry out actions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import pybullet as p

from gem_lite.actions import Action, ExpertAction, GripperState, Outcome, PickPlace, Push
from gem_lite.language import Instruction
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.sensor_errors import corrupt, draw_different_units
from gem_lite.se2 import Pose2, Workspace, quaternion
from gem_lite.simulation import panda  # noqa: F401 (registers the arm)
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.effectors import EFFECTORS, PARKED, RATE, Effector
from gem_lite.simulation.looks import HOME, TABLE_COLOR, Look

SOLVED = 0.99
"""An episode is solved if its score is above this."""
SETTLE_STEPS = 4800
"""The scene may take this many simulation steps to come to rest."""
SETTLED_SPEED = 0.005
"""A body slower than this (m/s) is at rest, as in CLIPort."""
LAMP_STREAM, UNIT_STREAM, FRAME_STREAM, TABLE_STREAM, ERRING_STREAM = (0, 1), (0, 2), (0, 3), (0, 4), (0, 5)
"""With the seed of an episode: seeds of the lamp, of what a camera keeps for an episode, of a frame's noise, of the
table's gray, and of whether cameras err."""
Watch = Callable[[str], None]
"""Called at the moments "picked", "pushed" and "placed" of an action, with the moment's name: to take pictures."""


def _ignore(_: object) -> None:
    """Nobody watches or films."""


class PlayedTask(Protocol):
    """A task as an environment knows it: `gem_lite.tasks.Task`.

    Attributes:
        workspace: the area of the task's table.
        effector: the name of the tool, see `effectors`.
        max_steps: the number of actions after which an episode ends.
    """

    workspace: Workspace
    effector: str
    max_steps: int

    @property
    def instruction(self) -> Instruction:
        """The present sentence."""

    def reset(self, environment: Environment, rng: np.random.Generator, seed: int) -> None:
        """Put the bodies of an episode on the tables."""

    def score(self, environment: Environment) -> float:
        """The share of the task that is done, in [0, 1]."""

    def advance(self, environment: Environment) -> None:
        """Called after every action: go on to the next sentence."""

    def expert(self, environment: Environment) -> ExpertAction | None:
        """The next action, from ground truth, or None if nothing is left to do."""


@dataclass(frozen=True)
class Step:
    """The result of an action.

    Attributes:
        observations: one for each table, after the action; none if nobody wants to look after the last one.
        reward: the change of the task's score, in [-1, 1].
        done: whether the episode is over.
        held: the id of the body that the tool held; None if it held nothing, and for a push.
        trace: the states of the tool during the action.
        outcome: what the action came to; None if the robot could not act at all.
    """

    observations: tuple[Observation, ...]
    reward: float
    done: bool
    held: int | None
    trace: tuple[GripperState, ...]
    outcome: Outcome | None = None

    @property
    def grasped(self) -> bool:
        """Whether the tool held a body; False for a push."""
        return self.held is not None


class Environment(ABC):
    """Bodies, a tool and a task on one or several tables. Each environment has its own physics client.

    Use as a context manager, or call `close`.

    Attributes:
        workspace: the area of a table that actions may reach, in the table's own frame.
        tables: the poses of the tables' frames in the world.
        base: the pose of the tool's base in the world.
        parked: the position (m) where the tool waits.
        effector: the tool. The task chooses it.
        trace: the states of the tool during the present action, or the last one.
        light: the lamp of the present episode.
        gray: the factor of the table's brightness in the present episode.
        film: called with each state after it came into the trace: to take pictures. By default nobody films.

    Args:
        style: the looks and the layout of the scenes.
    """

    tables: tuple[Pose2, ...] = (Pose2(0.0, 0.0),)
    base: Pose2 = Pose2(0.0, 0.0)
    parked: tuple[float, float, float] = PARKED

    def __init__(self, style: Look = HOME) -> None:
        self.style = style
        self.light = style.light
        self.gray = 1.0
        self._seed = 0
        self.workspace = Workspace()
        self._client = p.connect(p.DIRECT)
        self.bodies: list[Body] = []
        self.steps_taken = 0
        self.effector: Effector
        self.trace: list[GripperState] = []
        self.film: Callable[[GripperState], None] = _ignore
        self._task: PlayedTask | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect the physics client. Safe to call twice."""
        if self._client >= 0:
            p.disconnect(self._client)
            self._client = -1
            self._task = None

    @property
    def client(self) -> int:
        """The number of the physics client. Raises RuntimeError after `close`."""
        if self._client < 0:
            raise RuntimeError("the world is closed: make a new one")
        return self._client

    # Episodes

    @property
    def task(self) -> PlayedTask:
        """The task of the last `reset`. Raises RuntimeError before it."""
        if self._task is None:
            raise RuntimeError("the world has no task yet: call world.reset(task, seed) first")
        return self._task

    def reset(self, task: PlayedTask, seed: int) -> tuple[Observation, ...]:
        """Lay out an episode of ``task`` and observe it. All its random choices come from ``seed``."""
        self.begin(task, seed)
        return self.observe()

    def begin(self, task: PlayedTask, seed: int) -> None:
        """`reset` without pictures. Raises RuntimeError after `close`."""
        self.workspace = task.workspace
        self._seed = seed
        self.light = self.style.lamp.draw(self.style.light, self._random(LAMP_STREAM))
        self.gray = self._random(TABLE_STREAM).uniform(*self.style.grays)
        self.clear(self.style.tool(task.effector))
        self._task = task
        self.steps_taken = 0
        task.reset(self, np.random.default_rng(seed), seed)
        self.settle()
        # As in CLIPort, the first action is rewarded for what lies right from the beginning, too: a cube of a pile.
        self._score = 0.0

    def _random(self, stream: tuple[int, ...]) -> np.random.Generator:
        """Random numbers of the episode's seed that no other stream has."""
        return np.random.default_rng((self._seed, *stream))

    @abstractmethod
    def observe(self) -> tuple[Observation, ...]:
        """The views of the cameras of each table, in that table's own frame."""

    def as_measured(self, views: tuple[View, ...], table: int) -> Observation:
        """What the cameras of a table give for their true ``views``: with the errors of `Look.sensors`.

        They depend on the episode's seed, the table and, for what is new in each frame, the number of actions before.
        Looking twice gives the same.
        """
        seen = Observation(views)
        if not self.style.sensors or self._random(ERRING_STREAM).random() >= self.style.erring:
            return seen
        units_rng = self._random((*UNIT_STREAM, table))
        frame_rng = self._random((*FRAME_STREAM, table, self.steps_taken))
        units = draw_different_units(seen, self.style.sensors, units_rng)
        return corrupt(seen, units, frame_rng, self.light.brightness)

    def step(self, action: Action, watch: Watch = _ignore, last_look: bool = True) -> Step:
        """Carry out an action and score the result.

        Args:
            action: an action that the task's tool can carry out. Each pose is in the frame of its table.
            watch: called at the moments of the action.
            last_look: whether to observe the tables after the last action of an episode, too.

        Raises:
            ValueError: `check` refuses the action; nothing has moved.
            RuntimeError: there is no task yet.
        """
        self.check(action)
        held = None
        if isinstance(action, Push):
            self._push(action, watch)
        else:
            held = self._pick_and_place(action, watch)
        outcome = self.effector.outcome
        reward, done = self.conclude()
        watch("placed")
        observations = self.observe() if last_look or not done else ()
        return Step(observations, reward, done, held, tuple(self.trace), outcome)

    def check(self, action: Action) -> None:
        """Refuse an action that cannot be carried out.

        Raises:
            ValueError: the task's tool cannot carry it out, a table does not exist, a pose lies outside the workspace,
                a yaw is not finite, or a push has no length.
            RuntimeError: there is no task yet.
        """
        workspace = self.task.workspace
        if not isinstance(action, self.effector.actions):
            allowed = " or ".join(kind.__name__ for kind in self.effector.actions)
            tool = type(self.effector).__name__
            raise ValueError(f"action must be a {allowed} for the tool {tool}, got a {type(action).__name__}")
        for name, value in vars(action).items():  # poses, and the numbers of tables
            if not isinstance(value, Pose2):
                if not 0 <= value < len(self.tables):
                    raise ValueError(f"action.{name} must be in [0, {len(self.tables)}), got {value}")
            elif not workspace.contains(value.x, value.y):
                raise ValueError(f"action.{name} = {value} lies outside the workspace {workspace}")
            elif not math.isfinite(value.yaw):
                raise ValueError(f"action.{name} = {value} has a yaw that is not a finite number of radians")
        if isinstance(action, Push) and (action.start.x, action.start.y) == (action.end.x, action.end.y):
            raise ValueError(f"action.start and action.end must be different places, got {action.start} twice")

    @abstractmethod
    def reach(self, table: int) -> Pose2:
        """Bring the tool's base to a table.

        Returns:
            The table's pose in the base's frame, as the robot estimates it.
        """

    def _pick_and_place(self, action: PickPlace, watch: Watch) -> int | None:
        table_pose = self.reach(action.pick_table)
        self.trace.clear()
        grasped = self.effector.pick(self.base @ (table_pose @ action.pick), self.bodies)
        held = self.effector.held
        watch("picked")
        if grasped:
            if action.place_table != action.pick_table:
                table_pose = self.reach(action.place_table)
            self.effector.place(self.base @ (table_pose @ action.place))
        return held

    def _push(self, action: Push, watch: Watch) -> None:
        table_pose = self.reach(action.table)
        self.trace.clear()
        self.effector.push(self.base @ (table_pose @ action.start), self.base @ (table_pose @ action.end))
        watch("pushed")

    def conclude(self) -> tuple[float, bool]:
        """End an action: park the tool, let the bodies settle, score, and let the task go on to its next sentence.

        Returns:
            The change of the task's score since the last action, in [-1, 1], and whether the episode is over. The
            first change is counted from 0.
        """
        self.settle()  # Then the bodies sleep while the tool leaves, which saves much time.
        self.effector.park()
        self.settle()
        self.steps_taken += 1
        before = self._score
        self._score = self.task.score(self)
        self.task.advance(self)
        done = self._score > SOLVED or self.steps_taken >= self.task.max_steps
        return self._score - before, done

    # The scene

    @property
    def middle(self) -> Pose2:
        """The middle of a table, in the table's frame."""
        w = self.workspace
        return Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)

    @property
    def table_color(self) -> RGBA:
        """The colour of the tables in the present episode."""
        red, green, blue, alpha = TABLE_COLOR
        return self.gray * red, self.gray * green, self.gray * blue, alpha

    @abstractmethod
    def furnish(self) -> None:
        """Add the tables and the floor."""

    def clear(self, effector: str = "suction") -> None:
        """Reset the world to tables, floor and a tool. Raises ValueError if no tool has this name."""
        make_effector = EFFECTORS.find(effector)
        p.resetSimulation(physicsClientId=self.client)
        p.setGravity(0, 0, -9.8, physicsClientId=self.client)
        p.setTimeStep(1 / RATE, physicsClientId=self.client)
        self.bodies = []
        self.furnish()
        self.trace.clear()
        self.effector = make_effector(self.client, self.parked, self._log)

    def _log(self, state: GripperState) -> None:
        self.trace.append(state)
        self.film(state)

    def add_slab(self, pose: Pose2, half: tuple[float, float, float], top: float, color: RGBA, solid: bool) -> int:
        """Add a fixed box, its upper face at the height ``top``; visible only if not ``solid``. Returns its id."""
        common = dict(halfExtents=half, physicsClientId=self.client)
        visual = p.createVisualShape(p.GEOM_BOX, rgbaColor=color, **common)
        collision = p.createCollisionShape(p.GEOM_BOX, **common) if solid else -1
        position = (pose.x, pose.y, top - half[2])
        body = p.createMultiBody(0, collision, visual, position, quaternion(pose.yaw), physicsClientId=self.client)
        p.changeDynamics(body, -1, lateralFriction=1.0, physicsClientId=self.client)
        return body

    def add(self, body: Body) -> Body:
        """Register a body that was made in this environment's physics client."""
        if body.movable:
            p.changeDynamics(
                body.id, -1, activationState=p.ACTIVATION_STATE_ENABLE_SLEEPING, physicsClientId=self.client
            )
        self.bodies.append(body)
        return body

    def remove_bodies(self) -> None:
        """Take all bodies of the task away, so that it can lay out another scene. Tables and tool stay."""
        for body in self.bodies:
            p.removeBody(body.id, physicsClientId=self.client)
        self.bodies = []

    def _set_activation(self, state: int) -> None:
        for body in self.movable:
            p.changeDynamics(body, -1, activationState=state, physicsClientId=self.client)

    @property
    def movable(self) -> set[int]:
        """The ids of all movable bodies."""
        return {body.id for body in self.bodies if body.movable}

    def pose(self, body: Body) -> tuple[Pose2, float]:
        """The true pose of a body in the world, and the height z of its origin: for experts, rewards and tests."""
        (x, y, z), quat = p.getBasePositionAndOrientation(body.id, physicsClientId=self.client)
        return Pose2(x, y, p.getEulerFromQuaternion(quat)[2]), z

    def placement(self, body: Body) -> tuple[np.ndarray, np.ndarray]:
        """The true position (3,) (m) of a body in the world, and its rotation (3, 3): as `pose`, with its tilt."""
        position, turn = p.getBasePositionAndOrientation(body.id, physicsClientId=self.client)
        return np.array(position), np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)

    def on_table(self, pose: Pose2) -> tuple[Pose2, int]:
        """A pose in the world, converted for an action: the pose in the frame of its table, and that table's number.

        A pose beside all tables is given in the frame of the first table.
        """
        for number, table in enumerate(self.tables):
            local = table.inverse() @ pose
            if self.workspace.contains(local.x, local.y):
                return local, number
        return self.tables[0].inverse() @ pose, 0

    def settle(self) -> bool:
        """Simulate until every movable body rests, for at most `SETTLE_STEPS`. Returns whether all bodies rest.

        Then the bodies sleep: they cost no time until something touches them.
        """
        self._set_activation(p.ACTIVATION_STATE_WAKE_UP)
        for _ in range(SETTLE_STEPS // 10):
            for _ in range(10):
                p.stepSimulation(physicsClientId=self.client)
            speeds = [p.getBaseVelocity(body, physicsClientId=self.client)[0] for body in self.movable]
            if all(np.linalg.norm(speed) < SETTLED_SPEED for speed in speeds):
                self._set_activation(p.ACTIVATION_STATE_SLEEP)
                return True
        return False

    def wait(self, seconds: float) -> None:
        """Simulate for a fixed time. `settle` would stop too early for a body that begins to fall slowly."""
        for _ in range(round(RATE * seconds)):
            p.stepSimulation(physicsClientId=self.client)


def body_at(environment: Environment, pose: Pose2) -> int:
    """The id of the topmost body at a pose in the world, -1 if there is none. This is ground truth."""
    hit, *_ = p.rayTest((pose.x, pose.y, 0.5), (pose.x, pose.y, -0.01), physicsClientId=environment.client)
    return hit[0]
