"""Four task families on a table of another simulator (MuJoCo): an expert plays there, and policies are measured."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from gem_lite.cli import base

Split = Literal["val", "test"]
Endings = tuple[str, ...]


def expert(family: str, /, *, episodes: int = 20, split: Split = "val") -> None:
    """Let an expert play, who knows the true poses, and print the mean.

    Args:
        family: assembling-kits, stack-block-pyramid, towers-of-hanoi or separating-piles
        episodes: number of episodes
        split: of the episodes

    Examples:
      python -m experiments.foreign_tasks expert stack-block-pyramid --episodes 20
    """
    from experiments.foreign_tasks import playing

    played = playing.play_all(family, episodes, split, playing.by_expert)
    mean = 100 * sum(episode.reward for episode in played) / len(played)
    print(f"expert, foreign-{family}: {mean:.1f} ({len(played)})")


def measure(
    checkpoint: Path, family: str, /, *, episodes: int = 100, split: Split = "test", ending: Endings = (),
    out: base.Out = None,
) -> None:  # fmt: skip
    """Measure a policy, and file the row.

    Args:
        checkpoint: checkpoint of the policy
        family: assembling-kits, stack-block-pyramid, towers-of-hanoi or separating-piles
        episodes: number of episodes
        split: of the episodes
        ending: ending of a method's name with other rules of acting, such as with-bracketing (repeatable)

    Examples:
      python -m experiments.foreign_tasks measure data/gem-multi.safetensors assembling-kits --episodes 10 --split val
    """
    import torch

    from experiments.foreign_tasks import playing
    from gem_lite.evaluation import results

    torch.set_num_threads(1)
    playing.measure(checkpoint, family, episodes, split, ending, results.output(False, out, "foreign-tasks"))


def acts(
    checkpoint: Path, family: str, /, *, also: tuple[Path, ...] = (), episodes: int = 10, split: Split = "val",
    ending: Endings = (),
) -> None:  # fmt: skip
    """Ask policies at every step of an expert's episodes, in both simulators, and print what is right of their acts.

    Args:
        checkpoint: checkpoint of a policy: a gem policy
        family: assembling-kits, stack-block-pyramid, towers-of-hanoi or separating-piles
        also: checkpoint of another gem policy, which is asked at the same steps (repeatable)
        episodes: number of episodes
        split: of the episodes
        ending: as in measure; each policy is asked without it and with it

    Examples:
      python -m experiments.foreign_tasks acts data/gem-multi.safetensors assembling-kits
      python -m experiments.foreign_tasks acts data/gem-multi.safetensors separating-piles --ending with-place-peak
    """
    import torch

    from experiments.foreign_tasks import single_acts

    torch.set_num_threads(1)
    single_acts.report((checkpoint, *also), family, episodes, split, ending)


def draw(folder: Path, /) -> None:
    """Draw the first validation episode of each family, and what gem-multi makes of its first sentence.

    Args:
        folder: folder to write

    Examples:
      python -m experiments.foreign_tasks draw runs/foreign-tasks
    """
    import torch

    from experiments.foreign_tasks import drawing

    torch.set_num_threads(1)
    drawing.draw_all(folder)


APP = base.make_app("python -m experiments.foreign_tasks", __doc__, expert, measure, acts, draw)

if __name__ == "__main__":
    sys.exit(base.run(APP))
