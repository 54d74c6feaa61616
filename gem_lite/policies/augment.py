"""SE(2) augmentation: one rigid motion moves images, semantic maps and action labels together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from gem_lite.policies.inputs import TABLE_GRAY, Sample
from gem_lite.se2 import ImageMotion

TRIES = 100


def random_motion(
    rng: np.random.Generator, shape: tuple[int, int], keep: list[tuple[float, float]], turn: bool = True
) -> ImageMotion:  # fmt: skip
    """A random turn and shift that keeps the pixels ``keep`` inside the map. After `TRIES` failures, the identity.

    The turn is uniform. The shift is normal; its standard deviation is a sixth of the map's shorter side.

    Args:
        turn: whether to turn; otherwise the motion is a shift.
    """
    spread = min(shape) / 6
    for _ in range(TRIES):
        angle = float(rng.uniform(-np.pi, np.pi)) if turn else 0.0
        motion = ImageMotion(angle, tuple(rng.normal(0, spread, 2).tolist()))
        pixels = [motion.move(pixel, shape) for pixel in keep]
        if all(0 <= round(row) < shape[0] and 0 <= round(col) < shape[1] for row, col in pixels):
            return motion
    return ImageMotion(0.0, (0.0, 0.0))


def moved(rng: np.random.Generator, sample: Sample, turn: bool = True) -> Sample:
    """A sample moved by a `random_motion` that keeps pick and place on the table."""
    rows, cols = sample.rgbd.shape[-2:]
    return apply(random_motion(rng, (rows, cols), [sample.pick, sample.place], turn), sample)


def recolored(rng: np.random.Generator, sample: Sample) -> Sample:
    """Permute the colour channels of a sample's picture and scale each by 0.5 to 1.5. All else stays.

    The maps and features of a colour stay right; the picture's colours do not. So a network must use the maps and
    features, and cannot memorize the colours of the demonstrations.
    """
    rgbd = sample.rgbd.clone()
    gain = torch.from_numpy(rng.uniform(0.5, 1.5, 3)).to(rgbd)
    rgbd[:3] = rgbd[rng.permutation(3).tolist()] * gain[:, None, None]
    return replace(sample, rgbd=rgbd)


def relit(rng: np.random.Generator, sample: Sample, most: float) -> Sample:
    """Change the light of a sample's picture: as a whole, towards one side, and towards the border. All else stays.

    A rendered table has one colour, apart from shadows. Below a real lamp its colour changes slowly from place to
    place. A network that never saw this may take a small difference of colour for a thing.

    Args:
        most: the part of the light, 0 to 0.3, by which each of the three changes it at most, up or down. The second
            and the third can reach it in a corner alone.
    """
    height, width = sample.rgbd.shape[-2:]
    to_corner = np.hypot(height - 1, width - 1) / 2
    rows = (torch.arange(height)[:, None] - (height - 1) / 2) / to_corner
    cols = (torch.arange(width) - (width - 1) / 2) / to_corner
    whole, slope, border = rng.uniform(-most, most, 3).tolist()
    direction = float(rng.uniform(-np.pi, np.pi))
    side = np.cos(direction) * rows + np.sin(direction) * cols
    light = 1 + whole + slope * side + border * (rows**2 + cols**2)
    rgbd = sample.rgbd.clone()
    rgbd[:3] = (rgbd[:3] + TABLE_GRAY) * light - TABLE_GRAY
    return replace(sample, rgbd=rgbd)


def rescaled(rng: np.random.Generator, sample: Sample, gain: tuple[float, float], offset: float) -> Sample:
    """Multiply each of a sample's semantic maps by a random factor in ``gain`` and add at most +-``offset``.

    The value of a map at an object differs between scenes, but the named object has the highest value in each. So a
    network must compare the values of a map, and cannot memorize a threshold.
    """
    count = len(sample.maps)  # 0 for methods without semantic maps
    factors = torch.from_numpy(rng.uniform(*gain, count)).to(sample.rgbd)
    shifts = torch.from_numpy(rng.uniform(-offset, offset, count)).to(sample.rgbd)
    changes = zip(sample.maps.items(), factors, shifts, strict=True)
    return replace(sample, maps={name: semantic * factor + shift for (name, semantic), factor, shift in changes})


def apply(motion: ImageMotion, sample: Sample) -> Sample:
    """Move a whole sample. The pick's yaw turns with it; the relative place angle does not change."""
    rows, cols = sample.rgbd.shape[-2:]
    shape = (rows, cols)
    # Picture and maps have the same resolution, so one warp moves them all.
    warped = motion.warp(torch.cat([sample.rgbd, *sample.maps.values()])[None])[0]
    rgbd, *maps = warped.split([len(sample.rgbd), *(len(semantic) for semantic in sample.maps.values())])
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
    """Move features (D, h, w) of lower resolution as ``motion`` moves a picture of ``shape`` (H, W): float32."""
    scale = [coarse / fine for coarse, fine in zip(feature.shape[-2:], shape, strict=True)]
    scaled_motion = ImageMotion(motion.angle, (motion.shift[0] * scale[0], motion.shift[1] * scale[1]))
    return scaled_motion.warp(feature[None].float())[0]
