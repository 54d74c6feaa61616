"""Two things change places: "swap the red block and the green block", planned as three moves and carried out."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm
from typing_extensions import override

from experiments.planning.measuring import read
from experiments.planning.playing import act_out
from gem_lite import clip
from gem_lite.evaluation.statistics import mean_and_interval
from gem_lite.foundations import colors
from gem_lite.planning import goals
from gem_lite.planning.planner import Planner
from gem_lite.planning.swaps import ARRIVED
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.gem import Gem
from gem_lite.simulation.bodies import objects, shapes
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.world import World
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.packing_objects import OBJECT_RADIUS, TOPPLING
from gem_lite.tasks.put_block_in_bowl import BLOCK_RADIUS
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

KINDS = ("blocks", "objects")
"""Blocks of the seen colours, or everyday objects of any colour."""
COUNT = 5
"""So many things lie on the table. The first two are to change places."""
FIRST_SEED = 720_000


class Swapping(Task):
    """Things on a table, of which the first two are to change places.

    Args:
        kind: of `KINDS`.
    """

    def __init__(self, kind: str) -> None:
        super().__init__("test")
        self.kind = kind

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> Sequence[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        client = environment.client
        if self.kind == "blocks":
            names = [f"{color} block" for color in draw(rng, colors.SEEN, COUNT)]
            bodies = [shapes.add_block(client, colors.rgba(name.split()[0]), free.take(BLOCK_RADIUS)) for name in names]
        else:
            names = draw(rng, objects.NAMES, COUNT)
            bodies = []
            for name in names:
                rgba = colors.rgba(str(rng.choice(list(colors.RGB))))
                variant = int(rng.integers(*objects.TEST_VARIANTS))
                bodies.append(objects.add_object(client, name, rgba, free.take(OBJECT_RADIUS), variant))
        first, second, *_ = [self.put(environment, body, name) for body, name in zip(bodies, names, strict=True)]
        environment.wait(TOPPLING)
        sentence = f"swap the {names[0]} and the {names[1]}"
        there = PoseMetric(ARRIVED)
        return [
            Goal(sentence, (body,), (environment.pose(other)[0],), there)
            for body, other in ((first, second), (second, first))
        ]


def measure(scenes: int, path: Path) -> None:
    """Play the scenes that have no row yet, and add their rows to a file."""
    done = {(row["kind"], row["scene"]) for row in read(path)}
    waiting = [(kind, scene) for scene in range(scenes) for kind in KINDS if (kind, scene) not in done]
    if not waiting:
        return
    policy = load_policy(clip.DATA / "gem-multi.safetensors", clip.load())
    path.parent.mkdir(parents=True, exist_ok=True)
    with World() as world, path.open("a") as file:
        for kind, scene in tqdm(waiting, unit="scene"):
            file.write(json.dumps({"kind": kind, "scene": scene, **play(world, Swapping(kind), scene, policy)}) + "\n")
            file.flush()


def play(world: World, task: Swapping, scene: int, policy: Gem) -> dict:
    """A scene's row: how many of the two things are where the other one was, what was said, and why not."""
    (observation,) = world.reset(task, FIRST_SEED + scene)
    start = time.perf_counter()
    planner = Planner(goals.read(task.instruction), no_kinds, objects.NAMES, policy.source, policy.parser)
    acts = [
        (str(said), task.names.get(held or -1, "")) for said, held in act_out(world, observation, planner.next, policy)
    ]
    there = sum(goal.done(world) for goal in task.goals)
    plan = planner.plan
    return {
        "sentence": task.instruction, "there": there, "acts": acts, "problems": [*plan.missing, *plan.failed],
        "seconds": round(time.perf_counter() - start, 1),
    }  # fmt: skip


def no_kinds(names: Sequence[str], kind: str) -> list[bool]:
    """A swap asks for no kind.

    Raises:
        ValueError: always.
    """
    raise ValueError(f"a swap names its things, got the kind {kind!r}")


def table(path: Path) -> str:
    """The share (%) of scenes in which both things changed places, with 95 % intervals."""
    lines = ["| things | scenes | both at the other's place (%) | acts | seconds a scene |", "|---|---|---|---|---|"]
    for kind in KINDS:
        rows = [row for row in read(path) if row["kind"] == kind]
        if rows:
            mean, (low, high) = mean_and_interval([float(row["there"] == 2) for row in rows])
            acts = np.mean([len(row["acts"]) for row in rows])
            seconds = np.median([row["seconds"] for row in rows])
            lines.append(f"| {kind} | {len(rows)} | {mean} [{low}, {high}] | {acts:.1f} | {seconds:.1f} |")
    return "\n".join(lines)
