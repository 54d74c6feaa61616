"""How often a policy picks or places where no camera saw: python -m experiments.covered_camera."""

from __future__ import annotations

import argparse

import numpy as np
from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.policies.checkpoints import load_policy
from gem_lite.rgbd.observation import Observation
from gem_lite.simulation.world import World

TASKS = (
    "put-block-in-bowl-seen-colors",
    "packing-google-objects-seq-seen",
    "stack-block-pyramid-seq-seen-colors",
    "towers-of-hanoi-seq-seen-colors",
)


def main() -> None:
    """Print the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=200, help="number of scenes (default: %(default)s)")
    count = parser.parse_args().scenes
    if count < 1:
        parser.error(f"--scenes must be at least 1, got {count}")
    policy = load_policy(clip.DATA / "gem-multi.safetensors", clip.load())
    unseen, picks, places = [], 0, 0
    with World() as world:
        for index in tqdm(range(count), unit="scene"):
            task = tasks.make(TASKS[index % len(TASKS)], "val")
            (whole,) = world.reset(task, tasks.episode_seed("val", index // len(TASKS)))
            view = whole.views[index // len(TASKS) % len(whole.views)]
            choice = policy.decide(Observation((view,)), task.instruction)
            seen = choice.heightmap.seen
            unseen.append(1 - seen.mean())
            picks += not seen[choice.pick_cell[1:]]
            places += not seen[choice.place_cell[1:]]
    low, middle, high = 100 * np.quantile(unseen, (0, 0.5, 1))
    print(
        f"{count} scenes of one camera: unseen are {low:.1f} to {high:.1f} % of the cells, {middle:.1f} % at the median"
    )
    print(f"picks in an unseen cell: {picks}; places: {places}")


if __name__ == "__main__":
    main()
