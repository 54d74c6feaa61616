"""How often a policy succeeds when its cameras err: one row for each kind and size of error.

Kinds and sizes are those of gem_lite/rgbd/sensor_errors.py. Only what the policy sees is corrupted: its actions are
carried out in the true world. Every cell plays the same episodes, and episode i draws its errors from the same random
numbers in every cell, so that a larger error is a multiple of a smaller one and cells can be compared in pairs. Cells
that the file holds already are skipped: after a kill, the same command goes on. In a row, ``subset`` names the cell,
and ``kind``, ``level``, ``errors`` and ``error_seed`` say what it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.evaluation import actors, evaluate, results
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.rollout import Actor, Chosen, Observations
from gem_lite.policies.base import Policy
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd import levelling
from gem_lite.rgbd.sensor_errors import HARD, KINDS, NOMINAL, SHARES, SensorErrors, Unit, corrupt, draw_units
from gem_lite.se2 import Pose2
from gem_lite.simulation import looks
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.world import World

IDENTITY = (*results.IDENTITY, "error_seed")
"""The entries that identify a row; ``subset`` names the kind of error and its size."""
NOT_SCALED = ("mixed", "invalid", "occlusion")


def only(kind: str, errors: SensorErrors = NOMINAL, factor: float = 1.0) -> SensorErrors:
    """One kind of error alone, at ``factor`` times its size in ``errors``.

    Fractions stop at 1. What becomes of edges, and occlusion, which is geometry, are not scaled.

    Args:
        kind: one of `KINDS`.
        factor: a finite number of at least 0.
    """
    chosen: dict = {name: getattr(errors, name) for name in KINDS[kind]}
    for name in set(chosen) - set(NOT_SCALED):
        value = chosen[name] * factor
        chosen[name] = round(value) if "fattening" in name else min(value, 1.0) if name in SHARES else value
    return SensorErrors(errors.baseline, **chosen)


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


def erring_actor(policy: Policy, cell: Cell, seed: int, index: int) -> Actor:
    """An actor for episode ``index``: its policy acts in the true world on what erring cameras show."""
    unit_rng, frame_rng = (np.random.default_rng(part) for part in np.random.SeedSequence((seed, index)).spawn(2))
    act = actors.policy_actor(policy)
    units: tuple[Unit, ...] = ()

    def actor(
        environment: Environment, observations: Observations, empty_picks: Sequence[Pose2]
    ) -> Chosen | None:  # fmt: skip
        nonlocal units
        (observation,) = observations
        units = units or draw_units(observation, cell.errors, unit_rng)
        seen = corrupt(observation, units, frame_rng)
        if cell.levelled:
            seen = levelling.levelled(seen)
        return act(environment, (seen,), empty_picks)

    return actor


def row_of(cell: Cell, episodes: Sequence[Episode], facts: dict) -> dict:
    """The row of a cell."""
    more = {"kind": cell.kind, "level": cell.level, "errors": asdict(cell.errors), "levelled": cell.levelled}
    return results.result_row(facts["method"], facts["task"], episodes, cell.name, {**facts, **more})


def is_done(cell: Cell, facts: dict, rows: Sequence[dict], episodes: int) -> bool:
    """Whether ``rows`` hold this cell with the same facts over at least as many episodes.

    Rows of earlier versions lack errors that a camera may have now: these were off.
    """
    wanted = {**facts, "subset": cell.name}
    same = [row for row in rows if wanted.items() <= row.items() and SensorErrors(**row["errors"]) == cell.errors]
    return any(row["episodes"] >= episodes for row in same)


def measure(
    checkpoint: Path, task: str, split: tasks.Split, world: str, episodes: int, seed: int, out: Path,
    kinds: Sequence[str],
) -> None:  # fmt: skip
    """Measure the cells of some kinds that the file ``out`` lacks, and file each as soon as it is measured.

    Args:
        episodes: of each cell, from 0 on.
        seed: of the errors.
        kinds: among none, all and `KINDS`; empty for every kind.

    Raises:
        ValueError: there is no episode, a kind or the world is unknown, or the policy was trained for another table.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    known = ("none", "all", *KINDS)
    unknown = [kind for kind in kinds if kind not in known]
    if unknown:
        raise ValueError(f"kinds must be of {', '.join(known)}, got {', '.join(unknown)}")
    policy = load_policy(checkpoint, clip.load())
    evaluate.check_table(checkpoint, policy.config.workspace, tasks.make(task, split).workspace, task)
    facts = {"method": policy.name, "task": task, **results.policy_entries(read_card(checkpoint), policy.config)}
    facts |= {"world": world, "split": split, "start": 0, "error_seed": seed}
    rows = results.read_rows(out)
    chosen = [cell for cell in cells() if not kinds or cell.kind in kinds]
    missing = [cell for cell in chosen if not is_done(cell, facts, rows, episodes)]
    print(f"{len(chosen) - len(missing)} of {len(chosen)} cells are in {out}")
    with World(style=looks.style(world)) as home, tqdm(total=len(missing) * episodes, unit="episode") as bar:
        for cell in missing:
            bar.set_description(cell.name)
            played = []
            for index in range(episodes):
                actor = erring_actor(policy, cell, seed, index)
                played.append(evaluate.run_episode(home, actor, task, split, index))
                bar.update()
            row = row_of(cell, played, facts)
            results.file_rows([row], out, IDENTITY)
            bar.write("{kind}, {level}: {mean} {ci95}, {episodes} episodes".format(**row))
