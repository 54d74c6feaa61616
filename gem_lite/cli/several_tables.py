"""``gem-lite several-tables``: measure a policy over several tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite import tasks
from gem_lite.cli import names
from gem_lite.cli.command import MeasuringCommand
from gem_lite.evaluation import evaluate, results, table_poses
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.policies.checkpoints import read_card
from gem_lite.tasks import Split


@dataclass(frozen=True, kw_only=True)
class SeveralTables(MeasuringCommand):
    """Measure a policy over several tables, with their poses from tags and with their true poses. Writes all rows."""

    examples: ClassVar[tuple[str, ...]] = (
        "gem-lite several-tables data/gem-object-sorting.safetensors --curve",
        "gem-lite several-tables data/gem-object-sorting.safetensors --tasks object-sorting-seen --episodes 2",
    )

    checkpoint: Positional[Path]
    """checkpoint of the policy"""
    tasks: tuple[str, ...] = table_poses.TASKS
    """names of the tasks"""
    episodes: int = 100
    """number of episodes of each task"""
    start: int = 0
    """index of the first episode in the split"""
    split: Split = "test"
    """split of the episodes"""
    tables: int = 2
    """number of tables"""
    curve: bool = False
    """also measure with added errors of the poses"""
    world: str = "home"
    """looks of the world, see below"""
    clip: str | None = None
    """Hugging Face name or folder of a CLIP (without it: the embedded one)"""
    processes: int | None = None
    """number of episodes that run at once (without it: one per core)"""

    @override
    def run(self) -> None:
        conditions = (*table_poses.BOTH, *(table_poses.CURVE if self.curve else ()))
        method = read_card(self.checkpoint)["method"]
        measurements = [
            Measurement(
                method, task, self.episodes, self.split, self.start, self.checkpoint, self.clip, self.world,
                tables=self.tables, conditions=conditions,
            )
            for task in self.tasks
        ]  # fmt: skip
        for measurement in measurements:  # All tasks before the first is measured.
            measurement.check()
        for measurement in measurements:
            task = measurement.task
            path = results.output(self.file, self.out, tasks.family(task))
            rows, errors = evaluate.measure_and_file(measurement, path, self.processes)
            for row in rows:
                print(f"{task}, {row['poses']}, {row['shift']} m, {row['turn']} rad: {row['mean']} {row['ci95']}")
            for error in errors:
                print(error)
            print(f"the rows are in {path}")

    @override
    @classmethod
    def more_help(cls) -> str:
        return names.world_names()
