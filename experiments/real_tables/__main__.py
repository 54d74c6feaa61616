"""The real tables: kernels of parts, maps that look for a colour, and displaced cameras."""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base


def kernels(
    checkpoint: Path,
    /,
    *,
    picture: Path | None = None,
    clip: base.Clip = None,
    out: base.Out = None,
) -> None:
    """Compare the pick kernels of the two parts of each object, as Figure A2 does.

    Args:
        checkpoint: policy of GEM that knows parts
        picture: PNG of the four kernels of Figure A2 and their cosines

    Examples:
      python -m experiments.real_tables kernels runs/gem-real-tables.safetensors --picture runs/kernels.png
    """
    from experiments.real_tables import kernels as measuring
    from gem_lite import clip as clips
    from gem_lite.evaluation import results

    policy = measuring.load(checkpoint, clips.load(clip))
    rows = measuring.measure(checkpoint, policy)
    path = results.output(False, out, "real-table-kernels")
    measuring.file(rows, path)
    print(measuring.described(rows))
    print(f"the rows are in {path}")
    if picture:
        from experiments.real_tables import pictures

        pictures.draw_kernels(policy, picture)
        print(picture)


def color_bias(
    *,
    scenes: int = 20,
    picture: Path | None = None,
    clip: base.Clip = None,
    out: base.Out = None,
) -> None:
    """Measure how often a map of "yellow screwdriver" points at a yellow block (A.4.1), for words and for crops.

    Args:
        scenes: number of scenes of each colour and brightness
        picture: PNG of the scene in which the words point at the block most clearly

    Examples:
      python -m experiments.real_tables color-bias --scenes 2 --picture runs/color-bias.png
    """
    import torch

    from experiments.real_tables import color_bias as measuring
    from gem_lite import clip as clips
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    model = clips.load(clip)
    path = results.output(False, out, "color-bias")
    rows, clearest = measuring.measure(scenes, model, path)
    print(measuring.described(rows))
    print(f"the rows are in {path}")
    if picture:
        measuring.draw_scene(clearest, model, picture)
        print(picture)


def displaced(*task: str, episodes: int = 50, out: base.Out = None) -> None:
    """Measure how far erring cameras displace the table, and what the expert loses that acts as far beside.

    Args:
        task: tasks of the real tables
        episodes: number of test episodes

    Examples:
      python -m experiments.real_tables displaced arrange-letter-to-word-seen --episodes 10
    """
    from experiments.real_tables import displaced as measuring
    from gem_lite.evaluation import results

    path = results.output(False, out, "displaced-expert")
    print(measuring.described(measuring.measure(task, episodes, path)))
    print(f"the rows are in {path}")


APP = base.make_app("python -m experiments.real_tables", __doc__, kernels, color_bias, displaced)

if __name__ == "__main__":
    sys.exit(base.run(APP))
