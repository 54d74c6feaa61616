"""Pictures as words (Figure 4): GEM and a rival after VIMA on "put [picture] into [picture]"."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from gem_lite.cli import base


def collect(folder: Path, /, *, episodes: int = 600) -> None:
    """Collect demonstrations of the training level, seen from above, with segmentation in the place of depth.

    Args:
        folder: folder to write
        episodes: number of demonstrations

    Examples:
      python -m experiments.picture_prompts collect runs/prompts/demos --episodes 60
    """
    from experiments.picture_prompts.register_tasks import TASK_NAMES
    from experiments.picture_prompts.segmented_world import SegmentedWorld
    from gem_lite.evaluation import collecting

    collecting.collect(TASK_NAMES[0], episodes, folder, environment=SegmentedWorld)


def train_gem(
    folder: Path,
    checkpoint: Path,
    /,
    *,
    episodes: int,
    steps: int = 300,
    learning_rate: float = 1e-3,
    seed: int = 0,
    state: Path | None = None,
) -> None:
    """Train GEM with image-conditioned maps alone and without augmentation.

    Args:
        folder: demonstrations of collect
        checkpoint: file to write
        episodes: number of demonstrations, from the first
        steps: number of training steps
        learning_rate: learning rate
        seed: seed of the initial weights and the batches
        state: folder of a training that can be continued (without it: beside the checkpoint)

    Examples:
      python -m experiments.picture_prompts train-gem runs/prompts/demos runs/prompts/gem-6.safetensors --episodes 6
    """
    import torch

    from experiments.picture_prompts import measuring

    torch.set_num_threads(1)
    config = measuring.gem_config(steps, learning_rate)
    run = state or checkpoint.with_suffix("")
    with base.continues(str(run)):
        measuring.train_gem(folder, checkpoint, episodes, config, seed, run)


def train_rival(
    folder: Path,
    checkpoint: Path,
    /,
    *,
    episodes: int,
    steps: int = 1000,
    learning_rate: float = 1e-3,
    width: int = 128,
    layers: int = 2,
    dropout: float = 0.1,
    spread: float = 2.0,
    seed: int = 0,
) -> None:
    """Train the rival after VIMA.

    Args:
        folder: demonstrations of collect
        checkpoint: file to write
        episodes: number of demonstrations, from the first
        steps: number of training steps
        learning_rate: highest learning rate
        width: of all tokens, a multiple of 8
        layers: of the decoder
        dropout: of all transformer layers
        spread: width of a label (cm); 0 is VIMA's one right bin
        seed: seed of the initial weights and the batches

    Examples:
      python -m experiments.picture_prompts train-rival runs/prompts/demos runs/prompts/rival.safetensors --episodes 600
    """
    import torch

    from experiments.picture_prompts import measuring
    from experiments.picture_prompts.rival import RivalConfig

    torch.set_num_threads(1)
    config = RivalConfig(
        width=width, layers=layers, dropout=dropout, spread=spread, steps=steps, learning_rate=learning_rate
    )
    measuring.train_rival(folder, checkpoint, episodes, config, seed)


def measure(
    checkpoint: Path,
    /,
    *,
    level: Literal["placement", "combinations", "objects"] = "placement",
    split: base.Split = "test",
    episodes: int = 100,
    out: base.Out = None,
) -> None:
    """Measure a checkpoint of either method on a level, and file the row.

    Args:
        checkpoint: checkpoint of train-gem or train-rival
        level: VIMABench's first, second or third level
        episodes: number of episodes

    Examples:
      python -m experiments.picture_prompts measure runs/prompts/gem-6.safetensors --level objects
    """
    import torch

    from experiments.picture_prompts import measuring
    from experiments.picture_prompts.register_tasks import FAMILY
    from gem_lite import clip
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    path = results.output(False, out, "picture-prompts")
    trained = measuring.load(checkpoint, clip.load())
    played = measuring.play(trained.actor, f"{FAMILY}-{level}", split, episodes)
    row = measuring.row(trained, f"{FAMILY}-{level}", split, played)
    results.file_rows([row], path)
    low, high = row["ci95"]
    print(f"{row['method']}, {row['demos']} demonstrations, {level}: {row['mean']:.1f} [{low:.1f}, {high:.1f}]")
    print(f"the row is in {path}")


def peaks(*, scenes: int = 50, widths: tuple[float, ...] = (0.075, 0.0875, 0.1, 0.125, 0.15)) -> None:
    """Count how often the peak of a prompt picture's map is near the shown thing, and nearer to it than to the others.

    Args:
        scenes: number of validation scenes of the training level
        widths: widths of CLIP's patches (m)

    Examples:
      python -m experiments.picture_prompts peaks --scenes 10
    """
    import torch

    from experiments.picture_prompts import patch_peaks
    from gem_lite import clip

    torch.set_num_threads(1)
    print(patch_peaks.described(patch_peaks.measure(scenes, widths, clip.load())))


APP = base.make_app("python -m experiments.picture_prompts", __doc__, collect, train_gem, train_rival, measure, peaks)

if __name__ == "__main__":
    sys.exit(base.run(APP))
