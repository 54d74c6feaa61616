"""Other eyes than CLIP's patches: maps of regions and of object detectors (A.6), as pictures and in numbers."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from gem_lite.cli import base


def pictures(
    *, out: Path, episode: int = 0, sources: tuple[str, ...] = (), detector: str = "", clip: base.Clip = None
) -> None:
    """Draw a table and its maps from each source, as Figures A1 and A6 do: bowls, a mug handle, two touching blocks.

    Args:
        out: folder of the PNGs
        episode: number of the validation episode
        sources: map sources (without it: multi-view, dense and regions)
        detector: Hugging Face name or folder of a detector, for the source owl-vit or grounding-dino

    Examples:
      python -m experiments.other_eyes pictures --out runs/other-eyes
    """
    from experiments.other_eyes import pictures as drawing

    for path in drawing.draw(out, episode, sources, detector, clip):
        print(path)


def peaks(
    *,
    scenes: int = 50,
    kinds: tuple[str, ...] = (),
    sources: tuple[str, ...] = (),
    split: base.Split = "test",
    detector: str = "",
    clip: base.Clip = None,
    out: base.Out = None,
) -> None:
    """Measure how often the peak of a map lies on the named thing, for each source, and the seconds of a scene.

    Args:
        scenes: number of scenes of each kind
        kinds: kinds of scenes: put-block-in-bowl-seen-colors, pick-object-part-in-brown-box-seen, touching-blocks
            (without it: all)
        sources: map sources (without it: multi-view, single-view, dense and regions; besides, there are
            regions-that-rise and regions-of-whole-things, two other ways to propose regions)
        detector: Hugging Face name or folder of a detector, for the source owl-vit or grounding-dino

    Examples:
      python -m experiments.other_eyes peaks --scenes 10
      python -m experiments.other_eyes peaks --split val --sources regions regions-that-rise
      python -m experiments.other_eyes peaks --sources owl-vit --detector google/owlvit-base-patch32
    """
    import torch

    from experiments.other_eyes import peaks as measuring
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    path = results.output(False, out, "other-eyes")
    rows = measuring.measure(sources, kinds, split, scenes, detector, clip, path)
    print(measuring.described(rows))
    print(f"the rows are in {path}")


def acts(
    picture: Path,
    /,
    *checkpoints: Path,
    kind: Literal["put-block-in-bowl-seen-colors", "pick-object-part-in-brown-box-seen"],
    scenes: int = 3,
    clip: base.Clip = None,
) -> None:
    """Draw validation scenes on which some policies pick the named thing and others do not: what a source loses.

    Args:
        picture: PNG to write
        checkpoints: two or more of GEM, with other map sources
        kind: kind of scenes
        scenes: number of scenes to draw

    Examples:
      python -m experiments.other_eyes acts a7.png a.safetensors b.safetensors --kind put-block-in-bowl-seen-colors
    """
    import torch

    from experiments.other_eyes import acts as drawing

    torch.set_num_threads(1)
    for checkpoint, right in zip(checkpoints, drawing.draw(picture, kind, checkpoints, scenes, clip), strict=True):
        print(f"{checkpoint}: {right} of {drawing.SCENES} picks are on the named thing")


APP = base.make_app("python -m experiments.other_eyes", __doc__, pictures, peaks, acts)

if __name__ == "__main__":
    sys.exit(base.run(APP))
