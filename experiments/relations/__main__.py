"""Places that are relations: what the maps alone do, and pictures of the maps."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from gem_lite.cli import base

Task = Literal[
    "put-beside-seen-colors", "put-beside-unseen-colors", "put-beside-seen-objects", "put-beside-unseen-objects"
]


def play(
    task: Task = "put-beside-seen-colors",
    /,
    *,
    split: Literal["val", "test"] = "test",
    episodes: int = 100,
    clip: base.Clip = None,
) -> None:
    """Act by the maps alone, at most two actions an episode, and print the rewards.

    Args:
        task: task whose episodes are played
        split: split of the episodes
        episodes: number of episodes

    Examples:
      python -m experiments.relations play
      python -m experiments.relations play put-beside-unseen-objects --episodes 10
    """
    from collections import defaultdict

    from experiments.relations import measure
    from gem_lite import clip as clips
    from gem_lite.evaluation import statistics

    played = measure.play(task, split, episodes, clips.load(clip))
    groups = defaultdict(list, {"all": [one.reward for one in played]})
    for one in played:
        groups[one.relation].append(one.reward)
        if one.reward < 1:
            print(f"{one.sentence}: {one.reward:g} {one.refused}".strip())
    for name, rewards in groups.items():
        mean, (low, high) = statistics.mean_and_interval([rewards])
        print(f"{task}, {split}, {name}: {mean} [{low}, {high}] of {len(rewards)} episodes")


def draw(folder: Path, /, *, task: Task = "put-beside-seen-colors", count: int = 6, clip: base.Clip = None) -> None:
    """Draw validation tables from above, with the places that the sentence means in yellow.

    Args:
        folder: folder of the pictures
        task: task whose tables are drawn
        count: number of pictures

    Examples:
      python -m experiments.relations draw runs/relations
    """
    from experiments.relations import pictures
    from gem_lite import clip as clips

    for path in pictures.draw_tables(folder, task, count, clips.load(clip)):
        print(path)


def frame(path: Path = Path("runs/relations/frame.png"), /) -> None:
    """Draw the table's frame: where left, right, in front and behind are.

    Args:
        path: file of the picture

    Examples:
      python -m experiments.relations frame experiments/relations/frame.png
    """
    from experiments.relations import pictures

    pictures.draw_frame(path)
    print(path)


APP = base.make_app("python -m experiments.relations", "Places that are relations.", play, draw, frame)

if __name__ == "__main__":
    sys.exit(base.run(APP))
