"""Several tables and a mobile base that drives between them, looks at their tags and works on them.

The base replaces Spot (A.12). It is a box on four legs with a camera on a mast. It is visible, but nothing can touch
it. Its arm is the floating tool of `effectors`. The true pose of its camera differs from the pose that the robot
assumes by the errors of `RobotBody`. The robot carries out every action in the frame of its own base.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation
from typing_extensions import override

from gem_lite.rgbd.camera import Camera, View, as_pose
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.tags import LocalisationError, table_in_base
from gem_lite.se2 import Pose2, quaternion
from gem_lite.simulation.bodies import tag_plates
from gem_lite.simulation.bodies.shapes import boxes_mesh, create_body, create_visual
from gem_lite.simulation.effectors import CLEARANCE
from gem_lite.simulation.environment import Environment, PlayedTask
from gem_lite.simulation.looks import HOME as HOME_STYLE
from gem_lite.simulation.looks import Look
from gem_lite.simulation.rendering import cameras_around, render

TABLE_HEIGHT = 0.7
"""Height (m) of the tables' tops above the floor. All heights are measured from the tables' tops."""
FLANGE = 0.2
"""Width (m) of the board along each table's front edge (x_max) that carries its tag."""
STAND = 0.55
"""Distance (m) of the base from a table's front edge when it works there."""
SIDESTEPS = (0.0, 0.15, -0.15)
"""The places along a table's edge (m) from which the robot looks for the tag, in this order."""
CARRY = Pose2(-0.2, 0.0)
"""The pose of the tool in the base's frame while the base drives: behind the mast, where its camera does not see it."""
HOME = Pose2(1.5, -2.0, math.pi)
"""The pose where the base waits, in the first table's frame. The tables' cameras do not see it there."""
BODY_COLOR = (0.85, 0.68, 0.12, 1.0)
LEG_COLOR = (0.15, 0.15, 0.16, 1.0)
_LEVEL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # the axes of a level camera that looks along +x
_DOWN = Rotation.from_euler("y", math.radians(50))
MAST_CAMERA = Camera.pinhole("body", (0.1, 0.0, 0.6), (_DOWN * _LEVEL).as_quat())
"""The body camera in the base's frame (x forward, y left, z up from the tables' tops). It looks ahead and down."""


@dataclass(frozen=True)
class RobotBody:
    """The robot's body and its errors.

    Attributes:
        camera: the camera as the robot assumes it, in the base's frame.
        camera_offset: the error of the camera's calibration: the true camera is moved by it in the base's frame.
        camera_noise: standard deviation of each pixel's value (0-255).
        odometry: standard deviation (m, radians) of the place where the base stops.
    """

    camera: Camera = MAST_CAMERA
    camera_offset: Pose2 = field(default_factory=lambda: Pose2(0.0, 0.0))
    camera_noise: float = 0.0
    odometry: tuple[float, float] = (0.02, math.radians(3))


def side_by_side(count: int, gap: float = 0.4, length: float = 1.06) -> tuple[Pose2, ...]:
    """``count`` tables in a row along y, ``gap`` metres apart, all facing +x; the first is the world's frame."""
    return tuple(Pose2(0.0, i * (length + gap)) for i in range(count))


Finder = Callable[["MobileWorld", int], Pose2]
"""How a robot finds a table: it drives to the table and returns the table's pose in the base's frame."""


def localise(world: MobileWorld, table: int) -> Pose2:
    """A `Finder` that looks for the table's tag (A.12). If the tag is not seen, it tries the next of `SIDESTEPS`.

    Raises:
        LocalisationError: the tag was not found from any of `SIDESTEPS`.
    """
    failures = []
    for sideways in SIDESTEPS:
        world.drive(table, sideways)
        try:
            return table_in_base(world.look(), world.tags[table], world.tag)
        except LocalisationError as error:
            failures.append(f"{100 * sideways:+.0f} cm aside: {error}")
    raise LocalisationError(f"table {table} cannot be localised; " + "; ".join(failures))


def ask_simulator(world: MobileWorld, table: int) -> Pose2:
    """A `Finder` that takes the true pose from the simulator, for comparisons."""
    world.drive(table)
    return world.true_table(table)


def disturbed(find: Finder, error: Pose2) -> Finder:
    """A `Finder` whose poses are wrong by ``error``: a shift, and a turn about the table's middle."""

    def find_with_error(world: MobileWorld, table: int) -> Pose2:
        return find(world, table) @ world.middle @ error @ world.middle.inverse()

    return find_with_error


class MobileWorld(Environment):
    """Several tables, each with its cameras and a tag, and the base.

    Table i has the tag with number i. A table's frame is the same as in a `World` with this table alone. A task for
    one table uses the first table; object-sorting uses all tables.

    Args:
        tables: the poses of the tables' frames in the world. The first is the world's frame.
        body: the robot's body and its errors.
        find: drives the robot to a table and returns the table's pose in the base's frame. It may be set between
            episodes. Its error (`localise`: LocalisationError) ends the `step` and the episode.
        style: the looks and the layout of the scenes.

    Raises:
        ValueError: there is no table, the first table's frame is not the world's, or a tool stands at one table.
    """

    def __init__(
        self, tables: Sequence[Pose2] = side_by_side(2), body: RobotBody = RobotBody(), find: Finder = localise,
        style: Look = HOME_STYLE,
    ) -> None:  # fmt: skip
        if not tables:
            raise ValueError("tables is empty: a world needs at least one")
        if tables[0] != Pose2(0.0, 0.0):
            raise ValueError(f"tables[0] must be the world's frame, {Pose2(0.0, 0.0)}, got {tables[0]}")
        if any(tool == "panda" for _, tool in style.tools):
            raise ValueError(f"style must have tools that a robot carries; in {style.name!r} it stands at one table")
        super().__init__(style)  # It opens a simulator, which nobody could close after a refusal.
        self.tables = tuple(tables)
        self.body = body
        self.find = find
        self.tags = tuple(range(len(self.tables)))
        self.base = self.tables[0] @ HOME
        tool = self.base @ CARRY
        self.parked = (tool.x, tool.y, CLEARANCE)

    @override
    def furnish(self) -> None:
        w = self.workspace
        half = ((w.x_max - w.x_min) / 2, (w.y_max - w.y_min) / 2)
        for table, number in zip(self.tables, self.tags, strict=True):
            self.add_slab(table @ self.middle, (*half, 0.02), 0.0, self.table_color, solid=True)
            self.add_slab(table @ self.tag, (FLANGE / 2, FLANGE / 2, 0.02), -0.001, self.table_color, solid=True)
            tag_plates.add_tag(self.client, number, table @ self.tag)
        self.add_slab(self.tables[0], (20.0, 20.0, 0.05), -TABLE_HEIGHT, self.style.floor, solid=True)
        self._base = add_base(self.client, self.body.camera)
        self._move_base(self.tables[0] @ HOME)

    @property
    def tag(self) -> Pose2:
        """A table's tag in that table's frame, the same on all."""
        return Pose2(self.workspace.x_max + FLANGE / 2, self.middle.y)

    @override
    def begin(self, task: PlayedTask, seed: int) -> None:
        self._rng = np.random.default_rng((seed, len(self.tables)))
        super().begin(task, seed)

    @override
    def observe(self) -> tuple[Observation, ...]:
        cameras = cameras_around(self.workspace, self.style.cameras)
        seen = []
        for number, table in enumerate(self.tables):
            views = tuple(self._take_picture(camera, table) for camera in cameras)
            seen.append(self.as_measured(views, number))
        return tuple(seen)

    @override
    def reach(self, table: int) -> Pose2:
        """Drive to a table and find its pose with `find`. Raises the errors of `find`."""
        return self.find(self, table)

    def drive(self, table: int, sideways: float = 0.0) -> None:
        """Drive the base to a table. Its odometry decides how far from the planned pose it stops.

        The tool and the held body move with the base.

        Args:
            sideways: metres along the table's front edge.

        Raises:
            IndexError: there is no such table.
        """
        shift, turn = self.body.odometry
        planned = Pose2(self.workspace.x_max + STAND, self.middle.y + sideways, math.pi)
        error = Pose2(*self._rng.normal(0, shift, 2), self._rng.normal(0, turn))
        self._move_base(self.tables[table] @ planned @ error)
        self.effector.carry(self.base @ CARRY)

    def look(self) -> View:
        """The view of the body camera, in the base's frame. It carries the camera's assumed pose, not the true one."""
        view = self._take_picture(self.body.camera, self.base @ self.body.camera_offset)
        noise = self._rng.normal(0, self.body.camera_noise, view.rgb.shape) if self.body.camera_noise else 0
        return replace(view, rgb=np.clip(np.round(view.rgb + noise), 0, 255).astype(np.uint8))

    def true_table(self, table: int) -> Pose2:
        """The true pose of a table in the base's frame, for comparisons: no robot knows it."""
        return self.base.inverse() @ self.tables[table]

    @override
    def conclude(self) -> tuple[float, bool]:
        self._move_base(self.tables[0] @ HOME)
        return super().conclude()

    def _move_base(self, pose: Pose2) -> None:
        self.base = pose
        position = (pose.x, pose.y, 0.0)
        p.resetBasePositionAndOrientation(self._base, position, quaternion(pose.yaw), physicsClientId=self.client)

    def _take_picture(self, camera: Camera, frame: Pose2) -> View:
        """The view of a camera whose pose is given in ``frame``. The view is in that frame, too."""
        x, y, z = camera.position
        position = frame @ Pose2(x, y)
        rotation = Rotation.from_euler("z", frame.yaw).as_matrix() @ camera.rotation
        in_world = replace(camera, pose=as_pose(rotation, (position.x, position.y, z)))
        return replace(render(self.client, in_world, self.light)[0], camera=camera)


def add_base(client: int, camera: Camera) -> int:
    """Add the robot's visible body, in the base's frame. Returns its id."""
    top = camera.position[2]
    trunk = [((-0.50, -0.14, -0.36), (0.34, 0.14, -0.20))]
    dark = [((-0.06, -0.02, -0.20), (-0.02, 0.02, top)), ((-0.06, -0.09, top - 0.03), (0.03, 0.09, top + 0.03))]
    for x in (-0.44, 0.28):
        dark += [((x - 0.03, y - 0.03, -TABLE_HEIGHT), (x + 0.03, y + 0.03, -0.36)) for y in (-0.16, 0.16)]
    colored = ((trunk, BODY_COLOR), (dark, LEG_COLOR))
    visuals = [create_visual(client, boxes_mesh(boxes), color, 0.0) for boxes, color in colored]
    return create_body(client, -1, visuals, Pose2(0.0, 0.0), 0.0, 0.0, movable=False).id
