"""Five plain solids that only the embedded CLIP's pictures show."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh
from shapely import box

BASIC = ("box", "plate", "ball", "cylinder", "cone")
"""The names of `basic_mesh`'s solids."""


@cache
def basic_mesh(name: str) -> trimesh.Trimesh:
    """A box (open on top), plate, ball, cylinder or cone, 44 to 110 mm wide."""
    match name:
        case "box":
            walls = box(-0.045, -0.035, 0.045, 0.035).difference(box(-0.041, -0.031, 0.041, 0.031))
            floor = trimesh.creation.box(bounds=[[-0.045, -0.035, 0], [0.045, 0.035, 0.004]])
            return trimesh.util.concatenate([trimesh.creation.extrude_polygon(walls, 0.035), floor])
        case "plate":
            profile = [(0, 0), (0.034, 0), (0.055, 0.010), (0.055, 0.012), (0.034, 0.004), (0, 0.004)]
            return trimesh.creation.revolve(np.array(profile), sections=32)
        case "ball":
            return trimesh.creation.icosphere(subdivisions=3, radius=0.022).apply_translation([0, 0, 0.022])
        case "cylinder":
            profile = [(0, 0), (0.022, 0), (0.022, 0.05), (0, 0.05)]
            return trimesh.creation.revolve(np.array(profile), sections=32)
        case "cone":
            return trimesh.creation.revolve(np.array([(0, 0), (0.027, 0), (0, 0.058)]), sections=32)
    raise ValueError(f"name must be one of {', '.join(BASIC)}, got {name!r}")
