"""block-insertion: "put the red L-block in the blue box". The L must really fit into its fixture."""

from __future__ import annotations

import math

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes, trays
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import FULL_TURN, Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

TOLERANCE = 0.01
YAW_TOLERANCE = math.radians(15)
DEPTH_TOLERANCE = 0.003
"""The height of an inserted L differs by less than this (m) from that of an L on the fixture's floor."""
GRASP = Pose2(-0.02, -0.02)
"""The expert's grasp, in the L's frame: 14 mm from the notch, so that both arms are short levers."""
BLOCK_RADIUS = 0.05 * math.sqrt(2)


@register("block-insertion")
class BlockInsertion(Task):
    """One movable L-block and one fixed fixture of another colour, each at any pose."""

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        block, fixture = draw(rng, colors.SEEN, 2)
        fixture_pose = free.take(trays.FIXTURE_RADIUS)
        return self.arrange(environment, (block, fixture), free.take(BLOCK_RADIUS), fixture_pose)

    def arrange(
        self, environment: Environment, named: tuple[str, str], block_pose: Pose2, fixture_pose: Pose2
    ) -> list[Goal]:
        """Put an L and its fixture at two given poses, in two named colours. Returns the goal."""
        self.named_colors = named
        block_color, fixture_color = named
        fixture = trays.add_l_fixture(environment.client, colors.rgba(fixture_color), fixture_pose)
        self.put(environment, fixture, f"{fixture_color} box")
        block = shapes.add_l_block(environment.client, colors.rgba(block_color), block_pose)
        self.put(environment, block, f"{block_color} L-block")
        sentence = f"put the {block_color} L-block in the {fixture_color} box"
        # Position, height and yaw decide. An L has no symmetry: only one yaw is right.
        seated = PoseMetric(TOLERANCE, FULL_TURN, YAW_TOLERANCE, trays.WALL + block.rest_height, DEPTH_TOLERANCE)
        return [Goal(sentence, (block,), (fixture,), seated, grasp=GRASP, grasp_symmetry=FULL_TURN)]
