"""SE(2) augmentation: one rigid motion moves images, semantic maps and action labels together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from gem_lite.policies.samples import Sample
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
    """Exchange the colour channels of a sample's picture and scale each by 0.5 to 1.5; all else stays.

    What maps and features say of colours stays true, what the picture says does not: so a network must listen to
    them, and cannot learn the demonstrations' colours by heart.
    """
    rgbd = sample.rgbd.clone()
    gain = torch.from_numpy(rng.uniform(0.5, 1.5, 3)).to(rgbd)
    rgbd[:3] = rgbd[rng.permutation(3).tolist()] * gain[:, None, None]
    return replace(sample, rgbd=rgbd)


def rescaled(rng: np.random.Generator, sample: Sample, gain: tuple[float, float], offset: float) -> Sample:
    """Multiply each of a sample's semantic maps by a random factor in ``gain`` and add at most +-``offset``.

    How strongly a map answers to an object differs between scenes; which object it answers to most does not. So a
    network must compare a map's answers, and cannot learn a threshold by heart.
    """
    count = len(sample.maps)  # 0 for methods without semantic maps
    factors = torch.from_numpy(rng.uniform(*gain, count)).to(sample.rgbd)
    shifts = torch.from_numpy(rng.uniform(-offset, offset, count)).to(sample.rgbd)
    changes = zip(sample.maps.items(), factors, shifts, strict=True)
    return replace(sample, maps={name: semantic * factor + shift for (name, semantic), factor, shift in changes})


def apply(motion: ImageMotion, sample: Sample) -> Sample:
    """Move a whole sample: the pick's yaw turns along, the relative place angle does not."""
    shape = sample.rgbd.shape[-2:]
    # Picture and maps have the same resolution, so one warp moves them all.
    fine = motion.warp(torch.cat([sample.rgbd, *sample.maps.values()])[None])[0]
    rgbd, *maps = fine.split([len(sample.rgbd), *(len(semantic) for semantic in sample.maps.values())])
    return replace(
        sample,
        rgbd=rgbd,
        maps=dict(zip(sample.maps, maps, strict=True)),
        features={name: _warp_coarse(motion, feature, shape) for name, feature in sample.features.items()},
        pick=motion.move(sample.pick, shape),
        place=motion.move(sample.place, shape),
        pick_yaw=sample.pick_yaw + motion.angle,
    )


def _warp_coarse(motion: ImageMotion, feature: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Move features (D, h, w) as ``motion`` moves a picture of ``shape`` (H, W): their cells are larger."""
    scale = [few / many for few, many in zip(feature.shape[-2:], shape, strict=True)]
    coarse = ImageMotion(motion.angle, (motion.shift[0] * scale[0], motion.shift[1] * scale[1]))
    return coarse.warp(feature[None])[0]
