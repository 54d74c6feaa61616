"""A table of MuJoCo on which a task of gem_lite lays out its goals: what such a task asks of an environment is here."""

from __future__ import annotations

import math

import numpy as np
import trimesh
from foreign_world import tables
from foreign_world.world import HOME, ROD, ActingTable, acting_model, tool_down

from gem_lite.actions import Action, Push
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.tasks.task import Task

LOOKS = ("kitchen", "nursery", "workshop")
"""The looks whose tables are not brown: tasks name brown things."""
CUP_RADIUS = 0.005
CUP = np.array([(0.0, 0.0, 0.0), *((CUP_RADIUS * math.cos(turn), CUP_RADIUS * math.sin(turn), 0.0)
                                   for turn in np.arange(8) * math.pi / 4)])  # fmt: skip
"""The middle of the cup, and points of its rim (m)."""
BLADE = '<geom type="box" size="0.004 0.026 0.05" pos="0 0 -0.05" group="3" friction="0.3"/>'
"""The shape of the tool that pushes; its edge is across the way."""
RUN_UP = 0.02
"""A push begins this far (m) behind its start, so that the blade does not come down on the thing to push."""
BLADE_ABOVE = 0.002
"""The height (m) of the blade's lower edge over the table when it pushes."""
UPRIGHT = 0.7
"""An axis with a larger vertical part than this stands."""


class TaskTable(ActingTable):
    """The table as a task sees it. Call `begin` first, and `close` at the end.

    Attributes:
        workspace: the part of the table on which things lie.
    """

    workspace = Workspace()

    def begin(self, task: Task, seed: int) -> None:
        """Lay out the episode of a seed, and let all come to rest."""
        rng = np.random.default_rng(seed)
        self._meshes: list[str] = []
        self._fixed: list[str] = []
        self._moving: list[str] = []
        task.reset(self, rng, seed)
        bodies = "".join([*self._fixed, *self._moving])
        scene = tables.Scene(*tables.random_look(rng, LOOKS), ())
        tool = BLADE if task.effector == "spatula" else ROD
        assets = f"<asset>{''.join(self._meshes)}</asset>"
        self.load(acting_model(scene, bodies, len(self._moving), tool, assets), len(self._moving))

    # What a task does while it lays out

    def mesh(self, solid: trimesh.Trimesh) -> str:
        """Register a mesh. Returns its name."""
        name = f"solid{len(self._meshes)}"
        self._meshes.append(tables.mesh(name, solid.vertices, solid.faces.tolist()))
        return name

    def fix(self, shapes: str, pose: Pose2, height: float = 0.0) -> None:
        """Put fixed shapes, as MJCF, on the table: their z = 0 at ``height`` (m)."""
        self._fixed.append(f"<body {_at(pose, height)}>{shapes}</body>")

    def put(self, shapes: str, pose: Pose2, height: float = 0.0) -> Body:
        """Put a thing that moves on the table: shapes as MJCF, their z = 0 at ``height`` (m)."""
        number = len(self._moving)
        self._moving.append(f'<body name="thing{number}" {_at(pose, height)}><freejoint/>{shapes}</body>')
        return Body(number, 0.0, True)

    # What goals ask

    def add(self, body: Body) -> Body:
        """A task registers its bodies with an environment. Here, `put` did."""
        return body

    def pose(self, body: Body) -> tuple[Pose2, float]:
        """The true pose of a thing seen from above, and the height (m) of its middle."""
        thing = self._data.body(f"thing{body.id}")
        turn = thing.xmat.reshape(3, 3)
        # A block that fell onto its side may stand on its x axis.
        axis = turn[:, 1] if abs(turn[2, 0]) > UPRIGHT else turn[:, 0]
        x, y, z = thing.xipos.tolist()
        return Pose2(x, y, math.atan2(axis[1], axis[0])), z

    def on_table(self, pose: Pose2) -> tuple[Pose2, int]:
        """A pose in the world, in the frame of a table, and that table's number: there is one."""
        return pose, 0

    # Acts

    def act(self, action: Action) -> bool:
        """Carry out an action at the heights of what truly lies there. Returns whether it moved or held something."""
        if isinstance(action, Push):
            self.push(action)
            return True
        pick, place = (self.on_surface(pose.x, pose.y, pose.yaw) for pose in (action.pick, action.place))
        return self.pick_place(pick, place)

    def push(self, action: Push) -> None:
        """Go down `RUN_UP` behind the start until the blade meets something, move to the end, and rise."""
        start, end = action.start, action.end
        yaw = math.atan2(end.y - start.y, end.x - start.x)
        behind = Pose2(start.x, start.y, yaw) @ Pose2(-RUN_UP, 0.0)
        self._data.mocap_pos[0] = behind.x, behind.y, HOME
        self._data.mocap_quat[0] = tool_down(yaw)
        self._move((behind.x, behind.y, BLADE_ABOVE), yaw, 1.0, lambda: bool(self._contacts("tool")))
        height = float(self._data.mocap_pos[0][2])
        self._move((end.x, end.y, height), yaw, 0.15)
        self._move((end.x, end.y, HOME), yaw, 1.0)
        self.settle()

    def _below(self, point: np.ndarray) -> tuple[float, int]:
        """See the base. The tool ends in a cup: what is nearest below any point of its rim counts, too."""
        below = super()._below
        return min(below(point + offset) for offset in CUP)

    def _contacts(self, name: str) -> set[int]:
        """See the base. The tool is no obstacle for what it holds, even if the two begin to touch on the way."""
        return super()._contacts(name) - {self._model.body("tool").id}


def _at(pose: Pose2, height: float) -> str:
    return f'pos="{pose.x:.5f} {pose.y:.5f} {height:.5f}" euler="0 0 {math.degrees(pose.yaw):.4f}"'
