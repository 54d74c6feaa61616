"""How a mobile base finds a table: it drives to the table and looks at the tag (A.12), or it asks the simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from gem_lite.rgbd.tags import LocalisationError, table_in_base
from gem_lite.se2 import Pose2

if TYPE_CHECKING:
    from gem_lite.simulation.mobile_world import MobileWorld

Finder = Callable[["MobileWorld", int], Pose2]
"""Drives to a table and returns the table's pose in the base's frame."""

SIDESTEPS = (0.0, 0.15, -0.15)
"""The places along a table's edge (m) from which the robot looks for the tag, in this order."""


def localise(world: MobileWorld, table: int) -> Pose2:
    """A `Finder` that looks for the table's tag. If the tag is not seen, it tries the next of `SIDESTEPS`.

    Raises:
        LocalisationError: the tag was not found from any of `SIDESTEPS`.
    """
    failures = []
    for sideways in SIDESTEPS:
        world.drive(table, sideways)
        try:
            return table_in_base(world.look(), world.tags[table], world.tag)
        except LocalisationError as error:
            failures.append(f"{100 * sideways:+.0f} cm aside: {error}")
    raise LocalisationError(f"table {table} cannot be localised; " + "; ".join(failures))


def ask_simulator(world: MobileWorld, table: int) -> Pose2:
    """A `Finder` that takes the true pose from the simulator, for comparisons."""
    world.drive(table)
    return world.true_table(table)


def disturbed(find: Finder, error: Pose2) -> Finder:
    """A `Finder` whose poses are wrong by ``error``: a shift, and a turn about the table's middle."""

    def find_with_error(world: MobileWorld, table: int) -> Pose2:
        w = world.workspace
        middle = Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)
        return find(world, table) @ middle @ error @ middle.inverse()

    return find_with_error
