"""What stitching costs over 1, 2, 4 and 8 tables: python -m experiments.speed.mobile

One table's observation, repeated, since the cost does not depend on what is seen. Stitched: one kernel, all
tables' features at once. Apart: a decision's networks for each table on its own.
"""

import numpy as np
import torch

from experiments.speed.timing import seconds
from gem_lite import clip, tasks
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.inputs import collate
from gem_lite.simulation.world import World

COUNTS = (1, 2, 4, 8)
REPEATS = 7


@torch.inference_mode()
def main() -> None:
    """Print seconds for each number of tables, and how they grow."""
    policy = Gem(LITE.on_table(1.06), clip.load())
    policy.eval()
    task = tasks.make("object-sorting-seen", "val")
    with World() as world:
        (observation,) = world.reset(task, tasks.episode_seed("val", 0))
    inputs = policy.inputs(policy.embed(observation.views), policy.read(task.instruction))
    print(f"pick logits of one decision, {torch.get_num_threads()} threads; fastest of {REPEATS}")
    print("  tables   stitched      apart   apart / stitched   largest difference")
    spent = []
    for count in COUNTS:
        several = collate([inputs] * count)
        one = collate([inputs])
        together, logits = seconds(lambda several=several: policy.score_picks(several), REPEATS)
        apart, alone = seconds(lambda one=one, n=count: [policy.score_pick(one) for _ in range(n)], REPEATS)
        difference = max((logits[i : i + 1] - alone[i]).abs().max().item() for i in range(count))
        spent.append(together)
        print(f"  {count:6d}{together:9.3f} s{apart:9.3f} s{apart / together:15.2f}{difference:22.1e}")
    slope, start = np.polyfit(COUNTS, spent, 1)
    off = np.abs(np.polyval((slope, start), COUNTS) - spent).max()
    print(
        f"  stitched: {1000 * slope:.0f} ms a table and {1000 * start:.0f} ms once, up to {1000 * off:.0f} ms off that"
    )


if __name__ == "__main__":
    main()
