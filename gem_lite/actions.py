"""The actions of a robot and the state of its tool. Nothing here needs a simulator or a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from gem_lite.se2 import Pose2, wrap


@dataclass(frozen=True)
class PickPlace:
    """One pick and place; each pose lies in the frame of its table (metres, radians).

    Attributes:
        pick: the pose of the grasp.
        place: the pose of the release. ``place.yaw`` is the tool's *final yaw* on that table, not the relative angle.
        pick_table, place_table: the numbers of the tables; 0 if there is only one table.
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

    The blade is perpendicular to the path, so the yaws of both poses have no effect.
    """

    start: Pose2
    end: Pose2
    table: int = 0


Action = PickPlace | Push


class Outcome(Enum):
    """What an action came to, or its first half."""

    HELD = "held"
    PLACED = "placed"
    PUSHED = "pushed"
    NOTHING_HELD = "nothing held"
    OUT_OF_REACH = "out of reach"
    DROPPED = "dropped"
    NO_ANSWER = "no answer"
    STOPPED = "stopped"


MOST_EQUAL_YAWS = 360
"""A symmetry with more equal yaws, by less than a degree, is a mistake: 0 stands for all yaws."""


def equal_yaws(symmetry: float, name: str = "symmetry") -> int:
    """How many yaws of a full turn are equally right; 0 stands for all of them.

    Args:
        symmetry: the smallest turn (radians) that changes nothing, or 0 if every turn changes nothing.
        name: names the symmetry in the error message.

    Raises:
        ValueError: the symmetry is neither 0 nor 2 pi divided by a whole number.
    """
    if symmetry == 0:
        return 0
    copies = 2 * math.pi / symmetry if symmetry > 0 else 0.0
    if not 0.5 < copies < MOST_EQUAL_YAWS + 0.5 or abs(copies - round(copies)) > 1e-3:
        raise ValueError(
            f"{name} must be the smallest turn in radians that changes nothing: 2 pi divided by a whole number, or 0 "
            f"if every yaw is right, got {symmetry}"
        )
    return round(copies)


@dataclass(frozen=True)
class ExpertAction:
    """An expert's action and its yaw symmetries.

    A symmetry is the smallest turn (radians) that changes nothing: pi/2 for the grasp of a cube, 2 pi if only one yaw
    is right, 0 if every yaw is right (as for every push).

    Attributes:
        action: the action.
        pick_symmetry: the symmetry of the pick's yaw.
        place_symmetry: the symmetry of the relative place angle.

    Raises:
        ValueError: a symmetry is neither 0 nor 2 pi divided by a whole number.
    """

    action: Action
    pick_symmetry: float = 0.0
    place_symmetry: float = 0.0

    def __post_init__(self) -> None:
        equal_yaws(self.pick_symmetry, "pick_symmetry")
        equal_yaws(self.place_symmetry, "place_symmetry")


class GripperState(NamedTuple):
    """The state that a tool can measure itself: its position (m), its yaw (radians), and whether it holds something."""

    x: float
    y: float
    yaw: float
    holding: bool
