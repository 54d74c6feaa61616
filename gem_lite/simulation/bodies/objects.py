"""Everyday objects with named parts: a mug has a handle, a hammer has a head. Each is made of a few trimesh solids.

An object has any number of variants, which differ in their proportions. The embedded CLIP was trained on
`TRAINING_VARIANTS`; tests use others. Lengths are in metres. An object lies along x, on z = 0, and is at
most about 0.11 m long.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import animals, food, home, tools, toys
from gem_lite.simulation.bodies.parts import RGBA, Part
from gem_lite.simulation.bodies.shapes import Body, add_hull
from gem_lite.simulation.bodies.solids import join

TRAINING_VARIANTS = 12
"""The embedded CLIP was trained on the variants 0 .. 11 and on no others."""
TEST_VARIANTS = (1000, 1100)
"""The range of the variants in the scenes of tasks. CLIP was not trained on their proportions."""

NAMES: tuple[str, ...] = (
    "mug", "hammer", "screwdriver", "banana", "scissors", "bottle", "spoon", "fork", "knife", "pan", "spatula",
    "brush", "wrench", "magnifying glass", "flashlight", "key", "headphones", "teapot", "toy car", "airplane", "duck",
    "dumbbell", "hat", "glasses", "pear", "carrot", "lollipop", "pencil", "mushroom", "wine glass", "chair",
    "sailboat", "lamp",
    "fish", "turtle", "rabbit", "butterfly", "crab", "snail", "elephant", "whale", "apple", "donut", "ice cream",
    "pizza slice", "cheese", "cherries", "hamburger", "corn", "toy train", "rocket", "robot", "drum", "guitar",
    "trumpet", "truck", "teddy bear", "pliers", "saw", "axe", "shovel", "tape roll", "stapler", "clamp", "paint roller",
    "ladle", "rolling pin", "whisk", "salt shaker",
)  # fmt: skip
"""New names must go to the end of this list, because an object's variants depend on its place in it."""
_MAKERS = vars(animals) | vars(food) | vars(home) | vars(tools) | vars(toys)
"""The function `_ice_cream` of one of these files makes an "ice cream": from `Vary`, a list of parts."""


@cache
def parts(name: str, variant: int = 0, scale: float = 1.0) -> tuple[Part, ...]:
    """The parts of an object, in one frame: centred in x and y, resting on z = 0.

    Args:
        name: one of `NAMES`.
        variant: the number of the variant, at least 0; see `TRAINING_VARIANTS`.
        scale: its size as a multiple of the usual one.

    Raises:
        ValueError: the name is unknown, the variant is negative, or the scale is not above 0.
    """
    if name not in NAMES:
        raise ValueError(f"no object is named {name!r}; the names are {', '.join(NAMES)}")
    if variant < 0:
        raise ValueError(f"variant must be at least 0, got {variant}")
    if not scale > 0:
        raise ValueError(f"scale must be above 0, got {scale}")
    if scale != 1:
        return tuple(replace(part, mesh=part.mesh.copy().apply_scale(scale)) for part in parts(name, variant))
    rng = np.random.default_rng((NAMES.index(name), variant))
    pieces = _MAKERS["_" + name.replace(" ", "_")](lambda: float(rng.uniform(0.82, 1.18)))
    low, high = join(*[part.mesh for part in pieces]).bounds
    shift = [-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]]
    for part in pieces:
        part.mesh.apply_translation(shift)
    return tuple(pieces)


@cache
def extents(name: str, variant: int = 0, scale: float = 1.0) -> tuple[float, float, float]:
    """The sides (m) of an object's bounding box in its own frame. Raises ValueError as `parts`."""
    x, y, z = join(*[part.mesh for part in parts(name, variant, scale)]).extents.tolist()
    return x, y, z


def part_names(name: str) -> tuple[str, ...]:
    """The names of an object's parts: ("brim", "handle") for a mug."""
    return tuple(part.name for part in parts(name) if part.name)


def add_object(
    client: int, name: str, color: RGBA, pose: Pose2, variant: int = 0, movable: bool = True, scale: float = 1.0,
    by_part: bool = False,
) -> Body:  # fmt: skip
    """Put an object on the table. The first part is the body's base; part i is its link i - 1.

    Its contact shape is the convex hull of all parts; ``by_part``, that of each part.
    """
    colored = [replace(part, rgba=part.rgba or color) for part in parts(name, variant, scale)]
    return add_hull(client, join(*[part.mesh for part in colored]), colored, pose, 0.03, movable, by_part)
