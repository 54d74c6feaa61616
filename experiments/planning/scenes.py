"""The scenes: a brown box, three things of the asked kind and three of other kinds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, VolumeMetric
from gem_lite.tasks.packing_objects import ABOVE, OBJECT_RADIUS, TOPPLING
from gem_lite.tasks.spawn import FreeSpace, draw, put_brown_box
from gem_lite.tasks.task import Task

MEMBERS = {
    "animals": ("fish", "turtle", "rabbit", "butterfly", "crab", "snail", "elephant", "whale"),
    "food": (
        "banana", "pear", "carrot", "lollipop", "mushroom", "apple", "donut", "ice cream", "pizza slice", "cheese",
        "cherries", "hamburger", "corn",
    ),
    "toys": ("toy car", "toy train", "airplane", "sailboat", "rocket", "robot", "truck", "teddy bear"),
    "tools": ("hammer", "screwdriver", "wrench", "pliers", "saw", "axe", "shovel", "clamp", "paint roller"),
    "kitchen utensils": (
        "mug", "bottle", "spoon", "fork", "knife", "pan", "spatula", "teapot", "wine glass", "ladle", "rolling pin",
        "whisk", "salt shaker",
    ),
}  # fmt: skip
"""The objects of each kind. Those that people would argue about are left out: a duck is an animal and a bath toy,
scissors belong to tools and to the kitchen, a guitar is no toy; and what is of none of these kinds, such as a hat."""
KINDS = tuple(MEMBERS)
COUNT = 3
"""So many things of the kind lie on the table, and so many others."""
BOX_SIDES = (0.27, 0.33)
"""Each side (m) of the brown box is drawn from this range. Six things fit in it."""


class Sorting(Task):
    """A brown box, things of one kind and things of other kinds.

    Attributes:
        kind: what the sentence asks for.
        right, wrong: the bodies of the kind, and the others.
        plain_names: the name of each body, without its colour.
        box: the brown box.
    """

    max_steps = 2 * COUNT

    def __init__(self, kind: str) -> None:
        super().__init__("test")
        self.kind = kind
        self.plain_names: dict[int, str] = {}

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> Sequence[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        self.box, zone = put_brown_box(self, environment, rng, free, BOX_SIDES)
        right = draw(rng, MEMBERS[self.kind], COUNT)
        wrong = draw(rng, [name for kind in KINDS if kind != self.kind for name in MEMBERS[kind]], COUNT)
        bodies = []
        extents = {}
        for name in right + wrong:
            color = str(rng.choice(list(colors.RGB)))
            variant = int(rng.integers(*objects.TEST_VARIANTS))
            body = objects.add_object(
                environment.client, name, colors.rgba(color), free.take(OBJECT_RADIUS), variant
            )  # fmt: skip
            bodies.append(self.put(environment, body, f"{color} {name}"))
            self.plain_names[body.id] = name
            extents[body.id] = objects.extents(name, variant)
        environment.wait(TOPPLING)
        self.right = tuple(bodies[:COUNT])
        self.wrong = tuple(bodies[COUNT:])
        self.metric = VolumeMetric(self.box, zone.size, ABOVE, extents)
        return [Goal(f"pick all {self.kind} and place them into the brown box", self.right, (self.box,), self.metric)]
