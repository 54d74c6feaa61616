"""Record demonstrations on a table of another simulator (MuJoCo), and measure policies and refusals there."""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base


def record(folder: Path, /, *, episodes: int = 5) -> None:
    """Let the expert play the first training tables, and record those that it solves.

    Args:
        folder: folder to write
        episodes: number of episodes

    Examples:
      python -m experiments.foreign_table record runs/foreign-demos
    """
    from experiments.foreign_table import measuring

    measuring.record(folder, episodes)


def measure(checkpoint: Path, /, *, episodes: int = 100, out: base.Out = None) -> None:
    """Measure a policy on the first test tables, and file the row.

    Args:
        checkpoint: checkpoint of the policy
        episodes: number of test tables

    Examples:
      python -m experiments.foreign_table measure data/gem-foreign-table.safetensors
    """
    import torch

    from experiments.foreign_table import measuring
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    measuring.measure(checkpoint, episodes, results.output(False, out, "own-table"))


def refusals(*, tables: int = 50, out: base.Out = None) -> None:
    """Ask for things that are there and for things that are not, and file how often the policy refused.

    Args:
        tables: number of tables of each simulator

    Examples:
      python -m experiments.foreign_table refusals
    """
    import torch

    from experiments.foreign_table import measuring
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    measuring.refusals(tables, results.output(False, out, "own-table"))


def scenes(folder: Path, /) -> None:
    """Render the still tables of data/foreign-scenes again.

    Args:
        folder: folder to write

    Examples:
      python -m experiments.foreign_table scenes runs/foreign-scenes
    """
    from experiments.foreign_table import make_scenes

    make_scenes.write_all(folder)


APP = base.make_app("python -m experiments.foreign_table", __doc__, record, measure, refusals, scenes)

if __name__ == "__main__":
    sys.exit(base.run(APP))
