"""``gem-lite clip``: make an embedded CLIP, write its card, and calibrate any CLIP."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite.cli.command import Command

# Each command imports what it runs: torch takes seconds to load, and the help needs none of it.


@dataclass(frozen=True, kw_only=True)
class _TrainingInEpochs(Command):
    """A training that saves its state after each epoch, in the folder ``state``."""

    state: Path

    @override
    def stop_message(self) -> str:
        return f"stopped; the same command goes on from the last epoch in {self.state}"


@dataclass(frozen=True, kw_only=True)
class Pretrain(_TrainingInEpochs):
    """Train the embedded CLIP on captions and crops that this project renders itself. A stopped training continues."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite clip pretrain --scenes 3200 --epochs 7 --out runs/clip-tabletop",)

    scenes: int = 3200
    """training scenes to render"""
    epochs: int = 7
    """passes over the crops"""
    seed: int = 0
    """seed of scenes, captions and weights"""
    out: Path = Path("runs/clip-tabletop")
    """folder to write: a new one, or one with an embedded CLIP, which is replaced"""
    state: Path = Path("runs/pretrain_clip")
    """folder for the crops and for the state to resume from"""

    @override
    def run(self) -> None:
        from experiments.clip_tabletop import pretrain

        print(pretrain.pretrain(self.out, self.state, self.scenes, self.epochs, self.seed))


@dataclass(frozen=True, kw_only=True)
class Card(Command):
    """Measure an embedded CLIP on fresh scenes and write its card, README.md of its folder (some minutes)."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite clip card data/clip-tabletop --training-crops 806689",)

    folder: Positional[Path]
    """the CLIP, as `gem-lite clip pretrain` writes it"""
    training_crops: int
    """number of crops of its training, for the card"""

    @override
    def run(self) -> None:
        from experiments.clip_tabletop import card
        from gem_lite import clip

        print(card.write(self.folder, clip.load(self.folder), self.training_crops))


@dataclass(frozen=True, kw_only=True)
class Calibrate(Command):
    """Measure the scale of a CLIP's scores and its retrieval threshold on rendered scenes, and save them."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite clip calibrate openai/clip-vit-base-patch32",)

    clip: Positional[str]
    """Hugging Face name or folder of a CLIP"""

    @override
    def run(self) -> None:
        from gem_lite import clip
        from gem_lite.clip import calibration
        from gem_lite.evaluation import calibrating

        model = clip.load(self.clip)
        numbers = calibrating.calibrate(model, calibrating.rendered_scenes())
        print(f"{numbers}\nwrote {calibration.write(model, numbers)}")
