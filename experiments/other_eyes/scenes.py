"""Test scenes with the things that sentences name: bowls, a part of an object, and two blocks that touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from typing_extensions import override

from experiments.clip_tabletop.part_peaks import owners_from_above
from gem_lite import language, tasks
from gem_lite.foundations import colors
from gem_lite.policies.gem_config import GemConfig
from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.grips import Surfaces
from gem_lite.simulation.world import World
from gem_lite.tasks.goals import Goal
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Split, Task

BOWLS = "put-block-in-bowl-seen-colors"
PARTS = "pick-object-part-in-brown-box-seen"
TOUCHING = "touching-blocks"
WORLDS = {BOWLS: "home", PARTS: "real-table", TOUCHING: "home"}
"""The kinds of scenes, and the world in which each is shown."""
BETWEEN_MIDDLES = shapes.BLOCK_SIZE + 0.0005
"""The distance (m) of the middles of two blocks that touch."""


class TouchingBlocks(Task):
    """Two blocks of different colours side by side, and a third one alone. Nobody acts here, so there is no goal."""

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        named, beside, alone = draw(rng, tuple(colors.RGB), 3)
        middle = free.take(float(np.hypot(shapes.BLOCK_SIZE, shapes.BLOCK_SIZE / 2)))
        offset = Pose2(0.0, BETWEEN_MIDDLES / 2)
        self.named_color = named
        self.named_block = self._add(environment, named, middle @ offset)
        self._add(environment, beside, middle @ Pose2(0.0, -BETWEEN_MIDDLES / 2))
        self._add(environment, alone, free.take(shapes.BLOCK_SIZE / 2**0.5))
        return []

    def _add(self, environment: Environment, color: str, pose: Pose2) -> Body:
        block = shapes.add_block(environment.client, colors.rgba(color), pose)
        return self.put(environment, block, f"{color} block")


@dataclass(frozen=True)
class Question:
    """A phrase, and where the thing lies that it names.

    Attributes:
        role: which thing of the scene is asked for: "pick", "part" or "place".
        cells: (H, W) bool, the cells whose topmost point is the thing's.
    """

    role: str
    phrase: str
    cells: np.ndarray


@dataclass(frozen=True)
class Scene:
    """What the cameras show, and what is asked."""

    views: Sequence[View]
    questions: tuple[Question, ...]


def make(kind: str, split: Split) -> Task:
    """A new task of a kind of `WORLDS`."""
    return TouchingBlocks(split) if kind == TOUCHING else tasks.make(kind, split)


def world_of(kind: str) -> World:
    """The world in which a kind of scenes is shown."""
    return World(style=looks.style(WORLDS[kind]))


def configuration(kind: str) -> GemConfig:
    """`lite` on the table of a kind of scenes."""
    task = make(kind, "test")
    return GemConfig.preset("lite").for_table(task.workspace.limits, task.scale)


def look(world: World, kind: str, split: Split, index: int, phrase: str = "") -> Scene:
    """The beginning of an episode; with a ``phrase``, its first scene whose sentence holds it.

    Args:
        world: of `world_of`.
    """
    task = make(kind, split)
    (observation,) = world.reset(task, tasks.episode_seed(split, index))
    if kind == PARTS:
        while phrase not in task.goals[0].sentence:  # An episode asks for each part once.
            task.advance(world)
        (observation,) = world.observe()
    surfaces = Surfaces.of(world.client, world.bodies)
    owners = owners_from_above(surfaces, configuration(kind).workspace)
    questions = []
    for role, asked, bodies, part in _asked(task):
        numbers = [
            number for number, (body, name) in enumerate(surfaces.parts) if body in bodies and part in (None, name)
        ]  # fmt: skip
        questions.append(Question(role, asked, np.isin(owners, numbers)))
    return Scene(observation.views, tuple(questions))


def _asked(task: Task) -> list[tuple[str, str, tuple[Body, ...], str | None]]:
    """What a scene asks: the role, the phrase, the bodies that it names, and the part of them, None for all."""
    if isinstance(task, TouchingBlocks):
        return [("pick", f"{task.named_color} block", (task.named_block,), None)]
    goal = task.goals[0]
    queries = language.parse(goal.sentence)
    part = getattr(goal.metric, "part", None)
    bowls = tuple(target for target in goal.targets if isinstance(target, Body))
    return [
        ("pick" if part is None else "part", str(queries.pick), tuple(goal.bodies), part),
        ("place", str(queries.place), bowls, None),
    ]
