"""An act with the Panda, against the same act with the floating tool of the task: python -m experiments.speed.tools"""

import time
from dataclasses import replace

import numpy as np
from typing_extensions import override

from gem_lite import tasks
from gem_lite.rgbd.observation import Observation
from gem_lite.simulation.effectors import LOG_EVERY, RATE
from gem_lite.simulation.looks import ARM, HOME, REAL_TABLE, Look
from gem_lite.simulation.world import World

SCENES = (
    ("put-block-in-bowl-seen-colors", HOME), ("bars-in-box", HOME), ("arrange-letter-to-word-seen", REAL_TABLE),
    ("pick-object-part-in-brown-box-seen", REAL_TABLE),
)  # fmt: skip
EPISODES = 5


class Blind(World):
    """A table without cameras: pictures would take most of the time."""

    @override
    def observe(self) -> tuple[Observation, ...]:
        return ()


def act(task_name: str, style: Look, episode: int) -> tuple[float, float]:
    """Simulated seconds and processor seconds of the expert's first act of an episode, until the tool waits again."""
    task = tasks.make(task_name, "val")
    with Blind(style=style) as world:
        world.begin(task, tasks.episode_seed("val", episode))
        action = world.task.expert(world).action
        start = time.process_time()
        world.step(action)
        spent = time.process_time() - start
        return len(world.trace) * LOG_EVERY / RATE, spent


def main() -> None:
    """Print the means for each task, and their ratios."""
    for task_name, style in SCENES:
        arm = replace(style, name=f"{style.name} with an arm", tools=ARM, hulls_of_parts=True)
        floating, with_arm = (
            np.mean([act(task_name, look, episode) for episode in range(EPISODES)], axis=0) for look in (style, arm)
        )
        print(
            f"{task_name}: simulated {floating[0]:.1f} s and {with_arm[0]:.1f} s with the arm, ratio "
            f"{with_arm[0] / floating[0]:.1f}; processor {floating[1]:.2f} s and {with_arm[1]:.2f} s, ratio "
            f"{with_arm[1] / floating[1]:.1f}"
        )


if __name__ == "__main__":
    main()
