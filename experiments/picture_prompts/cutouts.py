"""Things as the rival sees them: cut out of pictures by their true masks, with their boxes (VIMA's object tokens)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from experiments.picture_prompts import segmented_world
from gem_lite.language import PictureSentence
from gem_lite.rgbd.observation import Observation

SIDE = 32
"""Rows and columns of a cutout, as in VIMA."""
SMALLEST = 2
"""A thing with fewer pixels is left out, as in VIMA."""
DIFFERENT = 4
"""A pixel of a prompt's picture shows the thing if one of its colours differs by more than this from the corner's."""
_EDGES = np.ones((3, 3))
"""Pixels that share an edge or a corner belong to one thing."""


@dataclass(frozen=True)
class Cutouts:
    """What the rival gets of one scene and its sentence.

    Attributes:
        things: (N, `SIDE`, `SIDE`, 3) uint8, the things on the table. Their order has no meaning.
        boxes: (N, 4) float32: their boxes' middle (row, column), height and width, as shares of the picture.
        prompt: (2, `SIDE`, `SIDE`, 3) uint8, the thing to pick and its container.
    """

    things: np.ndarray
    boxes: np.ndarray
    prompt: np.ndarray


def cut(picture: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part of a picture (H, W, 3) uint8 inside the box of a mask (H, W), padded with 0 to a square and resized.

    Returns:
        The cutout (`SIDE`, `SIDE`, 3) uint8 and its box (4,), see `Cutouts`.

    Raises:
        ValueError: the mask is empty.
    """
    if not mask.any():
        raise ValueError("mask must hold a pixel, got an empty one")
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    top, bottom = rows[0], rows[-1] + 1
    left, right = columns[0], columns[-1] + 1
    part = picture[top:bottom, left:right]
    height, width = part.shape[:2]
    side = max(height, width)
    above = (side - height) // 2
    beside = (side - width) // 2
    square = np.zeros((side, side, 3), np.uint8)
    square[above : above + height, beside : beside + width] = part
    extent = np.array([(top + bottom) / 2, (left + right) / 2, height, width])
    box = (extent / np.tile(mask.shape, 2)).astype(np.float32)
    return cv2.resize(square, (SIDE, SIDE), interpolation=cv2.INTER_AREA), box


def cut_prompt(picture: np.ndarray) -> np.ndarray:
    """The thing in a prompt's picture (H, W, 3) uint8, whose corner shows the background: a cutout."""
    differs = np.abs(picture.astype(int) - picture[0, 0]).max(axis=-1) > DIFFERENT
    return cut(picture, differs)[0]


def cutouts(observation: Observation, sentence: PictureSentence) -> Cutouts:
    """Cut out the things of a scene and of its sentence's two pictures.

    Things that touch are one. At the beginning of an episode none do; after a miss, this can harm the rival.

    Args:
        observation: of a `segmented_world.SegmentedWorld`.
    """
    (view,) = observation.views
    numbers, count = ndimage.label(segmented_world.masks(view), _EDGES)
    seen = [numbers == number for number in range(1, count + 1)]
    things = [cut(view.rgb, mask) for mask in seen if mask.sum() >= SMALLEST]
    pictures, boxes = zip(*things, strict=True)
    prompt = np.stack([cut_prompt(query.picture) for query in sentence.pictures])
    return Cutouts(np.stack(pictures), np.stack(boxes), prompt)
