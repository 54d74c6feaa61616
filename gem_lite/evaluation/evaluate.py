"""Measure a policy over episodes; the result is one row, see `results`."""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from gem_lite import clip, colors, tasks
from gem_lite.config import Config
from gem_lite.evaluation import results
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Action, Pose2, angle_bins
from gem_lite.simulation.world import World, body_at
from gem_lite.simulation.worlds import WORLDS, WorldStyle

LITE = Config.preset("lite")
"""Pixels and angles of the scripted methods."""
CHUNK = 5
"""Episodes that one worker runs in a row; fixed, so that results do not depend on the number of cores."""
Actor = Callable[[World, Observation, Sequence[Pose2]], Action | None]
"""Chooses an action, given where the tool has grasped nothing since it last held something.

Only experts look at the world; a policy's actor passes on the observation and the tool's own log."""


@dataclass(frozen=True)
class Episode:
    """The outcome of one episode.

    Attributes:
        index: of the episode in its split.
        reward: in [0, 1].
        steps: actions taken.
        named_colors: the colours that its sentence named, if any.
        placed_decisions: actions chosen while a body lay where the sentences want it (`Task.placed`).
        retaken: how many of these picked such a body.
    """

    index: int
    reward: float
    steps: int
    named_colors: tuple[str, ...]
    placed_decisions: int = 0
    retaken: int = 0


def run_episode(world: World, actor: Actor, task_name: str, split: tasks.Split, index: int) -> Episode:
    """One episode from reset to done."""
    task = tasks.make(task_name, split)
    observation = world.reset(task, tasks.episode_seed(split, index))
    total = 0.0
    done = False
    placed_decisions = 0
    retaken = 0
    empty_picks: list[Pose2] = []
    while not done:
        action = actor(world, observation, empty_picks)
        if action is None:
            break
        placed = task.placed(world)
        placed_decisions += bool(placed)
        retaken += body_at(world, action.pick) in placed
        step = world.step(action)
        empty_picks = [] if step.grasped else [*empty_picks, action.pick]
        observation = step.observation
        total += step.reward
        done = step.done
    return Episode(index, total, world.steps_taken, task.named_colors, placed_decisions, retaken)


def expert(world: World, _: Observation | None = None, __: Sequence[Pose2] = ()) -> Action | None:
    """The scripted expert; it reads the simulator's truth."""
    expert_action = world.task.expert(world)
    return None if expert_action is None else expert_action.action


def rounded_expert(settings: Config) -> Actor:
    """The expert, its action rounded to a configuration's pixels and angles: the best that a policy can do."""
    workspace, bins = settings.workspace, angle_bins(settings.angles)

    def nearest(angle: float) -> float:
        return float(bins[round(angle / (2 * np.pi / settings.angles)) % settings.angles])

    def actor(world: World, _: Observation, __: Sequence[Pose2] = ()) -> Action | None:
        action = expert(world)
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

    return lambda world, observation, empty_picks=(): Action(pose(), pose())


def policy_actor(policy: PickPlacePolicy) -> Actor:
    """A policy as an actor: it gets the camera views, the sentence and the tool's log, nothing else."""
    return lambda world, observation, empty_picks=(): policy.act(observation, world.task.instruction, empty_picks)


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
    try:
        method = methods.canonical(method)
    except ValueError as error:
        raise ValueError(f"{error}; without a checkpoint: {', '.join(SCRIPTED)}") from error
    if checkpoint is None:
        raise ValueError(f"{method} needs --checkpoint")
    policy = load_policy(checkpoint, clip.load(clip_name))
    if policy.name != method:
        raise ValueError(f"the checkpoint {checkpoint} holds {policy.name}, not {method}")
    table = policy.config.workspace.length
    if table != settings.workspace.length:
        raise ValueError(
            f"the checkpoint {checkpoint} was trained for a table {table} m long; the task's is "
            f"{settings.workspace.length} m long"
        )
    return policy_actor(policy)


def style_of(world: str) -> WorldStyle:
    """The look of the world with a name. Raises ValueError if there is none."""
    if world not in WORLDS:
        raise ValueError(f"world must be one of {', '.join(WORLDS)}, got {world!r}")
    return WORLDS[world]


def settings_of(task_name: str, split: tasks.Split, settings: Config = LITE) -> Config:
    """``settings`` on the table of a task: those of the scripted methods that depend on pixels and angles."""
    return settings.on_table(tasks.make(task_name, split).workspace.length)


def _run_chunk(chunk: tuple[str, Config, Path | None, str | None, str, str, tasks.Split, list[int]]) -> list[Episode]:
    method, settings, checkpoint, clip_name, world_name, task_name, split, indices = chunk
    torch.set_num_threads(1)
    actor = make_actor(method, settings, checkpoint, clip_name, seed=indices[0])
    with World(style=style_of(world_name)) as world:
        return [run_episode(world, actor, task_name, split, index) for index in indices]


def evaluate(
    method: str, task_name: str, episodes: int, split: tasks.Split = "test", start: int = 0,
    settings: Config = LITE, checkpoint: Path | None = None, clip_name: str | None = None,
    processes: int | None = None, world: str = "home",
) -> list[Episode]:  # fmt: skip
    """Run episodes ``start`` .. ``start + episodes - 1`` of a split in a world, one process a core.

    Raises:
        ValueError: an unknown method, task, split or world, a checkpoint that is not the method's, or no episode.
        FileNotFoundError: no such checkpoint.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    style_of(world)
    settings = settings_of(task_name, split, settings)
    make_actor(method, settings, checkpoint, clip_name, seed=start)  # Errors surface here, not in a worker.
    indices = range(start, start + episodes)
    chunks = [
        (method, settings, checkpoint, clip_name, world, task_name, split, list(indices[i : i + CHUNK]))
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


def main() -> None:
    """Command line: see ``python -m gem_lite.evaluation.evaluate --help``."""
    parser = argparse.ArgumentParser(
        description="Measure a policy over test episodes; prints the mean with its 95 % interval and writes the row.",
        epilog=methods.help_text()
        + "\n  expert, expert-rounded, random          need no checkpoint; expert-rounded: what rounding alone costs"
        "\n\nexample: python -m gem_lite.evaluation.evaluate gem put-block-in-bowl-unseen-colors "
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
    parser.add_argument("--world", default="home", help=f"one of {', '.join(WORLDS)} (default home)")
    results.add_output(parser)
    args = parser.parse_args()
    out = results.output(args, results.family(args.task))
    try:
        method, facts = _named(args)
        expected = {"method": method, "task": args.task, "subset": "all", **facts, "episodes": args.episodes}
        results.check_rows([expected], out)  # Before hours of measuring, not after them.
        found = evaluate(
            method, args.task, args.episodes, args.split, args.start,
            checkpoint=args.checkpoint, clip_name=args.clip, processes=args.processes, world=args.world,
        )  # fmt: skip
        rows = [results.result_row(method, args.task, found, "all", facts)]
        both_new = [e for e in found if e.named_colors and set(e.named_colors) <= set(colors.NEW)]
        if both_new:
            rows.append(results.result_row(method, args.task, both_new, "both named colours new", facts))
        for row in rows:
            print("{method} on {task}, {subset}: {mean} {ci95}, {episodes} episodes".format(**row))
        results.file_rows(rows, out)
    except (OSError, ValueError) as error:
        parser.exit(2, f"{error}\n")
    print(f"the rows are in {out}")


def _named(args: argparse.Namespace) -> tuple[str, dict]:
    """The method's name, and the rest of what names its rows."""
    where = {"world": args.world, "split": args.split, "start": args.start}
    if args.method in SCRIPTED:
        settings = None if args.method == "expert" else settings_of(args.task, args.split)
        return args.method, where | results.facts_of(None, settings)
    method = methods.canonical(args.method)
    if args.checkpoint is None:
        raise ValueError(f"{method} needs --checkpoint")
    card = read_card(args.checkpoint)
    return method, where | results.facts_of(card, methods.of_card(card)[1])


if __name__ == "__main__":
    main()
