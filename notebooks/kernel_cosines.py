"""Do pick kernels listen (Fig. A2)? Cosines of the kernels of phrases that want the same grasp, and of others.

The pairs of phrases are in data/kernel_pairs.csv. They were written before any policy for several tasks was trained.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from gem_lite.foundations.files import DATA
from gem_lite.policies.gem import Gem

PAIRS = DATA / "kernel_pairs.csv"


@dataclass(frozen=True)
class PhrasePair:
    """Two phrases, whether they want the same grasp, and why."""

    phrase: str
    other: str
    same_grasp: bool
    why: str


def read_pairs(path: Path = PAIRS) -> list[PhrasePair]:
    """The pairs of a CSV file with the columns phrase, other, same_grasp (0 or 1) and why.

    Raises:
        ValueError: ``same_grasp`` is neither 0 nor 1.
    """
    pairs = []
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["same_grasp"] not in ("0", "1"):
                raise ValueError(f"same_grasp must be 0 or 1, got {row['same_grasp']!r} in {path}")
            pairs.append(PhrasePair(row["phrase"], row["other"], row["same_grasp"] == "1", row["why"]))
    return pairs


@torch.inference_mode()
def pick_kernels(policy: Gem, phrases: Sequence[str]) -> torch.Tensor:
    """The unrotated pick kernels psi(phrase) (Eq. 9), (N, C, h, h) on the CPU."""
    words = torch.stack([policy.embed_words(phrase) for phrase in phrases]).to(policy.device)
    return policy.pick.kernel(words).float().cpu()


def cosines(vectors: torch.Tensor) -> torch.Tensor:
    """The cosines (N, N) of vectors (N, ...)."""
    unit = torch.nn.functional.normalize(vectors.flatten(1), dim=1)
    return unit @ unit.T


def centred_cosines(kernels: torch.Tensor) -> torch.Tensor:
    """The cosines (N, N) of kernels (N, C, h, h) after their mean is subtracted.

    What all kernels share says nothing about what they listen to; with it, all cosines would be near 1.
    """
    return cosines(kernels - kernels.mean(dim=0))


def pair_cosines(policy: Gem, pairs: Sequence[PhrasePair]) -> np.ndarray:
    """The centred cosine of each pair's kernels, (N,). The mean is that of all different phrases of the pairs."""
    phrases = list(dict.fromkeys(phrase for pair in pairs for phrase in (pair.phrase, pair.other)))
    of_phrases = centred_cosines(pick_kernels(policy, phrases))
    return np.array([float(of_phrases[phrases.index(pair.phrase), phrases.index(pair.other)]) for pair in pairs])
