"""SE(2) augmentation: one rigid motion moves images, semantic maps and action labels together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from gem_lite.se2 import ImageMotion

TRIES = 100


@dataclass(frozen=True)
class Sample:
    """One demonstrated step in the form that training reads.

    Attributes:
        image: (6, H, W): RGB-D, then the pick and the place semantic map.
        pick, place: pixels (row, col), not rounded.
        pick_yaw: the grasp's yaw (radians); ``delta``: place minus pick yaw.
        pick_symmetry, place_symmetry: turns that change nothing, see `tasks.ExpertAction`.
        pick_words, place_words: (D,) text embeddings.
    """

    image: torch.Tensor
    pick: tuple[float, float]
    place: tuple[float, float]
    pick_yaw: float
    delta: float
    pick_symmetry: float
    place_symmetry: float
    pick_words: torch.Tensor
    place_words: torch.Tensor


def random_motion(rng: np.random.Generator, shape: tuple[int, int], keep: list[tuple[float, float]]) -> ImageMotion:
    """A random turn and shift under which the pixels ``keep`` stay inside; the identity if none is found.

    The turn is uniform, the shift normal with a sixth of the map's shorter side.
    """
    spread = min(shape) / 6
    for _ in range(TRIES):
        motion = ImageMotion(float(rng.uniform(-np.pi, np.pi)), tuple(rng.normal(0, spread, 2).tolist()))
        moved = [motion.move(pixel, shape) for pixel in keep]
        if all(0 <= round(row) < shape[0] and 0 <= round(col) < shape[1] for row, col in moved):
            return motion
    return ImageMotion(0.0, (0.0, 0.0))


def apply(motion: ImageMotion, sample: Sample) -> Sample:
    """Move a whole sample: the pick's yaw turns along, the relative place angle does not."""
    shape = sample.image.shape[-2:]
    return replace(
        sample,
        image=motion.warp(sample.image[None])[0],
        pick=motion.move(sample.pick, shape),
        place=motion.move(sample.place, shape),
        pick_yaw=sample.pick_yaw + motion.angle,
    )
