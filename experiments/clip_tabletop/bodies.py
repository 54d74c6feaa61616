"""The single bodies of the embedded CLIP's pictures, their colours, and what each body is called."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pybullet as p
import pybullet_data
import trimesh

from experiments.clip_tabletop import basic_solids, printed, vocabulary
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import objects, shapes, tiles
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.tasks import object_sorting
from gem_lite.tasks.spawn import FreeSpace

COLOR_NAMES, SHAPE_NAMES, NOUN_NAMES = (
    tuple(names) for names in (vocabulary.COLORS, vocabulary.SHAPES, vocabulary.NOUNS)
)
UNNAMED = 0.35
"""Share of training's bodies in any colour at all: their captions name the shape alone, so shape is
learned apart from the named colours and combines with colours that it was never shown in."""
TEST_VARIANTS = 1000
"""Objects in test scenes have variants from here on; see `objects.TRAINING_VARIANTS`."""
SHARES = {"plain": 0.2, "tile": 0.15, "symbol": 0.05}
"""Shares of blocks and bowls, of tiles, and of symbol boxes among the bodies; the others are drawn from all shapes."""
Kind = Literal["training", "test", "held-out", "foreign"]


@dataclass(frozen=True)
class Label:
    """What a body is called: the indices of its colour (-1: no name) and of its noun, and the names of its parts."""

    color: int
    noun: int
    parts: tuple[str, ...] = ()


@dataclass
class LabelledScene:
    """The bodies of a scene.

    Attributes:
        labels: the label of each body by its id.
        leader: the id that stands for a body of a group that has one label, such as the cubes of a pile.
        ground: the bodies on which others lie, such as a kit. In a crop, what lies on them counts more than they do.
    """

    labels: dict[int, Label] = field(default_factory=dict)
    leader: dict[int, int] = field(default_factory=dict)
    ground: set[int] = field(default_factory=set)

    def grouped(self, bodies: np.ndarray) -> np.ndarray:
        """An array of body ids (-1: no body), with each body's leader in its place."""
        leaders = np.arange(-1, max(bodies.max(), *self.leader, 0) + 1)
        for body, leader in self.leader.items():
            leaders[body + 1] = leader
        return leaders[bodies + 1]

    def name(self, bodies: list[Body], color: int, noun: str) -> None:
        """Give several bodies one label. In pictures they count as one body, the first."""
        self.labels[bodies[0].id] = Label(color, NOUN_NAMES.index(noun))
        for body in bodies:
            self.leader[body.id] = bodies[0].id


@dataclass(frozen=True)
class Builder:
    """Where a scene is built: the physics client, the free space, the kind of the scene, and the random choices."""

    client: int
    free: FreeSpace
    kind: Kind
    rng: np.random.Generator
    scene: LabelledScene

    def color(self, noun: str) -> tuple[int, tuple[float, ...]]:
        """A colour for a noun: its index (-1: unnamed) and an RGBA value."""
        return draw_color(noun, self.kind, self.rng)


def jittered(rgb: tuple[int, int, int], rng: np.random.Generator) -> tuple[float, ...]:
    """The RGBA of a colour, a little changed."""
    color = np.array(rgb) * rng.uniform(0.9, 1.08) + rng.normal(0, 6, 3)
    return (*np.clip(color / 255, 0, 1), 1.0)


@cache
def foreign_mesh(name: str) -> trimesh.Trimesh:
    """pybullet_data's own "mug" or "duck", 80 mm long: a mesh from outside this project, which is in no training."""
    file = {"mug": "objects/mug.obj", "duck": "duck.obj"}[name]
    mesh = trimesh.load(Path(pybullet_data.getDataPath()) / file, force="mesh")
    # The duck's file has y up.
    if name == "duck":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    mesh.apply_scale(0.08 / max(mesh.extents))
    centre = mesh.bounds.mean(axis=0)
    return mesh.apply_translation([-centre[0], -centre[1], -mesh.bounds[0, 2]])


# Single bodies


def draw(kind: Kind, rng: np.random.Generator) -> tuple[int, str, tuple[float, ...]]:
    """A colour's index (-1: unnamed), a noun and an RGBA value."""
    if kind == "held-out" and rng.random() < 0.5:
        color, shape = sorted(vocabulary.HELD_OUT)[rng.integers(len(vocabulary.HELD_OUT))]
        return COLOR_NAMES.index(color), shape, jittered(vocabulary.RGB[color], rng)
    noun = _draw_noun(kind, rng)
    if noun in vocabulary.BOXES:
        return -1, noun, object_sorting.WALLS
    color, rgba = draw_color(noun, kind, rng)
    return color, noun, rgba


def draw_color(noun: str, kind: Kind, rng: np.random.Generator) -> tuple[int, tuple[float, ...]]:
    """A colour's index (-1: unnamed) and an RGBA value. It is none of those that are held out for the noun."""
    while True:
        unnamed = kind == "training" and rng.random() < UNNAMED
        rgb = rng.uniform(0, 255, 3) if unnamed else np.zeros(3)
        color = vocabulary.nearest_color(rgb) if unnamed else str(rng.choice(COLOR_NAMES))
        # An unnamed red-like hexagon would show what is held out.
        if (color, noun) in vocabulary.HELD_OUT:
            continue
        if unnamed:
            return -1, (*(rgb / 255), 1.0)
        return COLOR_NAMES.index(color), jittered(vocabulary.RGB[color], rng)


def _draw_noun(kind: Kind, rng: np.random.Generator) -> str:
    if kind == "foreign" and rng.random() < 0.5:
        return str(rng.choice(["mug", "duck"]))
    chance = rng.random()
    for group, nouns in (("plain", ("block", "bowl")), ("tile", tiles.TILES), ("symbol", tuple(vocabulary.BOXES))):
        if chance < SHARES[group]:
            return str(rng.choice(nouns))
        chance -= SHARES[group]
    return str(rng.choice(SHAPE_NAMES))


def _radius(noun: str) -> float:
    if noun in vocabulary.BOXES:
        return object_sorting.BOX_RADIUS
    if noun in ("box", "plate", *objects.NAMES) or noun.endswith("towel"):
        return 0.056
    radii = {"bowl": 0.058, "block": 0.03, "L-block": 0.07, "ball": 0.024, "cylinder": 0.024, "cone": 0.028}
    return radii.get(noun, 0.042)


def add(build: Builder, noun: str, color: tuple[float, ...], pose: Pose2) -> int:
    """Put the body of a noun on the table. Returns its id."""
    client = build.client
    if noun == "block":
        return shapes.add_block(client, color, pose).id
    if noun == "bowl":
        return shapes.add_bowl(client, color, pose, movable=False).id
    if build.kind == "foreign" and noun in ("mug", "duck"):
        return shapes.add_mesh(client, foreign_mesh(noun), color, pose).id
    if noun in vocabulary.BOXES:
        return object_sorting.add_symbol_box(client, noun.removesuffix(" box"), pose).id
    if noun in tiles.TILES:
        return printed.add_tile(client, noun, color, pose).id
    if noun in vocabulary.TEXTURED:
        texture, thing = noun.split()
        add = printed.add_towel if thing == "towel" else printed.add_textured_block
        return add(client, texture, color, pose).id
    if noun in objects.NAMES:
        first = 0 if build.kind == "training" else TEST_VARIANTS
        variant = first + int(build.rng.integers(objects.TRAINING_VARIANTS))
        return objects.add_object(client, noun, color, pose, variant, movable=False).id
    if noun == "L-block":
        mesh = shapes.l_block_mesh()
    else:
        mesh = basic_solids.basic_mesh(noun) if noun in basic_solids.BASIC else shapes.piece_mesh(noun)
    return shapes.add_mesh(client, mesh, color, pose).id


def fill(build: Builder) -> None:
    """Put single bodies on what is left of the table."""
    rng = build.rng
    for _ in range(rng.integers(10, 20)):
        color, noun, rgba = draw(build.kind, rng)
        pose = build.free.sample(_radius(noun))
        if pose is None:
            continue
        of_parts = noun in objects.NAMES and build.kind != "foreign"
        named = tuple(part.name for part in objects.parts(noun)) if of_parts else ()
        build.scene.labels[add(build, noun, rgba, pose)] = Label(color, NOUN_NAMES.index(noun), named)
        if noun == "bowl" and rng.random() < 0.15:
            put_block(build, pose, 0.031)


def put_block(build: Builder, pose: Pose2, height: float) -> None:
    """A block with its middle at a height (m), as the table shows it after a placement."""
    color, rgba = build.color("block")
    block = shapes.add_block(build.client, rgba, pose)
    turn = p.getQuaternionFromEuler((0, 0, build.rng.uniform(0, 6)))
    p.resetBasePositionAndOrientation(block.id, (pose.x, pose.y, height), turn, physicsClientId=build.client)
    build.scene.name([block], color, "block")
