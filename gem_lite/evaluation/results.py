"""Rows of results: what names one, how they are filed in data/results, and how they are read again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gem_lite import clip, tasks
from gem_lite.config import Config
from gem_lite.evaluation import statistics
from gem_lite.files import read_json, write_atomically

if TYPE_CHECKING:
    from gem_lite.evaluation.evaluate import Episode

RESULTS = clip.DATA / "results"
"""The rows that the lessons draw."""
RUNS = Path("runs/results")
"""Rows of runs that nobody asked to file."""
OLD_CAMERA = "home, old camera"
"""The world of rows that were measured while `View.points` was half a pixel off. No registered world has the name."""
TRAINING = ("demos", "seed", "train_seconds", "train_cpu_seconds", "hardware", "data_sha256", "demonstrations_world")
"""What a row holds of a checkpoint's card as it is; None for what is not trained or what an old card lacks."""
IDENTITY = (
    "method", "task", "subset", "world", "split", "start", "demos", "data_sha256", "seed", "steps", "config",
    "config_hash", "clip_fingerprint", "checkpoint_sha256",
)  # fmt: skip
"""What names a row of a policy's results: everything that changes its meaning but for the number of episodes."""
TRAINED = ("seed", "checkpoint_sha256")
"""Where the rows of one `Cell` may differ: it holds several trainings."""


# Writing


def facts_of(card: dict | None, settings: Config | None) -> dict:
    """What a row says of the policy. All values are None where they do not apply.

    Args:
        card: of the checkpoint (`checkpoints.read_card`); None for what is not trained.
        settings: the configuration; None for what does not depend on one.
    """
    trained = card or {}
    model = trained.get("clip", {})
    return {
        **{name: trained.get(name) for name in TRAINING},
        "steps": settings.steps if settings and card else None,
        "config": settings.name if settings else None,
        "config_hash": settings.digest if settings else None,
        "clip": model.get("name"),
        "clip_fingerprint": model.get("fingerprint"),
        "checkpoint_sha256": trained.get("sha256"),
    }


def scored(rewards: dict[int, float]) -> dict:
    """The last part of a row: every episode's reward by its index, their mean with its interval, and the date."""
    mean, interval = statistics.mean_and_interval(list(rewards.values()))
    return {
        "episodes": len(rewards), "mean": mean, "ci95": list(interval), "interval": statistics.INTERVAL,
        "rewards": {str(index): round(reward, 4) for index, reward in rewards.items()},
        "date": datetime.now(UTC).date().isoformat(),
    }  # fmt: skip


def result_row(method: str, task_name: str, found: Sequence[Episode], subset: str, facts: dict) -> dict:
    """One row: ``facts`` holds the rest of what names it, see `facts_of`.

    ``placed_decisions`` counts actions chosen while a body already lay where the sentences want it, ``retaken`` those
    of them that picked such a body.
    """
    named = {"method": method, "task": task_name, "subset": subset}
    counted = {
        "placed_decisions": sum(episode.placed_decisions for episode in found),
        "retaken": sum(episode.retaken for episode in found),
    }
    return named | facts | counted | scored({episode.index: episode.reward for episode in found})


def results_file(task_name: str) -> Path:
    """Where the rows of a task's family are filed. Raises ValueError if no task has the name."""
    return RESULTS / f"{tasks.family(task_name)}.jsonl"


def output(filed: bool, path: Path | None, name: str) -> Path:
    """Where rows go: to ``path`` if there is one, else to ``name`` among the ``filed`` rows or among `RUNS`."""
    return path or (RESULTS if filed else RUNS) / f"{name}.jsonl"


def read_rows(path: Path) -> list[dict]:
    """The rows of a JSON-lines file; none if there is no such file. Raises ValueError with the line that is no row."""
    lines = path.read_bytes().splitlines() if path.exists() else []
    rows = [read_json(line, f"line {number} of {path}") for number, line in enumerate(lines, start=1)]
    for number, row in enumerate(rows, start=1):
        wrong = [name for name in IDENTITY if isinstance(row.get(name), dict | list)]
        episodes = row.get("episodes", 0)
        if isinstance(episodes, bool) or not isinstance(episodes, int):
            wrong.append("episodes")
        if wrong:
            raise ValueError(f"line {number} of {path} is no row: see its {', '.join(wrong)}")
    return rows


def _key(row: dict, identity: Sequence[str]) -> tuple:
    return tuple(row.get(name) for name in identity)


def check_rows(rows: Sequence[dict], path: Path, identity: Sequence[str] = IDENTITY) -> None:
    """Whether ``path`` would take the rows. They need ``identity`` and the number of ``episodes``, nothing else.

    Raises:
        ValueError: a row lacks a part of its name, or one over more episodes is there.
    """
    filed = {_key(row, identity): row for row in read_rows(path)}
    for row in rows:
        named = ", ".join(f"{name} {row[name]}" for name in identity if row.get(name) is not None)
        lacking = [name for name in identity if name not in row]
        if lacking:
            raise ValueError(f"the row ({named}) lacks {', '.join(lacking)}: measure it again with this version")
        old = filed.get(_key(row, identity))
        if old and row["episodes"] < old.get("episodes", 0):
            raise ValueError(
                f"{path} holds a row over {old['episodes']} episodes ({named}), which one over {row['episodes']} "
                f"does not replace: run at least {old['episodes']} episodes, or write to another file with --out"
            )


def file_rows(rows: Sequence[dict], path: Path, identity: Sequence[str] = IDENTITY) -> None:
    """Append rows to a JSON-lines file; a row that agrees in all of ``identity`` and is not longer is replaced.

    Raises:
        ValueError: see `check_rows`; then nothing is written.
    """
    check_rows(rows, path, identity)
    new_keys = {_key(row, identity) for row in rows}
    kept = [row for row in read_rows(path) if _key(row, identity) not in new_keys]
    write_atomically(path, "".join(json.dumps(row) + "\n" for row in [*kept, *rows]).encode())


# Reading


@dataclass(frozen=True)
class Cell:
    """What a method scored on episodes of a task.

    Attributes:
        rewards: (training seeds, episodes) in [0, 1].
        mean, interval: 0-100, with 95 %, over episodes and seeds (`statistics.mean_and_interval`).
        cpu_seconds: of one training, the mean over seeds; None for what is not trained.
        episodes: the episodes' indices.
    """

    rewards: np.ndarray
    mean: float
    interval: tuple[float, float]
    cpu_seconds: float | None
    episodes: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.mean:.1f} [{self.interval[0]:.1f}, {self.interval[1]:.1f}]"


def paired_difference(one: Cell, other: Cell) -> statistics.Difference:
    """What ``one`` scored more than ``other`` on the same episodes, see `statistics.paired_difference`.

    Raises:
        ValueError: the cells are of different episodes.
    """
    if one.episodes != other.episodes:
        raise ValueError(
            f"one and other must be of the same episodes, got {_span(one.episodes)} and {_span(other.episodes)}"
        )
    return statistics.paired_difference(one.rewards, other.rewards)


def _span(episodes: Sequence[int]) -> str:
    return f"{len(episodes)} episodes ({episodes[0]} to {episodes[-1]})"


def pool(rows: Sequence[dict], episodes: int | None = None, identity: Sequence[str] = IDENTITY) -> Cell:
    """Rows of several training seeds as one cell.

    Args:
        rows: at least one. They may differ in `TRAINED` alone.
        episodes: only the first so many.

    Raises:
        LookupError: the rows differ in more, two are of the same seed, or they are not of the same episodes.
    """
    named = "{method} on {task}".format(**rows[0])
    for name in identity:
        values = list(dict.fromkeys(row.get(name) for row in rows))
        if len(values) > 1 and name not in TRAINED:
            raise LookupError(f"rows of {named} differ in {name}: {', '.join(map(str, values))}; ask for one of them")
    seeds = [row["seed"] for row in rows]
    if len(set(seeds)) < len(seeds):
        different = ", ".join(str(row["checkpoint_sha256"])[:12] for row in rows)
        raise LookupError(
            f"there are several rows of {named} with the same training seed, of the checkpoints {different}: "
            "ask for one with checkpoint_sha256, or remove the others"
        )
    played = [sorted(map(int, row["rewards"]))[:episodes] for row in rows]
    if any(indices != played[0] for indices in played):
        raise LookupError(f"the rows of {named} are of different episodes")
    if episodes and len(played[0]) < episodes:
        raise LookupError(f"the rows of {named} have {len(played[0])} episodes, not {episodes}")
    rewards = np.array([[row["rewards"][str(index)] for index in played[0]] for row in rows])
    seconds = [row["train_cpu_seconds"] for row in rows if row["train_cpu_seconds"] is not None]
    mean, interval = statistics.mean_and_interval(rewards)
    return Cell(rewards, mean, interval, float(np.mean(seconds)) if seconds else None, tuple(played[0]))


def select(rows: Sequence[dict], wanted: dict, shown: Sequence[str]) -> list[dict]:
    """The rows that agree with ``wanted``.

    Raises:
        LookupError: there are none; the message lists the values of ``shown`` that the task's rows have.
    """
    found = [row for row in rows if wanted.items() <= row.items()]
    if found:
        return found
    asked = ", ".join(f"{name} {value}" for name, value in wanted.items())
    of_task = [row for row in rows if row.get("task") == wanted["task"]]
    near = [row for row in of_task if row.get("method") == wanted["method"]] or of_task
    there = dict.fromkeys(", ".join(f"{name} {row.get(name)}" for name in shown) for row in near)
    raise LookupError(f"there is no row with {asked}. There are: {'; '.join(there) or 'none of this task'}")


def cell(
    method: str, task: str, demos: int | None = 10, episodes: int | None = None, steps: int = Config.steps,
    world: str = "home", **more: object,
) -> Cell:  # fmt: skip
    """The filed rows of a method on the test episodes from the first on, pooled over training seeds.

    Args:
        demos: demonstrations it was trained on; None for what is not trained.
        episodes: only the first so many, to compare with a cell that has fewer.
        steps: of its training.
        world: where it was measured: a world's name, or `OLD_CAMERA`.
        more: other entries of the rows with their values, such as ``demonstrations_world="varied"``, where rows
            differ in more than the training seed.

    Raises:
        LookupError: there is no such row (the message says which there are), or see `pool`.
    """
    wanted = {"method": method, "task": task, "demos": demos, "world": world, "split": "test", "start": 0}
    wanted |= {"subset": "all"} | ({"steps": steps} if demos else {}) | more
    shown = ("method", "demos", "steps", "world", *more)
    return pool(select(read_rows(results_file(task)), wanted, shown), episodes)
