"""A table of MuJoCo that acts: a tool picks and places by physics."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import mujoco
import numpy as np

from .tables import CAMERAS, INNER, Scene, camera_pose, free_body, intrinsics, model_of, picture, random_scene

HOME = 0.32
"""The tool's tip travels at this height above the table (m)."""
SUCTION, CLEAR = 0.010, 0.001
"""The cup holds a thing whose surface is at most this far (m) below the tip; the tip stops this far (m) above it."""
REST = 0.004
"""A thing rests if it is slower (m/s, and ten times as many rad/s)."""
FARTHEST = 5.0
"""A depth camera reaches as far (m)."""
ROD = '<geom type="capsule" size="0.005 0.05" pos="0 0 -0.055" group="3"/>'
"""The tool's shape: a rod that is not drawn."""
DRAWN = np.array([1, 1, 1, 0, 0, 0], np.uint8)
"""The groups of geometries that are drawn. Only they stop a ray: the hidden ones are rougher."""


@dataclass(frozen=True)
class Look:
    """What the cameras see, one entry of each list for each camera.

    Attributes:
        colors: (H, W, 3) uint8 RGB.
        depths: (H, W) float32 metres along the camera's axis; 0 beyond `FARTHEST`.
        intrinsics: (3, 3) pixels.
        poses: (4, 4) from the camera's axes (x right, y down, z forward) to the table's frame (m).
        names: of the cameras.
    """

    colors: list[np.ndarray]
    depths: list[np.ndarray]
    intrinsics: list[np.ndarray]
    poses: list[np.ndarray]
    names: list[str]


def tool_pose(x: float, y: float, yaw: float, z: float) -> np.ndarray:
    """(4, 4) pose of a tool that points down to the table (metres, radians)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, sin, 0, x], [sin, -cos, 0, y], [0, 0, -1, z], [0, 0, 0, 1.0]])


def acting_model(scene: Scene, bodies: str, things: int, tool: str = ROD, more: str = "") -> mujoco.MjModel:
    """The table with bodies, a tool, and a weld between the tool and each thing that is off.

    Args:
        bodies: as MJCF, those that move as "thing0", "thing1" and so on, one after the other.
        things: how many move.
        tool: the shape of the tool, as MJCF; the origin of its frame is the tip, and z points down to the table.
        more: sections of the model, as MJCF.
    """
    holder = f'<body name="tool" mocap="true" pos="0.5 0 {HOME}" quat="0 1 0 0">{tool}</body>'
    welds = "".join(f'<weld body1="tool" body2="thing{number}" active="false"/>' for number in range(things))
    option = '<option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="5"/>'
    return model_of(scene, bodies + holder, f"{option}<equality>{welds}</equality>{more}")


class ActingTable(AbstractContextManager):
    """A table of MuJoCo on which a tool picks and places. Call `load` first, and `close` at the end.

    Attributes:
        held: the number of the thing that the tool holds; None if it holds nothing.
    """

    def __init__(self) -> None:
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free what rendering holds."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers = {}

    def load(self, model: mujoco.MjModel, things: int) -> None:
        """Take a model of `acting_model` with its number of things, and let all come to rest. Nothing is rendered."""
        self.close()
        self.held = None
        self._things = range(things)
        self._model = model
        self._data = mujoco.MjData(model)
        self.settle()

    def look(self) -> Look:
        """What the cameras see now."""
        colors, depths = [], []
        for name, (_, _, size, _) in CAMERAS.items():
            if size not in self._renderers:
                self._renderers[size] = mujoco.Renderer(self._model, *size)
            rgb, depth = picture(self._renderers[size], self._data, name)
            colors.append(rgb)
            depths.append(np.where(depth < FARTHEST, depth, np.float32(0)))
        return Look(colors, depths, list(map(intrinsics, CAMERAS)), list(map(camera_pose, CAMERAS)), list(CAMERAS))

    def on_surface(self, x: float, y: float, yaw: float) -> np.ndarray:
        """(4, 4) pose of a tool that touches what truly lies at a place (metres, radians)."""
        return tool_pose(x, y, yaw, HOME - self._below(np.array([x, y, HOME]))[0])

    def pick_place(self, pick: np.ndarray, place: np.ndarray) -> bool:
        """Pick and place with the tool, until all things rest.

        The tool goes down to the pick's height, or to what it meets before. Its cup holds what is at most `SUCTION`
        below. It carries that to the place, turned by the difference of the yaws, and lowers it until it touches
        something or stands at the place's height. The tool takes its thing to have stood on the table.

        Args:
            pick, place: (4, 4) tool poses in the table's frame (m). Only the translation and the yaw matter. The height
                is that of the surface below the tool.

        Returns:
            Whether the tool held something.
        """
        (pick_x, pick_y, pick_z), pick_yaw = _planar(pick, "pick")
        (place_x, place_y, place_z), place_yaw = _planar(place, "place")
        self._data.mocap_pos[0] = pick_x, pick_y, HOME
        self._data.mocap_quat[0] = tool_down(pick_yaw)
        self._move((pick_x, pick_y, pick_z + CLEAR), pick_yaw, 0.25, self._meets)
        tip = self._data.mocap_pos[0].copy()
        self.held = self._suck()
        self._move((tip[0], tip[1], HOME), pick_yaw, 0.25)
        picked = self.held is not None
        if picked:
            turn = (place_yaw - pick_yaw + math.pi) % (2 * math.pi) - math.pi
            self._move((place_x, place_y, HOME), pick_yaw + turn, 0.4)
            name = f"thing{self.held}"
            carried = self._contacts(name)
            # A little lower than the map says, so that it is the touch that ends the way down.
            goal = (place_x, place_y, place_z + tip[2] - 0.003)
            self._move(goal, pick_yaw + turn, 0.12, lambda: bool(self._contacts(name) - carried))
            self._data.eq_active[self.held], self.held = 0, None
            self._move((place_x, place_y, HOME), pick_yaw + turn, 0.25)
        self.settle()
        return picked

    def settle(self, longest: float = 4.0) -> None:
        """Let physics run until all things rest for a tenth of a second, or ``longest`` seconds have passed."""
        calm = 0
        for _ in range(int(longest / self._model.opt.timestep)):
            mujoco.mj_step(self._model, self._data)
            calm = calm + 1 if self._speeds().max() < REST else 0
            if calm >= 50:
                return

    def _speeds(self) -> np.ndarray:
        """(N,) each thing's speed (m/s); a tenth of its turning (rad/s) if that is more."""
        velocities = self._data.qvel.reshape(-1, 2, 3)
        return (np.linalg.norm(velocities, axis=2) * (1.0, 0.1)).max(axis=1)

    def _move(self, goal: tuple[float, ...], yaw: float, speed: float, stop: Callable[[], bool] = bool) -> None:
        """Drive the tool's tip to a place (m) in a straight line, at most ``speed`` m/s, or until ``stop``."""
        start, quat = self._data.mocap_pos[0].copy(), self._data.mocap_quat[0].copy()
        start_yaw = 2 * math.atan2(quat[2], quat[1])
        turn = (yaw - start_yaw + math.pi) % (2 * math.pi) - math.pi
        seconds = 1.5 * max(math.dist(start, goal) / speed, abs(turn) / 2.0)
        steps = max(1, math.ceil(seconds / self._model.opt.timestep))
        for step in range(1, steps + 1):
            if stop():
                return
            share = step / steps
            share *= share * (3 - 2 * share)  # starts and ends at rest
            self._data.mocap_pos[0] = start + share * (np.array(goal) - start)
            self._data.mocap_quat[0] = tool_down(start_yaw + share * turn)
            mujoco.mj_step(self._model, self._data)

    def _below(self, point: np.ndarray) -> tuple[float, int]:
        """How far below a point (m) the next surface is, and the body that has it."""
        down, geom, tool = np.array([0, 0, -1.0]), np.zeros(1, np.int32), self._model.body("tool").id
        far = mujoco.mj_ray(self._model, self._data, point, down, DRAWN, 1, tool, geom)
        return (float(far), int(self._model.geom_bodyid[geom[0]])) if geom[0] >= 0 else (math.inf, 0)

    def _meets(self) -> bool:
        """Whether the tool's tip is just above a surface, or touches one."""
        return self._below(self._data.mocap_pos[0])[0] <= 1.5 * CLEAR or bool(self._contacts("tool"))

    def _suck(self) -> int | None:
        """Hold the thing below the tip, as it lies. Returns its number."""
        mujoco.mj_forward(self._model, self._data)
        far, body = self._below(self._data.mocap_pos[0])
        number = body - self._model.body("thing0").id
        if far > SUCTION or number not in self._things:
            return None
        tool, thing = self._data.body("tool"), self._data.body(body)
        quat = np.zeros(4)
        mujoco.mju_mulQuat(quat, tool.xquat * [1, -1, -1, -1], thing.xquat)
        place = tool.xmat.reshape(3, 3).T @ (thing.xpos - tool.xpos)
        self._model.eq_data[number, :10] = [0, 0, 0, *place, *quat]
        self._data.eq_active[number] = 1
        return number

    def _contacts(self, name: str) -> set[int]:
        """The bodies that touch a body."""
        pairs = self._model.geom_bodyid[self._data.contact.geom].reshape(-1, 2)
        own = self._model.body(name).id
        touching = pairs[(pairs == own).any(axis=1)]
        return set(touching[touching != own].tolist())


class ForeignWorld(ActingTable):
    """An `ActingTable` with blocks and bowls. Call `reset` first, and `close` at the end.

    Attributes:
        scene: the table as it was laid: its first thing is the named block, its second the named bowl.
    """

    def reset(self, seed: int) -> Look:
        """Lay the table of a seed, let all come to rest, and look."""
        self.lay(random_scene(seed))
        return self.look()

    def lay(self, scene: Scene) -> None:
        """Lay a table: its first thing is the named block, its second the named bowl. Nothing is rendered."""
        if [thing.kind for thing in scene.things[:2]] != ["block", "bowl"]:
            raise ValueError("the first thing must be the named block, and the second the named bowl")
        self.scene = scene
        bodies = "".join(free_body(number, thing) for number, thing in enumerate(scene.things))
        self.load(acting_model(scene, bodies, len(scene.things)), len(scene.things))

    @property
    def sentence(self) -> str:
        """What the episode asks for."""
        block, bowl = self.scene.things[:2]
        return f"put the {block.color} block in the {bowl.color} bowl"

    def pose(self, number: int) -> np.ndarray:
        """(4, 4) true pose of a thing (m). Its origin is where its middle touches the table."""
        pose, body = np.eye(4), self._data.body(f"thing{number}")
        pose[:3, :3], pose[:3, 3] = body.xmat.reshape(3, 3), body.xpos
        return pose

    def expert(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """The true pick and place: (x, y, yaw) in metres and radians. The block is not turned."""
        block, bowl = self.pose(0), self.pose(1)
        yaw = (math.atan2(block[1, 0], block[0, 0]) + math.pi / 4) % (math.pi / 2) - math.pi / 4
        x, y, _ = (block @ [0, 0, 0.024, 1])[:3]
        return (float(x), float(y), yaw), (float(bowl[0, 3]), float(bowl[1, 3]), yaw)

    def solved(self) -> bool:
        """Whether no tool holds the named block, and it rests with its centre below and within the bowl's rim."""
        bowl = self.pose(1)
        x, y, z = (np.linalg.inv(bowl) @ self.pose(0) @ [0, 0, 0.024, 1])[:3]
        inside = math.hypot(x, y) < INNER[0] and 0 < z < INNER[1] and bowl[2, 2] > 0.95
        return bool(inside and self.held != 0 and self._speeds()[0] < 5 * REST)


def tool_down(yaw: float) -> np.ndarray:
    """(4,) quaternion (w first) of a tool that points down."""
    return np.array([0.0, math.cos(yaw / 2), math.sin(yaw / 2), 0.0])


def _planar(pose: np.ndarray, name: str) -> tuple[tuple[float, float, float], float]:
    """The place (m) and the yaw (radians) of a tool's pose."""
    pose = np.asarray(pose, float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(f"{name} must be a (4, 4) pose of finite numbers, got {pose.tolist()}")
    return (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3])), math.atan2(pose[1, 0], pose[0, 0])
