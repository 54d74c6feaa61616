"""How a set of demonstrations is saved, loaded and verified.

A set is a folder of episodes (`Demonstration.load`) and a manifest, which names every episode with its SHA-256. The
manifest is written last. The name of an episode holds the beginning of its SHA-256, so that the episodes of a new set
never overwrite those of an old one: the old set stays complete until the new manifest is written. Only one process at a
time writes into a folder (`gem_lite.foundations.files.writing`), and what no manifest names is left alone.

Episodes that a person or another program recorded need no manifest. Sets of earlier versions hold archives instead of
folders (`packed`); they are read, and a collection goes on behind them.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from typing_extensions import override

from gem_lite.demonstrations import packed
from gem_lite.demonstrations.records import ACTION_FILE, EPISODE_FILE, Demonstration, is_hidden, natural_order
from gem_lite.foundations.files import FileSequence, read_verified, write_atomically, write_together, writing
from gem_lite.foundations.forms import Form, Text, Whole

SCHEMA = 4
"""Of the manifest. In sets with schema 3, every episode is an archive."""
MANIFEST_FILE = "manifest.json"
_EPISODE = r"^episode-[0-9]{4,}-[0-9a-f]{12}(\.npz)?$"
"""A name that contains a folder could point outside the set."""
_SHA256 = r"^[0-9a-f]{64}$"


class Manifest(Form):
    """The file manifest.json.

    A collection has ``start`` and ``next``, the indices of its first and next episode, and ``workspace``: x_min, x_max,
    y_min, y_max (m) of its table. ``scale`` is the size of its things, as a multiple of CLIPort's.
    """

    version: Literal[3, 4] = Field(alias="schema")
    task: Text
    split: Text
    world: Text
    start: Whole | None = None
    next: Whole | None = None
    workspace: tuple[float, float, float, float] | None = None
    scale: float = Field(default=1.0, gt=0)
    files: dict[Annotated[str, Field(pattern=_EPISODE)], Annotated[str, Field(pattern=_SHA256)]] = Field(min_length=1)

    @model_validator(mode="after")
    def _both_or_neither(self) -> Self:
        if (self.start is None) != (self.next is None):
            raise ValueError("must have both start and next, or neither")
        return self


class DemonstrationSet(FileSequence[Demonstration]):
    """The demonstrations of a folder, as `load` gives them."""

    @property
    def digest(self) -> str:
        """One SHA-256 for the whole set."""
        return hashlib.sha256(json.dumps(self.sums).encode()).hexdigest()

    @override
    def item(self, path: Path, digest: str) -> Demonstration:
        if path.suffix == ".npz":
            return packed.read(path, read_verified(path, digest))
        _verify(path, digest)
        return Demonstration.load(path)


def load(folder: Path) -> DemonstrationSet:
    """Load a set and verify the SHA-256 of each episode. An episode is decoded when it is accessed.

    Without a manifest, the episodes are those that a person or another program recorded, in the order of their names.

    Raises:
        FileNotFoundError: the folder, its manifest or one of its episodes is missing.
        ValueError: the manifest has another schema, or an episode has changed since it was saved.
    """
    folder = Path(folder)
    if not (folder / MANIFEST_FILE).exists() and any(folder.glob(f"*/*/{ACTION_FILE}")):
        return DemonstrationSet(folder, _recorded(folder))
    sums = read_manifest(folder).files
    for name, digest in sums.items():
        _verify(folder / name, digest)
    return DemonstrationSet(folder, sums)


def read_manifest(folder: Path) -> Manifest:
    """Read and check the manifest of a set. Raises FileNotFoundError or ValueError; the message names the problem."""
    path = Path(folder) / MANIFEST_FILE
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no demonstrations: there is no {MANIFEST_FILE} in it")
    return Manifest.read(path.read_bytes(), path)


def _recorded(folder: Path) -> dict[str, str]:
    """The recorded episodes of a folder without a manifest, with their SHA-256."""
    episodes = sorted((path for path in folder.iterdir() if path.is_dir() and not is_hidden(path)), key=natural_order)
    for path in episodes:
        if (path / EPISODE_FILE).exists():
            raise FileNotFoundError(f"{folder} is no whole set: it holds {path.name}, but no {MANIFEST_FILE}")
    return {path.name: _sum_of(path) for path in episodes}


def _verify(path: Path, digest: str) -> None:
    """Raise FileNotFoundError if an episode is missing, ValueError if it has another SHA-256."""
    if not path.is_dir():
        read_verified(path, digest)
    elif _sum_of(path) != digest:
        raise ValueError(f"{path} is cut off or changed: its SHA-256 is not the manifest's")


def _sum_of(episode: Path) -> str:
    """The SHA-256 of an episode's folder, without its hidden files and folders."""
    files = {path.relative_to(episode): path for path in episode.rglob("*") if path.is_file()}
    shown = {name: path for name, path in files.items() if not any(map(is_hidden, (name, *name.parents[:-1])))}
    return _sum({name: path.read_bytes() for name, path in shown.items()})


def _sum(contents: Mapping[Path, bytes]) -> str:
    sums = {path.as_posix(): hashlib.sha256(content).hexdigest() for path, content in contents.items()}
    return hashlib.sha256(json.dumps(sums, sort_keys=True).encode()).hexdigest()


def save(demonstrations: Sequence[Demonstration], folder: Path) -> None:
    """Write a set. The episodes of an old set in ``folder`` are removed after the new one is complete; others stay.

    Raises:
        ValueError: there are no demonstrations, or they have different tasks, splits or worlds.
        OSError: a file cannot be written, or another process writes into the folder. The old set stays.
    """
    if not demonstrations:
        raise ValueError("demonstrations is empty: there is nothing to save")
    folder = Path(folder)
    with writing(folder):
        old = _named_episodes(folder)
        files: dict[str, str] = {}
        facts: dict[str, str] = {}
        try:
            for number, demonstration in enumerate(demonstrations):
                own = {name: getattr(demonstration, name) for name in ("task", "split", "world")}
                facts = facts or own
                if own != facts:
                    raise ValueError(f"demonstrations must be of one task, split and world, got {facts} and {own}")
                files |= write_episode(folder, number, demonstration)
        except BaseException:
            _remove(folder, files.keys() - old)
            raise
        write_manifest(folder, facts, files)
        _remove(folder, old - files.keys())


def _named_episodes(folder: Path) -> set[str]:
    """The names of the episodes of the set in a folder; none if there is no set, or its manifest is damaged."""
    try:
        return set(read_manifest(folder).files)
    except (FileNotFoundError, ValueError):
        return set()


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def write_episode(folder: Path, number: int, demonstration: Demonstration) -> dict[str, str]:
    """Write an episode, inside `files.writing`. Returns its name and its SHA-256."""
    contents = demonstration.contents(Path())
    digest = _sum(contents)
    path = folder / f"episode-{number:04d}-{digest[:12]}"
    if path.is_dir():
        if _sum_of(path) == digest:
            return {path.name: digest}
        shutil.rmtree(path)  # It has changed since it was written.
    fresh = folder / ".part"
    shutil.rmtree(fresh, ignore_errors=True)  # A killed process may have left it.
    try:
        write_together({fresh / name: content for name, content in contents.items()})
        os.replace(fresh, path)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    return {path.name: digest}


def write_manifest(folder: Path, facts: Mapping[str, object], files: Mapping[str, str]) -> None:
    """Write the manifest of a set, inside `files.writing`: the ``facts`` about it, and its episodes' SHA-256."""
    manifest = {"schema": SCHEMA, **facts, "files": files}
    write_atomically(folder / MANIFEST_FILE, json.dumps(manifest, indent=1).encode())
