"""block-insertion: "put the red L-block in the blue box"; the L really has to go into its fixture."""

from __future__ import annotations

import math

import numpy as np

from gem_lite import colors
from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Action, Pose2, wrap
from gem_lite.simulation import shapes, trays
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

TOLERANCE, YAW_TOLERANCE = 0.01, math.radians(15)
DEPTH_TOLERANCE = 0.003
"""The L is in if it is this near (m) to the height of one that stands flat on the fixture's floor."""
GRASP = Pose2(-0.02, -0.02)
"""Where the expert grasps, in the L's frame: 14 mm from the notch, so that both arms are short levers."""
BLOCK_RADIUS = 0.05 * math.sqrt(2)


class BlockInsertion(Task):
    """One movable L-block and one fixed fixture of another colour, each at any pose."""

    def __init__(self, unseen_colors: bool) -> None:
        super().__init__()
        self._palette = colors.UNSEEN if unseen_colors else colors.SEEN

    def reset(self, world: World, rng: np.random.Generator) -> None:
        """See `Task.reset`."""
        free = FreeSpace(world.workspace, rng, world.style)
        block, fixture = (str(name) for name in rng.choice(self._palette, 2, replace=False))
        pose = free.take(trays.FIXTURE_RADIUS)
        self._fixture = world.add(trays.add_l_fixture(world.client, colors.rgba(fixture), pose))
        self._block = world.add(shapes.add_l_block(world.client, colors.rgba(block), free.take(BLOCK_RADIUS)))
        self.names = {self._block.id: f"{block} L-block", self._fixture.id: f"{fixture} box"}
        self.named_colors = (block, fixture)
        self.instruction = f"put the {block} L-block in the {fixture} box"
        self.max_steps = 1

    def score(self, world: World) -> float:
        """1 if the L stands in the fixture, in position, yaw and depth; else 0."""
        pose, z = world.pose(self._block)
        off = world.pose(self._fixture)[0].inverse() @ pose
        seated = abs(z - trays.WALL - self._block.rest_height) < DEPTH_TOLERANCE
        return float(seated and math.hypot(off.x, off.y) < TOLERANCE and abs(wrap(off.yaw)) < YAW_TOLERANCE)

    def expert(self, world: World) -> ExpertAction | None:
        """Take the L by `GRASP` to where that point belongs. An L has no symmetry: one turn is right."""
        if self.score(world):
            return None
        pick, place = (world.pose(body)[0] @ GRASP for body in (self._block, self._fixture))
        return ExpertAction(Action(pick, place), 2 * math.pi, 2 * math.pi)
