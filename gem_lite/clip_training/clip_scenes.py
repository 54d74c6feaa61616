"""The scenes of the embedded CLIP's pictures: what lies on the table, and what each body is called."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pybullet as p
import pybullet_data
import trimesh

from gem_lite.clip_training import vocabulary
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import kits, objects, piles, ropes, shapes, stands, symbols, tiles, trays
from gem_lite.simulation.shapes import Body
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
STRUCTURES = 0.6
"""Share of the scenes with something that the tasks build: a kit, a stand, a rope, a pile and so on."""
CUBOID = (0.03, 0.1)
"""Range of the sides (m) of blocks that are no cubes."""
BOX_SIDES = (0.06, 0.34)
"""Range of the sides (m) of the large open boxes."""

Kind = Literal["training", "test", "held-out", "foreign"]


@dataclass(frozen=True)
class Label:
    """What a body is called: the indices of its colour (-1: no name) and of its noun, and the names of its parts."""

    color: int
    noun: int
    parts: tuple[str, ...] = ()


@dataclass
class Scene:
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
    scene: Scene

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
        return -1, noun, symbols.WALLS
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
        return symbols.BOX_RADIUS
    if noun in ("box", "plate", *objects.NAMES) or noun.endswith("towel"):
        return 0.056
    radii = {"bowl": 0.058, "block": 0.03, "L-block": 0.07, "ball": 0.024, "cylinder": 0.024, "cone": 0.028}
    return radii.get(noun, 0.042)


def _add(build: Builder, noun: str, color: tuple[float, ...], pose: Pose2) -> int:
    client = build.client
    if noun == "block":
        return shapes.add_block(client, color, pose).id
    if noun == "bowl":
        return shapes.add_bowl(client, color, pose, movable=False).id
    if build.kind == "foreign" and noun in ("mug", "duck"):
        return shapes.add_mesh(client, foreign_mesh(noun), color, pose).id
    if noun in vocabulary.BOXES:
        return symbols.add_symbol_box(client, noun.removesuffix(" box"), pose).id
    if noun in tiles.TILES:
        return tiles.add_tile(client, noun, color, pose).id
    if noun in vocabulary.TEXTURED:
        texture, thing = noun.split()
        add = tiles.add_towel if thing == "towel" else tiles.add_textured_block
        return add(client, texture, color, pose).id
    if noun in objects.NAMES:
        first = 0 if build.kind == "training" else TEST_VARIANTS
        variant = first + int(build.rng.integers(objects.TRAINING_VARIANTS))
        return objects.add_object(client, noun, color, pose, variant, movable=False).id
    if noun == "L-block":
        mesh = shapes.l_block_mesh()
    else:
        mesh = shapes.basic_mesh(noun) if noun in shapes.BASIC else shapes.piece_mesh(noun)
    return shapes.add_mesh(client, mesh, color, pose).id


def _fill(build: Builder) -> None:
    """Put single bodies on what is left of the table."""
    rng = build.rng
    for _ in range(rng.integers(10, 20)):
        color, noun, rgba = draw(build.kind, rng)
        pose = build.free.sample(_radius(noun))
        if pose is None:
            continue
        of_parts = noun in objects.NAMES and build.kind != "foreign"
        named = tuple(part.name for part in objects.parts(noun)) if of_parts else ()
        build.scene.labels[_add(build, noun, rgba, pose)] = Label(color, NOUN_NAMES.index(noun), named)
        if noun == "bowl" and rng.random() < 0.15:
            _put_block(build, pose, 0.031)


def _put_block(build: Builder, pose: Pose2, height: float) -> None:
    """A block with its middle at a height (m), as the table shows it after a placement."""
    color, rgba = build.color("block")
    block = shapes.add_block(build.client, rgba, pose)
    turn = p.getQuaternionFromEuler((0, 0, build.rng.uniform(0, 6)))
    p.resetBasePositionAndOrientation(block.id, (pose.x, pose.y, height), turn, physicsClientId=build.client)
    build.scene.name([block], color, "block")


# What the tasks build


def _kit(build: Builder) -> None:
    pose = build.free.sample(math.hypot(*kits.KIT_SIZE[:2]) / 2)
    if pose is None:
        return
    names = [str(name) for name in build.rng.choice(vocabulary.PIECES, len(kits.SPOTS))]
    yaws = build.rng.uniform(-np.pi, np.pi, len(names)).tolist()
    board, holes = kits.add_full_kit(build.client, pose, names, yaws)
    build.scene.name([board], -1, "kit")
    build.scene.ground.add(board.id)
    for hole, name, spot, yaw in zip(holes, names, kits.SPOTS, yaws, strict=True):
        build.scene.name([hole], -1, f"{name} hole")
        if build.rng.random() < 0.2:
            color, rgba = build.color(name)
            place = pose @ spot
            piece = shapes.add_mesh(build.client, shapes.piece_mesh(name), rgba, Pose2(place.x, place.y, yaw))
            build.scene.name([piece], color, name)


def _stand(build: Builder) -> None:
    pose = build.free.sample(stands.STAND_RADIUS)
    if pose is None:
        return
    plates = stands.add_stand(build.client, pose)
    names = (("light brown", "side"), ("brown", "middle of the stand"), ("dark brown", "side"))
    for plate, (color, noun) in zip(plates, names, strict=True):
        build.scene.name([plate], COLOR_NAMES.index(color), noun)
        build.scene.ground.add(plate.id)
    height = [stands.PLATE[2]] * len(plates)
    for radius in sorted(stands.RING_RADII, reverse=True):
        peg = int(build.rng.integers(len(plates)))
        place = pose @ Pose2(0.0, (peg - 1) * stands.PLATE[1])
        color, rgba = build.color("ring")
        build.scene.name([stands.add_ring(build.client, radius, rgba, place, height[peg])], color, "ring")
        height[peg] += stands.RING_HEIGHT


def _pyramid(build: Builder) -> None:
    pose = build.free.sample(0.08)
    if pose is None:
        return
    for number, name in enumerate(("light brown", "brown", "dark brown")):
        place = pose @ Pose2(0.0, (number - 1) * 0.05)
        rgba = jittered(vocabulary.RGB[name], build.rng)
        plate = shapes.add_box(build.client, (0.05, 0.05, 0.005), rgba, place, movable=False)
        build.scene.name([plate], COLOR_NAMES.index(name), "block")
        if build.rng.random() < 0.4:
            _put_block(build, place, 0.025)


def _rope(build: Builder) -> None:
    guide_pose = build.free.sample(ropes.LENGTH / math.sqrt(2) + ropes.STRIP[0])
    if guide_pose is not None:
        build.scene.name([ropes.add_guide(build.client, guide_pose)], COLOR_NAMES.index("lime"), "square guide")
    middle = build.free.sample(0.1)
    if middle is None:
        return
    heading = np.cumsum(build.rng.normal(0, 0.5, ropes.BEADS)) + middle.yaw
    steps = ropes.SPACING * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    points = np.cumsum(steps, axis=0)
    points = points - points.mean(axis=0) + (middle.x, middle.y)
    heights = np.full(ropes.BEADS, 1.5 * ropes.BEAD)
    beads = ropes.add_rope(build.client, np.column_stack([points, heights]))
    color = COLOR_NAMES.index("red")
    if build.rng.random() < 0.5:
        color, rgba = build.color("rope")
        for bead in beads[1:-1]:
            p.changeVisualShape(bead.id, -1, rgbaColor=rgba, physicsClientId=build.client)
    build.scene.name(beads, color, "rope")


def _pile(build: Builder) -> None:
    middle = build.free.sample(0.1)
    if middle is None:
        return
    spread = build.rng.uniform(0.03, 0.1)
    offsets = build.rng.uniform(-spread, spread, (piles.CUBES, 2))
    poses = [middle @ Pose2(float(x), float(y), 40 * float(x + y)) for x, y in offsets]
    color, rgba = build.color("pile of {} blocks")
    build.scene.name(piles.add_pile(build.client, rgba, poses), color, "pile of {} blocks")
    for _ in range(2):
        pose = build.free.sample(piles.SQUARE / math.sqrt(2))
        if pose is not None:
            color, rgba = build.color("square")
            build.scene.name([piles.add_square(build.client, rgba, pose)], color, "square")


def _packing(build: Builder) -> None:
    x, y = build.rng.uniform(*BOX_SIDES, 2).tolist()
    pose = build.free.sample(math.hypot(x, y) / 2)
    if pose is None:
        return
    color, rgba = build.color("box")
    if build.rng.random() < 0.6:
        color, rgba = COLOR_NAMES.index("brown"), jittered(vocabulary.RGB["brown"], build.rng)
    height = build.rng.uniform(0.03, 0.07)
    box = trays.add_container(build.client, (x, y), rgba, pose, height)
    build.scene.name([box], color, "box")
    build.scene.ground.add(box.id)
    for _ in range(build.rng.integers(1, 7)):
        size = build.rng.uniform(*CUBOID, 2).tolist()
        place = build.free.sample(math.hypot(*size) / 2)
        if place is not None:
            color, rgba = build.color("block")
            block = shapes.add_box(build.client, (size[0], size[1], build.rng.uniform(0.03, 0.05)), rgba, place)
            build.scene.name([block], color, "block")
    if min(x, y) > 0.12 and build.rng.random() < 0.5:
        noun = str(build.rng.choice(objects.NAMES))
        color, rgba = build.color(noun)
        build.scene.labels[_add(build, noun, rgba, pose)] = Label(color, NOUN_NAMES.index(noun))


_BUILDERS: tuple[tuple[Callable[[Builder], None], float], ...] = (
    (_kit, 0.28), (_stand, 0.14), (_pyramid, 0.1), (_rope, 0.14), (_pile, 0.14), (_packing, 0.2),
)  # fmt: skip
"""The structures and their shares."""


def _background(client: int, rng: np.random.Generator) -> None:
    gray = rng.uniform(0.17, 0.4)
    sheet = p.createVisualShape(
        p.GEOM_BOX, halfExtents=(0.25, 0.5, 5e-4), rgbaColor=(*(gray + rng.normal(0, 0.015, 3)), 1),
        physicsClientId=client,
    )  # fmt: skip
    p.createMultiBody(0, -1, sheet, (0.5, 0, -5e-4), physicsClientId=client)
    floor = p.createVisualShape(
        p.GEOM_BOX, halfExtents=(3, 3, 5e-4), rgbaColor=(*([rng.uniform(0.15, 0.5)] * 3), 1), physicsClientId=client
    )
    p.createMultiBody(0, -1, floor, (0.5, 0, -0.1), physicsClientId=client)


def lay_out(client: int, workspace: Workspace, kind: Kind, rng: np.random.Generator) -> Scene:
    """Fill the table."""
    _background(client, rng)
    build = Builder(client, FreeSpace(workspace, rng, gap=0.004), kind, rng, Scene())
    if rng.random() < STRUCTURES:
        functions, shares = zip(*_BUILDERS, strict=True)
        functions[int(rng.choice(len(functions), p=shares))](build)
    _fill(build)
    return build.scene
