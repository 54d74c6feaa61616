"""``gem-lite train``: train a method from demonstrations. Options can set every value of its configuration."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import tyro
from typing_extensions import override
from tyro.conf import FlagConversionOff, Positional

from gem_lite.cli.command import Command, ImportingCommand, parse_known
from gem_lite.config import Config
from gem_lite.learning import train
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy


@dataclass(frozen=True, kw_only=True)
class Method:
    """The options that choose the method's configuration, and their defaults."""

    method: str = "gem"
    """name of the method, see below"""
    preset: str = "lite"
    """the base of the configuration: lite, for two CPU cores, or paper"""

    def find(self) -> tuple[type[PickPlacePolicy], Config]:
        """The method's class, and its configuration from the preset and the endings of its name.

        Raises:
            ValueError: the method or the preset is unknown.
        """
        return methods.find(self.method, self.preset)


@dataclass(frozen=True, kw_only=True)
class Train(Method, ImportingCommand):
    """Train a method from demonstrations. A stopped training continues.

    With several processes (`accelerate launch --num_processes 4 -m gem_lite.cli train ...`), each draws its own batch.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gem-lite train data/demos/put-block-in-bowl-seen-colors-10 runs/gem.safetensors",
        "gem-lite train data/demos/put-block-in-bowl-seen-colors-10 runs/short.safetensors --config.steps 300",
        "gem-lite train data/foreign-demos runs/mine.safetensors --config.rectangle 0.25 0.75 -0.5 0.5",
    )
    failures: ClassVar[tuple[type[Exception], ...]] = (*Command.failures, FloatingPointError)

    demonstrations: Positional[Path]
    """folder made by `gem-lite collect`, or with your own recorded episodes (docs/your_table.md)"""
    checkpoint: Positional[Path]
    """safetensors file to write"""
    episodes: int | None = None
    """number of demonstrations to use, from the first (without it: all)"""
    seed: int = 0
    """seed of the weights and of the batches"""
    clip: str | None = None
    """Hugging Face name or folder of a CLIP (without it: the embedded one)"""
    device: Literal["cpu", "cuda"] = "cpu"
    """device of the training"""
    state: Path | None = None
    """folder for the state to resume from (without it: runs/<name of the checkpoint>-<hash of its path>)"""
    prepared: Path | None = None
    """cache of prepared steps that trainings share; it may be deleted when none runs (without it: kept in --state)"""
    also: tuple[Path, ...] = ()
    """more folders, of other tasks: one policy for all of them (--method gem-multi)"""
    config: Annotated[Config, FlagConversionOff]
    """The values of the method's configuration; the defaults are the preset's. The task sets the table's length;
    --config.rectangle x_min x_max y_min y_max (m) is for a table of your own."""

    @override
    @classmethod
    def defaults(cls, words: Sequence[str]) -> Self:
        chosen = parse_known(Method, words)
        return cls(
            demonstrations=tyro.MISSING, checkpoint=tyro.MISSING, method=chosen.method, preset=chosen.preset,
            config=chosen.find()[1],
        )  # fmt: skip

    @override
    def run(self) -> None:
        method, preset = self.find()
        if self.config.table != preset.table:
            raise ValueError("--config.table must be left out: the task of the demonstrations sets it")
        card = train.train_from_folder(
            self.demonstrations, self.checkpoint, method, self.config, self._state, self.seed, self.episodes,
            self.clip, self.device, self.also, self.prepared,
        )  # fmt: skip
        if card:
            print(
                f"wrote {self.checkpoint} after {card['train_seconds']:.0f} s of training {card['method']} "
                f"on {card['demos']} demonstrations"
            )

    @override
    def stop_message(self) -> str:
        return f"stopped; the same command goes on from the last state in {self._state}"

    @property
    def _state(self) -> Path:
        if self.state:
            return self.state
        # Relative to the working folder, as runs/ itself: both may move together. Two checkpoints may have one name.
        path = os.path.relpath(self.checkpoint.resolve(), Path.cwd())
        return Path("runs") / f"{self.checkpoint.stem}-{hashlib.sha256(path.encode()).hexdigest()[:8]}"

    @override
    @classmethod
    def more_help(cls) -> str:
        return methods.help_text() + "\n"
