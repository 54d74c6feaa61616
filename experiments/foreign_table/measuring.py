"""On a table of another simulator: what an expert does there, how far a policy comes, when it refuses.

The table is that of notebooks/foreign_world (MuJoCo); nothing of gem_lite is in it. A policy gets the pictures and the
sentence, and its action is carried out as `gem_lite.policies.robot_plan.plan` says it to a robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from foreign_world import TEST_SEEDS, TRAIN_SEEDS, ForeignWorld
from foreign_world.tables import KINDS, NAMED, random_scene
from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.actions import ExpertAction, PickPlace
from gem_lite.demonstrations import DemonstrationStep
from gem_lite.evaluation import results
from gem_lite.evaluation.evaluate import check_table
from gem_lite.evaluation.results import Episode
from gem_lite.maps import refusal
from gem_lite.policies import robot_plan
from gem_lite.policies.base import Policy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.world import World

SHIPPED = clip.DATA / "gem-multi.safetensors"
TASK = "foreign-block-in-bowl"
ACTIONS = 2
"""A policy may act this often in an episode: once more than needed, as in our own tasks."""
DEPTH_SCALE = 0.001
"""Metres of one step of a recorded depth picture."""
ASKED_SEED = 5_000
"""Refusals are measured on test tables from this number on: others than those on which policies act."""
MOST = min(ASKED_SEED, len(TRAIN_SEEDS))
"""The most tables or episodes of a command: the seeds end there."""
OUR_TASKS = (
    "put-block-in-bowl-unseen-colors", "packing-google-objects-group-unseen", "packing-box-pairs-unseen-colors"
)  # fmt: skip
"""Tasks of our simulator on whose tables refusals are measured as well."""


def seen(world: ForeignWorld) -> Observation:
    """What the cameras see now, as a policy reads it."""
    look = world.look()
    return Observation.from_arrays(look.colors, look.depths, look.intrinsics, look.poses, look.names)


def check_count(name: str, count: int, least: int = 1) -> None:
    """Raises ValueError if there is no such number of tables or episodes."""
    if not least <= count <= MOST:
        raise ValueError(f"{name} must be a whole number from {least} to {MOST}, got {count}")


def load(checkpoint: Path) -> Policy:
    """A policy. Raises ValueError if it was trained for a table of another size or place."""
    policy = load_policy(checkpoint, clip.load()).eval()
    check_table(checkpoint, policy.config.workspace, Workspace(), "the other simulator")
    return policy


def record(folder: Path, episodes: int) -> None:
    """Let the expert play the first training tables, and record those that it solves."""
    check_count("episodes", episodes)
    recorded = 0
    with ForeignWorld() as world, tqdm(total=episodes, unit="episode") as bar:
        for seed in TRAIN_SEEDS:
            world.lay(random_scene(seed))
            observation = seen(world)
            pick, place = world.expert()
            world.pick_place(world.on_surface(*pick), world.on_surface(*place))
            if not world.solved():
                continue
            # A cube looks the same after a quarter turn. In a round bowl, every yaw is right.
            expert = ExpertAction(PickPlace(Pose2(*pick), Pose2(*place)), math.pi / 2)
            recorded += 1
            step = DemonstrationStep(observation, world.sentence, expert)
            step.save(folder / f"episode-{recorded}" / "step-1", DEPTH_SCALE)
            bar.update()
            if recorded == episodes:
                return


def play(world: ForeignWorld, policy: Policy, index: int) -> Episode:
    """A test table, until it is solved or the policy has acted `ACTIONS` times."""
    world.lay(random_scene(TEST_SEEDS[index]))
    empty_picks: list[Pose2] = []
    steps = 0
    while steps < ACTIONS and not world.solved():
        choice = policy.decide(seen(world), world.sentence, empty_picks)
        planned = robot_plan.plan(choice)
        held = world.pick_place(planned.pick, planned.place)
        empty_picks = [] if held else [*empty_picks, choice.action.pick]
        steps += 1
    return Episode(index, float(world.solved()), steps, ())


def measure(checkpoint: Path, episodes: int, out: Path) -> None:
    """Measure a policy on the first test tables, and file its row."""
    check_count("episodes", episodes)
    policy = load(checkpoint)
    with ForeignWorld() as world:
        played = [play(world, policy, index) for index in tqdm(range(episodes), unit="episode")]
    facts = {"world": "MuJoCo", "split": "test", "start": 0, "actions": ACTIONS}
    file_row(checkpoint, policy, TASK, played, "all", facts, out)


def file_row(
    checkpoint: Path, policy: Policy, task: str, episodes: Sequence[Episode], subset: str, facts: dict,
    path: Path,
) -> None:  # fmt: skip
    """File the row of a measurement, and print it."""
    facts = facts | results.policy_entries(read_card(checkpoint), policy.config)
    row = results.result_row(policy.name, task, episodes, subset, facts)
    results.file_rows([row], path)
    print(f"{row['method']}, {row['task']}, {row['subset']}: {row['mean']} {row['ci95']} ({row['episodes']})")


def foreign_tables(count: int) -> Iterator[tuple[Observation, set[str], list[str]]]:
    """Test tables of the other simulator: the pictures, what is there, and what could be there."""
    names = [f"{color} {kind}" for color in NAMED for kind in KINDS]
    with ForeignWorld() as world:
        for number in range(count):
            world.lay(random_scene(TEST_SEEDS[ASKED_SEED + number]))
            yield seen(world), {f"{thing.color} {thing.kind}" for thing in world.scene.things}, names


def our_tables(count: int) -> Iterator[tuple[Observation, set[str], list[str]]]:
    """As `foreign_tables`, of our simulator: the tasks take turns. What could be there is what other tables hold."""
    tables = []
    with World() as world:
        for number in range(count):
            name = OUR_TASKS[number % len(OUR_TASKS)]
            task = tasks.make(name, "test")
            (observation,) = world.reset(task, tasks.episode_seed("test", ASKED_SEED + number))
            tables.append((name, observation, {thing for thing in task.names.values() if thing}))
    for name, observation, there in tables:
        yield observation, there, sorted(set().union(*(others for task, _, others in tables if task == name)))


def refusals(tables: int, out: Path) -> None:
    """On each table, ask for two things that are there and one that is not; file how often the policy refused."""
    check_count("tables", tables, 2 * len(OUR_TASKS))  # two of each of our tasks
    policy = load_policy(SHIPPED, clip.load()).eval()
    for world, source in (("MuJoCo", foreign_tables), ("home", our_tables)):
        rng = np.random.default_rng(0)
        answers: dict[str, list[Episode]] = {"named thing is there": [], "named thing is not there": []}
        for observation, present, names in tqdm(source(tables), f"refusals, {world}", tables, unit="table"):
            scene = policy.embed(observation.views)
            asked = rng.choice(sorted(present), 2, replace=False).tolist()
            asked.append(str(rng.choice([name for name in names if name not in present])))
            for phrase in asked:
                refused = refusal.refusal(scene, [phrase], policy.source) is not None
                episodes = answers["named thing is there" if phrase in present else "named thing is not there"]
                episodes.append(Episode(len(episodes), float(refused), 0, ()))
        facts = {"world": world, "split": "test", "start": ASKED_SEED, "lowest_margin": refusal.LOWEST_MARGIN}
        for subset, episodes in answers.items():
            file_row(SHIPPED, policy, "refusal", episodes, subset, facts, out)
