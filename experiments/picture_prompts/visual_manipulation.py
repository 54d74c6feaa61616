"""The task visual-manipulation, after VIMABench: "put [picture] into [picture]". Its sentence names nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from typing_extensions import override

from experiments.picture_prompts import patterned, textures
from experiments.picture_prompts.portraits import portrait
from gem_lite.language import ImageQuery, PictureSentence
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.spawn import FreeSpace, TableFullError
from gem_lite.tasks.task import Split, Task

Level = Literal["placement", "combinations", "objects"]
"""VIMABench's levels 1, 2 and 3."""
NEAR = 0.1
"""Two things whose origins are less than this (m) apart, seen from above, are near each other."""
ACTS = 5
LAYOUTS = 100
"""So many layouts are tried until one can be won."""
MARGIN = 0.05
"""A portrait is so much larger than the thing, as a share of the thing's side."""
SMALLEST_PORTRAIT = 0.125
"""A portrait shows at least a square of this side (m): that of a crop of `lite`."""


@dataclass(frozen=True)
class Lists:
    """From what an episode is drawn: the names of shapes, and of textures, of what is dragged and of containers."""

    dragged: tuple[str, ...]
    containers: tuple[str, ...]
    dragged_textures: tuple[str, ...]
    container_textures: tuple[str, ...]


_DRAGGED = tuple(name for name in patterned.DRAGGED if name not in patterned.HELD_OUT_DRAGGED)
_CONTAINERS = tuple(name for name in patterned.CONTAINERS if name not in patterned.HELD_OUT_CONTAINERS)
LISTS: dict[Level, Lists] = {
    "placement": Lists(_DRAGGED, _CONTAINERS, textures.W, textures.C),
    "combinations": Lists(_DRAGGED, _CONTAINERS, textures.C, textures.W),
    "objects": Lists(
        patterned.HELD_OUT_DRAGGED, patterned.HELD_OUT_CONTAINERS, textures.NAMES[:24], textures.NAMES[24:]
    ),
}  # fmt: skip
"""As in VIMABench: all textures are in the third level, in our order, and ten of them in no other."""


@dataclass(frozen=True)
class Thing:
    """A shape with a texture; ``sides`` (m) are those of the shape "container"."""

    name: str
    texture: str
    sides: tuple[float, float]

    def __str__(self) -> str:
        return f"{self.texture} {self.name}"

    def add(self, client: int, pose: Pose2) -> Body:
        """Put it on the table."""
        return patterned.add(client, self.name, self.texture, pose, self.sides)

    @property
    def radius(self) -> float:
        """It lies within a circle of this radius (m) about its origin."""
        return patterned.radius(self.name, self.sides)

    def portrait(self) -> np.ndarray:
        """It alone, unturned, from above."""
        x, y, side = patterned.square(self.name, self.sides)

        def put(client: int, middle: Pose2) -> Body:
            return self.add(client, middle @ Pose2(-x, -y))

        return portrait(put, max(SMALLEST_PORTRAIT, (1 + MARGIN) * side))


class VisualManipulation(Task):
    """A thing to drag, a fixed container, and a distractor of any other look. The sentence shows the first two.

    The thing is in the container if it is `NEAR` it, whatever its yaw. The episode is lost, and over, if the distractor
    is near the container or the thing, even if the thing is in the container, or if the thing left the table.
    In training, all levels draw from the lists of "placement".
    """

    def __init__(self, split: Split = "train", unseen: bool = False, level: Level = "placement") -> None:
        super().__init__(split, unseen)
        self.lists = LISTS["placement" if split == "train" else level]
        self._bodies: tuple[Body, ...] = ()

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        self.max_steps = ACTS
        things = self._draw_things(rng)
        poses = self._draw_poses(environment, rng, things)
        self._bodies = tuple(
            self.put(environment, thing.add(environment.client, pose), str(thing))
            for thing, pose in zip(things, poses, strict=True)
        )
        dragged, container, _ = self._bodies
        pictures = [ImageQuery(thing.portrait(), f"picture-{i}") for i, thing in enumerate(things[:2])]
        sentence = PictureSentence("put {0} into {1}", tuple(pictures))
        grasp = Pose2(*patterned.grasp_point(things[0].name))
        return [Goal(sentence, (dragged,), (container,), PoseMetric(NEAR), grasp=grasp)]

    @override
    def score(self, environment: Environment) -> float:
        return 0.0 if self.lost(environment) else super().score(environment)

    @override
    def advance(self, environment: Environment) -> None:
        super().advance(environment)
        if self.lost(environment):
            self.max_steps = environment.steps_taken

    def lost(self, environment: Environment) -> bool:
        """Whether nothing can be won any more."""
        poses = [environment.pose(body)[0] for body in self._bodies]
        place, _ = environment.on_table(poses[0])
        return not winnable(poses) or not environment.workspace.contains(place.x, place.y)

    def _draw_things(self, rng: np.random.Generator) -> tuple[Thing, Thing, Thing]:
        """The thing to drag, its container, and the distractor."""
        lists = self.lists

        def draw_thing(names: Sequence[str], of_textures: Sequence[str]) -> Thing:
            name, texture = str(rng.choice(names)), str(rng.choice(of_textures))
            x, y = rng.uniform(*patterned.CONTAINER_SIDES, 2).tolist()
            return Thing(name, texture, (x, y))

        dragged = draw_thing(lists.dragged, lists.dragged_textures)
        container = draw_thing(lists.containers, lists.container_textures)
        distractor = dragged
        while str(distractor) in (str(dragged), str(container)):
            distractor = draw_thing(
                lists.dragged + lists.containers, lists.dragged_textures + lists.container_textures
            )  # fmt: skip
        return dragged, container, distractor

    def _draw_poses(self, environment: Environment, rng: np.random.Generator, things: Sequence[Thing]) -> list[Pose2]:
        """Free poses. Unlike VIMABench, a layout that is lost from the beginning is drawn again."""
        for _ in range(LAYOUTS):
            free = FreeSpace(environment.workspace, rng, environment.style)
            container, dragged, distractor = (free.sample(thing.radius) for thing in (things[1], things[0], things[2]))
            if dragged and container and distractor and winnable([dragged, container, distractor]):
                return [dragged, container, distractor]
        raise TableFullError(f"none of {LAYOUTS} layouts has free places for {', '.join(map(str, things))}")


def winnable(poses: Sequence[Pose2]) -> bool:
    """Whether the distractor is near none of the thing to drag and its container: their three poses, it comes last."""
    *others, distractor = poses
    return all(math.hypot(pose.x - distractor.x, pose.y - distractor.y) >= NEAR for pose in others)
