"""The data folder, checked JSON, sequences in files, and files that are written completely or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NoReturn, Self, TypeVar, overload

import filelock

Item = TypeVar("Item")


def data_folder(package: Path) -> Path:
    """The folder of models, demonstrations and results, given the folder of the package ``gem_lite``.

    In a checkout it is ``data`` beside the package. In an installed wheel it is ``gem_lite_data`` beside it.
    """
    checkout = package.parent / "data"
    return checkout if (checkout / "clip-tabletop").is_dir() else package.parent / "gem_lite_data"


DATA = data_folder(Path(__file__).resolve().parent.parent)
"""Models, demonstrations and results."""


def cache_folder() -> Path:
    """The library's folder in the user's cache, for what it computed once. The folder may not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gem_lite"


def read_json(content: bytes | str, name: object) -> dict:
    """Read a JSON object from a file's content.

    Args:
        name: names the content in an error message.

    Raises:
        ValueError: the content is cut off, is not JSON or not an object, or a number in it is not finite as a float.
    """

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant:.20} is no finite number")

    def real(digits: str) -> float:
        number = float(digits)
        return number if math.isfinite(number) else refuse(digits)

    def whole(digits: str) -> int:
        real(digits)
        return int(digits)

    try:
        value = json.loads(content, parse_constant=refuse, parse_float=real, parse_int=whole)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name} is cut off or no JSON: {error}") from error
    if not isinstance(value, dict):
        raise ValueError(f"{name} must hold a JSON object, got {type(value).__name__}")
    return value


def write_atomically(path: Path, content: bytes) -> None:
    """Write to a temporary name, then rename. After an interruption or on a full disk, the old file is unchanged."""
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write files that belong together. A file that names others must come after them.

    After an error all old files are there, unchanged, and no new ones. If the process is killed, all files are old, all
    are new, or the last one is missing: a reader that begins with the last file never gets a mixture. Only one process
    at a time may write several files (`writing`); a single file may have any number of writers.

    Raises:
        OSError: a file cannot be written.
    """
    token = uuid.uuid4().hex[:12]
    fresh = {path: path.with_name(f"{path.name}.{token}.part") for path in contents}
    old: dict[Path, Path] = {}
    renamed: list[Path] = []
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            fresh[path].write_bytes(content)
            with fresh[path].open("rb+") as file:
                os.fsync(file.fileno())
        if len(contents) > 1:
            for path in reversed(fresh):
                if path.is_file():
                    old[path] = path.with_name(f"{path.name}.{token}.old")
                    os.replace(path, old[path])
        for path, complete in fresh.items():
            renamed.append(path)
            os.replace(complete, path)
    except BaseException:
        if len(contents) > 1:  # A single file may have replaced an old version, which is not kept.
            for path in renamed:
                if path not in old and path.is_file():
                    path.unlink()
        for path, kept in old.items():
            if kept.exists():
                os.replace(kept, path)
        raise
    finally:
        for leftover in fresh.values():
            if leftover.exists():
                leftover.unlink()
    for kept in old.values():
        kept.unlink()
    for folder in {path.parent for path in contents}:
        _sync_folder(folder)


def _sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where the system can do that: Windows cannot."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Write into a folder as the only process. The system frees the lock when the process ends, after a kill, too.

    Meanwhile the folder has a file ``.lock``. A killed process leaves it there; it is in nobody's way.

    Raises:
        OSError: another process writes into the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = filelock.FileLock(folder / ".lock")
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise BlockingIOError(f"another process writes into {folder}: wait for it, or give another folder") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # Windows keeps a file that is open.
            (folder / ".lock").unlink()
        lock.release()


@contextlib.contextmanager
def unchanged(path: Path) -> Iterator[None]:
    """Read the files that belong to ``path``, which is replaced whenever they are (`write_together`).

    Raises:
        ValueError: ``path`` was replaced meanwhile, so what was read may be a mixture.
    """
    before = path.stat()
    yield
    after = path.stat() if path.exists() else None
    if after is None or (before.st_ino, before.st_mtime_ns) != (after.st_ino, after.st_mtime_ns):
        raise ValueError(f"{path.parent} was written while it was read: read it again")


class FileSequence(Sequence[Item]):
    """Items in the files of a folder, one in each file. Each access reads the file; no item is kept in memory.

    A slice is a sequence of the same kind. A class of this kind says by `item` how an item is made of its file.

    Attributes:
        folder: the folder of the files.
        sums: the names of the files and their SHA-256, in the order of the items.
    """

    def __init__(self, folder: Path, sums: Mapping[str, str]) -> None:
        self.folder = folder
        self.sums = dict(sums)

    def __len__(self) -> int:
        return len(self.sums)

    @overload
    def __getitem__(self, index: int) -> Item: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: int | slice) -> Item | Self:
        """One item, or several.

        Raises:
            FileNotFoundError: the file of the item is missing.
            ValueError: the file of the item is cut off or changed, or a slice is empty.
        """
        entries = list(self.sums.items())
        if isinstance(index, slice):
            selected = entries[index]
            if not selected:
                limits = f"{index.start}:{index.stop}:{index.step}"
                raise ValueError(f"the slice [{limits}] is empty: {self.folder} has {len(self)} files")
            return type(self)(self.folder, dict(selected))
        name, digest = entries[index]
        return self.item(self.folder / name, digest)

    def item(self, path: Path, digest: str) -> Item:
        """The item in a file, whose content must have a SHA-256."""
        raise NotImplementedError


def read_verified(path: Path, digest: str) -> bytes:
    """The content of a file.

    Args:
        digest: the SHA-256 that its content must have.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: its content has another SHA-256.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing, though the manifest names it")
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise ValueError(f"{path} is cut off or changed: its SHA-256 is not the manifest's")
    return content
