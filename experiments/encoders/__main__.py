"""How far features are from turning with their scene, before and after training: python -m experiments.encoders."""

from __future__ import annotations

import argparse
from pathlib import Path

import equivariance as eq
import numpy as np
import torch
import torch.nn.functional as F
from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.evaluation.evaluate import check_table
from gem_lite.policies.base import Policy
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.inputs import Inputs
from gem_lite.simulation.world import World

TURNS = 24
"""The turns are the multiples of 360 degrees / 24."""
KINDS = {"quarter": 6, "eighth": 3, "any": 1}
"""A kind of turns is the multiples of so many of them, without those of the kinds before it."""


def largest_errors(policy: Policy, inputs: Inputs, role: str) -> list[float]:
    """The largest relative error of phi(P_g o) against P_g phi(o) (Sec. A.9.2, step 1) of each kind of turns.

    The scene is padded to a square. Its picture and its map turn; the words stay.
    """
    both = torch.cat([inputs.rgbd, inputs.maps[role]])[None]
    rows, cols = both.shape[-2:]
    side = max(rows, cols)
    whole = F.pad(both, ((side - cols) // 2, (side - cols) // 2, (side - rows) // 2, (side - rows) // 2))
    module = policy.roles[role].eval()
    words = inputs.words[role][None]
    errors = eq.generator_errors(lambda o: module.features(o[:, :4], o[:, 4:], words), whole, TURNS)
    largest, counted = [], {0}
    for every in KINDS.values():
        turns = set(range(0, TURNS, every)) - counted
        counted |= turns
        largest.append(max(errors[turn] for turn in turns))
    return largest


def main() -> None:
    """Print a line for each policy and role."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoints", type=Path, nargs="+", help="checkpoints of gem")
    parser.add_argument("--task", required=True, help="the task of the scenes: validation episodes")
    parser.add_argument("--scenes", type=int, default=5, help="number of scenes (default: %(default)s)")
    arguments = parser.parse_args()
    model = clip.load()
    policies = {path: load_policy(path, model) for path in arguments.checkpoints}
    asked = tasks.make(arguments.task, "val").workspace
    for path, trained in policies.items():
        check_table(path, trained.config.workspace, asked, arguments.task)
    episodes = []
    with World() as world:
        for index in range(arguments.scenes):
            task = tasks.make(arguments.task, "val")
            (observation,) = world.reset(task, tasks.episode_seed("val", index))
            episodes.append((observation, task.instruction))
    print(f"largest relative error of the features, mean over {arguments.scenes} scenes; {', '.join(KINDS)} turns")
    for path, trained in policies.items():
        untrained = type(trained)(trained.config, model, trained.memory, seed=0)
        for role in trained.roles:
            errors = np.zeros((2, arguments.scenes, len(KINDS)))
            for scene, (observation, instruction) in enumerate(tqdm(episodes, f"{path.stem}, {role}", unit="scene")):
                inputs = trained.inputs(trained.embed(observation.views), trained.read(instruction))
                errors[:, scene] = [largest_errors(policy, inputs, role) for policy in (untrained, trained)]
            before, after = (" ".join(f"{error:7.4f}" for error in means) for means in errors.mean(axis=1))
            print(f"{path.stem}, {role}: untrained {before}; trained {after}")


if __name__ == "__main__":
    main()
