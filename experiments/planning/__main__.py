"""Vague goals, planned and carried out: python -m experiments.planning."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from tqdm import tqdm

from experiments.planning.playing import planning, play, repeating, truly_belong
from experiments.planning.scenes import COUNT, KINDS, Sorting
from gem_lite import clip
from gem_lite.evaluation.statistics import mean_and_interval
from gem_lite.language import models
from gem_lite.planning.belonging import Belonging
from gem_lite.policies.checkpoints import load_policy
from gem_lite.simulation.world import World

ROWS = Path("data/results/planning.jsonl")
METHODS = ("planner", "without planner", "true names", "true kinds", "true names and kinds")
"""Who says the sentences: the planner; nobody (the policy gets the vague instruction); the planner with the true names
of the things, with the true kinds of names, with both."""
FILED, TUNING = 700_000, 800_000
"""Seeds of the scenes: of those that are filed, and of those on which the planner was tuned."""


def main() -> None:
    """Play the scenes that have no row yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=50, help="number of scenes (default: %(default)s)")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS, help="who says the sentences")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of the rows (default: %(default)s)")
    parser.add_argument("--tuning", action="store_true", help="other scenes, for tuning; give --rows, too")
    asked = parser.parse_args()
    if asked.tuning and asked.rows == ROWS:
        parser.error("--tuning needs --rows: its rows do not belong into the filed ones")
    rows = [json.loads(line) for line in asked.rows.read_text().splitlines()] if asked.rows.exists() else []
    done = {(row["method"], row["scene"]) for row in rows}
    waiting = [(m, scene) for scene in range(asked.scenes) for m in asked.methods if (m, scene) not in done]
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    if waiting:
        policy = load_policy(clip.DATA / "gem-multi.safetensors", clip.load())
        belongs = Belonging(models.load())
        sayers = {
            "planner": planning(policy, belongs),
            "without planner": repeating,
            "true names": planning(policy, belongs, true_names=True),
            "true kinds": planning(policy, truly_belong),
            "true names and kinds": planning(policy, truly_belong, true_names=True),
        }
        with World() as world, asked.rows.open("a") as file:
            for method, scene in tqdm(waiting, unit="scene"):
                task = Sorting(KINDS[scene % len(KINDS)])
                seed = (TUNING if asked.tuning else FILED) + scene
                outcome = play(world, task, seed, policy, sayers[method])
                row = {"method": method, "scene": scene, "kind": task.kind, **asdict(outcome)}
                file.write(json.dumps(row) + "\n")
                file.flush()
                rows.append(row)
    show(rows)


def show(rows: list[dict]) -> None:
    """Print the table: the shares of right and of wrong things in the box, with 95 % intervals over scenes."""
    print("| who says the sentences | scenes | right ones packed | wrong ones packed | acts | s a scene |")
    print("|---|---|---|---|---|---|")
    for method in METHODS:
        of_method = [row for row in rows if row["method"] == method]
        if not of_method:
            continue
        shares = []
        for which in ("right", "wrong"):
            mean, (low, high) = mean_and_interval([row[which] / COUNT for row in of_method])
            shares.append(f"{mean} % [{low}, {high}]")
        acts = np.mean([len(row["acts"]) for row in of_method])
        seconds = np.mean([row["seconds"] for row in of_method])
        print(f"| {method} | {len(of_method)} | {shares[0]} | {shares[1]} | {acts:.1f} | {seconds:.1f} |")


if __name__ == "__main__":
    main()
