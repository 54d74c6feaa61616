"""Pictures of one thing alone, from above."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gem_lite.rgbd.camera import Camera
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.rendering import render
from gem_lite.simulation.world import World

PIXELS = 128
"""Rows and columns of a portrait, as VIMABench has rows."""
DISTANCE = 8.0
"""The camera is so far away (m) that it sees hardly any side of the thing, as a height map."""
DOWN = (1.0, 0.0, 0.0, 0.0)
"""The rotation of a camera that looks down. x is to the right and y is up, as in a height map."""


def portrait(put: Callable[[int, Pose2], Body], side: float) -> np.ndarray:
    """A thing in the middle of an empty table, without any tool: (`PIXELS`, `PIXELS`, 3) uint8.

    Args:
        put: gets PyBullet's client and a pose, and puts the thing there.
        side: of the square that the picture shows (m).
    """
    with World() as world:
        world.clear()
        middle = world.middle
        put(world.client, middle)
        camera = Camera.pinhole(
            "portrait", (middle.x, middle.y, DISTANCE), DOWN, (PIXELS, PIXELS), focal=PIXELS * DISTANCE / side
        )
        return render(world.client, camera, world.light)[0].rgb
