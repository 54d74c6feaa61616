"""The demonstrations of folders, checked together for one training."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from gem_lite import demonstrations, language
from gem_lite.config import MULTI_TASK, Config
from gem_lite.demonstrations import OWN_WORLD, DemonstrationSet
from gem_lite.se2 import Pose2

SPLIT = "train"
"""The split of the demonstrations that train policies. The others measure them."""


def demonstrations_of_tasks(
    folders: Sequence[Path], episodes: int | None, settings: Config
) -> list[DemonstrationSet]:  # fmt: skip
    """The demonstrations of each folder. Several folders need a method with the ending "multi".

    Raises:
        FileNotFoundError: a folder holds no demonstrations.
        ValueError: the folders do not fit the method, ``episodes`` does not fit a folder, a task has more
            demonstrations than another, or a folder's demonstrations are not of the split `SPLIT`.
    """
    several = MULTI_TASK in settings.ablations
    if several != (len(folders) > 1):
        raise ValueError(
            f"a method with the ending {MULTI_TASK!r} needs several folders of demonstrations, any other method one, "
            f"got the endings {settings.variant or 'none'!r} and {len(folders)}"
        )
    sets = [_first_demonstrations(path, episodes) for path in folders]
    for path, part in zip(folders, sets, strict=True):
        if part[0].split != SPLIT:
            raise ValueError(
                f"demonstrations must be of the split {SPLIT!r}, got {part[0].split!r} in {path}: episodes of that "
                "split measure policies"
            )
    counts = demonstrations_by_task(sets)
    if len(set(counts.values())) > 1:
        numbers = ", ".join(f"{count} of {task}" for task, count in counts.items())
        raise ValueError(f"each task must have equally many demonstrations, got {numbers}: give --episodes")
    return sets


def demonstrations_by_task(sets: Sequence[DemonstrationSet]) -> dict[str, int]:
    """The number of demonstrations of each task, in the order of the folders."""
    counts: dict[str, int] = {}
    for part in sets:
        counts[part[0].task] = counts.get(part[0].task, 0) + len(part)
    return counts


def on_table_of(sets: Sequence[DemonstrationSet], settings: Config) -> Config:
    """The configuration for the tables of all demonstrations. Those of one's own table lie on the configuration's.

    Raises:
        ValueError: demonstrations of our tasks with a rectangle or mixed with others, different tables or sizes of
            things, or a manifest without its table; or see `check_recorded`.
    """
    own = {part[0].world == OWN_WORLD for part in sets}
    if own == {True}:
        for part in sets:
            check_recorded(part, settings)
        return settings
    if True in own or settings.rectangle is not None:
        raise ValueError(
            "demonstrations of our tasks cannot have a rectangle, nor be mixed with those of another table"
        )
    tables = sorted({_table(part) for part in sets})
    if len(tables) > 1:
        raise ValueError(
            "the tasks of the folders must have one table (x_min, x_max, y_min, y_max in m) and things of one scale, "
            f"got {tables}"
        )
    return settings.for_table(*tables[0])


def _table(demos: DemonstrationSet) -> tuple[tuple[float, float, float, float], float]:
    """The limits (m) of the table of demonstrations of our tasks, and the scale of its things: of their manifest."""
    manifest = demonstrations.read_manifest(demos.folder)
    if manifest.workspace is None:
        raise ValueError(
            f'the manifest in {demos.folder} must have an entry "workspace": [x_min, x_max, y_min, y_max] (m), got '
            f"none: gem-lite collect {demos[0].task} {demos.folder} --episodes {len(demos)} --world {demos[0].world} "
            "adds it, and plays no episode again"
        )
    return manifest.workspace, manifest.scale


def check_recorded(demos: DemonstrationSet, settings: Config) -> None:
    """Check demonstrations that a person or another program recorded.

    Raises:
        FileNotFoundError: a file is missing.
        ValueError: a file is not allowed, a pose lies outside the configuration's table, or its parser refuses a
            sentence. The message names the step.
    """
    parser = language.PARSERS.find(settings.parser)
    table = settings.workspace
    for name, demonstration in zip(demos.sums, demos, strict=True):
        for count, step in enumerate(demonstration.steps):
            where = f"{demos.folder / name}, step {count}"
            for key, pose in vars(step.expert.action).items():
                if isinstance(pose, Pose2) and not table.contains(pose.x, pose.y):
                    raise ValueError(
                        f"{where}: the {key} at ({pose.x:.3f}, {pose.y:.3f}) m lies outside the table, which is x "
                        f"{table.x_min:.3f} to {table.x_max:.3f} m, y {table.y_min:.3f} to {table.y_max:.3f} m; "
                        "--config.rectangle sets another"
                    )
            try:
                language.read_goals(step.instruction, parser)
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from error


def data_hash(sets: Sequence[DemonstrationSet]) -> str:
    """The SHA-256 of the demonstrations; of several sets, that of their hashes one after the other."""
    hashes = [part.digest for part in sets]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


def _first_demonstrations(folder: Path, episodes: int | None) -> DemonstrationSet:
    demos = demonstrations.load(folder)
    if episodes is not None and not 1 <= episodes <= len(demos):
        raise ValueError(f"episodes must be at least 1 and at most {len(demos)}, which {folder} holds, got {episodes}")
    return demos[:episodes]
