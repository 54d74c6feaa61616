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
from experiments.picture_prompts import segmented_world
from experiments.picture_prompts.register_tasks import TASK_NAMES
from experiments.picture_prompts.rival import Rival, RivalConfig
from gem_lite import demonstrations, tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import actors, results
from gem_lite.evaluation.evaluate import run_episode
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.rollout import Actor
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE, GemConfig
from gem_lite.policies.inputs import Sample
from gem_lite.training import folders
from gem_lite.training.train import train_from_folder

WORLD = "segmented"
"""In rows, the name of `segmented_world.SegmentedWorld`."""
PICTURES_ALONE = replace(
    LITE, semantic_map="single-view", image_weight=0.0, drop_image_map=0.0, top_patch=0.1, top_stride=0.025,
    turn=False, recolor=False, map_gain=(1.0, 1.0), map_offset=0.0, peak_margin=None, empty_radius=0.0, steps=300,
)  # fmt: skip
"""GEM with image-conditioned maps alone: the source "single-view" compares the height map's patches with the picture
(Eq. 3), and there is no second map. `patch_peaks` chose the width of a patch.

Two rules of ours are off, since the rival has none like them: a pick near the map's peak, and no second try at a spot
where nothing was grasped."""
SEARCHED = ("steps", "learning_rate")
"""The entries of `PICTURES_ALONE` that a training may change."""


class Unaugmented(Gem):
    """GEM whose training shows each demonstration as it is, as for the paper's Figure 4."""

    @override
    def augmented(self, sample: Sample, rng: np.random.Generator) -> Sample:
        return sample


def gem_config(steps: int, learning_rate: float) -> GemConfig:
    """`PICTURES_ALONE` for a training."""
    return replace(PICTURES_ALONE, steps=steps, learning_rate=learning_rate)


def train_gem(folder: Path, checkpoint: Path, episodes: int, config: GemConfig, seed: int, run: Path) -> None:
    """Train GEM on the first ``episodes`` demonstrations of a folder, and write its checkpoint. It can be continued.

    Raises:
        ValueError, OSError: see `segmented_world.check` and `train_from_folder`.
    """
    segmented_world.check(demonstrations.load(folder)[:episodes], folder)
    train_from_folder(folder, checkpoint, Unaugmented, config, run, seed, episodes)


def train_rival(folder: Path, checkpoint: Path, episodes: int, config: RivalConfig, seed: int) -> None:
    """Train the rival on the first ``episodes`` demonstrations of a folder, and write its checkpoint.

    Raises:
        ValueError: ``episodes`` is not from 1 to the number of demonstrations, ``seed`` is negative, the name of the
            checkpoint does not end in ".safetensors", or see `segmented_world.check`.
    """
    rivals.check_request(checkpoint, seed)
    whole = demonstrations.load(folder)
    if not 1 <= episodes <= len(whole):
        raise ValueError(f"episodes must be from 1 to {len(whole)}, the number in {folder}, got {episodes}")
    demos = whole[:episodes]
    segmented_world.check(demos, folder)
    rival = Rival(config, tasks.make(TASK_NAMES[0]).workspace, seed)
    rivals.train(rival, demos, seed)
    facts = {"demos": episodes, "seed": seed, "data_sha256": folders.data_hash([demos])}
    rivals.save(rival, checkpoint, facts)


@dataclass(frozen=True)
class Trained:
    """A trained method, and the entries of a row that describe it."""

    actor: Actor
    facts: dict


def load(checkpoint: Path, clip: Clip) -> Trained:
    """A checkpoint of either method.

    Raises:
        FileNotFoundError: it is not complete.
        ValueError: it is damaged, of another method, or of a GEM with other inputs than `PICTURES_ALONE`.
    """
    card = read_card(checkpoint)
    config: GemConfig | RivalConfig
    if card["method"] == rivals.METHOD:
        rival = rivals.load(checkpoint, card, tasks.make(TASK_NAMES[0]).workspace)
        config = rival.config
        parameters = rivals.count_parameters(rival)
        actor = rival.actor()
    else:
        policy = load_policy(checkpoint, clip)
        if not isinstance(policy, Gem) or policy.config != replace(PICTURES_ALONE, **searched(policy.config)):
            raise ValueError(f"the checkpoint must be one of train-gem or train-rival, got {policy.name}: {checkpoint}")
        config = policy.config
        parameters = rivals.count_parameters(policy)
        actor = actors.policy_actor(policy)
    values = json.dumps(asdict(config), sort_keys=True)
    facts = results.policy_entries(card, None) | searched(config)
    facts["spread"] = config.spread if isinstance(config, RivalConfig) else None
    facts |= {"parameters": parameters, "config_hash": hashlib.sha256(values.encode()).hexdigest()[:12]}
    return Trained(actor, {"method": card["method"], **facts})


def searched(config: GemConfig | RivalConfig) -> dict:
    """The values of `SEARCHED`."""
    return {name: getattr(config, name) for name in SEARCHED}


def play(actor: Actor, task_name: str, split: tasks.Split, episodes: int) -> list[Episode]:
    """The first episodes of a level. Raises ValueError if ``episodes`` is below 1."""
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    with segmented_world.SegmentedWorld() as world:
        numbers = tqdm(range(episodes), f"{task_name} ({split})", unit="episode")
        return [run_episode(world, actor, task_name, split, index) for index in numbers]


def row(trained: Trained, task_name: str, split: tasks.Split, played: Sequence[Episode]) -> dict:
    """A row; its ``first_act`` is the share of the episodes that were won with one act."""
    first = statistics.mean(episode.steps == 1 and episode.reward == 1 for episode in played)
    facts = trained.facts | {"world": WORLD, "split": split, "start": 0, "first_act": round(first, 4)}
    return results.result_row(facts.pop("method"), task_name, played, "all", facts)
