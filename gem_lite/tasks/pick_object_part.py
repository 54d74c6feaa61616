"""pick-object-part-in-brown-box: "pick the mug handle and place into brown box", of the paper's real tables (A.11)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.grips import Surfaces
from gem_lite.tasks import real_table
from gem_lite.tasks.goals import Goal, Target, ZoneMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, TableFullError, draw, put_brown_box
from gem_lite.tasks.task import Split, Task

SEEN = (
    "mug", "hammer", "screwdriver", "scissors", "spoon", "brush", "magnifying glass", "flashlight", "pliers", "bottle",
)  # fmt: skip
UNSEEN = ("paint roller", "axe", "ladle", "carrot", "lollipop")
"""Objects with two named parts each, which the jaw can hold. The paper has as many; Figure 5 shows them."""
BOX_SIDES = (0.085, 0.095)
"""Each side (m) of the brown box is drawn from this range."""
HEIGHT = 0.04
"""An object is in the box if its origin is below this height (m): it may lean on a wall."""
OBJECTS = 3
OBJECT_RADIUS = 0.06 * real_table.SCALE
TOPPLING = 1.0
"""Seconds before the first picture, in which bodies that cannot stand fall over."""
LAYOUTS = 100
"""So many scenes are drawn until the jaw can hold the named part."""
POINTS = 40
YAWS = 18
"""An expert tries so many points of a part, and so many yaws in half a turn."""
STEADY = 3
"""It takes a point at which so many neighbouring yaws hold the part, or else fewer."""


@dataclass(frozen=True)
class HeldPartMetric:
    """A body is at its target if it lies in the box, and the jaw's last pick took it by the named part.

    Attributes:
        inside: decides whether the body is in the box.
        part: the name of the part.
        symmetry: 0, because every yaw is right.
    """

    inside: ZoneMetric
    part: str
    symmetry: float = 0.0

    def share(self, environment: Environment, body: Body, target: Target) -> float:
        """1 if both are true, else 0. The environment's tool must be a `ParallelJaw`."""
        grip = environment.effector.grip
        by_the_part = grip is not None and (grip.body, grip.part) == (body.id, self.part)
        return self.inside.share(environment, body, target) * by_the_part


@register("pick-object-part-in-brown-box", {"seen": {}, "unseen": {"unseen": True}})
class PickObjectPart(Task):
    """A brown box, an object of which the sentence names a part, and up to two others of other names.

    An episode names each part of each object once, in random order. After each act, the scene is taken away and another
    is laid out, with other objects at other poses. So a part that was missed is not asked for again. An object without
    a free place is left out. `SEEN` objects have 20 parts; the "unseen" variant shows `UNSEEN` ones in validation and
    test, with 10 parts. The tool must say what it gripped, as `ParallelJaw` does.
    """

    workspace = real_table.WORKSPACE
    scale = real_table.SCALE
    effector = "parallel-jaw"

    def __init__(self, split: Split = "train", unseen: bool = False) -> None:
        super().__init__(split, unseen)
        self.object_names = UNSEEN if self.unseen else SEEN
        self._right = 0.0
        self._rng = np.random.default_rng(0)
        self._asked: list[tuple[str, str]] = []

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        parts = [(name, part) for name in self.object_names for part in objects.part_names(name)]
        self._asked = [parts[number] for number in rng.permutation(len(parts))]
        self._rng = rng
        self._right = 0.0
        self.max_steps = len(parts)
        return [self._next_scene(environment)]

    @override
    def score(self, environment: Environment) -> float:
        """The share of the parts that were held and whose object then lay in the box."""
        return (self._right + sum(goal.done(environment) for goal in self.goals)) / self.max_steps

    @override
    def advance(self, environment: Environment) -> None:
        """Count the act, and lay out the next scene. After the last act, the scene stays."""
        if self._asked:
            self._right += self.goals[0].done(environment)
            self.goals = (self._next_scene(environment),)

    def _next_scene(self, environment: Environment) -> Goal:
        """Lay out scenes for the next part until the jaw can hold it."""
        name, part = self._asked.pop(0)
        for _ in range(LAYOUTS):
            environment.remove_bodies()
            self.names = {}
            box, zone = self._lay_out_objects(environment, name)
            environment.wait(TOPPLING)
            environment.settle()
            body = environment.bodies[1]
            grasp = central_grasp(Surfaces.of(environment.client, environment.bodies), body, part)
            if grasp is not None:
                metric = HeldPartMetric(replace(zone, height=HEIGHT), part)
                sentence = f"pick the {name} {part} and place into brown box"
                grasp = environment.pose(body)[0].inverse() @ grasp
                return Goal(sentence, (body,), (box,), metric, grasp=grasp, grasp_symmetry=math.pi)
        raise TableFullError(f"in none of {LAYOUTS} scenes can the jaw hold the {name} {part}")

    def _lay_out_objects(self, environment: Environment, named: str) -> tuple[Body, ZoneMetric]:
        """The box, then the named object, then others."""
        free = FreeSpace(real_table.AREA, self._rng, environment.style, real_table.GAP)
        box, zone = put_brown_box(self, environment, self._rng, free, BOX_SIDES)
        others = [name for name in self.object_names if name != named]
        for name in (named, *draw(self._rng, others, OBJECTS - 1)):
            color = str(self._rng.choice(list(colors.RGB)))
            variant = int(self._rng.integers(*objects.TEST_VARIANTS))
            with suppress(TableFullError):
                pose = free.take(OBJECT_RADIUS)
                body = objects.add_object(
                    environment.client, name, colors.rgba(color), pose, variant, scale=self.scale,
                    by_part=environment.style.hulls_of_parts,
                )  # fmt: skip
                self.put(environment, body, f"{color} {name}")
        return box, zone


def central_grasp(surfaces: Surfaces, body: Body, part: str) -> Pose2 | None:
    """The pose in the world at which a jaw holds a part, nearest to the part's middle; None if it cannot be held.

    Its yaw is in the middle of those that hold the part there.
    """
    points = surfaces.points[surfaces.owners == surfaces.parts.index((body, part)), :2]
    from_middle = np.linalg.norm(points - points.mean(axis=0), axis=1)
    tried = points[np.argsort(from_middle[:POINTS])]
    surfaces = surfaces.around(tried)

    def held(pose: Pose2) -> Pose2 | None:
        """The pose with the part in the middle of the jaw, if the jaw holds the part there, too."""
        grip = surfaces.grip(pose)
        return pose @ Pose2(0.0, grip.middle) if grip and (grip.body, grip.part) == (body.id, part) else None

    best, steadiest = None, 0
    for x, y in tried.tolist():
        first, count = longest_run([held(Pose2(x, y, math.pi * yaw / YAWS)) is not None for yaw in range(YAWS)])
        if count > steadiest:
            centred = held(Pose2(x, y, math.pi * (first + (count - 1) / 2) / YAWS))
            if centred is not None and held(centred) is not None:
                best, steadiest = centred, count
        if steadiest >= STEADY:
            break
    return best


def longest_run(flags: Sequence[bool]) -> tuple[int, int]:
    """The first place and the length of the longest run of true flags on a circle."""
    count = len(flags)
    if all(flags):
        return 0, count
    runs = {start: 0 for start in range(count)}
    for start in runs:
        while flags[(start + runs[start]) % count]:
            runs[start] += 1
    start = max(runs, key=lambda place: runs[place])
    return start, runs[start]
