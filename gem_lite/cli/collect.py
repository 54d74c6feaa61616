"""``gem-lite collect`` and ``gem-lite verify``: make expert demonstrations, and check them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from tqdm import tqdm
from typing_extensions import override
from tyro.conf import Positional

from gem_lite import demonstrations
from gem_lite.cli import names
from gem_lite.cli.command import Command, ImportingCommand
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.learning import collecting
from gem_lite.tasks import Split


@dataclass(frozen=True, kw_only=True)
class Collect(ImportingCommand):
    """Let the expert play episodes of a task, and save those that succeed. A stopped collection continues."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite collect bars-in-box runs/demos/bars --episodes 2",)
    failures: ClassVar[tuple[type[Exception], ...]] = (*Command.failures, RuntimeError)

    task: Positional[str]
    """name of the task, see below"""
    folder: Positional[Path]
    """where to save them"""
    episodes: int = 10
    """number of episodes"""
    split: Split = "train"
    """split of the episodes"""
    start: int = 0
    """index in the split of the first episode to try"""
    world: str = "home"
    """looks of the world, see below"""

    @override
    def run(self) -> None:
        demos = collecting.collect(self.task, self.episodes, self.folder, self.split, self.start, self.world)
        print(summary(self.folder, demos))

    @override
    def stop_message(self) -> str:
        return f"stopped; the same command goes on from the episodes in {self.folder}"

    @override
    @classmethod
    def more_help(cls) -> str:
        return f"{names.task_names()}\n{names.world_names()}"


@dataclass(frozen=True, kw_only=True)
class Verify(Command):
    """Load a set of demonstrations and check the SHA-256 of every file."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite verify data/demos/put-block-in-bowl-seen-colors-10",)

    folder: Positional[Path]
    """folder made by `gem-lite collect`"""

    @override
    def run(self) -> None:
        print(summary(self.folder, demonstrations.load(self.folder)))


def summary(folder: Path, demos: DemonstrationSet) -> str:
    """The content of a set, in one line. Every file is read and checked."""
    steps = sum(len(demonstration.steps) for demonstration in tqdm(demos, "verifying", unit="episode"))
    return f"{folder}: {len(demos)} episodes, {steps} steps, data hash {demonstrations.data_hash(folder)[:12]}"
