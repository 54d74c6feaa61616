"""SE(2) augmentation: one rigid motion moves images, semantic maps and action labels together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from gem_lite.policies.samples import RGBD, Sample
from gem_lite.se2 import ImageMotion

TRIES = 100


def random_motion(
    rng: np.random.Generator, shape: tuple[int, int], keep: list[tuple[float, float]], turn: bool = True
) -> ImageMotion:  # fmt: skip
    """A random turn and shift under which the pixels ``keep`` stay inside; the identity if none is found.

    The turn is uniform, the shift normal with a sixth of the map's shorter side.

    Args:
        turn: whether to turn at all.
    """
    spread = min(shape) / 6
    for _ in range(TRIES):
        angle = float(rng.uniform(-np.pi, np.pi)) if turn else 0.0
        motion = ImageMotion(angle, tuple(rng.normal(0, spread, 2).tolist()))
        moved = [motion.move(pixel, shape) for pixel in keep]
        if all(0 <= round(row) < shape[0] and 0 <= round(col) < shape[1] for row, col in moved):
            return motion
    return ImageMotion(0.0, (0.0, 0.0))


def recolored(rng: np.random.Generator, sample: Sample) -> Sample:
    """Exchange the colour channels of a sample's picture and scale each by 0.5 to 1.5; maps and height stay.

    What the maps say of colours stays true, what the picture says does not: so a network must listen to the
    maps, and cannot learn the demonstrations' colours by heart.
    """
    image = sample.image.clone()
    gain = torch.from_numpy(rng.uniform(0.5, 1.5, 3)).to(image)
    image[:3] = image[rng.permutation(3).tolist()] * gain[:, None, None]
    return replace(sample, image=image)


def rescaled(rng: np.random.Generator, sample: Sample, gain: tuple[float, float], offset: float) -> Sample:
    """Multiply each of a sample's semantic maps by a random factor in ``gain`` and add at most +-``offset``.

    How strongly a map answers to an object differs between scenes; which object it answers to most does not. So a
    network must compare a map's answers, and cannot learn a threshold by heart.
    """
    image = sample.image.clone()
    maps = image[RGBD:]  # (M, H, W); M is 0 for methods without semantic maps
    factor = torch.from_numpy(rng.uniform(*gain, len(maps))).to(image)
    shift = torch.from_numpy(rng.uniform(-offset, offset, len(maps))).to(image)
    image[RGBD:] = maps * factor[:, None, None] + shift[:, None, None]
    return replace(sample, image=image)


def apply(motion: ImageMotion, sample: Sample) -> Sample:
    """Move a whole sample: the pick's yaw turns along, the relative place angle does not."""
    shape = sample.image.shape[-2:]
    scale = [few / many for few, many in zip(sample.coarse.shape[-2:], shape, strict=True)]
    coarse = ImageMotion(motion.angle, (motion.shift[0] * scale[0], motion.shift[1] * scale[1]))
    return replace(
        sample,
        image=motion.warp(sample.image[None])[0],
        coarse=coarse.warp(sample.coarse[None])[0],
        pick=motion.move(sample.pick, shape),
        place=motion.move(sample.place, shape),
        pick_yaw=sample.pick_yaw + motion.angle,
    )
