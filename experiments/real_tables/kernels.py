"""Do the two parts of an object have different pick kernels (Figure A2)?"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch
from kernel_cosines import centred_cosines, cosines, pick_kernels

from gem_lite.clip import Clip
from gem_lite.evaluation import results
from gem_lite.policies import checkpoints
from gem_lite.policies.gem import Gem
from gem_lite.simulation.bodies import objects
from gem_lite.tasks.pick_object_part import SEEN

BLOCKS = ("blue block", "red block")
FIGURE_A2 = (*BLOCKS, "scissors blade", "scissors handle")
PARTS = tuple(f"{name} {part}" for name in SEEN for part in objects.part_names(name))
"""The pick phrases of pick-object-part-in-brown-box."""
PHRASES = (*PARTS, *BLOCKS)
"""The mean that is subtracted is that of their kernels."""
BAR = 0.9
"""Two grasps differ if the cosine of their kernels is below this."""
UNTRAINED = 5
"""So many policies with random weights are asked the same."""
IDENTITY = ("kind", "object", "checkpoint_sha256")
"""The entries that identify a row of the results."""


def load(path: Path, model: Clip) -> Gem:
    """The policy of a checkpoint.

    Raises:
        ValueError: it is none of GEM's, or `checkpoints.load_policy` refuses it.
        FileNotFoundError: it is missing.
    """
    policy = checkpoints.load_policy(path, model)
    if not isinstance(policy, Gem):
        raise ValueError(f"the checkpoint must hold a policy of GEM, whose kernels words make, got {policy.name}")
    return policy


def both_cosines(policy: Gem) -> dict[str, np.ndarray]:
    """The cosines (N, N) of the pick kernels of `PHRASES`: as they are, and after their mean is subtracted."""
    kernels = pick_kernels(policy, PHRASES)
    return {"cosine": cosines(kernels).numpy(), "centred_cosine": centred_cosines(kernels).numpy()}


def measure(path: Path, policy: Gem) -> list[dict]:
    """A row for each seen object, of a policy that ``path`` holds."""
    card = checkpoints.read_card(path)
    trained = both_cosines(policy)
    untrained = [both_cosines(Gem(policy.config, policy.clip, seed=seed)) for seed in range(UNTRAINED)]
    rows = []
    for name in SEEN:
        one, other = (PHRASES.index(f"{name} {part}") for part in objects.part_names(name))
        numbers = {key: round(float(table[one, other]), 4) for key, table in trained.items()}
        of_untrained = {
            f"untrained_{key}": [round(float(tables[key][one, other]), 4) for tables in untrained] for key in trained
        }
        rows.append({
            "kind": "kernels", "method": card["method"], "object": name, "parts": list(objects.part_names(name)),
            **numbers, **of_untrained, "tasks": card["task"].split(" + "), "demos": card["demos"], "seed": card["seed"],
            "world": card["demonstrations_world"], "checkpoint_sha256": card["sha256"], "config": policy.config.name,
            "config_hash": policy.config.digest, "clip": policy.clip.name, "clip_fingerprint": policy.clip.fingerprint,
            "episodes": 0, "date": datetime.now(UTC).date().isoformat(),
        })  # fmt: skip
    return rows


def file(rows: list[dict], path: Path) -> None:
    """File the rows of `measure`. Raises OSError if ``path`` cannot be written."""
    results.file_rows(rows, path, IDENTITY)


def described(rows: list[dict]) -> str:
    """The rows as a table, and how many objects are below `BAR`, for the policy and for random weights."""
    titles = ("object", "parts", "cosine", "centred")
    lines = ["{:18}{:20}{:>8}{:>9}".format(*titles)]
    for row in rows:
        parts = ", ".join(row["parts"])
        lines.append(f"{row['object']:18}{parts:20}{row['cosine']:8.2f}{row['centred_cosine']:9.2f}")
    for key, title in (("cosine", "as they are"), ("centred_cosine", "their mean subtracted")):
        below = sum(row[key] < BAR for row in rows)
        below_untrained = np.array([row[f"untrained_{key}"] for row in rows]) < BAR  # (objects, seeds)
        counts = ", ".join(map(str, below_untrained.sum(axis=0)))
        lines.append(f"below {BAR}, {title}: {below} of {len(rows)} objects; random weights: {counts}")
    return "\n".join(lines)


def of_figure_a2(policy: Gem) -> tuple[torch.Tensor, dict[str, np.ndarray]]:
    """For the phrases of `FIGURE_A2` the kernels (4, C, h, h) and `both_cosines` (4, 4)."""
    places = [PHRASES.index(phrase) for phrase in FIGURE_A2]
    return pick_kernels(policy, FIGURE_A2), {
        key: table[np.ix_(places, places)] for key, table in both_cosines(policy).items()
    }
