"""What both methods see here: one picture from above, and segmentation in the place of depth (A.1.5).

VIMA gets the true masks of all things. So that both methods see the same, the masks are in the depth picture: there,
each thing is a flat plate, whatever its true form. No true height is in any picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from typing_extensions import override

from experiments.picture_prompts.portraits import DOWN
from gem_lite.demonstrations import Demonstration
from gem_lite.rgbd.camera import Camera, View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Workspace
from gem_lite.simulation.rendering import render
from gem_lite.simulation.world import World

ABOVE = "above"
"""The name of the camera."""
SIZE = (320, 160)
"""Rows and columns of the picture: VIMABench's 3.125 mm a pixel."""
DISTANCE = 6.0
"""The camera is so far above the table (m) that it sees hardly any side of a thing."""
PLATE = 0.05
"""The height (m) of every thing in the depth picture: 1 in a network's height channel."""
_BODY = (1 << 24) - 1
"""The bits of a pixel's number that hold the body's id (`render`)."""


def camera_above(workspace: Workspace) -> Camera:
    """The camera that shows a table and nothing else."""
    middle = ((workspace.x_min + workspace.x_max) / 2, (workspace.y_min + workspace.y_max) / 2)
    focal = SIZE[0] * DISTANCE / workspace.length
    return Camera.pinhole(ABOVE, (*middle, DISTANCE), DOWN, SIZE, focal)


class SegmentedWorld(World):
    """A world whose cameras are `camera_above` alone."""

    @override
    def observe(self) -> tuple[Observation, ...]:
        view, numbers = render(self.client, camera_above(self.workspace), self.light, segmentation=True)
        is_thing = np.isin(numbers & _BODY, [body.id for body in self.bodies])
        depth = np.where(is_thing, DISTANCE - PLATE, DISTANCE).astype(np.float32)
        return (Observation((View(view.camera, view.rgb, depth),)),)


def masks(view: View) -> np.ndarray:
    """Which pixels of a view of `SegmentedWorld` show a thing: (H, W) bool."""
    return view.depth < DISTANCE - PLATE / 2


def check(demos: Sequence[Demonstration], folder: Path) -> None:
    """Check that demonstrations are of a `SegmentedWorld`. Raises ValueError naming their folder if one is not."""
    for demonstration in demos:
        views = demonstration.steps[0].observation.views
        if [view.camera.name for view in views] != [ABOVE] or len(np.unique(views[0].depth)) > 2:
            raise ValueError(
                f"{folder} must hold demonstrations of one camera above the table, with segmentation in the place of "
                f"depth (the command collect makes them), got another world's (seed {demonstration.seed})"
            )
