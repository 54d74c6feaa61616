"""Train and measure both methods by the same rules: the same pictures, demonstrations, episodes and score."""

from __future__ import annotations

import hashlib
import json
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm
from typing_extensions import override

from experiments.picture_prompts import rival as rivals
from experiments.picture_prompts.register_tasks import TASK_NAMES
from experiments.picture_prompts.rival import Rival, RivalConfig
from experiments.picture_prompts.segmented_world import SegmentedWorld
from gem_lite import demonstrations, tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import actors, results
from gem_lite.evaluation.evaluate import run_episode
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.rollout import Actor
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE, GemConfig
from gem_lite.policies.inputs import Sample
from gem_lite.training.train import train_from_folder

WORLD = "segmented"
"""In rows, the name of `SegmentedWorld`."""
GEM, RIVAL = "gem", "vima-like"
IDENTITY = ("method", "task", "split", "demos", "seed", "config_hash")
PICTURES_ALONE = replace(
    LITE, semantic_map="single-view", image_weight=0.0, drop_image_map=0.0, top_patch=0.1, top_stride=0.025,
    turn=False, recolor=False, map_gain=(1.0, 1.0), map_offset=0.0,
)  # fmt: skip
"""GEM with image-conditioned maps alone: the source "single-view" compares the height map's patches with the picture
(Eq. 3), and there is no second map. `experiments.picture_prompts.peaks` chose the width of a patch."""


class Unaugmented(Gem):
    """GEM whose training shows each demonstration as it is, as for the paper's Figure 4."""

    @override
    def augmented(self, sample: Sample, rng: np.random.Generator) -> Sample:
        return sample


def gem_config(steps: int, learning_rate: float) -> GemConfig:
    """`PICTURES_ALONE` for a training."""
    return replace(PICTURES_ALONE, steps=steps, learning_rate=learning_rate)


def train_gem(folder: Path, checkpoint: Path, episodes: int, config: GemConfig, seed: int, run: Path) -> None:
    """Train GEM on the first ``episodes`` demonstrations of a folder, and write its checkpoint. It can be continued."""
    train_from_folder(folder, checkpoint, Unaugmented, config, run, seed, episodes)


def train_rival(folder: Path, checkpoint: Path, episodes: int, config: RivalConfig, seed: int) -> None:
    """Train the rival on the first ``episodes`` demonstrations of a folder, and write its checkpoint."""
    every = demonstrations.load(folder)
    if not 1 <= episodes <= len(every):
        raise ValueError(f"episodes must be from 1 to {len(every)}, the number in {folder}, got {episodes}")
    workspace = tasks.make(TASK_NAMES[0]).workspace
    rival = Rival(config, workspace, seed)
    rivals.train(rival, every[:episodes], seed)
    rivals.save(rival, checkpoint, {"method": RIVAL, "demos": episodes, "seed": seed})


@dataclass(frozen=True)
class Trained:
    """A trained method, and the entries of a row that describe it."""

    actor: Actor
    facts: dict


def load(checkpoint: Path, clip: Clip) -> Trained:
    """A checkpoint of either method.

    Raises:
        FileNotFoundError: it is not complete.
        ValueError: see `load_policy`.
    """
    for file in (checkpoint, checkpoint.with_suffix(".json")):
        if not file.is_file():
            raise FileNotFoundError(f"the checkpoint {checkpoint} is not complete: {file} is missing")
    card = results.read_json(checkpoint.with_suffix(".json").read_bytes(), checkpoint)
    if card["method"] == RIVAL:
        rival, card = rivals.load(checkpoint, tasks.make(TASK_NAMES[0]).workspace)
        counted, config = rivals.parameters(rival), rival.config
        actor = rival.actor()
    else:
        policy = load_policy(checkpoint, clip)
        counted, config = rivals.parameters(policy), policy.config
        actor = actors.policy_actor(policy)
    facts = {"method": card["method"], "demos": card["demos"], "seed": card["seed"], "parameters": counted}
    values = json.dumps(asdict(config), sort_keys=True)
    facts |= {"steps": config.steps, "learning_rate": config.learning_rate, "batch": config.batch}
    return Trained(actor, {**facts, "config_hash": hashlib.sha256(values.encode()).hexdigest()[:8]})


def play(actor: Actor, task_name: str, split: tasks.Split, episodes: int) -> list[Episode]:
    """The first episodes of a level. Raises ValueError if ``episodes`` is below 1."""
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    with SegmentedWorld() as world:
        numbers = tqdm(range(episodes), f"{task_name} ({split})", unit="episode")
        return [run_episode(world, actor, task_name, split, index) for index in numbers]


def row(trained: Trained, task_name: str, split: tasks.Split, played: Sequence[Episode]) -> dict:
    """A row: `first_act` counts the episodes that were won with one act."""
    first = statistics.mean(episode.steps == 1 and episode.reward == 1 for episode in played)
    names = {"task": task_name, "split": split, "world": WORLD, "first_act": round(first, 4)}
    return {**trained.facts, **names, **results.reward_entries({one.index: one.reward for one in played})}
