"""``gem-lite pointing``: play the pointing game with every kind of semantic map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from typing_extensions import override

from gem_lite.cli.command import MeasuringCommand
from gem_lite.cli.results import described_pointing
from gem_lite.evaluation import results


@dataclass(frozen=True, kw_only=True)
class Pointing(MeasuringCommand):
    """Play the pointing game with every kind of semantic map. Prints and writes one row for each map."""

    examples: ClassVar[tuple[str, ...]] = (
        "gem-lite pointing --scenes 200 --kind shapes",
        "gem-lite pointing --scenes 100 --task packing-shapes-unseen",
    )

    scenes: int = 200
    """number of scenes of a kind, or of episodes of the task"""
    kind: Literal["bowls", "shapes"] | None = None
    """kind of the scenes (without it: both kinds)"""
    task: Literal["packing-shapes-seen", "packing-shapes-unseen"] | None = None
    """measure the test episodes of this task instead of scenes, with the text-conditioned map alone"""
    clip: str | None = None
    """Hugging Face name or folder of a CLIP (without it: the embedded one)"""

    @override
    def run(self) -> None:
        # Only here: they load torch and the simulator, which takes seconds. The help needs neither.
        from gem_lite import tasks
        from gem_lite.evaluation import pointing, pointing_scenes

        if self.task:
            path = results.output(self.file, self.out, tasks.family(self.task))
            row = pointing.measure_packing(self.task, self.scenes, path, self.clip)
            print("the map points at the named piece of {task}: {mean} {ci95}, {episodes} episodes".format(**row))
            print(f"the row is in {path}")
            return
        path = results.output(self.file, self.out, "pointing")
        for kind in [self.kind] if self.kind else pointing_scenes.KINDS:
            for row in pointing.measure_scenes(kind, self.scenes, path, self.clip):
                print(described_pointing(row))
        print(f"the rows are in {path}")
