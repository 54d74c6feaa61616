"""``gem-lite verify``: check stored demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from tqdm import tqdm
from typing_extensions import override
from tyro.conf import Positional

from gem_lite.cli.command import Command

if TYPE_CHECKING:
    from gem_lite.demonstrations import DemonstrationSet


@dataclass(frozen=True, kw_only=True)
class Verify(Command):
    """Load a set of demonstrations and check the SHA-256 of every file."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite verify data/demos/put-block-in-bowl-seen-colors-10",)

    folder: Positional[Path]
    """folder made by `gem-lite collect`"""

    @override
    def run(self) -> None:
        from gem_lite import demonstrations  # Only here: it loads torch, which takes seconds. The help needs none.

        print(summary(self.folder, demonstrations.load(self.folder)))


def summary(folder: Path, demos: DemonstrationSet) -> str:
    """The content of a set, in one line. Every file is read and checked."""
    steps = sum(len(demonstration.steps) for demonstration in tqdm(demos, "verifying", unit="episode"))
    return f"{folder}: {len(demos)} episodes, {steps} steps, data hash {demos.digest[:12]}"
