"""Four task families on the table of another simulator.

Sentences, goals, rewards and numbers of acts are those of gem_lite's tasks; sizes and proportions are others, and
differ from episode to episode.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.foreign_tasks import bodies
from experiments.foreign_tasks.table import TaskTable
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.tasks import assembling_kits, separating_piles, stack_block_pyramid, towers_of_hanoi
from gem_lite.tasks.goals import Goal, PoseMetric, ZoneMetric
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

QUARTER = math.pi / 2
TOLERANCE, YAW_TOLERANCE = assembling_kits.TOLERANCE, assembling_kits.YAW_TOLERANCE
"""Of a place (m) and of a yaw (radians), in all families."""
KIT = (0.31, 0.21, 0.007)
"""Sides (m) of the board of a kit."""
SPOTS = (Pose2(-0.1, 0.05), Pose2(0.0, 0.05), Pose2(0.1, 0.05), Pose2(-0.05, -0.05), Pose2(0.05, -0.05))
"""The places of the holes in the frame of the board."""

LINE = 0.0065
"""Width (m) of a square's outline."""


def other_size(rng: np.random.Generator) -> float:
    """A factor: 5 to 10 % smaller or larger."""
    return 1 + float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.1))


class StackBlockPyramid(Task):
    """Six blocks and a base of three long plates with cut corners."""

    max_steps = stack_block_pyramid.StackBlockPyramid.max_steps

    def lay_out(self, environment: TaskTable, rng: np.random.Generator, seed: int) -> list[Goal]:
        """See `Task.lay_out`."""
        free = FreeSpace(environment.workspace, rng)
        factor = other_size(rng)
        side = factor * shapes.BLOCK_SIZE
        spacing = factor * stack_block_pyramid.SPACING
        width = rng.uniform(1.2, 1.5) * spacing
        thickness = rng.uniform(0.007, 0.012)
        base = free.take(math.hypot(width, 3 * spacing) / 2)
        for color, (y, _) in zip(bodies.BROWNS, stack_block_pyramid.SPOTS, strict=False):
            bodies.add_plate(environment, (width, spacing), thickness, color, base @ Pose2(0, factor * y))
        self.named_colors = tuple(draw(rng, self.palette, len(stack_block_pyramid.SPOTS)))
        a, b, c, d, e, _ = self.named_colors
        places = (*stack_block_pyramid.PLATES, f"{a} and {b} blocks", f"{b} and {c} blocks", f"{d} and {e} blocks")
        goals = []
        for color, place, (y, layer) in zip(self.named_colors, places, stack_block_pyramid.SPOTS, strict=True):
            block = bodies.add_block(environment, side, color, free.take(side / math.sqrt(2)))
            self.put(environment, block, f"{color} block")
            height = thickness + (layer + 0.5) * side
            on_spot = PoseMetric(TOLERANCE, QUARTER, YAW_TOLERANCE, height, TOLERANCE)
            sentence = f"put the {color} block on the {place}"
            goals.append(Goal(sentence, (block,), (base @ Pose2(0, factor * y),), on_spot, grasp_symmetry=QUARTER))
        return goals


class AssemblingKits(Task):
    """A board with five printed holes and the five pieces; each piece has proportions of its own, and so has its hole.

    The shapes are those that no demonstration of gem_lite has, as in its validation and test episodes.
    """

    max_steps = assembling_kits.AssemblingKits.max_steps

    def lay_out(self, environment: TaskTable, rng: np.random.Generator, seed: int) -> list[Goal]:
        """See `Task.lay_out`."""
        free = FreeSpace(environment.workspace, rng)
        kit = free.take(math.hypot(*KIT[:2]) / 2)
        environment.fix(bodies.solid_box(KIT, bodies.WOOD), kit)
        count = len(SPOTS)
        names = [str(name) for name in rng.choice(shapes.UNSEEN_SHAPES, count)]
        outlines = [bodies.piece_outline(name, rng) for name in names]
        places = []
        for outline, spot in zip(outlines, SPOTS, strict=True):
            middle = kit @ spot
            hole = Pose2(middle.x, middle.y, rng.uniform(-math.pi, math.pi))
            bodies.add_hole(environment, outline, hole, KIT[2])
            places.append(hole)
        self.named_colors = tuple(draw(rng, self.palette, count))
        goals = []
        for number in rng.permutation(count):
            name, color, outline = names[number], self.named_colors[number], outlines[number]
            piece = bodies.add_piece(environment, outline, color, free.take(bodies.radius(outline)))
            self.put(environment, piece, f"{color} {name}")
            twins = [place for i, place in enumerate(places) if i != number and names[i] == name]
            hole = f"{assembling_kits.location(places[number], twins)} {name} hole".strip()
            symmetry = bodies.symmetry(outline)
            metric = PoseMetric(TOLERANCE, symmetry, YAW_TOLERANCE)
            sentence = f"put the {color} {name} in the {hole}"
            grasp = bodies.grasp(outline)
            # The tool holds a ring off its middle, so a round piece must keep its yaw.
            goal = Goal(sentence, (piece,), (places[number],), metric, 1.0, grasp, symmetry, rotations=symmetry > 0)
            goals.append(goal)
        return goals


class TowersOfHanoi(Task):
    """A stand of three pegs on three brown plates, and three rings of three sizes and colours on the lighter side."""

    max_steps = towers_of_hanoi.TowersOfHanoi.max_steps

    def lay_out(self, environment: TaskTable, rng: np.random.Generator, seed: int) -> list[Goal]:
        """See `Task.lay_out`."""
        free = FreeSpace(environment.workspace, rng)
        side = other_size(rng) * towers_of_hanoi.SIDE
        thickness = rng.uniform(0.006, 0.014)
        ring_height = rng.uniform(0.009, 0.013)
        factor = other_size(rng)
        peg = rng.uniform(0.004, 0.006), thickness + 3 * ring_height + rng.uniform(0.008, 0.02)
        inner = peg[0] + rng.uniform(0.008, 0.0098)  # So a ring that hangs on a peg is at most 1 cm off.
        stand = free.take(math.hypot(side, 3 * side) / 2)
        plates = [stand @ Pose2(0, number * side) for number in (-1, 0, 1)]
        for color, plate in zip(bodies.BROWNS, plates, strict=True):
            bodies.add_peg(environment, side, thickness, peg, color, plate)
        self.named_colors = tuple(draw(rng, self.palette, 3))
        rings = {}
        radii = [factor * radius for radius in towers_of_hanoi.RING_RADII]
        for layer, size in enumerate((towers_of_hanoi.LARGE, towers_of_hanoi.MIDDLE, towers_of_hanoi.SMALL)):
            color = self.named_colors[size]
            pose = Pose2(plates[0].x, plates[0].y, rng.uniform(-math.pi, math.pi))
            height = thickness + layer * (ring_height + 0.0005)
            ring = bodies.add_ring(environment, (inner, radii[size]), ring_height, color, pose, height)
            rings[size] = self.put(environment, ring, f"{color} ring")
        goals = []
        for size, number in towers_of_hanoi.MOVES:
            grasp = Pose2((inner + radii[size]) / 2, 0.0)
            sentence = f"move the {self.named_colors[size]} ring to the {towers_of_hanoi.PLATES[number]}"
            metric = PoseMetric(TOLERANCE)
            # The tool holds a ring off its middle, so the ring must keep its yaw.
            goals.append(Goal(sentence, (rings[size],), (plates[number],), metric, grasp=grasp, rotations=False))
        return goals


class SeparatingPiles(Task):
    """A pile of 50 small cubes and two squares, in three colours. A blade pushes the pile into the named square."""

    effector = "spatula"
    max_steps = separating_piles.SeparatingPiles.max_steps

    def lay_out(self, environment: TaskTable, rng: np.random.Generator, seed: int) -> list[Goal]:
        """See `Task.lay_out`."""
        free = FreeSpace(environment.workspace, rng, gap=0.0)
        factor = other_size(rng)
        square, other, pile = draw(rng, self.palette, 3)
        self.named_colors = (pile, square)
        places = [free.take(separating_piles.SQUARE_RADIUS) for _ in range(2)]
        for color, place in zip((square, other), places, strict=True):
            bodies.add_square(environment, factor * separating_piles.SQUARE, LINE, color, place)
        side = other_size(rng) * separating_piles.CUBE
        cubes = []
        for x, y in spread(rng, 1.45 * side):
            pose = Pose2(0.5 + x, y, rng.uniform(-math.pi, math.pi))
            cube = bodies.add_block(environment, side, pile, pose, mass=0.001)
            cubes.append(self.put(environment, cube, f"pile of {pile} blocks"))
        sentence = f"push the pile of {pile} blocks into the {square} square"
        scored = ZoneMetric(tuple(factor * length for length in separating_piles.SCORED), environment.workspace.z_max)
        return [Goal(sentence, tuple(cubes), (places[0],), scored)]


def spread(rng: np.random.Generator, apart: float) -> np.ndarray:
    """(50, 2): places (m) round the middle of the table, at least ``apart`` from each other."""
    places = np.empty((0, 2))
    while len(places) < separating_piles.CUBES:
        place = rng.uniform(-separating_piles.SPREAD, separating_piles.SPREAD, 2)
        if np.all(np.linalg.norm(places - place, axis=1) >= apart):
            places = np.vstack([places, place])
    return places


FAMILIES = {
    "assembling-kits": AssemblingKits, "stack-block-pyramid": StackBlockPyramid, "towers-of-hanoi": TowersOfHanoi,
    "separating-piles": SeparatingPiles,
}  # fmt: skip
