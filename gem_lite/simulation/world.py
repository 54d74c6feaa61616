"""The PyBullet world of one table."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pybullet as p
from typing_extensions import override

from gem_lite.rgbd.camera import View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.looks import Look
from gem_lite.simulation.rendering import cameras_around, render

INVISIBLE = (0.0, 0.0, 0.0, 0.0)


class World(Environment):
    """One table. Its frame is the world's frame."""

    @override
    def furnish(self) -> None:
        w = self.workspace
        half = ((w.x_max - w.x_min) / 2, (w.y_max - w.y_min) / 2, 0.0005)
        self.add_slab(self.middle, half, 0.0, self.table_color, solid=False)
        self.add_slab(self.middle, (3.0, 3.0, 0.05), 0.0, INVISIBLE, solid=True)
        self._floor = self.add_floor()

    def add_floor(self) -> int:
        """Add the floor round the table. Returns its id."""
        return self.add_slab(self.middle, (3.0, 3.0, 0.0005), -0.1, self.style.floor, solid=False)

    @override
    def observe(self) -> tuple[Observation, ...]:
        if self.light.shadow:  # The shadows of the bodies fall on the floor.
            return (self.as_measured(self._views(), table=0),)
        # The floor fills the pictures, so its pixels are most of the renderer's work, and they never change.
        p.changeVisualShape(self._floor, -1, rgbaColor=INVISIBLE, physicsClientId=self.client)
        views = self._views()
        p.changeVisualShape(self._floor, -1, rgbaColor=self.style.floor, physicsClientId=self.client)
        lit = replace(self.style, light=self.light)
        seen = []
        for view, floor in zip(views, _floor_views(lit, self.workspace), strict=True):
            behind = view.depth > floor.depth
            rgb = np.where(behind[..., None], floor.rgb, view.rgb)
            seen.append(View(view.camera, rgb, np.where(behind, floor.depth, view.depth)))
        return (self.as_measured(tuple(seen), table=0),)

    def _views(self) -> tuple[View, ...]:
        """The true views of the cameras."""
        cameras = cameras_around(self.workspace, self.style.cameras)
        return tuple(render(self.client, camera, self.light)[0] for camera in cameras)

    @override
    def reach(self, table: int) -> Pose2:
        return self.tables[table]


@lru_cache(maxsize=16)
def _floor_views(style: Look, workspace: Workspace) -> tuple[View, ...]:
    """What the cameras see of the floor alone."""
    with World(style=style) as world:
        world.workspace = workspace
        world.add_floor()
        return world._views()
