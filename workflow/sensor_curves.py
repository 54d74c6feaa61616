"""How often a policy succeeds when its cameras err: one row for each kind and size of error.

Kinds and sizes are those of `gem_lite.rgbd.sensor_errors`. Only what the policy sees is corrupted: its actions are
carried out in the true world. Every cell plays the same episodes, and episode i draws its errors from the same random
numbers in every cell, so that a larger error is a multiple of a smaller one and cells can be compared in pairs. Cells
that the file holds already are skipped: after a kill, the same command goes on. In a row, ``subset`` names the cell,
and ``kind``, ``level``, ``errors`` and ``error_seed`` say what it is.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.evaluation import actors, evaluate, results
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.rollout import Decision, Observations
from gem_lite.policies import methods
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd import levelling
from gem_lite.rgbd.sensor_errors import HARD, KINDS, NOMINAL, SensorErrors, Unit, corrupt, draw_units, only
from gem_lite.se2 import Pose2
from gem_lite.simulation import worlds
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.world import World

TASK = "put-block-in-bowl-seen-colors"
CHECKPOINT = clip.DATA / "gem-put-block-in-bowl.safetensors"
FILE = results.RUNS / "sensor-errors.jsonl"
"""Rows go here without --out; those that are published are in data/results."""
IDENTITY = (*results.IDENTITY, "error_seed")
"""The entries that identify a row; ``subset`` names the kind of error and its size."""


@dataclass(frozen=True)
class Cell:
    """One point of a curve: a kind of error, the name of its size, and the sizes themselves."""

    kind: str
    level: str
    errors: SensorErrors
    levelled: bool = False
    """Whether the poses are corrected by the flat table (`rgbd.levelling`) before the policy sees them."""

    @property
    def name(self) -> str:
        """As rows hold it in ``subset``."""
        return f"sensor errors: {self.kind}, {self.level}{', levelled' if self.levelled else ''}"


def cells() -> list[Cell]:
    """All cells, the most telling ones first."""
    found = [
        Cell("none", "clean", SensorErrors()),
        Cell("all", "nominal", NOMINAL),
        Cell("all", "hard", HARD),
        Cell("all", "hard", HARD, levelled=True),
        Cell("rotation", "hard", only("rotation", HARD), levelled=True),
        Cell("rotation", "2 x hard", only("rotation", HARD, 2.0), levelled=True),
    ]
    for level in ("hard", "2 x hard", "nominal"):
        for kind in KINDS:
            base, factor = (NOMINAL if level == "nominal" else HARD), (2.0 if level == "2 x hard" else 1.0)
            if kind == "quantisation":  # its nominal and hard sizes are the same
                factor = {"nominal": 1.0, "hard": 4.0, "2 x hard": 8.0}[level]
                found.append(Cell(kind, f"{factor:.0f} x nominal", only(kind, NOMINAL, factor)))
            else:
                found.append(Cell(kind, level, only(kind, base, factor)))
    return found


class ErringEyes:
    """An actor whose policy sees through erring cameras."""

    def __init__(self, policy: PickPlacePolicy, cell: Cell, seed: int) -> None:
        self.actor = actors.policy_actor(policy)
        self.errors = cell.errors
        self.workspace = policy.config.workspace if cell.levelled else None
        self.seed = seed
        self.units: tuple[Unit, ...] = ()
        self.frames = np.random.default_rng()

    def begin(self, index: int) -> None:
        """Forget the cameras of the episode before; those of episode ``index`` are drawn at its first look."""
        unit_seed, frame_seed = np.random.SeedSequence((self.seed, index)).spawn(2)
        self.unit_rng, self.frames = np.random.default_rng(unit_seed), np.random.default_rng(frame_seed)
        self.units = ()

    def __call__(
        self, environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]
    ) -> Decision | None:  # fmt: skip
        """The policy's decision in the true world, from what the erring cameras show."""
        (observation,) = observations
        self.units = self.units or draw_units(observation, self.errors, self.unit_rng)
        seen = corrupt(observation, self.units, self.frames)
        if self.workspace is not None:
            seen = levelling.levelled(seen, self.workspace)
        return self.actor(environment, (seen,), empty_picks)


def row_of(cell: Cell, episodes: Sequence[Episode], facts: dict) -> dict:
    """The row of a cell."""
    more = {"kind": cell.kind, "level": cell.level, "errors": asdict(cell.errors), "levelled": cell.levelled}
    name = facts["method"], facts["task"]
    return results.result_row(*name, episodes, cell.name, {**facts, **more})


def is_done(cell: Cell, facts: dict, rows: Sequence[dict], episodes: int) -> bool:
    """Whether ``rows`` hold this cell with the same facts over at least as many episodes."""
    wanted = {**facts, "subset": cell.name, "errors": asdict(cell.errors)}
    return any(wanted.items() <= row.items() and row["episodes"] >= episodes for row in rows)


def measure(
    checkpoint: Path, task_name: str, split: tasks.Split, world: str, episodes: int, seed: int, path: Path,
    chosen: Sequence[Cell],
) -> None:  # fmt: skip
    """Measure the cells that ``path`` lacks, and file each as soon as it is measured."""
    policy = load_policy(checkpoint, clip.load())
    trained, asked = (one.workspace.length for one in (policy.config, tasks.make(task_name, split)))
    if trained != asked:
        raise ValueError(
            f"the checkpoint {checkpoint} was trained for a table {trained} m long; the task's is {asked} m"
        )
    card = read_card(checkpoint)
    facts = {"method": policy.name, "task": task_name, **results.facts_of(card, methods.of_card(card)[1])}
    facts |= {"world": world, "split": split, "start": 0, "error_seed": seed}
    rows = results.read_rows(path)
    missing = [cell for cell in chosen if not is_done(cell, facts, rows, episodes)]
    print(f"{len(chosen) - len(missing)} of {len(chosen)} cells are in {path}")
    with World(style=worlds.style(world)) as home, tqdm(total=len(missing) * episodes, unit="episode") as bar:
        for cell in missing:
            bar.set_description(cell.name)
            eyes = ErringEyes(policy, cell, seed)
            played = []
            for index in range(episodes):
                eyes.begin(index)
                played.append(evaluate.run_episode(home, eyes, task_name, split, index))
                bar.update()
            row = row_of(cell, played, facts)
            results.file_rows([row], path, IDENTITY)
            bar.write("{kind}, {level}: {mean} {ci95}, {episodes} episodes".format(**row))


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", type=Path, default=CHECKPOINT, help="policy to measure (%(default)s)")
    parser.add_argument("--task", default=TASK, help="name of the task (%(default)s)")
    parser.add_argument("--split", default="test", choices=("train", "val", "test"), help="of the episodes (test)")
    parser.add_argument("--world", default="home", help="looks of the world (%(default)s)")
    parser.add_argument("--episodes", type=int, default=30, help="episodes of a cell, from 0 on (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the errors (%(default)s)")
    parser.add_argument("--out", type=Path, default=FILE, help="file of rows (%(default)s)")
    parser.add_argument("--kinds", nargs="+", metavar="KIND", help=f"only these: none, all, {', '.join(KINDS)}")
    arguments = parser.parse_args()
    if arguments.episodes < 1:
        parser.error(f"--episodes must be at least 1, got {arguments.episodes}")
    wrong = set(arguments.kinds or ()) - {"none", "all", *KINDS}
    if wrong:
        parser.error(f"--kinds must be among none, all, {', '.join(KINDS)}, got {', '.join(sorted(wrong))}")
    torch.set_num_threads(1)
    chosen = [cell for cell in cells() if arguments.kinds is None or cell.kind in arguments.kinds]
    try:
        measure(
            arguments.checkpoint, arguments.task, arguments.split, arguments.world, arguments.episodes, arguments.seed,
            arguments.out, chosen,
        )  # fmt: skip
    except (OSError, ValueError) as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()
