"""How a mobile base finds a table: it drives there and looks at the tag (A.12), or asks the simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from gem_lite.rgbd.tags import LocalisationError, table_in_base
from gem_lite.se2 import Pose2

if TYPE_CHECKING:
    from gem_lite.simulation.mobile_world import MobileWorld

Finder = Callable[["MobileWorld", int], Pose2]
"""Drives to a table and says where its frame is in the base's."""

SIDESTEPS = (0.0, 0.15, -0.15)
"""Where along a table's edge (m) the robot looks for its tag, one place after the other."""


def localise(world: MobileWorld, table: int) -> Pose2:
    """Drive to a table and look for its tag, from another place if need be: its frame in the base's.

    Raises:
        LocalisationError: the tag was not found from any of `SIDESTEPS`.
    """
    said = []
    for sideways in SIDESTEPS:
        world.drive(table, sideways)
        try:
            return table_in_base(world.look(), world.tags[table], world.tag)
        except LocalisationError as error:
            said.append(f"{100 * sideways:+.0f} cm aside: {error}")
    raise LocalisationError(f"table {table} cannot be localised; " + "; ".join(said))


def by_truth(world: MobileWorld, table: int) -> Pose2:
    """A `Finder` that asks the simulator: for comparisons."""
    world.drive(table)
    return world.true_table(table)


def disturbed(find: Finder, error: Pose2) -> Finder:
    """A `Finder` whose answers are wrong by ``error``: a shift, and a turn about the table's middle."""

    def wrong(world: MobileWorld, table: int) -> Pose2:
        w = world.workspace
        middle = Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)
        return find(world, table) @ middle @ error @ middle.inverse()

    return wrong
