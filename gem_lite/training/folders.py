"""The demonstrations of folders, checked together for one training."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from accelerate import PartialState

from gem_lite import demonstrations, language
from gem_lite.config import MULTI_TASK, Config
from gem_lite.demonstrations import OWN_WORLD, DemonstrationSet
from gem_lite.foundations.files import as_number
from gem_lite.training import recorded_steps

SPLIT = "train"
"""The split of the demonstrations that train policies. The others measure them."""


def packed(folders: Sequence[Path], into: Path, settings: Config) -> list[Path]:
    """The folders, with those of recorded episodes replaced by sets in ``into`` that hold the same episodes.

    Of several processes, the first writes these sets, and the others must come after it.

    Raises: see `recorded_steps.read`.
    """
    parser = language.PARSERS.find(settings.parser)
    ready = []
    for number, folder in enumerate(folders):
        if not recorded_steps.is_recorded(folder):
            ready.append(folder)
            continue
        place = into / str(number) / folder.resolve().name
        if PartialState().is_main_process:  # Only one process may write into a folder.
            recorded_steps.pack(folder, place, settings.workspace, parser)
        ready.append(place)
    return ready


def demonstrations_of_tasks(
    folders: Sequence[Path], episodes: int | None, settings: Config
) -> list[DemonstrationSet]:  # fmt: skip
    """The demonstrations of each folder, equally many. Several folders need a method with the ending "multi".

    Raises:
        FileNotFoundError: a folder holds no demonstrations.
        ValueError: the folders do not fit the method, ``episodes`` does not fit a folder, the numbers of demonstrations
            differ, or a folder's demonstrations are not of the split `SPLIT`.
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
    counts = sorted({len(part) for part in sets})
    if len(counts) > 1:
        raise ValueError(f"the folders must hold equally many demonstrations, got {counts}: give --episodes")
    return sets


def on_table_of(sets: Sequence[DemonstrationSet], settings: Config) -> Config:
    """The configuration for the tables of all demonstrations. Those of one's own table lie on the configuration's.

    Raises:
        ValueError: demonstrations of our tasks with a rectangle or mixed with others, tables of other lengths, or a
            manifest without its table.
    """
    own = {part[0].world == OWN_WORLD for part in sets}
    if own == {True}:
        return settings
    if True in own or settings.rectangle is not None:
        raise ValueError(
            "demonstrations of our tasks cannot have a rectangle, nor be mixed with those of another table"
        )
    lengths = sorted({_table_length(part) for part in sets})
    if len(lengths) > 1:
        raise ValueError(f"the tasks of the folders must have equally long tables, got {lengths} m")
    return settings.on_table(lengths[0])


def _table_length(demos: DemonstrationSet) -> float:
    """The length (m) of the table on which demonstrations of our tasks lie, as their manifest says it."""
    limits = demonstrations.read_manifest(demos.folder).get("workspace")
    if limits is None:
        raise ValueError(
            f'the manifest in {demos.folder} must have an entry "workspace": [x_min, x_max, y_min, y_max] (m), got '
            f"none: gem-lite collect {demos[0].task} {demos.folder} --episodes {len(demos)} --world {demos[0].world} "
            "adds it, and plays no episode again"
        )
    try:
        _, _, y_min, y_max = map(as_number, limits)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{demos.folder}/manifest.json has a wrong workspace, {limits!r:.80}: {error}") from error
    return y_max - y_min


def data_hash(folders: Sequence[Path], episodes: int | None) -> str:
    """The SHA-256 of the demonstrations; of several folders, that of their hashes one after the other."""
    hashes = [demonstrations.data_hash(folder, episodes) for folder in folders]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


def _first_demonstrations(folder: Path, episodes: int | None) -> DemonstrationSet:
    if episodes is not None and episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    demos = demonstrations.load(folder)[:episodes]
    if episodes is not None and len(demos) < episodes:
        raise ValueError(f"episodes must be at most {len(demos)}, which {folder} holds, got {episodes}")
    return demos
