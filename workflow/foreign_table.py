"""A table of another simulator: record demonstrations there, measure a policy there, measure refusals.

    python workflow/foreign_table.py record runs/foreign-demos
    gem-lite train runs/foreign-demos runs/mine.safetensors
    python workflow/foreign_table.py measure runs/mine.safetensors
    python workflow/foreign_table.py refusals

The table is data/foreign-scenes/foreign_world.py (MuJoCo); nothing of gem_lite is in it. A policy gets the pictures and
the sentence, and its action is carried out as `gem_lite.policies.robot.plan` says it to a robot.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.actions import ExpertAction, PickPlace
from gem_lite.evaluation import results
from gem_lite.evaluation.results import Episode
from gem_lite.maps import recognition
from gem_lite.policies import methods, robot
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.recordings import Recording
from gem_lite.se2 import Pose2
from gem_lite.simulation.world import World

sys.path.insert(0, str(clip.DATA / "foreign-scenes"))

from foreign_world import KINDS, NAMED, TEST_SEEDS, TRAIN_SEEDS, ForeignWorld, Look

FILE = results.RUNS / "own-table.jsonl"
"""Rows go here without --out; those that are published are in data/results."""
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


def seen(look: Look) -> Observation:
    """What the cameras see, as a policy reads it."""
    return Observation.from_arrays(look.colors, look.depths, look.intrinsics, look.poses, look.names)


def record(folder: Path, episodes: int) -> None:
    """Let the expert play the first training tables, and record those that it solves."""
    found = 0
    with ForeignWorld() as world, tqdm(total=episodes, unit="episode") as bar:
        for seed in TRAIN_SEEDS:
            observation = seen(world.reset(seed))
            pick, place = world.expert()
            world.pick_place(world.on_surface(*pick), world.on_surface(*place))
            if not world.solved():
                continue
            # A cube looks the same after a quarter turn. In a round bowl, every yaw is right.
            expert = ExpertAction(PickPlace(Pose2(*pick), Pose2(*place)), math.pi / 2)
            folder_of_step = folder / f"episode-{found + 1}" / "step-1"
            Recording(observation, world.sentence, expert).save(folder_of_step, DEPTH_SCALE)
            found += 1
            bar.update()
            if found == episodes:
                return


def measure(checkpoint: Path, episodes: int, path: Path) -> None:
    """Measure a policy on the first test tables, and file its row."""
    policy = load_policy(checkpoint, clip.load()).eval()
    played = []
    with ForeignWorld() as world:
        bar = tqdm(range(episodes), unit="episode")
        for index in bar:
            look = world.reset(TEST_SEEDS[index])
            sentence = world.sentence
            empty_picks: list[Pose2] = []
            steps = 0
            while steps < ACTIONS and not world.solved():
                choice = policy.decide(seen(look if steps == 0 else world.look()), sentence, empty_picks)
                planned = robot.plan(choice)
                held = world.pick_place(planned.pick, planned.place)
                empty_picks = [] if held else [*empty_picks, choice.action.pick]
                steps += 1
            played.append(Episode(index, float(world.solved()), steps, ()))
            bar.set_description(f"{sum(episode.reward for episode in played):.0f} solved")
    card = read_card(checkpoint)
    facts = {"world": "MuJoCo", "split": "test", "start": 0, "actions": ACTIONS}
    facts |= results.facts_of(card, methods.of_card(card)[1])
    file_row(policy.name, TASK, played, "all", facts, path)


def file_row(method: str, task: str, episodes: Sequence[Episode], subset: str, facts: dict, path: Path) -> None:
    """File the row of a measurement, and print it."""
    row = results.result_row(method, task, episodes, subset, facts)
    results.file_rows([row], path)
    print(f"{row['method']}, {row['task']}, {row['subset']}: {row['mean']} {row['ci95']} ({row['episodes']})")


def foreign_tables(count: int) -> Iterator[tuple[Observation, set[str], list[str]]]:
    """Test tables of the other simulator: the pictures, what is there, and what could be there."""
    names = [f"{color} {kind}" for color in NAMED for kind in KINDS]
    with ForeignWorld() as world:
        for number in range(count):
            look = world.reset(TEST_SEEDS[ASKED_SEED + number])
            yield seen(look), {f"{thing.color} {thing.kind}" for thing in world.scene.things}, names


def our_tables(count: int) -> Iterator[tuple[Observation, set[str], list[str]]]:
    """As `foreign_tables`, of our simulator: the tasks take turns. What could be there is what other tables hold."""
    found = []
    with World() as world:
        for number in range(count):
            name = OUR_TASKS[number % len(OUR_TASKS)]
            task = tasks.make(name, "test")
            (observation,) = world.reset(task, tasks.episode_seed("test", ASKED_SEED + number))
            found.append((name, observation, {thing for thing in task.names.values() if thing}))
    for name, observation, there in found:
        yield observation, there, sorted(set().union(*(others for task, _, others in found if task == name)))


def refusals(tables: int, path: Path) -> None:
    """On each table, ask for two things that are there and one that is not; file how often the answer is right."""
    policy = load_policy(SHIPPED, clip.load()).eval()
    card = read_card(SHIPPED)
    for world, source in (("MuJoCo", foreign_tables), ("home", our_tables)):
        rng = np.random.default_rng(0)
        there: list[Episode] = []
        absent: list[Episode] = []
        for observation, present, names in tqdm(source(tables), f"refusals, {world}", tables, unit="table"):
            scene = policy.embed(observation.views)
            missing = [name for name in names if name not in present]
            for phrase in rng.choice(sorted(present), 2, replace=False):
                refused = recognition.refusal(scene, [str(phrase)], policy.source) is not None
                there.append(Episode(len(there), float(refused), 0, ()))
            refused = recognition.refusal(scene, [str(rng.choice(missing))], policy.source) is not None
            absent.append(Episode(len(absent), float(refused), 0, ()))
        facts = {"world": world, "split": "test", "start": ASKED_SEED, "lowest_margin": recognition.LOWEST_MARGIN}
        facts |= results.facts_of(card, methods.of_card(card)[1])
        file_row(policy.name, "refusal", there, "named thing is there", facts, path)
        file_row(policy.name, "refusal", absent, "named thing is not there", facts, path)


def main() -> None:
    """Read the command line and do what it says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=FILE, help="file of rows (%(default)s)")
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="let the expert record demonstrations")
    recording.add_argument("folder", type=Path, help="folder to write")
    recording.add_argument("--episodes", type=int, default=5, help="how many (%(default)s)")
    measuring = commands.add_parser("measure", help="measure a policy")
    measuring.add_argument("checkpoint", type=Path, help="file of the policy")
    measuring.add_argument("--episodes", type=int, default=100, help="how many test tables (%(default)s)")
    asking = commands.add_parser("refusals", help="ask for things that are there, and for things that are not")
    asking.add_argument("--tables", type=int, default=50, help="of each simulator (%(default)s)")
    arguments = parser.parse_args()
    count = arguments.tables if arguments.command == "refusals" else arguments.episodes
    if not 1 <= count <= MOST:
        parser.error(f"the number of tables or episodes must be from 1 to {MOST}, got {count}")
    torch.set_num_threads(1)
    try:
        match arguments.command:
            case "record":
                record(arguments.folder, count)
            case "measure":
                measure(arguments.checkpoint, count, arguments.out)
            case "refusals":
                refusals(count, arguments.out)
    except (OSError, ValueError) as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()
