"""How often does a policy succeed when its cameras err?"""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base
from gem_lite.foundations.files import DATA


def measure(
    *,
    checkpoint: Path = DATA / "gem-put-block-in-bowl.safetensors",
    task: str = "put-block-in-bowl-seen-colors",
    split: base.Split = "test",
    world: base.World = "home",
    episodes: int = 30,
    seed: int = 0,
    kinds: tuple[str, ...] = (),
    out: base.Out = None,
) -> None:
    """Measure a policy on what erring cameras show, for each kind and size of error.

    Points that the file of rows holds already are skipped.

    Args:
        checkpoint: policy to measure
        task: name of the task
        episodes: number of episodes of each point, from 0 on
        seed: seed of the errors
        kinds: kinds of errors: none, all, disparity, holes, edges, rotation, position, color, quantisation (without
            it: every kind)

    Examples:
      python -m experiments.sensor_noise
      python -m experiments.sensor_noise --kinds rotation --episodes 5
    """
    import torch

    from experiments.sensor_noise import curves
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    path = results.output(False, out, "sensor-errors")
    with base.continues(f"the rows in {path}"):
        curves.measure(checkpoint, task, split, world, episodes, seed, path, kinds)


APP = base.make_app("python -m experiments.sensor_noise", None, help_epilogue=base.examples(measure))
APP.default(measure)

if __name__ == "__main__":
    sys.exit(base.run(APP))
