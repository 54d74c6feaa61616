"""``gem-lite train``: train a method from demonstrations, with every value of its configuration to be set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import tyro
from typing_extensions import override
from tyro.conf import FlagConversionOff, Positional

from gem_lite.cli import names
from gem_lite.cli.command import Command, Outside, first_look
from gem_lite.config import Config
from gem_lite.learning import train
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy


@dataclass(frozen=True, kw_only=True)
class Method:
    """The words that decide which values a configuration has, and their defaults."""

    method: str = "gem"
    """name of the method, see below"""
    preset: str = "lite"
    """the configuration to begin with: lite, for two CPU cores, or paper"""

    def find(self) -> tuple[type[PickPlacePolicy], Config]:
        """The method's class, and its preset with what the endings of its name switch off.

        Raises:
            ValueError: no such method or preset.
        """
        return methods.find(self.method, self.preset)


@dataclass(frozen=True, kw_only=True)
class Train(Method, Outside):
    """Train a method from demonstrations. A training that was stopped goes on.

    With several processes, `accelerate launch --num_processes 4 -m gem_lite.cli train ...`, each draws its own batch.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gem-lite train data/demos/put-block-in-bowl-seen-colors-10 runs/gem.safetensors",
        "gem-lite train data/demos/put-block-in-bowl-seen-colors-10 runs/short.safetensors --config.steps 300",
    )
    failures: ClassVar[tuple[type[Exception], ...]] = (*Command.failures, FloatingPointError)

    demonstrations: Positional[Path]
    """folder made by `gem-lite collect`"""
    checkpoint: Positional[Path]
    """safetensors file to write"""
    episodes: int | None = None
    """use only the first so many demonstrations"""
    seed: int = 0
    """seed of weights and draws"""
    clip: str | None = None
    """Hugging Face name or folder of a CLIP (without it: the embedded one)"""
    device: Literal["cpu", "cuda"] = "cpu"
    """where to train"""
    state: Path | None = None
    """folder for the state to resume from (without it: runs/<checkpoint>)"""
    config: Annotated[Config, FlagConversionOff]
    """Every value of the method's configuration, as the preset has it; the length of the table is the task's."""

    @override
    @classmethod
    def defaults(cls, words: Sequence[str]) -> Self:
        chosen = first_look(Method, words)
        return cls(
            demonstrations=tyro.MISSING, checkpoint=tyro.MISSING, method=chosen.method, preset=chosen.preset,
            config=chosen.find()[1],
        )  # fmt: skip

    @override
    def run(self) -> None:
        method, preset = self.find()
        if self.config.table != preset.table:
            raise ValueError("--config.table: the task of the demonstrations decides it; leave it out")
        card = train.train_from_folder(
            self.demonstrations, self.checkpoint, method, self.config, self._state, self.seed, self.episodes,
            self.clip, self.device,
        )  # fmt: skip
        if card:
            print(
                f"wrote {self.checkpoint} after {card['train_seconds']:.0f} s of training {card['method']} "
                f"on {card['demos']} demonstrations"
            )

    @override
    def after_stop(self) -> str:
        return f"stopped; the same command goes on from the last state in {self._state}"

    @property
    def _state(self) -> Path:
        return self.state or Path("runs") / self.checkpoint.stem

    @override
    @classmethod
    def more_help(cls) -> str:
        return names.method_names()
