"""Scenes of the pointing game: which bodies lie where, and the phrases that name some of them.

The simulator's poses and masks only score the maps. No map is made with them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gem_lite import colors, language, tasks
from gem_lite.config import Config
from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2
from gem_lite.simulation import shapes
from gem_lite.simulation.rendering import bodies_from_above
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

LITE = Config.preset("lite")
KINDS = ("bowls", "shapes")
"""Cluttered put-block-in-bowl scenes, and scenes of kitting pieces; both in the unseen colours."""
FIRST_SCENE = 3000
"""Scene i comes from test seed ``FIRST_SCENE + i``: evaluations stay below, and calibration uses validation seeds."""
PIECES = 10
"""How many pieces lie in a scene of shapes."""
QUESTIONS = 2
"""How many of these pieces a phrase names."""
PACKING = ("packing-shapes-seen", "packing-shapes-unseen")
"""Tasks in whose episodes the map alone is measured like a method: what would it pick?"""


@dataclass(frozen=True)
class Scene:
    """A laid-out scene. Only ``views`` may reach a map; the rest is the simulator's truth, which scores the map.

    Attributes:
        seed: everything random in the scene comes from it.
        views: the three cameras' RGB-D pictures.
        above: (H, W) id of the body seen straight from above, per cell of the height map.
        names: each body's name, such as "red block", by its id.
        poses: each body's pose, by its id.
        questions: phrases, each with the name of the bodies that it means.
    """

    seed: int
    views: tuple[View, ...]
    above: np.ndarray
    names: dict[int, str]
    poses: dict[int, Pose2]
    questions: tuple[tuple[str, str], ...]

    def poses_of(self, name: str) -> list[Pose2]:
        """The poses of all bodies of that name."""
        return [self.poses[body] for body, body_name in self.names.items() if body_name == name]


def lay_out_bowls(world: World, seed: int, settings: Config = LITE) -> Scene:
    """A put-block-in-bowl scene with its distractors; the questions are the instruction's two phrases."""
    task = tasks.make("put-block-in-bowl-unseen-colors", "test")
    views = world.reset(task, seed)[0].views
    queries = language.parse(task.instruction)
    block, bowl = task.named_colors
    questions = ((queries.pick, f"{block} block"), (queries.place, f"{bowl} bowl"))
    return _scene(world, seed, settings, views, task.names, questions)


def lay_out_shapes(world: World, seed: int, settings: Config = LITE, palette: Sequence[str] = colors.UNSEEN) -> Scene:
    """`PIECES` kitting pieces at random poses, no two of the same colour and shape, with `QUESTIONS` questions.

    Raises:
        RuntimeError: there is no free place for a piece (this has never happened).
    """
    rng = np.random.default_rng(seed)
    pairs = list(itertools.product(palette, shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES))
    world.clear()
    free = FreeSpace(world.workspace, rng)
    names = {}
    for index in rng.choice(len(pairs), PIECES, replace=False):
        color, shape = pairs[index]
        mesh = shapes.piece_mesh(shape)
        pose = free.sample(float(np.linalg.norm(mesh.vertices[:, :2], axis=1).max()))
        if pose is None:
            raise RuntimeError(f"there is no free place for the {color} {shape}")
        names[world.add(shapes.add_mesh(world.client, mesh, colors.rgba(color), pose)).id] = f"{color} {shape}"
    world.settle()
    named = rng.choice(list(names.values()), QUESTIONS, replace=False).tolist()
    return _scene(world, seed, settings, world.observe()[0].views, names, tuple(zip(named, named, strict=True)))


def lay_out_packing(world: World, task_name: str, index: int, settings: Config = LITE) -> Scene:
    """Test episode ``index`` of one of the `PACKING` tasks, as it begins; its question is the pick's phrase."""
    task = tasks.make(task_name, "test")
    seed = tasks.episode_seed("test", index)
    views = world.reset(task, seed)[0].views
    phrase = language.parse(task.instruction).pick
    right_name = next(name for name in task.names.values() if name.lower().endswith(f" {phrase}"))
    return _scene(world, seed, settings, views, task.names, ((phrase, right_name),))


def _scene(
    world: World, seed: int, settings: Config, views: tuple[View, ...], names: dict[int, str],
    questions: tuple[tuple[str, str], ...],
) -> Scene:  # fmt: skip
    poses = {body.id: world.pose(body)[0] for body in world.bodies}
    return Scene(seed, views, bodies_from_above(world.client, settings.workspace), names, poses, questions)


def lay_out(kind: str, world: World, seed: int, settings: Config = LITE) -> Scene:
    """A scene of one of the `KINDS`; everything random in it comes from ``seed``."""
    check_kind(kind)
    if kind == "bowls":
        return lay_out_bowls(world, seed, settings)
    return lay_out_shapes(world, seed, settings)


def check_kind(kind: str) -> None:
    """Raises ValueError if there is no such kind of scene."""
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")


def scene_seeds(scenes: int) -> list[int]:
    """The seeds of the first ``scenes`` scenes, the same for both kinds."""
    if scenes < 1:
        raise ValueError(f"scenes must be at least 1, got {scenes}")
    return [tasks.episode_seed("test", FIRST_SCENE + index) for index in range(scenes)]
