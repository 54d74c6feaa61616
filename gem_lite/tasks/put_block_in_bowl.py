"""put-block-in-bowl: "put the red blocks in a green bowl", after CLIPort."""

from __future__ import annotations

import math

import numpy as np

from gem_lite import colors
from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Action, Pose2
from gem_lite.simulation import shapes
from gem_lite.simulation.task import Task
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

TOLERANCE = 0.05
"""A block this near (metres, in x and y) to a bowl's centre is in the bowl."""
DISTRACTORS = 6
BLOCK_RADIUS = shapes.BLOCK_SIZE / math.sqrt(2)


class PutBlockInBowl(Task):
    """1-3 fixed bowls of one colour, at most as many blocks of another, six movable distractors.

    The distractors (block or bowl by a coin's toss) take the remaining colours of the full list in
    order, as in CLIPort, so colours that are never named do appear among them in training.
    """

    def __init__(self, unseen_colors: bool) -> None:
        super().__init__()
        self._palette = colors.UNSEEN if unseen_colors else colors.SEEN

    def reset(self, world: World, rng: np.random.Generator) -> None:
        """Lay out the scene. Raises RuntimeError if a named object finds no place (never seen)."""
        free = FreeSpace(world.workspace, rng, world.style)
        bowl_count = int(rng.integers(1, 4))
        block_count = int(rng.integers(1, bowl_count + 1))
        block_color, bowl_color = (str(name) for name in rng.choice(self._palette, 2, replace=False))
        self._bowls = [self._add_bowl(world, free, bowl_color, movable=False) for _ in range(bowl_count)]
        self._blocks = [self._add_block(world, free, block_color) for _ in range(block_count)]
        if None in self._bowls + self._blocks:
            raise RuntimeError("a bowl or block that the instruction names found no free place")
        others = [name for name in colors.RGB if name not in (block_color, bowl_color)]
        self.names = {body.id: f"{block_color} block" for body in self._blocks}
        self.names |= {body.id: f"{bowl_color} bowl" for body in self._bowls}
        for color in others[:DISTRACTORS]:
            if rng.random() < 0.5:
                noun, body = "block", self._add_block(world, free, color)
            else:
                noun, body = "bowl", self._add_bowl(world, free, color, movable=True)
            if body is not None:
                self.names[body.id] = f"{color} {noun}"
        self.named_colors = (block_color, bowl_color)
        self.instruction = f"put the {block_color} blocks in a {bowl_color} bowl"
        self.max_steps = block_count + 1

    @staticmethod
    def _add_bowl(world: World, free: FreeSpace, color: str, movable: bool) -> shapes.Body | None:
        profile = world.style.bowls[free.choose(len(world.style.bowls))]
        pose = free.sample(profile.rim)
        return pose and world.add(shapes.add_bowl(world.client, colors.rgba(color), pose, movable, profile))

    @staticmethod
    def _add_block(world: World, free: FreeSpace, color: str) -> shapes.Body | None:
        pose = free.sample(BLOCK_RADIUS, shapes.BLOCK_SIZE / 2)
        return pose and world.add(shapes.add_block(world.client, colors.rgba(color), pose))

    def _distances(self, world: World) -> np.ndarray:
        """(blocks, bowls) in metres, seen from above."""
        xy = [[(pose.x, pose.y) for pose in (world.pose(b)[0] for b in group)] for group in (self._blocks, self._bowls)]
        blocks, bowls = (np.array(points) for points in xy)
        return np.linalg.norm(blocks[:, None] - bowls[None], axis=-1)

    def placed(self, world: World) -> set[int]:
        """See `Task.placed`."""
        near = self._distances(world).min(axis=1) < TOLERANCE
        return {block.id for block, is_near in zip(self._blocks, near, strict=True) if is_near}

    def score(self, world: World) -> float:
        """The share of named blocks within `TOLERANCE` of a named bowl."""
        return float((self._distances(world).min(axis=1) < TOLERANCE).mean())

    def expert(self, world: World) -> ExpertAction | None:
        """Take the block farthest from its bowl, centre to centre, to its nearest empty bowl.

        The grasp is fixed to the block: its centre, with its yaw. A cube looks the same after a
        quarter turn; in a round bowl every relative angle is as good as any, and the tool keeps its yaw.
        """
        distances = self._distances(world)
        outside = np.flatnonzero(distances.min(axis=1) >= TOLERANCE)
        if len(outside) == 0:
            return None
        empty = np.flatnonzero(distances.min(axis=0) >= TOLERANCE)
        targets = empty if len(empty) else np.arange(len(self._bowls))
        nearest = distances[np.ix_(outside, targets)]
        row = int(nearest.min(axis=1).argmax())
        block, bowl = self._blocks[outside[row]], self._bowls[targets[int(nearest[row].argmin())]]
        pick, target = world.pose(block)[0], world.pose(bowl)[0]
        return ExpertAction(Action(pick, Pose2(target.x, target.y, pick.yaw)), math.pi / 2, 0.0)
