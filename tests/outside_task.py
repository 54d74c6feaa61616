"""A task, an end effector and a world that come from outside the library; evaluation's processes import this module."""

import math

import numpy as np

from gem_lite.se2 import Pose2
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import shapes
from gem_lite.tasks import Task, register
from gem_lite.tasks.goals import Goal, ZoneMetric

RED = (1.0, 0.34, 0.35, 1.0)
CUBES = 6
NIGHT = looks.register(looks.Look("night", floor=(0.05, 0.05, 0.1, 1.0)))


@register("sweeping", {"near": {}, "far": {"reach": 0.3, "max_steps": 1}})
class Sweeping(Task):
    """Small cubes in a heap, to be pushed into a zone with the spatula."""

    effector = "spatula"

    def __init__(self, split="train", reach=0.15, max_steps=12):
        super().__init__(split)
        self.reach, self.max_steps = reach, max_steps

    def lay_out(self, environment, rng, seed):
        side = 0.015
        cubes = []
        for row, col in np.ndindex(2, CUBES // 2):
            pose = Pose2(0.45 + 1.5 * side * row, 0.1 + 1.5 * side * col, rng.uniform(0, math.pi / 2))
            cube = shapes.add_box(environment.client, (side,) * 3, RED, pose)
            cubes.append(self.put(environment, cube, "red cube"))
        zone = Pose2(0.5, 0.1 - self.reach)
        inside = ZoneMetric((0.12, 0.12), height=0.05)
        return [Goal("push the pile of red blocks into the green square", tuple(cubes), (zone,), inside)]
