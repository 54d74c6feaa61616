"""Make the embedded CLIP, and measure it."""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base


def pretrain(
    *,
    scenes: int = 3200,
    epochs: int = 7,
    seed: int = 0,
    out: Path = Path("runs/clip-tabletop"),
    state: Path = Path("runs/pretrain_clip"),
) -> None:
    """Train a CLIP on captions and crops that this project renders itself.

    Args:
        scenes: number of training scenes to render
        epochs: number of passes over the crops
        seed: seed of scenes, captions and weights
        out: folder to write
        state: folder for the crops and for the state to resume from

    Examples:
      python -m experiments.clip_tabletop pretrain
    """
    from experiments.clip_tabletop import pretrain as training

    with base.continues(f"the last epoch in {state}"):
        print(training.pretrain(out, state, scenes, epochs, seed))


def card(folder: Path, /, *, training_crops: int) -> None:
    """Measure a CLIP on fresh scenes, and write its card.

    Args:
        folder: the CLIP, as pretrain writes it
        training_crops: number of crops of its training

    Examples:
      python -m experiments.clip_tabletop card data/clip-tabletop --training-crops 806689
    """
    from experiments.clip_tabletop import card as measuring
    from gem_lite import clip

    print(measuring.write(folder, clip.load(folder), training_crops))


APP = base.make_app("python -m experiments.clip_tabletop", __doc__, pretrain, card)

if __name__ == "__main__":
    sys.exit(base.run(APP))
