"""Train the GEM that the lesson "GEM from an empty file" types, and play test episodes with it."""

from __future__ import annotations

import sys
import time
import types
from pathlib import Path

import nbformat

from gem_lite.cli import base
from gem_lite.foundations.files import DATA

LESSON = Path(__file__).resolve().parents[2] / "notebooks" / "gem_from_an_empty_file.ipynb"
TAG = "mechanism"
TASK = "put-block-in-bowl-seen-colors"


def program() -> str:
    """The cells of the lesson with the tag `TAG`, joined: a program without checks and figures."""
    cells = nbformat.read(LESSON, as_version=4).cells
    return "\n\n\n".join(cell.source for cell in cells if TAG in cell.metadata.get("tags", [])) + "\n"


def train(*, steps: int = 2000, seed: int = 0, episodes: int = 10, demos: int = 10) -> None:
    """Train the lesson's GEM, play test episodes, and print their mean score in percent.

    Args:
        steps: number of training steps
        seed: of the first weights and of the batches
        episodes: number of test episodes, from 0 on
        demos: number of demonstrations, from the first of the ten that are shipped

    Examples:
      python -m experiments.from_an_empty_file
      python -m experiments.from_an_empty_file --steps 50 --episodes 2 --demos 3
    """
    from gem_lite import demonstrations, tasks
    from gem_lite.simulation.world import World

    typed = types.ModuleType(LESSON.stem)
    exec(compile(program(), LESSON.name, "exec"), typed.__dict__)
    start = time.perf_counter()
    shown = list(demonstrations.load(DATA / "demos" / f"{TASK}-10"))[:demos]
    memory = typed.CropMemory.of(shown)
    typed.torch.manual_seed(seed)
    gem = typed.Gem()
    losses = typed.train(gem, typed.prepare(shown, memory), steps, seed)
    print(f"losses of the last step: pick {losses[-1, 0]:.2f}, place {losses[-1, 1]:.2f}")
    print(f"trained for {time.perf_counter() - start:.0f} s")
    with World() as world:
        task = tasks.make(TASK, "test")
        scores = [typed.play(gem, world, task, number, memory) for number in range(episodes)]
    print(f"{steps} steps, seed {seed}, {len(shown)} demonstrations: {100 * sum(scores) / episodes:.1f} in {episodes} "
          f"test episodes, which scored {[round(score, 2) for score in scores]}")  # fmt: skip


APP = base.make_app("python -m experiments.from_an_empty_file", None, help_epilogue=base.examples(train))
APP.default(train)

if __name__ == "__main__":
    sys.exit(base.run(APP))
