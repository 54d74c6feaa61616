"""The rows of all scenes, and their table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from tqdm import tqdm

from experiments.planning.playing import Sayer, planning, play, repeating, truly_belong
from experiments.planning.scenes import COUNT, KINDS, Sorting
from gem_lite import clip
from gem_lite.evaluation.statistics import mean_and_interval
from gem_lite.language import models
from gem_lite.planning.belonging import Belonging
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.gem import Gem
from gem_lite.simulation.world import World

METHODS = ("planner", "without planner", "true names", "true kinds", "true names and kinds")
"""Who says the sentences: the planner; nobody (the policy gets the vague instruction); the planner with the true names
of the things, with the true kinds of names, with both."""
FILED, TUNING = 710_000, 800_000
"""Seeds of the scenes: of those that are filed, and of those on which the planner was tuned."""


def measure(scenes: int, methods: Sequence[str], tuning: bool, path: Path) -> None:
    """Play the scenes that have no row yet, and add their rows to a file.

    Raises:
        ValueError: an unknown method.
    """
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise ValueError(f"methods must be of {', '.join(METHODS)}, got {unknown[0]!r}")
    first = TUNING if tuning else FILED
    done = {(row["method"], row.get("seed", FILED + row["scene"])) for row in read(path)}  # Filed rows name no seed.
    asked = [(method, scene) for scene in range(scenes) for method in methods]
    waiting = [(method, scene) for method, scene in asked if (method, first + scene) not in done]
    if not waiting:
        return
    policy = load_policy(clip.DATA / "gem-multi.safetensors", clip.load())
    sayers = sayers_of(policy)
    path.parent.mkdir(parents=True, exist_ok=True)
    with World() as world, path.open("a") as file:
        for method, scene in tqdm(waiting, unit="scene"):
            task = Sorting(KINDS[scene % len(KINDS)])
            outcome = play(world, task, first + scene, policy, sayers[method])
            facts = {"method": method, "scene": scene, "seed": first + scene, "kind": task.kind}
            file.write(json.dumps(facts | asdict(outcome)) + "\n")
            file.flush()


def sayers_of(policy: Gem) -> dict[str, Sayer]:
    """Who says the sentences, by `METHODS`."""
    belongs = Belonging(models.load())
    return {
        "planner": planning(policy, belongs),
        "without planner": repeating,
        "true names": planning(policy, belongs, true_names=True),
        "true kinds": planning(policy, truly_belong),
        "true names and kinds": planning(policy, truly_belong, true_names=True),
    }


def read(path: Path) -> list[dict]:
    """The rows of a file; none if there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def table(path: Path) -> str:
    """The shares (%) of right and of wrong things in the box, 95 % intervals over scenes; acts and time."""
    lines = [
        "| who says the sentences | scenes | right ones packed (%) | wrong ones packed (%) | acts | median s a scene |",
        "|---|---|---|---|---|---|",
    ]
    rows = read(path)
    for method in METHODS:
        of_method = [row for row in rows if row["method"] == method]
        if not of_method:
            continue
        shares = []
        for which in ("right", "wrong"):
            mean, (low, high) = mean_and_interval([row[which] / COUNT for row in of_method])
            shares.append(f"{mean} [{low}, {high}]")
        acts = np.mean([len(row["acts"]) for row in of_method])
        seconds = np.median([row["seconds"] for row in of_method])
        lines.append(f"| {method} | {len(of_method)} | {shares[0]} | {shares[1]} | {acts:.1f} | {seconds:.1f} |")
    return "\n".join(lines)
