"""The data folder, checked JSON, sequences in files, and files that are written completely or not at all."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn, Self, TypeVar, overload

Item = TypeVar("Item")


def data_folder(package: Path) -> Path:
    """The folder of models, demonstrations and results, given the folder of the package ``gem_lite``.

    In a checkout it is ``data`` beside the package. In an installed wheel it is ``gem_lite_data`` beside it.
    """
    checkout = package.parent / "data"
    return checkout if (checkout / "clip-tabletop").is_dir() else package.parent / "gem_lite_data"


DATA = data_folder(Path(__file__).resolve().parent)
"""Models, demonstrations and results."""


def read_json(content: bytes | str, name: object) -> dict:
    """Read a JSON object from a file's content.

    Args:
        name: names the content in an error message.

    Raises:
        ValueError: the content is cut off, is not JSON or not an object, or a number in it is not finite.
    """

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is no JSON number")

    try:
        value = json.loads(content, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name} is cut off or no JSON: {error}") from error
    if not isinstance(value, dict):
        raise ValueError(f"{name} must hold a JSON object, got {type(value).__name__}")
    return value


def write_atomically(path: Path, content: bytes) -> None:
    """Write to a temporary name, then rename. After an interruption or on a full disk, the old file is unchanged."""
    write_together({path: content})


def write_together(contents: dict[Path, bytes]) -> None:
    """`write_atomically` for several files: all new files are on the disk before the first old file is replaced."""
    temporary = {path: path.with_name(path.name + ".part") for path in contents}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary[path].write_bytes(content)
    except OSError:
        for leftover in temporary.values():
            leftover.unlink(missing_ok=True)
        raise
    for path, complete in temporary.items():
        os.replace(complete, path)


class FileSequence(Sequence[Item]):
    """Items in the files of a folder, one in each file. Each access reads the file; no item is kept in memory.

    A slice is a sequence of the same kind. A class of this kind says by `decode` how an item is made of a file.

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
        path = self.folder / name
        return self.decode(path, read_verified(path, digest))

    def decode(self, path: Path, content: bytes) -> Item:
        """The item of a file, whose content has been checked."""
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


def as_tuples(value: object) -> object:
    """Turn JSON's lists into tuples, at every depth. All numbers must be finite."""
    if isinstance(value, list):
        return tuple(as_tuples(part) for part in value)
    return value if isinstance(value, str) else as_number(value)


def as_text(value: object) -> str:
    """A text of JSON that is not empty. Raises ValueError for anything else."""
    if not isinstance(value, str) or not value:
        raise ValueError(f"a text is needed, got {value!r}")
    return value


def as_number(value: object) -> float:
    """A finite number of JSON. Raises ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"a finite number is needed, got {value!r}")
    return value


def as_whole_number(value: object) -> int:
    """A whole number of JSON, from 0 on. Raises ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"a whole number from 0 on is needed, got {value!r}")
    return value
