"""``gem-lite collect``: make expert demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite.cli import names
from gem_lite.cli.command import Command, ImportingCommand
from gem_lite.cli.verify import summary
from gem_lite.evaluation import collecting
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
