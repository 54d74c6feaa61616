"""Train the GEM that the lesson "GEM from an empty file" types, and play test episodes with it."""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base


def run(
    *, steps: int = 2000, seed: int = 0, episodes: int = 10, demos: int = 10, checkpoint: Path | None = None
) -> None:  # fmt: skip
    """Train the lesson's GEM, play test episodes, and print their mean score in percent.

    Args:
        steps: number of training steps
        seed: of the first weights and of the batches
        episodes: number of test episodes, from 0 on
        demos: number of demonstrations, from the first of the ten that are shipped
        checkpoint: weights of the library's GEM to play with; then nothing is trained

    Examples:
      python -m experiments.from_an_empty_file
      python -m experiments.from_an_empty_file --steps 50 --episodes 2 --demos 3
      python -m experiments.from_an_empty_file --checkpoint data/gem-put-block-in-bowl.safetensors
    """
    for name, value, most in (("steps", steps, None), ("episodes", episodes, None), ("demos", demos, 10)):
        if value < 1 or (most is not None and value > most):
            raise ValueError(f"{name} must be at least 1{'' if most is None else f' and at most {most}'}, got {value}")
    from experiments.from_an_empty_file import typed_lesson

    typed = typed_lesson.load()
    if checkpoint:
        gem, memory = typed_lesson.shipped(typed, checkpoint)
    else:
        gem, memory = typed_lesson.trained(typed, steps, seed, demos)
    scores = typed_lesson.played(typed, gem, memory, episodes)
    print(f"mean score {100 * sum(scores) / episodes:.1f} in {episodes} test episodes: "
          f"{', '.join(f'{100 * score:.0f}' for score in scores)}")  # fmt: skip


APP = base.make_app("python -m experiments.from_an_empty_file", None, help_epilogue=base.examples(run))
APP.default(run)

if __name__ == "__main__":
    sys.exit(base.run(APP))
