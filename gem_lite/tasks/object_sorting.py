"""object-sorting: "pick the mug and place into the recycle box", the paper's task for several tables (A.12)."""

from __future__ import annotations

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import objects, symbol_boxes, trays
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, ZoneMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

SEEN = (
    "mug", "hammer", "banana", "scissors", "bottle", "spoon", "pan", "brush", "key", "teapot", "toy car", "duck", "hat",
    "glasses", "pencil",
)  # fmt: skip
UNSEEN = (
    "headphones", "airplane", "dumbbell", "pear", "carrot", "lollipop", "mushroom", "magnifying glass", "flashlight",
    "wrench", "sailboat", "lamp",
)  # fmt: skip
SEEN_BOXES = ("recycle", "gear")
UNSEEN_BOXES = ("recycle", "smiley")
OBJECTS = 5
OBJECT_RADIUS = 0.06
TOPPLING = 2.0
"""Seconds before the first picture. In this time, bodies that cannot stand (some ducks) fall over."""
INSIDE = ZoneMetric((symbol_boxes.BOX_SIDE, symbol_boxes.BOX_SIDE), trays.CONTAINER_HEIGHT)


@register("object-sorting", {"seen": {}, "unseen": {"unseen": True}})
class ObjectSorting(Task):
    """Two symbol boxes and five objects in any colours, spread over all tables; the sentence names one of each.

    The tables have the size of the paper's, 106 x 53 cm. The seed of an episode chooses the named object in turn, so
    75 demonstrations name each of the 15 training objects five times. An episode has one action.
    """

    workspace = Workspace.of_length(1.06)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        object_names, box_symbols = (UNSEEN, UNSEEN_BOXES) if self.unseen else (SEEN, SEEN_BOXES)
        free = [FreeSpace(environment.workspace, rng, environment.style) for _ in environment.tables]

        def random_pose(radius: float) -> Pose2:
            table = int(rng.integers(len(environment.tables)))
            return environment.tables[table] @ free[table].take(radius)

        boxes = []
        for symbol in box_symbols:
            box = symbol_boxes.add_symbol_box(environment.client, symbol, random_pose(symbol_boxes.BOX_RADIUS))
            boxes.append(self.put(environment, box, f"{symbol} box"))
        named = object_names[seed % len(object_names)]
        distractors = draw(rng, [name for name in object_names if name != named], OBJECTS - 1)
        bodies = []
        for name in (named, *distractors):
            color = str(rng.choice(list(colors.RGB)))
            pose = random_pose(OBJECT_RADIUS)
            variant = int(rng.integers(*objects.TEST_VARIANTS))
            body = objects.add_object(environment.client, name, colors.rgba(color), pose, variant)
            bodies.append(self.put(environment, body, f"{color} {name}"))
        environment.wait(TOPPLING)
        number = int(rng.integers(len(boxes)))
        sentence = f"pick the {named} and place into the {box_symbols[number]} box"
        return [Goal(sentence, (bodies[0],), (boxes[number],), INSIDE)]
