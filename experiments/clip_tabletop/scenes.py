"""The scenes of the embedded CLIP's pictures: what the tasks build on the table, among single bodies."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pybullet as p

from experiments.clip_tabletop import vocabulary
from experiments.clip_tabletop.bodies import (
    COLOR_NAMES,
    NOUN_NAMES,
    Builder,
    Kind,
    Label,
    LabelledScene,
    add,
    fill,
    jittered,
    put_block,
)
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import objects, shapes, trays
from gem_lite.tasks import align_rope, assembling_kits, separating_piles, towers_of_hanoi
from gem_lite.tasks.spawn import FreeSpace

STRUCTURES = 0.6
"""Share of the scenes with something that the tasks build: a kit, a stand, a rope, a pile and so on."""
CUBOID = (0.03, 0.1)
"""Range of the sides (m) of blocks that are no cubes."""
BOX_SIDES = (0.06, 0.34)
"""Range of the sides (m) of the large open boxes."""


def _kit(build: Builder) -> None:
    pose = build.free.sample(math.hypot(*assembling_kits.KIT_SIZE[:2]) / 2)
    if pose is None:
        return
    names = [str(name) for name in build.rng.choice(vocabulary.PIECES, len(assembling_kits.SPOTS))]
    yaws = build.rng.uniform(-np.pi, np.pi, len(names)).tolist()
    board, holes = assembling_kits.add_full_kit(build.client, pose, names, yaws, [shapes.USUAL_FORM] * len(names))
    build.scene.name([board], -1, "kit")
    build.scene.ground.add(board.id)
    for hole, name, spot, yaw in zip(holes, names, assembling_kits.SPOTS, yaws, strict=True):
        build.scene.name([hole], -1, f"{name} hole")
        if build.rng.random() < 0.2:
            color, rgba = build.color(name)
            place = pose @ spot
            piece = shapes.add_mesh(build.client, shapes.piece_mesh(name), rgba, Pose2(place.x, place.y, yaw))
            build.scene.name([piece], color, name)


def _stand(build: Builder) -> None:
    pose = build.free.sample(towers_of_hanoi.STAND_RADIUS)
    if pose is None:
        return
    plates = towers_of_hanoi.add_stand(build.client, pose)
    names = (("light brown", "side"), ("brown", "middle of the stand"), ("dark brown", "side"))
    for plate, (color, noun) in zip(plates, names, strict=True):
        build.scene.name([plate], COLOR_NAMES.index(color), noun)
        build.scene.ground.add(plate.id)
    height = [towers_of_hanoi.THICKNESS] * len(plates)
    for radius in sorted(towers_of_hanoi.RING_RADII, reverse=True):
        peg = int(build.rng.integers(len(plates)))
        place = pose @ Pose2(0.0, (peg - 1) * towers_of_hanoi.SIDE)
        color, rgba = build.color("ring")
        build.scene.name([towers_of_hanoi.add_ring(build.client, radius, rgba, place, height[peg])], color, "ring")
        height[peg] += towers_of_hanoi.RING_HEIGHT


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
            put_block(build, place, 0.025)


def _rope(build: Builder) -> None:
    guide_pose = build.free.sample(align_rope.LENGTH / math.sqrt(2) + align_rope.STRIP[0])
    if guide_pose is not None:
        build.scene.name([align_rope.add_guide(build.client, guide_pose)], COLOR_NAMES.index("lime"), "square guide")
    middle = build.free.sample(0.1)
    if middle is None:
        return
    heading = np.cumsum(build.rng.normal(0, 0.5, align_rope.BEADS)) + middle.yaw
    steps = align_rope.SPACING * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    points = np.cumsum(steps, axis=0)
    points = points - points.mean(axis=0) + (middle.x, middle.y)
    heights = np.full(align_rope.BEADS, 1.5 * align_rope.BEAD)
    beads = align_rope.add_rope(build.client, np.column_stack([points, heights]))
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
    offsets = build.rng.uniform(-spread, spread, (separating_piles.CUBES, 2))
    poses = [middle @ Pose2(float(x), float(y), 40 * float(x + y)) for x, y in offsets]
    color, rgba = build.color("pile of {} blocks")
    build.scene.name(separating_piles.add_pile(build.client, rgba, poses), color, "pile of {} blocks")
    for _ in range(2):
        pose = build.free.sample(separating_piles.SQUARE / math.sqrt(2))
        if pose is not None:
            color, rgba = build.color("square")
            build.scene.name([separating_piles.add_square(build.client, rgba, pose)], color, "square")


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
        build.scene.labels[add(build, noun, rgba, pose)] = Label(color, NOUN_NAMES.index(noun))


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


def lay_out(client: int, workspace: Workspace, kind: Kind, rng: np.random.Generator) -> LabelledScene:
    """Fill the table."""
    _background(client, rng)
    build = Builder(client, FreeSpace(workspace, rng, gap=0.004), kind, rng, LabelledScene())
    if rng.random() < STRUCTURES:
        functions, shares = zip(*_BUILDERS, strict=True)
        functions[int(rng.choice(len(functions), p=shares))](build)
    fill(build)
    return build.scene
