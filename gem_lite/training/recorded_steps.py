"""Demonstrations that were recorded on a table outside this library: checked together, and made ready for training."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from gem_lite import demonstrations, language
from gem_lite.actions import PickPlace
from gem_lite.demonstrations import Demonstration, natural_order
from gem_lite.rgbd.recordings import ACTION_FILE
from gem_lite.se2 import Workspace


def is_recorded(folder: Path) -> bool:
    """Whether a folder holds recorded episodes: folders of steps, each with its action."""
    return not (folder / "manifest.json").exists() and any(folder.glob(f"*/*/{ACTION_FILE}"))


def read(folder: Path, workspace: Workspace, parser: language.Parser = language.parse) -> Iterator[Demonstration]:
    """The recorded episodes of a folder, one after the other, in the order of their names.

    Args:
        workspace: every pick and place must lie in it.
        parser: must understand every sentence.

    Raises:
        FileNotFoundError: the folder holds no recorded episode, or a file is missing.
        ValueError: a file is not allowed, a pose lies outside the workspace, or the parser refuses a sentence. The
            message names the step.
    """
    episodes = sorted((part for part in Path(folder).iterdir() if part.is_dir()), key=natural_order)
    if not episodes:
        raise FileNotFoundError(f"{folder} holds no recorded episodes: there is no folder in it")
    for number, episode in enumerate(episodes):
        demonstration = replace(Demonstration.load(episode), seed=number)
        for count, step in enumerate(demonstration.steps):
            where = f"{episode}, step {count}"
            action = step.expert.action
            assert isinstance(action, PickPlace)
            for name in ("pick", "place"):
                pose = getattr(action, name)
                if not workspace.contains(pose.x, pose.y):
                    raise ValueError(
                        f"{where}: the {name} at ({pose.x:.3f}, {pose.y:.3f}) m lies outside the table, which is x "
                        f"{workspace.x_min:.3f} to {workspace.x_max:.3f} m, y {workspace.y_min:.3f} to "
                        f"{workspace.y_max:.3f} m; --config.rectangle sets another"
                    )
            try:
                parser(step.instruction)
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from error
        yield demonstration


def pack(
    folder: Path, into: Path, workspace: Workspace, parser: language.Parser = language.parse
) -> demonstrations.DemonstrationSet:
    """`read` a folder and write its episodes as a set, as `demonstrations.save` does.

    Raises: see `read`.
    """
    demonstrations.save(list(read(folder, workspace, parser)), into)
    return demonstrations.load(into)
