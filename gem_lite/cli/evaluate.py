"""``gem-lite evaluate``: measure a policy over episodes of a task."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite import tasks
from gem_lite.cli import names
from gem_lite.cli.command import MeasuringCommand
from gem_lite.evaluation import evaluate, results
from gem_lite.evaluation.actors import SCRIPTED
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.tasks import Split


@dataclass(frozen=True, kw_only=True)
class Evaluate(MeasuringCommand):
    """Measure a policy over episodes of a task. Prints the mean with its 95 % interval and writes the rows."""

    examples: ClassVar[tuple[str, ...]] = (
        "gem-lite evaluate gem put-block-in-bowl-unseen-colors --checkpoint data/gem-put-block-in-bowl.safetensors",
        "gem-lite evaluate expert bars-in-box --episodes 2 --world shadows",
    )

    method: Positional[str]
    """name of the method, see below"""
    task: Positional[str]
    """name of the task, see below"""
    checkpoint: Path | None = None
    """checkpoint to load, for a learned method"""
    episodes: int = 100
    """number of episodes"""
    start: int = 0
    """index of the first episode in the split"""
    split: Split = "test"
    """split of the episodes"""
    skip: tuple[int, ...] = ()
    """indices of episodes to leave out, such as those that the expert does not solve: later ones take their place"""
    world: str = "home"
    """looks of the world, see below"""
    clip: str | None = None
    """Hugging Face name or folder of a CLIP (without it: the embedded one)"""
    preset: str = "lite"
    """pixels and angles of a method without a checkpoint: lite or paper"""
    processes: int | None = None
    """number of episodes that run at once (without it: one per core)"""

    @override
    def run(self) -> None:
        path = results.output(self.file, self.out, tasks.family(self.task))
        measurement = Measurement(
            self.method, self.task, self.episodes, self.split, self.start, self.checkpoint, self.clip, self.world,
            self.preset, self.skip,
        )  # fmt: skip
        rows, _ = evaluate.measure_and_file(measurement, path, self.processes)
        for row in rows:
            print("{method} on {task}, {subset}: {mean} {ci95}, {episodes} episodes".format(**row))
        print(f"the rows are in {path}")

    @override
    @classmethod
    def more_help(cls) -> str:
        scripted = f"  {', '.join(SCRIPTED)}: need no checkpoint; expert-rounded shows the loss by rounding alone\n"
        return "\n".join([names.method_names() + scripted, names.task_names(), names.world_names()])
