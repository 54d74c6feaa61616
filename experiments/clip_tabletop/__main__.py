"""Make the embedded CLIP, and measure it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from gem_lite.cli import base

Withhold = Literal["nothing", "pairs", "words"]


def pretrain(
    *,
    scenes: int = 3200,
    epochs: int = 7,
    seed: int = 0,
    withhold: Withhold = "nothing",
    out: Path | None = None,
    state: Path = Path("runs/pretrain_clip"),
) -> None:
    """Train a CLIP on captions and crops that this project renders itself.

    Args:
        scenes: number of training scenes to render
        epochs: number of passes over the crops
        seed: seed of scenes, captions and weights
        withhold: list of parts and letters that no caption names, see withheld.py
        out: folder to write (without it: runs/clip-tabletop, or runs/clip-pairs and so on)
        state: folder for the crops and for the state to resume from

    Examples:
      python -m experiments.clip_tabletop pretrain
      python -m experiments.clip_tabletop pretrain --withhold words --out runs/clip-words
    """
    from experiments.clip_tabletop import pretrain as training
    from experiments.clip_tabletop.withheld import LISTS

    folder = out or Path(f"runs/clip-{'tabletop' if withhold == 'nothing' else withhold}")
    with base.continues(f"the last epoch in {state}"):
        print(training.pretrain(folder, state, scenes, epochs, seed, LISTS[withhold]))


def card(folder: Path, /, *, training_crops: int, withhold: Withhold = "nothing") -> None:
    """Measure a CLIP on fresh scenes, and write its card.

    Args:
        folder: the CLIP, as pretrain writes it
        training_crops: number of crops of its training
        withhold: list of its training

    Examples:
      python -m experiments.clip_tabletop card data/clip-tabletop --training-crops 806689
    """
    from experiments.clip_tabletop import card as measuring
    from experiments.clip_tabletop.withheld import LISTS
    from gem_lite import clip

    print(measuring.write(folder, clip.load(folder), training_crops, LISTS[withhold]))


def part_peaks(
    *,
    episodes: int = 10,
    method: Literal["gem", "gem-with-part-crops"] = "gem",
    text_weight: float = 0.8,
    world: base.World = "real-table",
    clip: base.Clip = None,
    out: base.Out = None,
) -> None:
    """Measure how often the peak of a map lies on the named part, for words, for a crop, and for a blend of both.

    Args:
        episodes: number of test scenes of each part
        method: its crops and patches
        text_weight: weight of the words in the blend, 0 to 1; the crop has the rest

    Examples:
      python -m experiments.clip_tabletop part-peaks --clip runs/clip-words
      python -m experiments.clip_tabletop part-peaks --method gem-with-part-crops --text-weight 0.2 --episodes 4
    """
    from dataclasses import replace

    from experiments.clip_tabletop import part_peaks as measuring
    from gem_lite.evaluation import results
    from gem_lite.policies import methods

    if not 0 <= text_weight <= 1:
        raise ValueError(f"text_weight must be in [0, 1], got {text_weight:g}")
    maps = replace(methods.find(method)[1], text_weight=text_weight, image_weight=round(1 - text_weight, 4))
    path = results.output(False, out, "part-peaks")
    print(measuring.described(measuring.measure(episodes, world, clip, maps, path)))
    print(f"the rows are in {path}")


def crop_search(
    *, episodes: int = 3, world: base.World = "real-table", clip: base.Clip = None, out: base.Out = None
) -> None:
    """Measure how wide a part's crop should be, and how much it should weigh, on validation scenes.

    Args:
        episodes: number of validation scenes of each part

    Examples:
      python -m experiments.clip_tabletop crop-search --episodes 1
    """
    from experiments.clip_tabletop import crop_search as measuring
    from gem_lite.evaluation import results

    path = results.output(False, out, "crop-search")
    print(measuring.described(measuring.measure(episodes, world, clip, path)))
    print(f"the rows are in {path}")


def withheld_picks(
    *checkpoint: Path,
    withheld: Literal["pairs", "words"] = "words",
    episodes: int = 10,
    world: base.World = "real-table",
    clip: base.Clip = None,
    out: base.Out = None,
) -> None:
    """Measure how often policies pick the named part, for parts that their CLIP never read and for the others.

    Args:
        checkpoint: policies of pick-object-part-in-brown-box
        withheld: list of the words that the CLIP never read
        episodes: number of test episodes

    Examples:
      python -m experiments.clip_tabletop withheld-picks runs/words-0.safetensors --clip runs/clip-words
    """
    from experiments.clip_tabletop import withheld_picks as measuring
    from gem_lite.evaluation import results

    path = results.output(False, out, "withheld-picks")
    if not checkpoint:
        raise ValueError("name at least one checkpoint")
    rows = [measuring.measure(one, withheld, clip, world, episodes, path) for one in checkpoint]
    print(measuring.described(rows))
    print(f"the rows are in {path}")


APP = base.make_app(
    "python -m experiments.clip_tabletop", __doc__, pretrain, card, part_peaks, crop_search, withheld_picks
)

if __name__ == "__main__":
    sys.exit(base.run(APP))
