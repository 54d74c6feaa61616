"""Play the pointing game with every kind of semantic map."""

from __future__ import annotations

import sys
from typing import Literal

from gem_lite.cli import base


def play(
    *,
    scenes: int = 200,
    kind: Literal["bowls", "shapes"] | None = None,
    task: Literal["packing-shapes-seen", "packing-shapes-unseen"] | None = None,
    clip: base.Clip = None,
    out: base.Out = None,
) -> None:
    """Play the pointing game with every kind of semantic map, and file the rows.

    Args:
        scenes: number of scenes of a kind, or of episodes
        kind: kind of the scenes (without it: both)
        task: play its test episodes instead, with the text-conditioned map alone

    Examples:
      python -m experiments.pointing
      python -m experiments.pointing --scenes 100 --task packing-shapes-unseen
    """
    from pointing import KINDS

    from experiments.pointing import measure
    from gem_lite import tasks
    from gem_lite.cli.results import described_pointing
    from gem_lite.evaluation import results

    if scenes < 1:
        raise ValueError(f"scenes must be at least 1, got {scenes}")
    path = results.output(False, out, tasks.family(task) if task else "pointing")
    if task:
        row = measure.measure_packing(task, scenes, path, clip)
        print("the map points at the named piece of {task}: {mean} {ci95}, {episodes} episodes".format(**row))
    else:
        for asked_kind in [kind] if kind else KINDS:
            for row in measure.measure_scenes(asked_kind, scenes, path, clip):
                print(described_pointing(row))
    print(f"the rows are in {path}")


APP = base.make_app("python -m experiments.pointing", None, help_epilogue=base.examples(play))
APP.default(play)

if __name__ == "__main__":
    sys.exit(base.run(APP))
