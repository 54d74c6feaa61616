"""The pointing game: the centre of a map's highest plateau must lie on the thing that the phrase names.

Nothing is trained for it. It follows Zhang et al., "Top-down Neural Attention by Excitation Backprop" (ECCV 2016).
The simulator's poses and masks only score the maps; no map is made with them. `python -m experiments.pointing` plays
many scenes and files the rows.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gem_lite import language, tasks
from gem_lite.foundations import colors
from gem_lite.maps import semantic_map
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.camera import Camera, View
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.rendering import render
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

KINDS = ("bowls", "shapes")
"""Cluttered put-block-in-bowl scenes, and scenes of kitting pieces; both in the unseen colours."""
PIECES = 10
"""How many pieces lie in a scene of shapes."""
QUESTIONS = 2
"""How many of these pieces a phrase names."""
MATCHED = "matched-single-view"
"""A map from patches of the height map that are as wide as those of `WIDE` are on the table, on average."""
WIDE = "wide-patches"
"""A map of three views like "fused", from the paper's patches of 40 pixels."""
RADIUS = 0.02
"""A map is near a right body if it points at most this far (m, in x and y) from its centre: half a block."""
NEAR = f"within_{1000 * RADIUS:.0f}mm"
"""The entry of a row that says how often a map was near."""


@dataclass(frozen=True)
class AskedScene:
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
    views: Sequence[View]
    above: np.ndarray
    names: dict[int, str]
    poses: dict[int, Pose2]
    questions: Sequence[tuple[str, str]]

    def poses_of(self, name: str) -> list[Pose2]:
        """The poses of all bodies of that name."""
        return [self.poses[body] for body, body_name in self.names.items() if body_name == name]


def scene_of(
    world: World, seed: int, views: Sequence[View], names: dict[int, str], questions: Sequence[tuple[str, str]]
) -> AskedScene:
    """What lies in a world now, as a scene."""
    poses = {body.id: world.pose(body)[0] for body in world.bodies}
    return AskedScene(seed, views, bodies_from_above(world.client, LITE.workspace), names, poses, questions)


def bodies_from_above(client: int, workspace: Workspace) -> np.ndarray:
    """The topmost body in each cell of a height map: the truth, for scores and tests.

    Returns:
        (H, W) body ids (-1: no body) at the centres of the cells.
    """
    # A camera 50 m above the table moves the top of a block by less than half a millimetre. An orthographic projection
    # would be exact, but with it TinyRenderer loses parts of bowls.
    w = workspace
    height = 50.0
    position = ((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2, height)
    near = height - w.z_max
    far = height + 1
    camera = Camera.pinhole("above", position, (1.0, 0.0, 0.0, 0.0), w.shape, height / w.pixel, near, far)
    ids = render(client, camera, segmentation=True)[1]
    return np.where(ids < 0, ids, ids & 0xFFFFFF)  # without the bits of the link


def lay_out(kind: str, world: World, seed: int) -> AskedScene:
    """A scene of one of the `KINDS`; everything random in it comes from ``seed``."""
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    return lay_out_bowls(world, seed) if kind == "bowls" else lay_out_shapes(world, seed)


def lay_out_bowls(world: World, seed: int) -> AskedScene:
    """A put-block-in-bowl scene with its distractors; the questions are the instruction's two phrases."""
    task = tasks.make("put-block-in-bowl-unseen-colors", "test")
    views = world.reset(task, seed)[0].views
    queries = language.parse(task.instruction)
    block, bowl = task.named_colors
    return scene_of(world, seed, views, task.names, ((queries.pick, f"{block} block"), (queries.place, f"{bowl} bowl")))


def lay_out_shapes(world: World, seed: int, palette: Sequence[str] = colors.UNSEEN) -> AskedScene:
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
    return scene_of(world, seed, world.observe()[0].views, names, tuple(zip(named, named, strict=True)))


@dataclass(frozen=True)
class Pointing:
    """The point at which one map pointed for one phrase.

    Attributes:
        row, col: the plateau's centre, in cells.
        distance: metres, in x and y, from that point to the nearest right body's centre.
        shown: the name of the body that is seen from above at that point, or "table".
        exact: whether it is a right body.
    """

    seed: int
    phrase: str
    map: str
    row: float
    col: float
    distance: float
    shown: str
    exact: bool

    @property
    def near(self) -> bool:
        """Whether a right body's centre lies within `RADIUS`."""
        return self.distance <= RADIUS


def point(semantic: np.ndarray, name: str, scene: AskedScene, question: tuple[str, str]) -> Pointing:
    """The point at which a map (H, W) points, scored against the scene's truth; ``name`` is the map's."""
    phrase, right_name = question
    row, col = semantic_map.plateau_centre(semantic, LITE)
    x, y = LITE.workspace.to_world(row, col)
    distance = min(float(np.hypot(x - pose.x, y - pose.y)) for pose in scene.poses_of(right_name))
    shown = scene.names.get(int(scene.above[LITE.workspace.nearest_cell(x, y)]), "table")
    return Pointing(scene.seed, phrase, name, row, col, distance, shown, shown == right_name)
