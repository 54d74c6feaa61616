"""The tasks by name, and the seeds of their episodes. To add a family, write a class and register it."""

from gem_lite.simulation.task import Split, Task
from gem_lite.tasks import (  # noqa: F401 (each module registers its family)
    align_rope,
    assembling_kits,
    bars_in_box,
    block_insertion,
    object_sorting,
    packing_box_pairs,
    packing_objects,
    packing_shapes,
    put_block_in_bowl,
    separating_piles,
    stack_block_pyramid,
    towers_of_hanoi,
)
from gem_lite.tasks.registry import SPLITS, family, make, names, register, variants

__all__ = ["SEED_START", "SPLITS", "Split", "Task", "episode_seed", "family", "make", "names", "register", "variants"]

SEED_START: dict[Split, int] = {"train": 0, "val": 1_000_000, "test": 2_000_000}
"""Episode i of a split has the seed SEED_START[split] + i. The ranges of the splits do not overlap."""


def episode_seed(split: Split, index: int) -> int:
    """The seed of episode ``index`` of a split.

    Raises:
        ValueError: the split is unknown, or the index is outside [0, 1000000).
    """
    if split not in SEED_START:
        raise ValueError(f"split must be one of {', '.join(SEED_START)}, got {split!r}")
    if not 0 <= index < 1_000_000:
        raise ValueError(f"index must be in [0, 1000000), got {index}")
    return SEED_START[split] + index
