"""The tasks, by name, and the seeds of their episodes."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from typing import Literal

from gem_lite.simulation.task import Task
from gem_lite.tasks.bars_in_box import BarsInBox
from gem_lite.tasks.block_insertion import BlockInsertion
from gem_lite.tasks.object_sorting import ObjectSorting
from gem_lite.tasks.packing_shapes import PackingShapes
from gem_lite.tasks.put_block_in_bowl import PutBlockInBowl
from gem_lite.tasks.stack_block_pyramid import StackBlockPyramid

__all__ = ["NAMES", "SEED_START", "Split", "Task", "episode_seed", "make"]

Split = Literal["train", "val", "test"]

SEED_START: dict[str, int] = {"train": 0, "val": 1_000_000, "test": 2_000_000}
"""Episode i of a split has the seed SEED_START[split] + i: the ranges never meet below a million episodes."""

_MAKERS: dict[str, Callable[[bool], Task]] = {
    "put-block-in-bowl-seen-colors": PutBlockInBowl,
    "put-block-in-bowl-unseen-colors": PutBlockInBowl,
    "stack-block-pyramid-seq-seen-colors": StackBlockPyramid,
    "stack-block-pyramid-seq-unseen-colors": StackBlockPyramid,
    "packing-shapes-seen": PackingShapes,
    "packing-shapes-unseen": PackingShapes,
    "block-insertion": BlockInsertion,
    "bars-in-box": BarsInBox,
    "object-sorting-seen": ObjectSorting,
    "object-sorting-unseen": ObjectSorting,
}
"""What makes a task; its argument tells whether words come from the unseen sets."""

NAMES = tuple(_MAKERS)


def episode_seed(split: Split, index: int) -> int:
    """The seed of episode ``index`` of a split."""
    if split not in SEED_START:
        raise ValueError(f"split must be one of {', '.join(SEED_START)}, got {split!r}")
    if not 0 <= index < 1_000_000:
        raise ValueError(f"index must be in [0, 1000000), got {index}")
    return SEED_START[split] + index


def make(name: str, split: Split = "train") -> Task:
    """The task of that name, with the colours and shapes of ``split``.

    An "unseen" task takes them from the unseen sets in validation and test; in training, and in every other
    task, they are the seen ones.

    Raises:
        ValueError: unknown name (the message has the nearest ones) or split.
    """
    if split not in SEED_START:
        raise ValueError(f"split must be one of {', '.join(SEED_START)}, got {split!r}")
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, n=3, cutoff=0.3) or NAMES
        raise ValueError(f"no task is named {name!r}; the nearest names: {', '.join(near)}")
    unseen = "unseen" in name and split != "train"
    return _MAKERS[name](unseen)
