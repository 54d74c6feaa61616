"""``gem-lite results list`` and ``results show``: the stored rows. They need neither a simulator nor torch."""

from __future__ import annotations

from pathlib import Path

from gem_lite.foundations.files import DATA


def list_(*, folder: Path = DATA / "results") -> None:
    """Name the files of results, and the methods (or maps) of their rows.

    Args:
        folder: folder of the files; results without --file are in runs/results

    Examples:
      gem-lite results list
    """
    from gem_lite.evaluation import results

    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is no folder of results")
    for name, path in files_by_name(folder).items():
        rows = results.read_rows(path)
        names = dict.fromkeys(row.get("method", row.get("map", row.get("kind", "rows"))) for row in rows)
        print(f"{name}: {len(rows)} rows, of {', '.join(names)}")


def show(name: str, /, *, method: str | None = None, task: str | None = None, world: str | None = None) -> None:
    """Print the rows of a file of results, one per line.

    Args:
        name: name of the file, as in `gem-lite results list`, or the path of another file
        method: only rows of this method (or of this map)
        task: only rows of this task
        world: only rows that were measured in this world

    Examples:
      gem-lite results show benchmark/block-insertion --method gem
    """
    from gem_lite.evaluation import results

    stored = files_by_name(results.RESULTS)
    path = stored.get(name, Path(name))
    if not path.is_file():
        raise FileNotFoundError(f"there are no results named {name!r}; there are: {', '.join(stored)}")
    rows = [
        row
        for row in results.read_rows(path)
        if method in (None, row.get("method", row.get("map")))
        and task in (None, row.get("task"))
        and world in (None, row.get("world"))
    ]
    if not rows:
        raise ValueError(f"{name} has no such row")
    print(*map(described, rows), sep="\n")


def files_by_name(folder: Path) -> dict[str, Path]:
    """The files of rows in a folder and its folders, by name: pointing, benchmark/align-rope."""
    paths = [*sorted(folder.glob("*.jsonl")), *sorted(folder.glob("*/*.jsonl"))]
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}


def described(row: dict) -> str:
    """A row in one line: its method, task, world and details, and its mean (0-100, with the 95 % interval)."""
    if row.get("kind") == "pointing":
        return described_pointing(row)
    if not {"method", "task", "world", "ci95", "mean", "episodes"} <= row.keys():  # of an experiment, by its own names
        return ", ".join(f"{name} {value}" for name, value in row.items())
    parts = {"demos": "demos", "steps": "steps", "seed": "seed", "poses": "poses by", "shift": "shift", "turn": "turn"}
    details = [f"{label} {row[name]}" for name, label in parts.items() if row.get(name) is not None]
    subset = row.get("subset", "all")
    where = ", ".join([row["task"], *([subset] if subset != "all" else []), f"in {row['world']}", *details])
    low, high = row["ci95"]
    return f"{row['method']} on {where}: {row['mean']} [{low}, {high}], {row['episodes']} episodes"


def described_pointing(row: dict) -> str:
    """A row of the pointing game in one line."""
    shares = (next(value for name, value in row.items() if name.startswith("within_")), row["exact"])
    near, exact = ("None" if share is None else "{mean} {ci95}".format(**share) for share in shares)
    counts = f"{row['phrases']} phrases, {row['without_crop']} more had no crop"
    return f"{row['scenes']}, {row['map']}: near {near}, exact {exact}, {counts}"
