"""The tasks, by name, and the seeds of their episodes."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from gem_lite.se2 import Action
from gem_lite.tabletop.tasks.put_block_in_bowl import PutBlockInBowl

if TYPE_CHECKING:
    from gem_lite.tabletop.world import World

Split = Literal["train", "val", "test"]

SEED_START: dict[str, int] = {"train": 0, "val": 1_000_000, "test": 2_000_000}
"""Episode i of a split has the seed SEED_START[split] + i: the ranges never meet below a million episodes."""

NAMES = ("put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors")


class Task(Protocol):
    """What `World` asks of a task."""

    instruction: str
    max_steps: int

    def reset(self, world: World, rng: np.random.Generator) -> None:
        """Lay out the scene and set the instruction."""

    def score(self, world: World) -> float:
        """The share of the job that is done, in [0, 1]."""

    def expert(self, world: World) -> ExpertAction | None:
        """The next action from ground truth, or None if nothing is left to do."""


@dataclass(frozen=True)
class ExpertAction:
    """An expert's action and its yaw symmetries.

    ``pick_symmetry`` and ``place_symmetry`` are the smallest turns (radians) that change nothing:
    pi/2 for the yaw of a cube's grasp, 0 where every yaw is as good, 2 pi where one yaw is right.
    ``place_symmetry`` is that of the relative angle.
    """

    action: Action
    pick_symmetry: float
    place_symmetry: float


def episode_seed(split: Split, index: int) -> int:
    """The seed of episode ``index`` of a split."""
    if split not in SEED_START:
        raise ValueError(f"split must be one of {', '.join(SEED_START)}, got {split!r}")
    if not 0 <= index < 1_000_000:
        raise ValueError(f"index must be in [0, 1000000), got {index}")
    return SEED_START[split] + index


def make(name: str, split: Split = "train") -> Task:
    """The task of that name, with the colours of ``split``.

    Raises:
        ValueError: unknown name (the message has the nearest ones) or split.
    """
    if split not in SEED_START:
        raise ValueError(f"split must be one of {', '.join(SEED_START)}, got {split!r}")
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, n=3, cutoff=0.3) or NAMES
        raise ValueError(f"no task is named {name!r}; the nearest names: {', '.join(near)}")
    unseen = "unseen" in name and split != "train"
    return PutBlockInBowl(unseen_colors=unseen)
