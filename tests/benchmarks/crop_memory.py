"""Seconds to retrieve a crop, in one product and entry by entry: python tests/benchmarks/crop_memory.py"""

from collections.abc import Sequence

import numpy as np
import torch
from timing import seconds
from torch.nn import functional

from gem_lite.maps.crop_memory import CropEntry, CropMemory

SIZES = (100, 1000, 5000)
THRESHOLD = 0.5
REPEATS = 20


class RandomClip:
    """Random embeddings as long as ViT-B/32's: what a retrieval costs does not depend on their meaning."""

    dim = 512

    def __init__(self) -> None:
        self.generator = torch.Generator().manual_seed(0)

    def embed_texts(self, phrases: Sequence[str]) -> torch.Tensor:
        return functional.normalize(torch.randn(len(phrases), self.dim, generator=self.generator), dim=1)

    embed_images = embed_texts


def one_by_one(memory: CropMemory, query: torch.Tensor, threshold: float) -> torch.Tensor | None:
    """What `CropMemory.retrieve` returns, with one cosine at a time."""
    best, nearest = 0, -1.0
    for index, key in enumerate(memory.keys):
        cosine = float(key @ query)
        if cosine > nearest:
            best, nearest = index, cosine
    return memory.values[best] if nearest >= threshold else None


def main() -> None:
    """Print both times and their ratio for every size; both must find the same crop."""
    clip, picture = RandomClip(), np.zeros((20, 20, 3), np.uint8)
    print(f"{clip.dim} numbers an embedding, {torch.get_num_threads()} threads")
    for size in SIZES:
        memory = CropMemory([CropEntry(f"thing {i}", picture, "t", i) for i in range(size)], clip)
        wanted = size * 2 // 3
        query = functional.normalize(memory.keys[wanted] + 0.3 * clip.embed_texts(["noise"])[0], dim=0)
        fast, by_product = seconds(lambda memory=memory, query=query: memory.retrieve(query, THRESHOLD), REPEATS)
        slow, by_loop = seconds(lambda memory=memory, query=query: one_by_one(memory, query, THRESHOLD), REPEATS)
        for found in (by_product, by_loop):
            assert found is not None and torch.equal(found, memory.values[wanted])
        print(f"{size:5d} entries: {fast * 1e3:6.3f} ms; one by one {slow * 1e3:7.3f} ms, {slow / fast:.0f} times that")


if __name__ == "__main__":
    main()
