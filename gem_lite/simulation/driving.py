"""The mobile base at work: drive to a table, find its frame by its tag, pick; drive on, place (A.12)."""

from __future__ import annotations

from collections.abc import Callable

from gem_lite.policies.several_tables import MobileChoice
from gem_lite.rgbd.tags import LocalisationError, table_in_base
from gem_lite.se2 import Pose2
from gem_lite.simulation.mobile_world import MobileStep, MobileWorld

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


Finder = Callable[[MobileWorld, int], Pose2]
"""Drives to a table and says where its frame is in the base's."""


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


def act(world: MobileWorld, choice: MobileChoice, find: Finder = localise) -> MobileStep:
    """Carry out a choice: drive, localise, pick; drive, localise, place. Nothing is done at a table not localised.

    Raises:
        LocalisationError: a table was not found.
        ValueError: a pose lies outside the workspace.
    """
    world.check("choice.pick", choice.pick)
    world.check("choice.place", choice.place)
    table = find(world, choice.pick_table)
    if world.pick(table @ choice.pick):
        if choice.place_table != choice.pick_table:
            table = find(world, choice.place_table)
        world.place(table @ choice.place)
    return world.finish()
