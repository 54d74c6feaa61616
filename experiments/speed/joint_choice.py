"""The time of an act with the product rule (A.1.6) over 8 picks, beside that of the best pick first.

python -m experiments.speed.joint_choice
"""

from __future__ import annotations

import time

import numpy as np
import torch

from gem_lite import clip, tasks
from gem_lite.policies.checkpoints import load_policy
from gem_lite.simulation.world import World

TASK, REPEATS = "packing-shapes-seen", 7


def main() -> None:
    torch.set_num_threads(1)
    policy = load_policy(clip.DATA / "gem-packing-shapes.safetensors", clip.load())
    task = tasks.make(TASK, "val")
    with World() as world:
        (observation,) = world.reset(task, tasks.episode_seed("val", 0))
    configs = {"best pick first": policy.config, "product rule": policy.config.ablated("with-joint-choice")}
    seconds: dict[str, list[float]] = {name: [] for name in configs}
    for repeat in range(REPEATS + 1):  # In turn, so that other programs slow both down; the first warms up.
        for name, config in configs.items():
            policy.act_as(config)
            start = time.perf_counter()
            policy.act(observation, task.instruction)
            if repeat:
                seconds[name].append(time.perf_counter() - start)
    medians = {name: float(np.median(values)) for name, values in seconds.items()}
    for name, median in medians.items():
        print(f"{name:16s} {median:.2f} s an act (median of {REPEATS})")
    print(f"ratio {medians['product rule'] / medians['best pick first']:.2f}")


if __name__ == "__main__":
    main()
