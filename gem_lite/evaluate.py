"""Measure a policy over episodes, and file the result as one row of data/results/*.jsonl."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike
from tqdm import tqdm

from gem_lite import clip, colors, config, methods
from gem_lite.config import Config
from gem_lite.demonstrations import read_json, write_whole
from gem_lite.policy import PickPlacePolicy
from gem_lite.se2 import Action, Pose2, angle_bins
from gem_lite.tabletop import tasks
from gem_lite.tabletop.world import Observation, World
from gem_lite.train import load_policy, read_card

RESULTS = clip.DATA / "results"
CHUNK = 5
"""Episodes that one worker runs in a row; fixed, so that results do not depend on the number of cores."""
IDENTITY = ("method", "task", "subset", "demos", "seed", "config", "steps", "split", "start")
"""What names a cell of the policies' results: a newer row of the same cell replaces the older one."""
Actor = Callable[[World, Observation], Action | None]
"""Chooses an action. Only experts look at the world; a policy's actor passes on the observation alone."""


@dataclass(frozen=True)
class Episode:
    """The outcome of one episode: ``reward`` in [0, 1], and the colours its sentence named, if any."""

    index: int
    reward: float
    steps: int
    named_colors: tuple[str, ...]


def run_episode(world: World, actor: Actor, task_name: str, split: tasks.Split, index: int) -> Episode:
    """One episode from reset to done."""
    task = tasks.make(task_name, split)
    observation = world.reset(task, tasks.episode_seed(split, index))
    total, done = 0.0, False
    while not done:
        action = actor(world, observation)
        if action is None:
            break
        step = world.step(action)
        observation, total, done = step.observation, total + step.reward, step.done
    return Episode(index, total, world.steps_taken, task.named_colors)


def expert(world: World, _: Observation) -> Action | None:
    """The scripted expert; it reads the simulator's truth."""
    found = world.task.expert(world)
    return found and found.action


def rounded_expert(settings: Config) -> Actor:
    """The expert, its action rounded to a configuration's pixels and angles: the best that a policy can do."""
    workspace, bins = settings.workspace, angle_bins(settings.angles)

    def nearest(angle: float) -> float:
        return float(bins[round(angle / (2 * np.pi / settings.angles)) % settings.angles])

    def actor(world: World, observation: Observation) -> Action | None:
        action = expert(world, observation)
        if action is None:
            return None
        pick, place = (workspace.to_world(*workspace.nearest_cell(p.x, p.y)) for p in (action.pick, action.place))
        yaw = nearest(action.pick.yaw)
        return Action(Pose2(*pick, yaw), Pose2(*place, yaw + nearest(action.delta)))

    return actor


def random_actor(settings: Config, seed: int) -> Actor:
    """A pick and a place at uniformly random pixels and angles."""
    rng, workspace, bins = np.random.default_rng(seed), settings.workspace, angle_bins(settings.angles)

    def pose() -> Pose2:
        cell = [rng.integers(length) for length in workspace.shape]
        return Pose2(*workspace.to_world(*cell), float(rng.choice(bins)))

    return lambda world, observation: Action(pose(), pose())


def policy_actor(policy: PickPlacePolicy) -> Actor:
    """A policy as an actor: it gets the camera views and the sentence, nothing else."""
    return lambda world, observation: policy.act(observation, world.task.instruction)


SCRIPTED = ("expert", "expert-rounded", "random")
"""Methods that need no checkpoint."""


def make_actor(method: str, settings: Config, checkpoint: Path | None, clip_name: str | None, seed: int) -> Actor:
    """The actor of a method's name: one of `SCRIPTED`, or a learned one from its checkpoint."""
    match method:
        case "expert":
            return expert
        case "expert-rounded":
            return rounded_expert(settings)
        case "random":
            return random_actor(settings, seed)
    if method not in methods.NAMES:
        raise ValueError(f"method must be one of {', '.join((*methods.NAMES, *SCRIPTED))}, got {method!r}")
    if checkpoint is None:
        raise ValueError(f"{method} needs --checkpoint")
    policy = load_policy(checkpoint, clip.load(clip_name))
    if policy.name != method:
        raise ValueError(f"the checkpoint {checkpoint} holds {policy.name}, not {method}")
    return policy_actor(policy)


def _run_chunk(chunk: tuple[str, Config, Path | None, str | None, str, tasks.Split, list[int]]) -> list[Episode]:
    method, settings, checkpoint, clip_name, task_name, split, indices = chunk
    torch.set_num_threads(1)
    actor = make_actor(method, settings, checkpoint, clip_name, seed=indices[0])
    with World() as world:
        return [run_episode(world, actor, task_name, split, index) for index in indices]


def evaluate(
    method: str, task_name: str, episodes: int, split: tasks.Split = "test", start: int = 0,
    settings: Config = config.LITE, checkpoint: Path | None = None, clip_name: str | None = None,
    processes: int | None = None,
) -> list[Episode]:  # fmt: skip
    """Run episodes ``start`` .. ``start + episodes - 1`` of a split, one process a core."""
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    settings = settings.on_table(tasks.make(task_name, split).workspace.length)
    make_actor(method, settings, checkpoint, clip_name, seed=start)  # Errors surface here, not in a worker.
    indices = range(start, start + episodes)
    chunks = [
        (method, settings, checkpoint, clip_name, task_name, split, list(indices[i : i + CHUNK]))
        for i in range(0, episodes, CHUNK)
    ]
    found: list[Episode] = []
    with (
        multiprocessing.get_context("spawn").Pool(min(processes or os.cpu_count() or 1, len(chunks))) as pool,
        tqdm(total=episodes, desc=f"{method} on {task_name}", unit="episode") as bar,
    ):
        for part in pool.imap(_run_chunk, chunks):
            found += part
            bar.update(len(part))
            bar.set_postfix(mean=f"{100 * np.mean([e.reward for e in found]):.1f}")
    return found


def mean_and_interval(rewards: ArrayLike, seed: int = 0) -> tuple[float, tuple[float, float]]:
    """Mean (0-100) of rewards in [0, 1] and its 95 % interval, by bootstrap with 10,000 draws.

    Where all episodes got 0, or all 1, a bootstrap has no width: then the exact binomial bound is given.

    Args:
        rewards: (episodes,), or (training seeds, episodes) of the same episodes: then every draw draws both.
    """
    values = 100 * np.atleast_2d(np.asarray(rewards, float))
    seeds, episodes = values.shape
    bound = 100 * 0.025 ** (1 / episodes)
    if np.allclose(values, 100):
        return 100.0, (round(bound, 1), 100.0)
    if np.allclose(values, 0):
        return 0.0, (0.0, round(100 - bound, 1))
    rng = np.random.default_rng(seed)
    columns = rng.integers(episodes, size=(10_000, episodes))
    # How often each seed is drawn stands for drawing seeds: their order does not matter to a mean.
    rows = rng.multinomial(seeds, [1 / seeds] * seeds, size=10_000) / seeds  # (draws, seeds)
    draws = np.einsum("ds,sde->d", rows, values[:, columns]) / episodes
    low, high = np.percentile(draws, [2.5, 97.5])
    return round(float(values.mean()), 1), (round(float(low), 1), round(float(high), 1))


def result_row(method: str, task_name: str, found: Sequence[Episode], subset: str, facts: dict) -> dict:
    """One cell of a results table, with every episode's reward by its index."""
    mean, interval = mean_and_interval([episode.reward for episode in found])
    return {
        "method": method, "task": task_name, "subset": subset, "episodes": len(found),
        "mean": mean, "ci95": list(interval), **facts,
        "rewards": {str(episode.index): round(episode.reward, 4) for episode in found},
        "date": datetime.now(UTC).date().isoformat(),
    }  # fmt: skip


def results_file(task_name: str) -> Path:
    """Where a task's rows belong: one file for a family, seen and unseen sets together."""
    return RESULTS / f"{re.sub('-(un)?seen(-colors)?$', '', task_name)}.jsonl"


def read_rows(path: Path) -> list[dict]:
    """The rows of a JSON-lines file; none if there is no such file. Raises ValueError with the line that is no row."""
    lines = path.read_bytes().splitlines() if path.exists() else []
    rows = [read_json(line, f"line {number} of {path}") for number, line in enumerate(lines, start=1)]
    for number, row in enumerate(rows, start=1):
        wrong = [name for name in IDENTITY if isinstance(row.get(name), dict | list)]
        if wrong:
            raise ValueError(f"line {number} of {path} is no row: see its {', '.join(wrong)}")
    return rows


def file_rows(rows: Sequence[dict], path: Path, identity: Sequence[str] = IDENTITY) -> None:
    """Append rows to a JSON-lines file; an older row that agrees in all of ``identity`` is replaced."""

    def key(row: dict) -> tuple:
        return tuple(row.get(name) for name in identity)

    new_keys = {key(row) for row in rows}
    kept = [row for row in read_rows(path) if key(row) not in new_keys]
    write_whole(path, "".join(json.dumps(row) + "\n" for row in [*kept, *rows]).encode())


def main() -> None:
    """Command line: see ``python -m gem_lite.evaluate --help``."""
    parser = argparse.ArgumentParser(
        description="Measure a policy over test episodes; prints the mean with its 95 % interval and files the row.",
        epilog=methods.HELP
        + "\n  expert, expert-rounded, random    need no checkpoint; expert-rounded is a policy's ceiling"
        "\n\nexample: python -m gem_lite.evaluate gem put-block-in-bowl-unseen-colors "
        "--checkpoint data/gem-put-block-in-bowl.safetensors",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("method", help="see below")
    parser.add_argument("task", help=f"one of {', '.join(tasks.NAMES)}")
    parser.add_argument("--checkpoint", type=Path, help="of a learned method: the checkpoint to load")
    parser.add_argument("--episodes", type=int, default=100, help="default 100")
    parser.add_argument("--start", type=int, default=0, help="index of the first episode of the split (default 0)")
    parser.add_argument("--split", default="test", choices=list(tasks.SEED_START), help="default test")
    parser.add_argument("--clip", help="Hugging Face name or folder of a CLIP (default: the embedded one)")
    parser.add_argument("--processes", type=int, help="how many episodes run at once (default: one a core)")
    parser.add_argument("--out", type=Path, help="results file (default: the task family's in data/results)")
    args = parser.parse_args()
    try:
        found = evaluate(
            args.method, args.task, args.episodes, args.split, args.start,
            checkpoint=args.checkpoint, clip_name=args.clip, processes=args.processes,
        )  # fmt: skip
        card = {} if args.method in SCRIPTED else read_card(args.checkpoint)
    except (OSError, ValueError) as error:
        parser.exit(2, f"{error}\n")
    settings = card.get("config", {})
    facts = {
        "split": args.split, "start": args.start,
        **{name: card.get(name) for name in ("demos", "seed", "train_seconds", "train_cpu_seconds", "hardware")},
        "config": settings.get("name", "lite"), "steps": settings.get("steps"),
        "clip": card.get("clip", {}).get("name"), "checkpoint_sha256": card.get("sha256"),
    }  # fmt: skip
    rows = [result_row(args.method, args.task, found, "all", facts)]
    both_new = [e for e in found if e.named_colors and set(e.named_colors) <= set(colors.NEW)]
    if both_new:
        rows.append(result_row(args.method, args.task, both_new, "both named colours new", facts))
    for row in rows:
        print("{method} on {task}, {subset}: {mean} {ci95}, {episodes} episodes".format(**row))
    file_rows(rows, args.out or results_file(args.task))


if __name__ == "__main__":
    main()
