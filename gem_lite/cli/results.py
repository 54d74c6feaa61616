"""``gem-lite results list`` and ``results show``: the stored rows. They need neither a simulator nor torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite.cli.command import Command
from gem_lite.evaluation import results


@dataclass(frozen=True, kw_only=True)
class List(Command):
    """Name the files of results, and the methods (or maps) of their rows."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results list",)

    folder: Path = results.RESULTS
    """folder of the files; results without --file are in runs/results"""

    @override
    def run(self) -> None:
        if not self.folder.is_dir():
            raise FileNotFoundError(f"{self.folder} is no folder of results")
        for name, path in files_by_name(self.folder).items():
            rows = results.read_rows(path)
            names = dict.fromkeys(row.get("method", row.get("map")) for row in rows)
            print(f"{name}: {len(rows)} rows, of {', '.join(names)}")


@dataclass(frozen=True, kw_only=True)
class Show(Command):
    """Print the rows of a file of results, one per line."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results show benchmark/block-insertion --method gem",)

    name: Positional[str]
    """name of the file, as in `gem-lite results list`, or the path of another file"""
    method: str | None = None
    """only rows of this method (or of this map)"""
    task: str | None = None
    """only rows of this task"""
    world: str | None = None
    """only rows that were measured in this world"""

    @override
    def run(self) -> None:
        stored = files_by_name(results.RESULTS)
        path = stored.get(self.name, Path(self.name))
        if not path.is_file():
            raise FileNotFoundError(f"there are no results named {self.name!r}; there are: {', '.join(stored)}")
        rows = [row for row in results.read_rows(path) if self.selects(row)]
        if not rows:
            raise ValueError(f"{self.name} has no such row")
        for row in rows:
            print(described(row))

    def selects(self, row: dict) -> bool:
        """Whether a row has the given method, task and world."""
        method = row.get("method", row.get("map"))
        return (
            self.method in (None, method)
            and self.task in (None, row.get("task"))
            and self.world in (None, row.get("world"))
        )


def files_by_name(folder: Path) -> dict[str, Path]:
    """The files of rows in a folder and its folders, by name: pointing, benchmark/align-rope."""
    paths = [*sorted(folder.glob("*.jsonl")), *sorted(folder.glob("*/*.jsonl"))]
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}


def described(row: dict) -> str:
    """A row in one line: its method, task, world and details, and its mean (0-100, with the 95 % interval)."""
    if row.get("kind") == "pointing":
        return described_pointing(row)
    parts = {"demos": "demos", "steps": "steps", "seed": "seed", "poses": "poses by", "shift": "shift", "turn": "turn"}
    details = [f"{label} {row[name]}" for name, label in parts.items() if row.get(name) is not None]
    subset = row.get("subset", "all")
    where = ", ".join([row["task"], *([subset] if subset != "all" else []), f"in {row['world']}", *details])
    low, high = row["ci95"]
    return f"{row['method']} on {where}: {row['mean']} [{low}, {high}], {row['episodes']} episodes"


def described_pointing(row: dict) -> str:
    """A row of the pointing game in one line."""
    near = next(value for name, value in row.items() if name.startswith("within_"))
    return (
        f"{row['scenes']}, {row['map']}: near {_rate_text(near)}, exact {_rate_text(row['exact'])}, "
        f"{row['phrases']} phrases, {row['without_crop']} more had no crop"
    )


def _rate_text(share: dict | None) -> str:
    return "None" if share is None else "{mean} {ci95}".format(**share)
