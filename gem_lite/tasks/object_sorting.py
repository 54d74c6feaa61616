"""object-sorting: "pick the mug and place into the recycle box", the paper's task for several tables (A.12)."""

from __future__ import annotations

import numpy as np

from gem_lite import colors
from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Action, Pose2, Workspace
from gem_lite.simulation import objects, symbols, trays
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import Simulation
from gem_lite.tasks.spawn import FreeSpace

SEEN = (
    "mug", "hammer", "banana", "scissors", "bottle", "spoon", "pan", "brush", "key", "teapot", "toy car", "duck", "hat",
    "glasses", "pencil",
)  # fmt: skip
UNSEEN = (
    "headphones", "airplane", "dumbbell", "pear", "carrot", "lollipop", "mushroom", "magnifying glass", "flashlight",
    "wrench", "sailboat", "lamp",
)  # fmt: skip
SEEN_BOXES, UNSEEN_BOXES = ("recycle", "gear"), ("recycle", "smiley")
OBJECTS = 5
OBJECT_RADIUS = 0.06
TOPPLING = 2.0
"""Seconds in which a body that cannot stand (some ducks) falls over, before anyone looks at it."""
VARIANTS = (1000, 1100)
"""Objects have proportions that the embedded CLIP was not trained on; see `objects.TRAINING_VARIANTS`."""


class ObjectSorting(Task):
    """Two symbol boxes and five objects in any colours, spread over all tables; the sentence names one of each.

    The tables are the paper's, 106 x 53 cm. Episode after episode goes through the objects by their seeds, so
    that 75 demonstrations hold five of each of training's 15. There is one try.
    """

    workspace = Workspace.of_length(1.06)

    def __init__(self, unseen: bool) -> None:
        super().__init__()
        self._objects, self._boxes = (UNSEEN, UNSEEN_BOXES) if unseen else (SEEN, SEEN_BOXES)

    def reset(self, world: Simulation, rng: np.random.Generator) -> None:
        """See `Task.reset`."""
        free = [FreeSpace(world.workspace, rng, world.style) for _ in world.tables]

        def anywhere(radius: float) -> Pose2:
            table = int(rng.integers(len(world.tables)))
            return world.tables[table] @ free[table].take(radius)

        boxes = [world.add(symbols.add_symbol_box(world.client, s, anywhere(symbols.BOX_RADIUS))) for s in self._boxes]
        self.names = {body.id: f"{symbol} box" for body, symbol in zip(boxes, self._boxes, strict=True)}
        wanted = self._objects[self.seed % len(self._objects)]
        others = [name for name in self._objects if name != wanted]
        chosen = [wanted, *(str(name) for name in rng.choice(others, OBJECTS - 1, replace=False))]
        bodies = []
        for name in chosen:
            color = str(rng.choice(list(colors.RGB)))
            pose, variant = anywhere(OBJECT_RADIUS), int(rng.integers(*VARIANTS))
            bodies.append(world.add(objects.add_object(world.client, name, colors.rgba(color), pose, variant)))
            self.names[bodies[-1].id] = f"{color} {name}"
        world.wait(TOPPLING)
        number = int(rng.integers(len(boxes)))
        self._body, self._box = bodies[0], boxes[number]
        self.instruction = f"pick the {chosen[0]} and place into the {self._boxes[number]} box"
        self.max_steps = 1

    def score(self, world: Simulation) -> float:
        """1 if the object's centre is in the box, else 0."""
        return float(trays.in_container(world, self._box, (symbols.BOX_SIDE,) * 2, self._body))

    def expert(self, world: Simulation) -> ExpertAction | None:
        """Take the object by its middle to the box's middle; every yaw and every turn is as good."""
        if self.score(world):
            return None
        pick, box = world.pose(self._body)[0], world.pose(self._box)[0]
        return ExpertAction(Action(pick, Pose2(box.x, box.y, pick.yaw)), 0.0, 0.0)
