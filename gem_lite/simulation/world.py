"""The PyBullet world of one table."""

from __future__ import annotations

from typing_extensions import override

from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.rendering import cameras_around, render
from gem_lite.simulation.worlds import TABLE_COLOR


class World(Environment):
    """One table. Its frame is the world's frame."""

    @override
    def furnish(self) -> None:
        w = self.workspace
        centre = Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)
        half = ((w.x_max - w.x_min) / 2, (w.y_max - w.y_min) / 2, 0.0005)
        self.add_slab(centre, half, 0.0, TABLE_COLOR, solid=False)
        self.add_slab(centre, (3.0, 3.0, 0.05), 0.0, (0, 0, 0, 0), solid=True)
        self.add_slab(centre, (3.0, 3.0, 0.0005), -0.1, self.style.floor, solid=False)

    @override
    def observe(self) -> tuple[Observation, ...]:
        cameras = cameras_around(self.workspace)
        return (Observation(tuple(render(self.client, camera, self.style.light)[0] for camera in cameras)),)

    @override
    def reach(self, table: int) -> Pose2:
        return self.tables[table]
