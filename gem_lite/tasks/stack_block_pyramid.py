"""stack-block-pyramid-seq: six sentences, "put the red block on the green and blue blocks", after CLIPort."""

from __future__ import annotations

import math

import numpy as np

from gem_lite import colors
from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Action, Pose2, wrap
from gem_lite.simulation import shapes
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

SPACING = 0.05
"""Distance (m) between the middles of neighbouring plates; also their length."""
PLATES = {
    "lightest brown block": (0.918, 0.688, 0.559, 1.0),
    "middle brown block": (0.612, 0.459, 0.373, 1.0),
    "darkest brown block": (0.306, 0.229, 0.186, 1.0),
}
"""The base's plates along its +y, as the sentences call them, and their RGBA."""
SPOTS = ((-0.05, 0), (0.0, 0), (0.05, 0), (-0.025, 1), (0.025, 1), (0.0, 2))
"""Where each of the six blocks belongs: y (m) in the base's frame, and layer."""
TOLERANCE = 0.01
"""A block this near (m) to its spot, in x and y and in height, is placed."""
YAW_TOLERANCE = math.radians(15)
BLOCK_EXTENT = (shapes.BLOCK_SIZE / math.sqrt(2), shapes.BLOCK_SIZE / 2)
"""How far (m) a block reaches to its corners, and to its sides."""


class StackBlockPyramid(Task):
    """Six movable blocks of six colours, and a fixed base of three brown plates; no distractors.

    The sentences come in a fixed order, bottom layer first. One that is fulfilled counts for good; one
    that is not stays, and the twelve steps of an episode leave room for six retries.
    """

    def __init__(self, unseen_colors: bool) -> None:
        super().__init__()
        self._palette = colors.UNSEEN if unseen_colors else colors.SEEN

    def reset(self, world: World, rng: np.random.Generator) -> None:
        """See `Task.reset`."""
        free = FreeSpace(world.workspace, rng, world.style)
        self.named_colors = tuple(str(name) for name in rng.choice(self._palette, len(SPOTS), replace=False))
        width, self._thickness = world.style.plates[free.choose(len(world.style.plates))]
        self._base = free.take(math.hypot(width, 3 * SPACING) / 2)
        size = (width, SPACING, self._thickness)
        plates = [
            world.add(shapes.add_box(world.client, size, rgba, self._base @ Pose2(0, y), movable=False))
            for rgba, (y, _) in zip(PLATES.values(), SPOTS, strict=False)
        ]
        self._blocks = [
            world.add(shapes.add_block(world.client, colors.rgba(name), free.take(*BLOCK_EXTENT)))
            for name in self.named_colors
        ]
        self.names = {plate.id: name for plate, name in zip(plates, PLATES, strict=True)}
        self.names |= {block.id: f"{color} block" for block, color in zip(self._blocks, self.named_colors, strict=True)}
        self.max_steps = 2 * len(SPOTS)
        self._placed = 0
        self.instruction = self._sentence(0)

    def _sentence(self, index: int) -> str:
        c = self.named_colors
        pairs = [f"{a} and {b} blocks" for a, b in ((c[0], c[1]), (c[1], c[2]), (c[3], c[4]))]
        return f"put the {c[index]} block on the {[*PLATES, *pairs][index]}"

    def _rests(self, world: World, index: int) -> bool:
        """Whether a block lies on its spot, square to the base, in the right layer."""
        y, layer = SPOTS[index]
        pose, z = world.pose(self._blocks[index])
        off = (self._base @ Pose2(0, y)).inverse() @ pose
        height = self._thickness + (layer + 0.5) * shapes.BLOCK_SIZE
        near = math.hypot(off.x, off.y) < TOLERANCE and abs(z - height) < TOLERANCE
        return near and abs(wrap(4 * off.yaw) / 4) < YAW_TOLERANCE  # a cube looks the same after a quarter turn

    def _reached(self, world: World) -> int:
        """How many sentences are done: those before, and from the present one on until one is open."""
        index = self._placed
        while index < len(SPOTS) and self._rests(world, index):
            index += 1
        return index

    def placed(self, world: World) -> set[int]:
        """See `Task.placed`."""
        return {block.id for block in self._blocks[: self._reached(world)]}

    def score(self, world: World) -> float:
        """The share of the six placements done."""
        return self._reached(world) / len(SPOTS)

    def advance(self, world: World) -> None:
        """Go on to the next sentence that is open; the last one stays."""
        self._placed = self._reached(world)
        self.instruction = self._sentence(min(self._placed, len(SPOTS) - 1))

    def expert(self, world: World) -> ExpertAction | None:
        """Take the present sentence's block by its centre to its spot, by the smallest turn that squares it."""
        if self._reached(world) == len(SPOTS):
            return None
        pick = world.pose(self._blocks[self._placed])[0]
        spot = self._base @ Pose2(0, SPOTS[self._placed][0])
        turn = wrap(4 * (spot.yaw - pick.yaw)) / 4
        return ExpertAction(Action(pick, Pose2(spot.x, spot.y, pick.yaw + turn)), math.pi / 2, math.pi / 2)
