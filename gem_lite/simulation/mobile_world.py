"""Several tables and a mobile base that drives between them, looks at their tags and reaches over them.

The base stands in for Spot (A.12): a box on four legs with a camera on a mast, only seen, never touched; its
arm is the floating tool of `gripper`. What the robot believes (where its camera sits) and what is true differ
by the errors of `RobotBody`. All that it is told to do, it does in the frame of its own base.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pybullet as p
import trimesh
from scipy.spatial.transform import Rotation

from gem_lite.demonstrations import GripperState
from gem_lite.rgbd.camera import Camera, View, as_pose, looking
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, quaternion
from gem_lite.simulation import tag_plates, worlds
from gem_lite.simulation.gripper import CLEARANCE
from gem_lite.simulation.rendering import LIGHT, Light, cameras_around, render
from gem_lite.simulation.shapes import create_compound, create_visual
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import Simulation
from gem_lite.simulation.worlds import TABLE_COLOR, WorldStyle

TABLE_HEIGHT = 0.7
"""Heights are measured from the tables' tops: the floor lies so far (m) below."""
FLANGE = 0.2
"""Width (m) of the board along each table's front edge (x_max) that carries its tag."""
STAND = 0.55
"""Distance (m) of the base from the front edge when it works at a table."""
CARRY = Pose2(-0.2, 0.0)
"""Where the tool waits in the base's frame while the base drives: behind the mast, out of its camera's sight."""
HOME = Pose2(1.5, -2.0, math.pi)
"""Where the base waits, in the first table's frame: out of the sight of the tables' cameras."""
BODY_COLOR, LEG_COLOR = (0.85, 0.68, 0.12, 1.0), (0.15, 0.15, 0.16, 1.0)


def mast_camera(height: float = 0.6, pitch: float = math.radians(50)) -> Camera:
    """The body camera in the base's frame (x forward, y left, z up from the tables' tops), looking down ahead.

    Args:
        height: metres above the tables' tops.
        pitch: radians below the horizon.
    """
    level = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # camera axes of a level look along +x
    turn = Rotation.from_euler("y", pitch) * level
    return Camera.pinhole("body", (0.1, 0.0, height), turn.as_quat())


@dataclass(frozen=True)
class RobotBody:
    """The robot's body: what it believes of its camera, and by how much that is wrong.

    Attributes:
        camera: where the robot believes its camera to be, in the base's frame.
        camera_offset: the calibration's error: the true camera is moved so in the base's frame.
        camera_noise: standard deviation of each pixel's value (0-255).
        odometry: standard deviation (m, radians) of where the base stops.
    """

    camera: Camera = field(default_factory=mast_camera)
    camera_offset: Pose2 = field(default_factory=lambda: Pose2(0.0, 0.0))
    camera_noise: float = 0.0
    odometry: tuple[float, float] = (0.02, math.radians(3))


def side_by_side(count: int, gap: float = 0.4, length: float = 1.06) -> tuple[Pose2, ...]:
    """``count`` tables in a row along y, ``gap`` metres apart, all facing +x; the first is the world's frame."""
    return tuple(Pose2(0.0, i * (length + gap)) for i in range(count))


@dataclass(frozen=True)
class MobileStep:
    """What an act over several tables led to: see `world.Step`."""

    reward: float
    done: bool
    grasped: bool
    trace: tuple[GripperState, ...]


class MobileWorld(Simulation):
    """Several tables, each with three cameras and a tag, and the base.

    Table i carries the tag with number i. A table's frame is that of a `World` with this table alone. A task that
    is made for one table lies on the first; object-sorting is spread over all.

    Args:
        tables: where the tables' frames are in the world. The first is the world's frame.
        body: the robot's body and its errors.
        style: how scenes look and lie.

    Raises:
        ValueError: no table, or the first one elsewhere.
    """

    def __init__(
        self, tables: Sequence[Pose2] = side_by_side(2), body: RobotBody = RobotBody(), gui: bool = False,
        style: WorldStyle = worlds.HOME,
    ) -> None:  # fmt: skip
        super().__init__(gui, style)
        if not tables:
            raise ValueError("tables is empty: a world needs at least one")
        if tables[0] != Pose2(0.0, 0.0):
            raise ValueError(f"tables[0] must be the world's frame, {Pose2(0.0, 0.0)}, got {tables[0]}")
        self.tables, self.body = tuple(tables), body
        self.tags = tuple(range(len(self.tables)))
        self.base = self.tables[0] @ HOME
        over = self.base @ CARRY
        self.parked = (over.x, over.y, CLEARANCE)

    def furnish(self) -> None:
        """See `Simulation`."""
        w = self.workspace
        half = ((w.x_max - w.x_min) / 2, (w.y_max - w.y_min) / 2)
        for table, number in zip(self.tables, self.tags, strict=True):
            middle = table @ Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)
            self.add_slab(middle, (*half, 0.02), 0.0, TABLE_COLOR, solid=True)
            flange = table @ Pose2(w.x_max + FLANGE / 2, (w.y_min + w.y_max) / 2)
            self.add_slab(flange, (FLANGE / 2, FLANGE / 2, 0.02), -0.001, TABLE_COLOR, solid=True)
            tag_plates.add_tag(self.client, number, table @ self.tag)
        self.add_slab(self.tables[0], (20.0, 20.0, 0.05), -TABLE_HEIGHT, self.style.floor, solid=True)
        self._base = add_base(self.client, self.body.camera)
        self._move_base(self.tables[0] @ HOME)

    @property
    def tag(self) -> Pose2:
        """A table's tag in that table's frame, the same on all."""
        w = self.workspace
        return Pose2(w.x_max + FLANGE / 2, (w.y_min + w.y_max) / 2)

    def begin(self, task: Task, seed: int) -> None:
        """Lay out an episode of ``task``; everything random in it comes from ``seed``."""
        self._rng = np.random.default_rng((seed, len(self.tables)))
        super().begin(task, seed)
        self._grasped = False

    def reset(self, task: Task, seed: int) -> tuple[Observation, ...]:
        """`begin`, and look at it."""
        self.begin(task, seed)
        return self.observe()

    def observe(self) -> tuple[Observation, ...]:
        """What the three cameras of each table see, in that table's own frame."""
        cameras = cameras_around(self.workspace)
        light = self.style.light
        return tuple(
            Observation(tuple(take(self.client, camera, table, light) for camera in cameras)) for table in self.tables
        )

    def photograph(self) -> np.ndarray:
        """(H, W, 3) uint8: tables and robot from outside, for figures."""
        middles = [table @ Pose2(self.workspace.x_max, 0.0) for table in self.tables]
        x, y = np.mean([(at.x, at.y) for at in middles], axis=0)
        away = 1.2 + max(np.hypot(at.x - x, at.y - y) for at in middles)
        camera = looking("outside", (x - away, y + 0.85 * away, 0.65 * away), (x, y - 0.22 * away, -0.45))
        return render(self.client, camera, self.style.light)[0].rgb

    def drive(self, table: int, sideways: float = 0.0) -> None:
        """Bring the base before a table, as near to where it is meant to stop as its odometry allows.

        What the tool holds comes along.

        Args:
            sideways: metres along the table's front edge.

        Raises:
            IndexError: no such table.
        """
        w, (shift, turn) = self.workspace, self.body.odometry
        meant = Pose2(w.x_max + STAND, (w.y_min + w.y_max) / 2 + sideways, math.pi)
        missed = Pose2(*self._rng.normal(0, shift, 2), self._rng.normal(0, turn))
        self._move_base(self.tables[table] @ meant @ missed)
        self.gripper.carry(self.base @ CARRY)

    def look(self) -> View:
        """What the body camera sees, in the base's frame and as if the camera were where the robot believes."""
        view = take(self.client, self.body.camera, self.base @ self.body.camera_offset, self.style.light)
        noise = self._rng.normal(0, self.body.camera_noise, view.rgb.shape) if self.body.camera_noise else 0
        return replace(view, rgb=np.clip(np.round(view.rgb + noise), 0, 255).astype(np.uint8))

    def true_table(self, table: int) -> Pose2:
        """A table's frame in the base's, from the simulator's truth: for comparisons, no robot knows it."""
        return self.base.inverse() @ self.tables[table]

    def pick(self, pose: Pose2) -> bool:
        """Reach for a pose in the base's frame. True if something is held."""
        self.gripper.trace.clear()
        self._grasped = self.gripper.pick(self.base @ pose, self.movable)
        return self._grasped

    def place(self, pose: Pose2) -> None:
        """Put what is held at a pose in the base's frame."""
        self.gripper.place(self.base @ pose)

    def finish(self) -> MobileStep:
        """Drive home and `conclude`: the next `observe` shows what the act led to."""
        self._move_base(self.tables[0] @ HOME)
        reward, done = self.conclude()
        return MobileStep(reward, done, self._grasped, tuple(self.gripper.trace))

    def _move_base(self, pose: Pose2) -> None:
        self.base = pose
        at, turn = (pose.x, pose.y, 0.0), quaternion(pose.yaw)
        p.resetBasePositionAndOrientation(self._base, at, turn, physicsClientId=self.client)


def placed(camera: Camera, frame: Pose2) -> Camera:
    """A camera given in a frame that lies at ``frame`` in the world, as the world sees it."""
    x, y, z = camera.position
    at = frame @ Pose2(x, y)
    turn = Rotation.from_euler("z", frame.yaw).as_matrix() @ camera.rotation
    return replace(camera, pose=as_pose(turn, (at.x, at.y, z)))


def take(client: int, camera: Camera, frame: Pose2, light: Light = LIGHT) -> View:
    """A picture by a camera given in a frame; its view is in that frame, too."""
    view, _ = render(client, placed(camera, frame), light)
    return replace(view, camera=camera)


def add_base(client: int, camera: Camera) -> int:
    """The robot's body in the base's frame, to be seen only; returns its id."""
    top = camera.position[2]
    trunk = [((-0.50, -0.14, -0.36), (0.34, 0.14, -0.20))]
    dark = [((-0.06, -0.02, -0.20), (-0.02, 0.02, top)), ((-0.06, -0.09, top - 0.03), (0.03, 0.09, top + 0.03))]
    for x in (-0.44, 0.28):
        dark += [((x - 0.03, y - 0.03, -TABLE_HEIGHT), (x + 0.03, y + 0.03, -0.36)) for y in (-0.16, 0.16)]
    meshes = [trimesh.util.concatenate([trimesh.creation.box(bounds=one) for one in boxes]) for boxes in (trunk, dark)]
    visuals = [create_visual(client, mesh, c, 0.0) for mesh, c in zip(meshes, (BODY_COLOR, LEG_COLOR), strict=True)]
    return create_compound(client, -1, visuals, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), 0.0)
