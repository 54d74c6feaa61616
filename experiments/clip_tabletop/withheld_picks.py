"""How often does a policy pick the named part, if its CLIP never read the part's name (Table A3)?

A checkpoint plays test episodes of pick-object-part-in-brown-box, each of which asks for every part once. Picks of
withheld parts and of kept ones are counted apart.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from tqdm import tqdm

from experiments.clip_tabletop.part_peaks import TASKS
from experiments.clip_tabletop.withheld import LISTS, Withheld
from gem_lite import clip, language, tasks
from gem_lite.evaluation import results, statistics
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.evaluation.rollout import rollout
from gem_lite.policies import checkpoints
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.world import World

TASK = TASKS[0]
IDENTITY = ("kind", "method", "withheld_list", "task", "world", "clip_fingerprint", "checkpoint_sha256")
"""The entries that identify a row of the results."""
STATES = ("withheld", "kept")


def is_withheld(instruction: str, withheld: Withheld) -> bool:
    """Whether the sentence's part is withheld. Raises ValueError if it names no part of an object."""
    phrase = str(language.parse(instruction).pick)
    for noun in objects.NAMES:
        for part in objects.part_names(noun):
            if phrase == f"{noun} {part}":
                return withheld.names(noun, part)
    raise ValueError(f"the sentence must name a part of an object, got {instruction!r}")


def measure(
    checkpoint: Path, withheld_list: str, clip_name: str | None, world_name: str, episodes: int, path: Path
) -> dict:
    """A row for a checkpoint, filed in ``path``.

    Raises:
        ValueError: ``episodes`` below 1, an unknown list, a checkpoint that cannot act, or ``path`` holds a row over
            more episodes.
        FileNotFoundError: no such checkpoint.
        OSError: ``path`` cannot be written.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    if withheld_list not in LISTS or not LISTS[withheld_list].parts:
        lists = ", ".join(name for name, words in LISTS.items() if words.parts)
        raise ValueError(f"withheld must be one of {lists}, got {withheld_list!r}")
    withheld = LISTS[withheld_list]
    card = checkpoints.read_card(checkpoint)
    measurement = Measurement(
        card["method"], TASK, episodes, checkpoint=checkpoint, clip_name=clip_name, world=world_name
    )
    config = measurement.acting_config
    actor = measurement.actor(0)
    model = clip.load(clip_name)
    shares: dict[str, list[float]] = {state: [] for state in STATES}
    with World(style=looks.style(world_name)) as world:
        for index in tqdm(range(episodes), "episodes", unit="episode"):
            task = tasks.make(TASK, "test")
            right: dict[str, list[float]] = defaultdict(list)
            for turn in rollout(world, task, tasks.episode_seed("test", index), actor):
                state = STATES[not is_withheld(turn.instruction, withheld)]
                right[state].append(float(turn.result.reward > 0))
            for state in STATES:
                shares[state].append(float(np.mean(right[state])))
    row = {
        "kind": "withheld-picks", "method": card["method"], "task": TASK, "world": world_name, "split": "test",
        "withheld_list": withheld_list, "episodes": episodes, "demos": card["demos"], "seed": card["seed"],
        "steps": config.steps, "checkpoint_sha256": card["sha256"], "config": config.name,
        "config_hash": config.digest, "clip": model.name, "clip_fingerprint": model.fingerprint,
        **{state: entries(shares[state]) for state in STATES}, "date": datetime.now(UTC).date().isoformat(),
    }  # fmt: skip
    results.file_rows([row], path, IDENTITY)
    return row


def entries(shares: Sequence[float]) -> dict:
    """The mean and interval (0-100) of each episode's share of right picks, with these shares."""
    mean, ci95 = statistics.mean_and_interval(shares)
    return {"mean": mean, "ci95": ci95, "rewards": np.round(shares, 4).tolist()}


def described(rows: Sequence[dict]) -> str:
    """A line for each row, then the difference of two methods, paired by episode, over their training seeds.

    Rows with other numbers of demonstrations, worlds, or CLIPs have differences of their own.
    """

    def cell(row: dict, state: str) -> str:
        low, high = row[state]["ci95"]
        return f"{row[state]['mean']:.1f} [{low:.1f}, {high:.1f}]"

    def conditions(row: dict) -> tuple:
        return row["demos"], row["world"], row["clip_fingerprint"]

    rows = sorted(rows, key=lambda row: (conditions(row), row["method"], row["seed"]))
    lines = [f"{'method':32}{'demos':>6}{'seed':>6}{'withheld parts':>22}{'kept parts':>22}"]
    for row in rows:
        cells = "".join(f"{cell(row, state):>22}" for state in STATES)
        lines.append(f"{row['method']:32}{row['demos']:6}{row['seed']:6}{cells}")
    for (demos, *_), group in itertools.groupby(rows, conditions):
        of_conditions = list(group)
        names = list(dict.fromkeys(row["method"] for row in of_conditions))
        for state in STATES if len(names) == 2 else ():
            ours, theirs = ([row[state]["rewards"] for row in of_conditions if row["method"] == name] for name in names)
            difference = statistics.paired_difference(ours, theirs)
            lines.append(f"{names[0]} minus {names[1]}, {demos} demonstrations, {state} parts: {difference}")
    return "\n".join(lines)
