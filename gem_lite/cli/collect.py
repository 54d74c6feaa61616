"""``gem-lite collect`` and ``gem-lite verify``: make demonstrations, and check them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gem_lite.cli.base import Import, Split, World, continues

if TYPE_CHECKING:
    from gem_lite.demonstrations import DemonstrationSet


def collect(
    task: str, folder: Path, /, *, episodes: int = 10, split: Split = "train", start: int = 0, world: World = "home",
    import_: Import = (),
) -> None:  # fmt: skip
    """Let the expert play episodes of a task, and save those that succeed.

    A stopped collection continues.

    Args:
        task: name of the task: gem-lite names lists them
        folder: where to save them
        episodes: number of episodes
        start: index in the split of the first episode to try

    Examples:
      gem-lite collect bars-in-box runs/demos/bars --episodes 2
    """
    from gem_lite.evaluation import collecting

    with continues(f"the episodes in {folder}"):
        try:
            demos = collecting.collect(task, episodes, folder, split, start, world)
        except RuntimeError as error:  # The expert fails too often.
            raise ValueError(str(error)) from error
    print(summary(folder, demos))


def verify(folder: Path, /) -> None:
    """Load a set of demonstrations and check the SHA-256 of every file.

    Args:
        folder: made by `gem-lite collect`

    Examples:
      gem-lite verify data/demos/put-block-in-bowl-seen-colors-10
    """
    from gem_lite import demonstrations

    print(summary(folder, demonstrations.load(folder)))


def summary(folder: Path, demos: DemonstrationSet) -> str:
    """The content of a set, in one line. Every file is read and checked."""
    from tqdm import tqdm

    steps = sum(len(demonstration.steps) for demonstration in tqdm(demos, "verifying", unit="episode"))
    return f"{folder}: {len(demos)} episodes, {steps} steps, data hash {demos.digest[:12]}"
