"""Vague goals, planned and carried out: how much of what belongs comes into the box?"""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base


def play(
    *, scenes: int = 50, methods: tuple[str, ...] = (), tuning: bool = False, out: base.Out = None,
) -> None:  # fmt: skip
    """Play the scenes, and print the table. Scenes that the file of rows holds already are skipped.

    Args:
        scenes: number of scenes, the five kinds in turn
        methods: who says the sentences: planner, "without planner", "true names", "true kinds", "true names and
            kinds" (without it: all)
        tuning: other scenes, on which the planner was tuned

    Examples:
      python -m experiments.planning play
      python -m experiments.planning play --scenes 5 --methods planner
    """
    import torch

    from experiments.planning import measuring
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    path = results.output(False, out, "planning-tuning" if tuning else "planning")
    with base.continues(f"the rows in {path}"):
        measuring.measure(scenes, methods or measuring.METHODS, tuning, path)
    print(measuring.table(path))


def table(rows: Path = Path("data/planning/rows.jsonl"), /) -> None:
    """Print the table of stored rows.

    Args:
        rows: file of the rows

    Examples:
      python -m experiments.planning table
    """
    from experiments.planning import measuring

    print(measuring.table(rows))


def nouns() -> None:
    """How well does the language model tell kinds apart? (some minutes).

    Examples:
      python -m experiments.planning nouns
    """
    import torch

    from experiments.planning import nouns as of_nouns
    from gem_lite.language import models

    torch.set_num_threads(1)
    print(of_nouns.table(models.load()))


def swap(*, scenes: int = 50, out: base.Out = None) -> None:
    """Play scenes in which two things are to change places, and print the table (about 25 minutes).

    Scenes that the file of rows holds already are skipped.

    Args:
        scenes: number of scenes of each kind: blocks, everyday objects

    Examples:
      python -m experiments.planning swap --scenes 5
    """
    import torch

    from experiments.planning import swapping
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    path = results.output(False, out, "swaps")
    with base.continues(f"the rows in {path}"):
        swapping.measure(scenes, path)
    print(swapping.table(path))


APP = base.make_app("python -m experiments.planning", __doc__, play, table, nouns, swap)

if __name__ == "__main__":
    sys.exit(base.run(APP))
