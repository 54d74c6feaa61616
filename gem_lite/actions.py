"""What a robot can be told to do, and what its tool says of itself: no simulator, no camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from gem_lite.se2 import Pose2, wrap


@dataclass(frozen=True)
class PickPlace:
    """One pick and place; each pose lies in the frame of its table (metres, radians).

    Attributes:
        pick: where the tool grasps.
        place: where it lets go; ``place.yaw`` is the tool's *final yaw* on that table, not the relative angle.
        pick_table, place_table: the tables' numbers, 0 where there is only one.
    """

    pick: Pose2
    place: Pose2
    pick_table: int = 0
    place_table: int = 0

    @property
    def delta(self) -> float:
        """The paper's relative place angle: place orientation minus pick orientation, in [-pi, pi)."""
        return wrap(self.place.yaw - self.pick.yaw)


@dataclass(frozen=True)
class Push:
    """One push along a table, from the position of ``start`` to that of ``end``, in the frame of the table.

    The blade stands square to the way, so the yaws of both poses play no part.
    """

    start: Pose2
    end: Pose2
    table: int = 0


Action = PickPlace | Push


@dataclass(frozen=True)
class ExpertAction:
    """An expert's action and its yaw symmetries.

    ``pick_symmetry`` and ``place_symmetry`` are the smallest turns (radians) that change nothing: pi/2 for the yaw of a
    cube's grasp, 0 where every yaw is as good (as for every push), 2 pi where one yaw is right. ``place_symmetry`` is
    that of the relative angle.
    """

    action: Action
    pick_symmetry: float = 0.0
    place_symmetry: float = 0.0


class GripperState(NamedTuple):
    """What a tool knows of itself, and nothing else: where it is (m, radians) and whether it holds something."""

    x: float
    y: float
    yaw: float
    holding: bool
