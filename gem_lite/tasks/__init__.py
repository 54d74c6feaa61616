"""The tasks by name, and the seeds of their episodes. To add a family, write a class and register it."""

import gem_lite.simulation  # noqa: F401 (before the families: it imports PyBullet without its message)
from gem_lite.tasks import (  # noqa: F401 (each module registers its family)
    align_rope,
    arrange_letter_to_word,
    assembling_kits,
    bars_in_box,
    block_insertion,
    block_stacking_pyramid,
    object_sorting,
    packing_box_pairs,
    packing_objects,
    packing_shapes,
    pick_object_part,
    pick_shapes_in_bowl,
    put_beside,
    put_block_in_bowl,
    separating_piles,
    stack_block_pyramid,
    towers_of_hanoi,
)
from gem_lite.tasks.registry import SPLITS, family, make, names, register, variants
from gem_lite.tasks.task import Split, Task

__all__ = [
    "PAPER", "REAL_TABLE", "SEED_START", "SPLITS", "Split", "Task", "episode_seed", "family", "make", "names",
    "register", "variants",
]  # fmt: skip

PAPER = (
    "align-rope", "assembling-kits-seq-seen-colors", "assembling-kits-seq-unseen-colors",
    "packing-box-pairs-seen-colors", "packing-box-pairs-unseen-colors", "packing-google-objects-seq-seen",
    "packing-google-objects-seq-unseen", "packing-google-objects-group-seen", "packing-google-objects-group-unseen",
    "packing-shapes-unseen", "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors",
    "separating-piles-seen-colors", "separating-piles-unseen-colors", "stack-block-pyramid-seq-seen-colors",
    "stack-block-pyramid-seq-unseen-colors", "towers-of-hanoi-seq-seen-colors", "towers-of-hanoi-seq-unseen-colors",
)  # fmt: skip
"""The paper's eighteen tasks (A.10); its packing-unseen-shapes is our packing-shapes-unseen."""
REAL_TABLE = (
    "arrange-letter-to-word-seen", "arrange-letter-to-word-unseen", "block-stacking-pyramid-seen",
    "block-stacking-pyramid-unseen", "pick-object-part-in-brown-box-seen", "pick-object-part-in-brown-box-unseen",
    "pick-shapes-in-bowl-seen", "pick-shapes-in-bowl-unseen",
)  # fmt: skip
"""The paper's four tasks on real tables (A.11), seen and unseen, in simulation."""

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
