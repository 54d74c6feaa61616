"""How a mobile robot knows where its tables are: through tags, through true poses, and through poses that are wrong."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from gem_lite import tasks
from gem_lite.evaluation import results
from gem_lite.se2 import Pose2
from gem_lite.simulation import mobile_world
from gem_lite.simulation.mobile_world import MobileWorld

TASKS = tasks.variants("object-sorting")
_SHARED = (name for name in results.IDENTITY if name not in ("subset", "skipped"))
IDENTITY = (*_SHARED, "tables", "poses", "shift", "turn")
"""The entries that identify a row of these results."""


class Condition(NamedTuple):
    """How the robot knows where a table is.

    Attributes:
        poses: by its tag, or by the simulator's truth.
        shift: metres by which the estimate is wrong, in a random direction.
        turn: radians by which it is turned about the table's middle, to a random side.
    """

    poses: Literal["tags", "truth"]
    shift: float = 0.0
    turn: float = 0.0

    def finder(self, rng: np.random.Generator) -> mobile_world.Finder:
        """The robot's way of finding a table, with a new random error for every table."""
        find = mobile_world.localise if self.poses == "tags" else mobile_world.ask_simulator

        def find_with_error(world: MobileWorld, table: int) -> Pose2:
            direction = rng.uniform(-math.pi, math.pi)
            error = Pose2(
                self.shift * math.cos(direction), self.shift * math.sin(direction), self.turn * rng.choice([-1, 1])
            )
            return mobile_world.disturbed(find, error)(world, table)

        return find_with_error


BOTH = (Condition("tags"), Condition("truth"))
"""Without injected errors."""
CURVE = (
    *(Condition("tags", shift / 100) for shift in (1, 2, 3, 4)),
    *(Condition("tags", 0.0, math.radians(turn)) for turn in (2, 4, 6, 8)),
)
"""Injected errors of the success curve."""
