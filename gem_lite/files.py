"""The data folder, checked JSON, and files that are written completely or not at all."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import NoReturn


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
