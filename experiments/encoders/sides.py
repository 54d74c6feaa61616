"""The score of each side of align-rope's guide, from the filed rows: python -m experiments.encoders.sides."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from gem_lite import tasks
from gem_lite.evaluation import results
from gem_lite.simulation.world import World

METHOD = "gem-with-steerable-encoder"
EPISODES = 50


def sides() -> dict[str, list[int]]:
    """The test episodes of each side of the guide, by their sentences."""
    episodes = defaultdict(list)
    with World() as world:
        for index in range(EPISODES):
            task = tasks.make("align-rope", "test")
            world.reset(task, tasks.episode_seed("test", index))
            episodes[task.instruction].append(index)
    return dict(episodes)


def main() -> None:
    """Print a line for each number of demonstrations."""
    rows = results.read_rows(results.benchmark_file("align-rope"))
    measured = {row["demos"]: row for row in rows if row["method"] == METHOD and row["split"] == "test"}
    for sentence, episodes in {**sides(), "all sides": list(range(EPISODES))}.items():
        means = [
            f"{demos}: {100 * np.mean([row['rewards'][str(index)] for index in episodes]):.1f}"
            for demos, row in sorted(measured.items())
        ]
        print(f"{sentence} ({len(episodes)} episodes): {', '.join(means)}")


if __name__ == "__main__":
    main()
