"""Collect demonstrations: the expert plays episodes in the simulator, and those that succeed are saved."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm

from gem_lite import demonstrations, tasks
from gem_lite.demonstrations import Demonstration, DemonstrationSet, DemonstrationStep
from gem_lite.evaluation import actors
from gem_lite.evaluation.rollout import rollout
from gem_lite.foundations.files import writing
from gem_lite.simulation import looks
from gem_lite.simulation.environment import SOLVED, Environment
from gem_lite.simulation.looks import Look
from gem_lite.simulation.world import World


def roll_out(environment: Environment, task_name: str, split: tasks.Split, index: int) -> Demonstration:
    """Let the expert play episode ``index`` of a split, on one table.

    Raises:
        ValueError: the task or the split is unknown, or there is more than one table.
    """
    seed = tasks.episode_seed(split, index)
    steps = []
    for turn in rollout(environment, tasks.make(task_name, split), seed, actors.expert):
        (observation,) = turn.observations
        seen = demonstrations.quantized(observation)  # As files hold it: fresh and loaded demonstrations are equal.
        result = turn.result
        steps.append(DemonstrationStep(seen, turn.instruction, turn.decision, result.trace, result.reward))
    return Demonstration(task_name, split, seed, tuple(steps), environment.style.name)


def collect(
    task_name: str, episodes: int, folder: Path, split: tasks.Split = "train", start: int = 0, world: str = "home",
    environment: Callable[[Look], World] = World,
) -> DemonstrationSet:  # fmt: skip
    """Collect ``episodes`` successful expert episodes. Failed episodes are skipped.

    Each episode is saved at once. If ``folder`` holds the beginning of the same collection, the missing episodes are
    added. If it holds more than ``episodes``, the first of them are returned, and the folder does not change.

    Args:
        start: the index in the split of the first episode to try.
        world: the name of a world, see `gem_lite.simulation.looks.style`.
        environment: makes the environment from the world's look; by default the world that all others use.

    Raises:
        ValueError: the task, the split or the world is unknown, ``episodes`` is below 1, or ``folder`` holds another
            set.
        RuntimeError: the expert failed in at least 20 episodes and in more than half of all.
        OSError: a file cannot be written, or another process writes into ``folder``.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    style = looks.style(world)
    task = tasks.make(task_name, split)
    folder = Path(folder)
    facts = {
        "task": task_name, "split": split, "world": world, "start": start,
        "workspace": task.workspace.limits, "scale": task.scale,
    }  # fmt: skip
    label = f"{task_name} ({split})"
    with writing(folder):
        files: dict[str, str] = {}
        index = start
        if (folder / "manifest.json").exists():
            files, index = _existing_episodes(folder, facts)
        with environment(style) as table, tqdm(None, label, episodes, initial=len(files), unit="episode") as bar:
            while len(files) < episodes:
                demonstration = roll_out(table, task_name, split, index)
                index += 1
                if sum(step.reward for step in demonstration.steps) > SOLVED:
                    files |= demonstrations.write_episode(folder, len(files), demonstration)
                    demonstrations.write_manifest(folder, {**facts, "next": index}, files)
                    bar.update()
                else:
                    bar.write(f"episode {index - 1}: the expert failed, skipped")
                    _check_failures(index - start, len(files), task_name)
    return demonstrations.load(folder)[:episodes]


def _check_failures(tried: int, succeeded: int, task_name: str) -> None:
    failed = tried - succeeded
    if failed >= 20 and failed > succeeded:
        raise RuntimeError(f"the expert failed in {failed} of {tried} episodes of {task_name}")


def _existing_episodes(folder: Path, facts: dict) -> tuple[dict[str, str], int]:
    """The files of a stopped collection, and the index of the next episode to try."""
    manifest = demonstrations.read_manifest(folder)
    old_facts = {name: getattr(manifest, name) for name in facts}
    if manifest.workspace is None:  # Sets of earlier versions lack it.
        old_facts["workspace"] = facts["workspace"]
    if old_facts != facts:
        raise ValueError(f"{folder} holds another set ({old_facts}, not {facts}): give another folder, or remove it")
    files = demonstrations.load(folder).sums
    if manifest.workspace is None:
        demonstrations.write_manifest(folder, {**facts, "next": manifest.next}, files)
    return files, manifest.next
