"""A map that turns with its picture, by averaging over rotations (A.8.5)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from gem_lite.se2 import angle_bins, rotate_image


def frame_averaged(
    score: Callable[[np.ndarray], np.ndarray], image: np.ndarray, rotations: int
) -> tuple[np.ndarray, np.ndarray]:
    """Average a map over the rotations C_n of its picture (A.8.5): (1/n) sum_g g^-1 score(g image).

    The result is equivariant: exactly to quarter turns if 4 divides n, to the other turns of C_n up to
    interpolation. Pixels that turning brings in from outside have the picture's median colour; pixels that it
    moves out of the picture are left out of the average.

    Args:
        score: maps an (S, S, 3) uint8 picture to an (S, S) map.
        image: (S, S, 3) uint8, a square crop of a height map.
        rotations: n, at least 1.

    Returns:
        The averaged map (S, S) float32, and (S, S) bool: cells that no rotation moves out of the picture.

    Raises:
        ValueError: the picture is not square or not uint8, or n is less than 1.
    """
    if image.ndim != 3 or image.shape[0] != image.shape[1] or image.dtype != np.uint8:
        raise ValueError(f"image must be a square (S, S, 3) uint8 picture, got {image.shape} {image.dtype}")
    if rotations < 1:
        raise ValueError(f"rotations must be at least 1, got {rotations}")
    outside = np.round(np.median(image, axis=(0, 1)))
    # Relative to the outside's colour, the zeros that rotate_image fills in are that colour. Doubles, so
    # that a picture and its quarter turn are rounded to the same bytes.
    relative = torch.from_numpy(image - outside).permute(2, 0, 1)[None]
    total = np.zeros(image.shape[:2])
    weight = np.zeros(image.shape[:2])
    inside = np.ones(image.shape[:2], bool)
    for angle in torch.from_numpy(angle_bins(rotations)):
        turned = rotate_image(relative, angle[None])[0].permute(1, 2, 0).numpy() + outside
        scores = torch.from_numpy(score(np.round(turned).astype(np.uint8)).astype(np.float64))
        # The map and its mask turn back together, so a cell cut by the border still averages to its map.
        back, kept = rotate_image(torch.stack([scores, torch.ones_like(scores)])[None], -angle[None])[0].numpy()
        total += back
        weight += kept
        inside &= kept > 1 - 1e-4
    return (total / weight).astype(np.float32), inside
