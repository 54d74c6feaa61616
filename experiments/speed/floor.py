"""A look at a table with a stored picture of the floor, against rendering the floor: python -m experiments.speed.floor

Both must give the same pictures, to the last bit.
"""

import time

import numpy as np

from gem_lite import tasks
from gem_lite.simulation.rendering import cameras_around, render
from gem_lite.simulation.world import World

SCENES = (("put-block-in-bowl-seen-colors", 5), ("packing-shapes-seen", 3), ("separating-piles-seen-colors", 3))


def main() -> None:
    """Print both times and their ratio."""
    spent = np.zeros(2)
    pictures = 0
    with World() as world:
        for task, count in SCENES:
            for episode in range(count):
                (observation,) = world.reset(tasks.make(task, "val"), tasks.episode_seed("val", episode))
                start = time.process_time()
                (observation,) = world.observe()
                middle = time.process_time()
                whole = [render(world.client, camera)[0] for camera in cameras_around(world.workspace)]
                spent += middle - start, time.process_time() - middle
                pictures += len(whole)
                for found, expected in zip(observation.views, whole, strict=True):
                    assert (found.rgb == expected.rgb).all()
                    assert (found.depth == expected.depth).all()
    stored, rendered = 1000 * spent / pictures
    print(f"one picture: floor rendered {rendered:.1f} ms, floor stored {stored:.1f} ms, ratio {rendered / stored:.1f}")


if __name__ == "__main__":
    main()
