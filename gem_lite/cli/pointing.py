"""``gem-lite pointing``: play the pointing game with every kind of semantic map."""

from __future__ import annotations

from typing import Literal

from gem_lite.cli.base import Clip, File, Import, Out
from gem_lite.cli.results import described_pointing


def pointing(
    *,
    scenes: int = 200,
    kind: Literal["bowls", "shapes"] | None = None,
    task: Literal["packing-shapes-seen", "packing-shapes-unseen"] | None = None,
    clip: Clip = None,
    file: File = False,
    out: Out = None,
    import_: Import = (),
) -> None:
    """Play the pointing game with every kind of semantic map.

    Prints and writes one row for each map.

    Args:
        scenes: number of scenes of a kind, or of episodes of the task
        kind: kind of the scenes (without it: both kinds)
        task: measure the test episodes of this task instead of scenes, with the text-conditioned map alone

    Examples:
      gem-lite pointing --scenes 200 --kind shapes
      gem-lite pointing --scenes 100 --task packing-shapes-unseen
    """
    from gem_lite import tasks
    from gem_lite.evaluation import pointing, pointing_scenes, results

    if task:
        path = results.output(file, out, tasks.family(task))
        row = pointing.measure_packing(task, scenes, path, clip)
        print("the map points at the named piece of {task}: {mean} {ci95}, {episodes} episodes".format(**row))
        print(f"the row is in {path}")
        return
    path = results.output(file, out, "pointing")
    for name in [kind] if kind else pointing_scenes.KINDS:
        for row in pointing.measure_scenes(name, scenes, path, clip):
            print(described_pointing(row))
    print(f"the rows are in {path}")
