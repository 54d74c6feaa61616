"""Measure a policy over episodes; the result is one row, see `results`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gem_lite import clip, tasks
from gem_lite.actions import Action, PickPlace, Push
from gem_lite.config import Config
from gem_lite.evaluation import results, workers
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.simulation import worlds
from gem_lite.simulation.environment import Environment, body_at
from gem_lite.simulation.world import World
from gem_lite.simulation.worlds import WorldStyle

LITE = Config.preset("lite")
"""Pixels and angles of the scripted methods."""
Observations = tuple[Observation, ...]
Actor = Callable[[Environment, Observations, Sequence[Pose2]], Action | None]
"""Chooses an action, given where the tool has grasped nothing since it last held something.

Only experts look at the environment; a policy's actor passes on the observations and the tool's own log."""


@dataclass(frozen=True)
class Episode:
    """The outcome of one episode.

    Attributes:
        index: of the episode in its split.
        reward: in [0, 1].
        steps: actions taken.
        subsets: the sets of episodes, besides all, to which it belongs (`Task.subsets`).
        placed_decisions: actions chosen while a body lay where the sentences want it (`Task.placed`).
        retaken: how many of these picked such a body.
    """

    index: int
    reward: float
    steps: int
    subsets: tuple[str, ...]
    placed_decisions: int = 0
    retaken: int = 0


def run_episode(
    environment: Environment, actor: Actor, task_name: str, split: tasks.Split, index: int
) -> Episode:  # fmt: skip
    """One episode from reset to done."""
    task = tasks.make(task_name, split)
    observations = environment.reset(task, tasks.episode_seed(split, index))
    total = 0.0
    done = False
    placed_decisions = 0
    retaken = 0
    empty_picks: list[Pose2] = []
    while not done:
        action = actor(environment, observations, empty_picks)
        if action is None:
            break
        placed = task.placed(environment)
        placed_decisions += bool(placed)
        if isinstance(action, PickPlace):
            retaken += body_at(environment, environment.tables[action.pick_table] @ action.pick) in placed
        step = environment.step(action)
        if isinstance(action, PickPlace):
            empty_picks = [] if step.grasped else [*empty_picks, action.pick]
        observations = step.observations
        total += step.reward
        done = step.done
    return Episode(index, total, environment.steps_taken, task.subsets(), placed_decisions, retaken)


def expert(environment: Environment, _: Observations = (), __: Sequence[Pose2] = ()) -> Action | None:
    """The scripted expert; it reads the simulator's truth."""
    expert_action = environment.task.expert(environment)
    return None if expert_action is None else expert_action.action


def rounded_expert(settings: Config) -> Actor:
    """The expert, its action rounded to a configuration's pixels and angles: the best that a policy can do."""
    workspace, bins = settings.workspace, angle_bins(settings.angles)

    def nearest(angle: float) -> float:
        return float(bins[round(angle / (2 * np.pi / settings.angles)) % settings.angles])

    def in_cell(pose: Pose2, yaw: float) -> Pose2:
        return Pose2(*workspace.to_world(*workspace.nearest_cell(pose.x, pose.y)), yaw)

    def actor(environment: Environment, _: Observations, __: Sequence[Pose2] = ()) -> Action | None:
        match expert(environment):
            case PickPlace(pick, place) as action:
                yaw = nearest(pick.yaw)
                turned = yaw + nearest(action.delta)
                return replace(action, pick=in_cell(pick, yaw), place=in_cell(place, turned))
            case Push(start, end) as action:
                return replace(action, start=in_cell(start, 0.0), end=in_cell(end, 0.0))
        return None

    return actor


def random_actor(settings: Config, seed: int) -> Actor:
    """An action that the tool can do, between uniformly random pixels and angles of the first table."""
    rng, workspace, bins = np.random.default_rng(seed), settings.workspace, angle_bins(settings.angles)

    def pose() -> Pose2:
        cell = [rng.integers(length) for length in workspace.shape]
        return Pose2(*workspace.to_world(*cell), float(rng.choice(bins)))

    def actor(environment: Environment, _: Observations, __: Sequence[Pose2] = ()) -> Action:
        kind = environment.effector.actions[0]
        return kind(pose(), pose())

    return actor


def policy_actor(policy: PickPlacePolicy) -> Actor:
    """A policy as an actor on one table: it gets the camera views, the sentence and the tool's log, nothing else."""

    def actor(environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]) -> Action:
        (observation,) = observations
        return policy.act(observation, environment.task.instruction, empty_picks)

    return actor


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


def settings_of(task_name: str, split: tasks.Split, settings: Config = LITE) -> Config:
    """``settings`` on the table of a task: those of the scripted methods that depend on pixels and angles."""
    return settings.on_table(tasks.make(task_name, split).workspace.length)


@dataclass(frozen=True)
class Job:
    """A few episodes for one process; see `evaluate` for what the attributes mean."""

    method: str
    settings: Config
    checkpoint: Path | None
    clip_name: str | None
    style: WorldStyle
    task_name: str
    split: tasks.Split
    indices: range


def run_job(job: Job) -> list[Episode]:
    """The episodes of a job, one after the other in one world."""
    actor = make_actor(job.method, job.settings, job.checkpoint, job.clip_name, seed=job.indices[0])
    with World(style=job.style) as world:
        return [run_episode(world, actor, job.task_name, job.split, index) for index in job.indices]


def evaluate(
    method: str, task_name: str, episodes: int, split: tasks.Split = "test", start: int = 0,
    settings: Config = LITE, checkpoint: Path | None = None, clip_name: str | None = None,
    processes: int | None = None, world: str = "home",
) -> list[Episode]:  # fmt: skip
    """Run episodes ``start`` .. ``start + episodes - 1`` of a split in a world, one process a core.

    Method, task and world may come from outside the library, see `workers.run_jobs`.

    Raises:
        ValueError: an unknown method, task, split or world, a checkpoint that is not the method's, or no episode.
        FileNotFoundError: no such checkpoint.
    """
    parts = workers.chunks(start, episodes)
    style = worlds.style(world)
    settings = settings_of(task_name, split, settings)
    make_actor(method, settings, checkpoint, clip_name, seed=start)  # Errors surface here, not in a worker.
    jobs = [Job(method, settings, checkpoint, clip_name, style, task_name, split, part) for part in parts]
    label = f"{method} on {task_name}"
    return workers.run_jobs(run_job, jobs, lambda episode: episode.reward, label, episodes, processes)


def rows_of(method: str, task_name: str, episodes: Sequence[Episode], facts: dict) -> list[dict]:
    """The rows of a measurement: one over all episodes, and one over each of the task's subsets that occurs.

    Args:
        facts: the rest of what names a row, see `results.facts_of`.
    """
    rows = [results.result_row(method, task_name, episodes, "all", facts)]
    for subset in dict.fromkeys(name for episode in episodes for name in episode.subsets):
        members = [episode for episode in episodes if subset in episode.subsets]
        rows.append(results.result_row(method, task_name, members, subset, facts))
    return rows


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
    parser.add_argument("task", help=f"one of {', '.join(tasks.names())}")
    parser.add_argument("--checkpoint", type=Path, help="of a learned method: the checkpoint to load")
    parser.add_argument("--episodes", type=int, default=100, help="default 100")
    parser.add_argument("--start", type=int, default=0, help="index of the first episode of the split (default 0)")
    parser.add_argument("--split", default="test", choices=list(tasks.SEED_START), help="default test")
    parser.add_argument("--clip", help="Hugging Face name or folder of a CLIP (default: the embedded one)")
    parser.add_argument("--processes", type=int, help="how many episodes run at once (default: one a core)")
    parser.add_argument("--world", default="home", help=f"one of {', '.join(worlds.names())} (default home)")
    results.add_output(parser)
    args = parser.parse_args()
    try:
        out = results.output(args, tasks.family(args.task))
        method, facts = _named(args)
        expected = {"method": method, "task": args.task, "subset": "all", **facts, "episodes": args.episodes}
        results.check_rows([expected], out)  # Before hours of measuring, not after them.
        found = evaluate(
            method, args.task, args.episodes, args.split, args.start,
            checkpoint=args.checkpoint, clip_name=args.clip, processes=args.processes, world=args.world,
        )  # fmt: skip
        rows = rows_of(method, args.task, found, facts)
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
