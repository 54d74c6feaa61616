"""Where the data is, JSON that is checked, and files that are written whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NoReturn


def data_folder(package: Path) -> Path:
    """Where models, demonstrations and results are, given the folder of the package ``gem_lite``.

    In a checkout that is ``data`` beside the package; an installed wheel has it as ``gem_lite_data``.
    """
    checkout = package.parent / "data"
    return checkout if (checkout / "clip-tabletop").is_dir() else package.parent / "gem_lite_data"


DATA = data_folder(Path(__file__).resolve().parent)
"""Models, demonstrations and results."""


def read_json(content: bytes | str, name: object) -> dict:
    """A JSON object from a file's content.

    Args:
        name: what the content is, for the error.

    Raises:
        ValueError: cut off, no JSON, no object, or a number in it is not finite.
    """

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is no JSON number")

    try:
        found = json.loads(content, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name} is cut off or no JSON: {error}") from error
    if not isinstance(found, dict):
        raise ValueError(f"{name} must hold a JSON object, got {type(found).__name__}")
    return found


def write_whole(path: Path, content: bytes) -> None:
    """Write to a temporary name, then rename: an interrupted run or a full disk leaves the old file whole."""
    write_together({path: content})


def write_together(contents: dict[Path, bytes]) -> None:
    """`write_whole` for files that belong together: no old one is replaced before every new one is on the disk."""
    partial = {path: path.with_name(path.name + ".part") for path in contents}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            partial[path].write_bytes(content)
    except OSError:
        for left in partial.values():
            left.unlink(missing_ok=True)
        raise
    for path, whole in partial.items():
        os.replace(whole, path)
