"""The demonstrations' crops at pick and place, and their retrieval by phrase (Eq. 2, A.7)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from gem_lite.se2 import Pose2
from gem_lite.tabletop.heightmap import HeightMap

if TYPE_CHECKING:
    from gem_lite.clip import Clip


@dataclass(frozen=True)
class CropEntry:
    """One event of a demonstration: what was acted on, in words and as a picture."""

    phrase: str
    image: np.ndarray
    episode: int


class CropMemory:
    """A database of (phrase, crop) pairs, embedded once.

    Attributes:
        entries: what is in it.
        keys: (N, D) text embeddings of the phrases, K of Eq. 2.
        values: (N, D) image embeddings of the crops, E_crop of Eq. 3.
    """

    def __init__(self, entries: Iterable[CropEntry], clip: Clip) -> None:
        self.entries = list(entries)
        if not self.entries:
            raise ValueError("entries is empty: a crop memory needs at least one demonstrated crop")
        self.keys = clip.embed_texts([entry.phrase for entry in self.entries]).cpu()
        self.values = clip.embed_images(np.stack([entry.image for entry in self.entries])).cpu()
        self._episodes = torch.tensor([entry.episode for entry in self.entries])

    def find(self, query: torch.Tensor, exclude_episode: int | None = None) -> tuple[int, float] | None:
        """Index and cosine of the nearest phrase to a text embedding (D,); None if nothing may be searched."""
        similarity = self.keys @ query
        if exclude_episode is not None:
            similarity = similarity.masked_fill(self._episodes == exclude_episode, -torch.inf)
        best = int(similarity.argmax())
        return None if torch.isinf(similarity[best]) else (best, float(similarity[best]))

    def retrieve(
        self, query: torch.Tensor, threshold: float, exclude_episode: int | None = None
    ) -> torch.Tensor | None:
        """QueriedCrop (Eq. 2): the image embedding (D,) of the nearest phrase's crop, None below ``threshold``."""
        found = self.find(query, exclude_episode)
        return None if found is None or found[1] < threshold else self.values[found[0]]


def cut(heightmap: HeightMap, pose: Pose2, side: float) -> np.ndarray:
    """The square of ``side`` metres around a pose, moved inside the map where it would stick out."""
    size = round(side / heightmap.workspace.pixel)
    row, col = heightmap.workspace.nearest_cell(pose.x, pose.y)
    height, width = heightmap.rgb.shape[:2]
    top, left = np.clip(row - size // 2, 0, height - size), np.clip(col - size // 2, 0, width - size)
    return heightmap.rgb[top : top + size, left : left + size]
