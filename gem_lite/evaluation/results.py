"""Rows of results: which entries identify a row, how rows are filed in data/results, and how they are read."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import filelock

from gem_lite.config import Config
from gem_lite.evaluation import statistics
from gem_lite.foundations.files import DATA, read_json, write_atomically

RESULTS = DATA / "results"
"""The rows that the lessons draw."""
RUNS = Path("runs/results")
"""Rows of runs that are not filed."""
CARD_ENTRIES = (
    "demos",
    "seed",
    "train_seconds",
    "train_cpu_seconds",
    "hardware",
    "data_sha256",
    "demonstrations_world",
)
"""Entries that a row copies from a checkpoint's card; None without a checkpoint, or where an old card lacks one."""
IDENTITY = (
    "method", "task", "subset", "world", "split", "start", "skipped", "demos", "data_sha256", "seed", "steps", "config",
    "config_hash", "clip_fingerprint", "checkpoint_sha256",
)  # fmt: skip
"""The entries that identify a row: all that change its meaning, except the number of episodes and `ACTING_RULES`."""
ACTING_RULES = 3
"""The version of what a policy does with its maps besides its networks: gates, forbidden actions, retries.

Raise it when a change of the library lets the same weights act in another way. A row holds the version under which it
was measured (1 where it holds none), and `is_outdated` says whether it is an older one."""
LOCK = ".lock"
"""The file in a folder of rows that a process locks while it reads and writes them."""


@dataclass(frozen=True)
class Episode:
    """The outcome of one episode.

    Attributes:
        index: of the episode in its split.
        reward: in [0, 1].
        steps: actions taken.
        subsets: the sets of episodes, besides all, to which it belongs (`Task.subsets`).
        placed_decisions: actions chosen while a body lay where the sentences want it (`Task.placed`).
        retaken: how many of these picked such a body.
        outcomes: what each action came to, an `actions.Outcome` in words.
        error: why the robot could not act; empty if it could.
        condition: how the robot knew where the tables are, a `table_poses.Condition`; None at one table.
    """

    index: int
    reward: float
    steps: int
    subsets: tuple[str, ...]
    placed_decisions: int = 0
    retaken: int = 0
    outcomes: tuple[str, ...] = ()
    error: str = ""
    condition: tuple | None = None


def policy_entries(card: dict | None, config: Config | None) -> dict:
    """The entries of a row that describe the policy. A value is None where it does not apply.

    Args:
        card: of the checkpoint (`checkpoints.read_card`); None if nothing was trained.
        config: the configuration; None if the method does not depend on one.
    """
    entries = card or {}
    model = entries.get("clip", {})
    return {
        **{name: entries.get(name) for name in CARD_ENTRIES},
        "steps": config.steps if config and card else None,
        "learning_rate": config.learning_rate if config and card else None,
        "config": config.name if config else None,
        "config_hash": config.digest if config else None,
        "clip": model.get("name"),
        "clip_fingerprint": model.get("fingerprint"),
        "checkpoint_sha256": entries.get("sha256"),
    }


def reward_entries(rewards: dict[int, float]) -> dict:
    """The last entries of a row: every episode's reward by its index, their mean with its interval, and the date."""
    mean, interval = statistics.mean_and_interval(list(rewards.values()))
    return {
        "episodes": len(rewards), "mean": mean, "ci95": list(interval), "interval": statistics.INTERVAL,
        "rewards": {str(index): round(reward, 4) for index, reward in rewards.items()}, "acting_rules": ACTING_RULES,
        "date": datetime.now(UTC).date().isoformat(),
    }  # fmt: skip


def result_row(method: str, task_name: str, episodes: Sequence[Episode], subset: str, facts: dict) -> dict:
    """One row. ``facts`` holds the other entries that identify it, see `policy_entries`; without ``skipped``, none was.

    ``placed_decisions`` counts the actions that were chosen while a body already lay where the sentences want it.
    ``retaken`` counts those of them that picked such a body, ``outcomes`` what the actions came to.
    """
    names = {"method": method, "task": task_name, "subset": subset, "skipped": []}
    counts: dict[str, object] = {
        "placed_decisions": sum(episode.placed_decisions for episode in episodes),
        "retaken": sum(episode.retaken for episode in episodes),
    }
    outcomes = Counter(outcome for episode in episodes for outcome in episode.outcomes)
    if outcomes:
        counts["outcomes"] = dict(outcomes)
    return names | facts | counts | reward_entries({episode.index: episode.reward for episode in episodes})


def benchmark_file(task_name: str) -> Path:
    """Where the benchmark's rows on a task are filed."""
    return RESULTS / "benchmark" / f"{task_name}.jsonl"


def stored_rows() -> list[dict]:
    """The benchmark's rows that are filed, sorted by task."""
    return [row for path in sorted(benchmark_file("").parent.glob("*.jsonl")) for row in read_rows(path)]


def output(filed: bool, path: Path | None, name: str) -> Path:
    """The file for rows: ``path`` if it is given, else ``name`` in `RESULTS` if ``filed``, else ``name`` in `RUNS`."""
    return path or (RESULTS if filed else RUNS) / f"{name}.jsonl"


def is_outdated(row: Mapping[str, object]) -> bool:
    """Whether a row was measured under an earlier version of `ACTING_RULES`. Those of scripted methods never are."""
    return row.get("clip_fingerprint") is not None and row.get("acting_rules", 1) != ACTING_RULES


def read_rows(path: Path) -> list[dict]:
    """The rows of a JSON-lines file; none if there is no such file. Raises ValueError naming a line that is no row."""
    lines = path.read_bytes().splitlines() if path.exists() else []
    rows = [read_json(line, f"line {number} of {path}") for number, line in enumerate(lines, start=1)]
    for number, row in enumerate(rows, start=1):
        wrong = [name for name in IDENTITY if name != "skipped" and isinstance(row.get(name), dict | list)]
        episodes = row.get("episodes", 0)
        if isinstance(episodes, bool) or not isinstance(episodes, int):
            wrong.append("episodes")
        skipped = row.get("skipped") or []
        if not isinstance(skipped, list) or not all(isinstance(index, int) for index in skipped):
            wrong.append("skipped")
        if wrong:
            raise ValueError(f"line {number} of {path} is no row: see its {', '.join(wrong)}")
    return rows


def entry(row: dict, name: str) -> object:
    """An entry that identifies a row, as something that can be compared; rows without ``skipped`` skipped nothing."""
    return tuple(row.get(name) or ()) if name == "skipped" else row.get(name)


def _key(row: dict, identity: Sequence[str]) -> tuple:
    return tuple(entry(row, name) for name in identity)


def check_rows(rows: Sequence[dict], path: Path, identity: Sequence[str] = IDENTITY) -> None:
    """Check that rows may be filed in ``path``. They need ``identity`` and the number of ``episodes``, nothing else.

    Raises:
        ValueError: a row lacks an entry of ``identity``, or the file holds such a row over more episodes.
        OSError: the folder of ``path`` cannot be made or written.
    """
    _check_names(rows, path, identity)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error}") from error


def _check_names(rows: Sequence[dict], path: Path, identity: Sequence[str]) -> None:
    filed = {_key(row, identity): row for row in read_rows(path)}
    for row in rows:
        row_name = ", ".join(f"{name} {row[name]}" for name in identity if row.get(name) not in (None, []))
        missing = [name for name in identity if name not in row]
        if missing:
            raise ValueError(f"the row ({row_name}) lacks {', '.join(missing)}: measure it again with this version")
        old = filed.get(_key(row, identity))
        if old and row["episodes"] < old.get("episodes", 0):
            raise ValueError(
                f"{path} holds a row over {old['episodes']} episodes ({row_name}), which one over {row['episodes']} "
                f"does not replace: run at least {old['episodes']} episodes, or write to another file with --out"
            )


def file_rows(rows: Sequence[dict], path: Path, identity: Sequence[str] = IDENTITY) -> None:
    """Append rows to a JSON-lines file. An old row with the same ``identity`` is replaced.

    One process at a time reads and writes the file; the others wait. After an error the rows are printed, so that what
    was measured is not lost.

    Raises:
        ValueError: see `check_rows`, or the file holds a line that is no row; nothing is written then.
        OSError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with filelock.FileLock(path.parent / LOCK):
            _check_names(rows, path, identity)
            new_keys = {_key(row, identity) for row in rows}
            kept = [row for row in read_rows(path) if _key(row, identity) not in new_keys]
            write_atomically(path, "".join(json.dumps(row) + "\n" for row in [*kept, *rows]).encode())
    except (OSError, ValueError) as error:
        for row in rows:
            print(json.dumps(row))
        if isinstance(error, ValueError):
            raise
        raise OSError(f"{path} cannot be written, its rows are printed instead: {error}") from error
