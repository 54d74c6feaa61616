"""Checks that all rows of a policy are of one checkpoint, and that what is measured is filed.

A policy that is lost and trained anew need not be the same, on another machine or by another version. These checks
refuse to mix the two.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from experiments.benchmark.plan import Cell, Training
from gem_lite.policies import checkpoints, methods


def check_checkpoints(rows: Iterable[Mapping[str, Any]]) -> None:
    """Check that all rows of one method, number of demonstrations, training seed and data are of one checkpoint.

    A policy for several tasks has one set of data. A policy for one task has one for its family, or for its variant.
    Methods that differ by rules of acting alone have one policy (`methods.trained`).
    On validation episodes, the trials of a search count as different policies.

    Raises:
        ValueError: rows are of two checkpoints.
    """
    policies: dict[tuple, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        if row["checkpoint_sha256"] is None:
            continue
        trial = None if row["split"] == "test" else row["config_hash"]
        facts = ("demos", "seed", "data_sha256", "clip_fingerprint", "config")
        policy = (methods.trained(row["method"]), *(row[name] for name in facts), trial)
        policies.setdefault(policy, {}).setdefault(row["checkpoint_sha256"], row)
    for (method, demos, seed, *_), by_checkpoint in policies.items():
        if len(by_checkpoint) > 1:
            named = ", ".join(f"{sha[:12]} on {row['task']}" for sha, row in by_checkpoint.items())
            raise ValueError(
                f"the rows of {method} with {demos} demonstrations and the training seed {seed} are of several "
                f"policies, {named}: remove the rows of all but one, and measure them again with this one"
            )


def check_policy(cell: Cell, cells: Iterable[Cell], policies: Path) -> None:
    """Check that a cell would be measured with a policy of its training, and with that of the training's other rows.

    Args:
        cells: all cells of the plan.
        policies: the folder of the checkpoints.

    Raises:
        ValueError: other rows are filed, and the checkpoint is missing, so that a policy would be trained anew, or it
            is another one; or the checkpoint is of another training, such as one with an older configuration.
        FileNotFoundError: the checkpoint has no card.
    """
    if cell.training is None:
        return
    path = policies / f"{cell.training.name}.safetensors"
    card = checkpoints.read_card(path) if path.exists() else None
    if card and not _is_of(card, cell.training):
        raise ValueError(
            f"{cell.name}: {path} is of another training than its name says (configuration, demonstrations, seed "
            "or CLIP): remove it to train it anew"
        )
    filed = {}
    for other in cells:
        row = other.row() if other.training == cell.training and other != cell else None
        if row:
            filed[row["checkpoint_sha256"]] = other.task
    if filed and set(filed) != {card["sha256"] if card else None}:
        state = "is another one" if card else "is missing and would be trained anew"
        rows = ", ".join(f"{sha[:12]} on {task}" for sha, task in filed.items())
        raise ValueError(
            f"{cell.name}: its policy {path} {state}, but other rows of this training are of the checkpoints {rows}: "
            "bring this checkpoint back, or remove all rows of this training to measure them anew"
        )


def missing(cells: Iterable[Cell], folder: Path) -> list[Path]:
    """The files of a folder into which those cells are measured that the tables lack.

    Raises:
        ValueError: such a file is there, so that a cell is measured and its row is not filed.
    """
    files = {folder / f"{cell.name}.jsonl": cell for cell in cells if cell.row() is None}
    for file in files:
        if file.exists():
            raise ValueError(
                f"{file} is measured, and data/results/benchmark/ lacks its row: file it by 'python -m "
                f"experiments.benchmark file {file}', or remove it to measure it anew"
            )
    return list(files)


def _is_of(card: dict, training: Training) -> bool:
    """Whether a checkpoint's card says what a training says."""
    facts = (card["method"], card.get("task"), card.get("demos"), card.get("seed"), card["clip"].get("fingerprint"))
    tasks = " + ".join(training.tasks)
    wanted = (training.method, tasks, training.demos, training.seed, training.clip_fingerprint)
    return facts == wanted and methods.of_card(card)[1] == training.config
