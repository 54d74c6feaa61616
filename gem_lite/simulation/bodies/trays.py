"""Fixed bodies that hold others, made of boxes: a container, and a fixture for the L-block."""

from __future__ import annotations

from collections.abc import Sequence

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.parts import Part
from gem_lite.simulation.bodies.shapes import Body, create_body, create_boxes, create_visual

WALL = 0.002
"""Thickness (m) of walls and floors, as in CLIPort."""
FRICTION = 0.3
"""Lateral friction of trays, as in CLIPort: a body that lands on an edge slides off it."""
CONTAINER_HEIGHT = 0.05
FIXTURE_HEIGHT = 0.02
FIXTURE_CLEARANCE = 0.007
"""Gap (m) round an L-block in its fixture. With an error of 10 mm or 15 degrees, the L rarely fits in."""
FIXTURE_RADIUS = 0.086
"""A fixture lies within a circle of this radius (m) about its origin."""

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""The lowest and the highest corner of a box (m)."""


def add_container(
    client: int, size: tuple[float, float], color: tuple[float, ...], pose: Pose2, height: float = CONTAINER_HEIGHT
) -> Body:  # fmt: skip
    """A fixed box, open on top; ``size`` (x, y metres) is measured between the middles of its walls."""
    return add_boxes(client, container_boxes(size, height), color, pose)


def container_boxes(size: tuple[float, float], height: float = CONTAINER_HEIGHT) -> list[Box]:
    """The floor and the four walls of `add_container`."""
    x = size[0] / 2
    y = size[1] / 2
    t = WALL / 2
    floor = [((-x, -y, 0), (x, y, WALL))]
    across_x = [((sign * x - t, -y - t, 0), (sign * x + t, y + t, height)) for sign in (-1, 1)]
    across_y = [((-x - t, sign * y - t, 0), (x + t, sign * y + t, height)) for sign in (-1, 1)]
    return floor + across_x + across_y


def add_l_fixture(client: int, color: tuple[float, ...], pose: Pose2) -> Body:
    """A fixed tray for the L-block of `shapes.l_block_mesh`. An L-block that fits in it has the pose of the tray."""
    low = -0.05 - FIXTURE_CLEARANCE
    middle = -0.01 + FIXTURE_CLEARANCE
    high = 0.05 + FIXTURE_CLEARANCE
    t = WALL
    floor = [((low, low, 0), (high, middle, t)), ((low, middle, 0), (middle, high, t))]
    walls = [
        ((low - t, low - t), (high + t, low)),  # below the lying arm
        ((high, low), (high + t, middle + t)),  # at its end
        ((middle, middle), (high, middle + t)),  # above it, in the notch
        ((middle, middle + t), (middle + t, high + t)),  # right of the upright arm, in the notch
        ((low - t, high), (middle, high + t)),  # at its end
        ((low - t, low), (low, high)),  # left of it
    ]
    return add_boxes(client, floor + [((*lower, 0), (*upper, FIXTURE_HEIGHT)) for lower, upper in walls], color, pose)


def add_boxes(client: int, boxes: Sequence[Box], color: tuple[float, ...], pose: Pose2) -> Body:
    """Boxes as one fixed body."""
    collision, mesh, lower = create_boxes(client, boxes)
    visual = create_visual(client, mesh, color, lower)
    parts = [Part("", mesh)]
    return create_body(client, collision, visual, pose, lower, 0.0, movable=False, friction=FRICTION, parts=parts)
