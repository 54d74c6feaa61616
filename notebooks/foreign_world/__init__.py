"""A foreign world that acts: tables of MuJoCo, and a tool that picks and places by physics. Nothing is of gem_lite.

Each episode asks for one thing: put the named block into the named bowl. Seeds 0 to 999 are for demonstrations
(`TRAIN_SEEDS`), those from 10000 are for tests (`TEST_SEEDS`). Import it before mujoco: it chooses a renderer that
needs no screen.

    with ForeignWorld() as world:
        look = world.reset(10_000)
        pick, place = world.expert()
        held = world.pick_place(world.on_surface(*pick), world.on_surface(*place))
        print(world.sentence, world.solved())

The tool is a rod with a suction cup. It is not drawn: a robot's arm goes out of the way before the cameras look.
"""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

from .tables import TEST_SEEDS, TRAIN_SEEDS
from .world import ForeignWorld, Look

__all__ = ["TEST_SEEDS", "TRAIN_SEEDS", "ForeignWorld", "Look"]
