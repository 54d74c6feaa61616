"""What a map says in numbers: its best places; and whether red and blue of the pictures are exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import plateau_centre
from gem_lite.maps.sources import MapSource
from gem_lite.rgbd.camera import View

SWAP_MARGIN = 0.05
"""Red and blue are probably swapped if the words' highest scores rise by more than this when they are swapped back."""


@dataclass(frozen=True)
class Place:
    """A place at which a map is high: x and y on the table (m), and the map's value, about 1 on a match."""

    x: float
    y: float
    score: float


def best_places(semantic: np.ndarray, seen: np.ndarray, config: PatchConfig, count: int = 5) -> list[Place]:
    """The centres of a map's highest plateaus in cells that a camera saw, the highest first.

    After each, the cells within half a patch of it or of its highest cell are left out.

    Args:
        semantic: (H, W), of ``config``'s resolution.
        seen: (H, W) bool, of the same height map.
        count: of places at most. There are fewer if no other cell is above 0.
    """
    left = np.where(seen, semantic, 0).astype(np.float32)
    rows, cols = np.indices(left.shape)
    reach = config.top_patch / 2 / config.pixel
    places: list[Place] = []
    while len(places) < count and left.max() > 0:
        highest = np.unravel_index(left.argmax(), left.shape)
        row, col = plateau_centre(left, config)
        x, y = config.workspace.to_world(row, col)
        places.append(Place(round(float(x), 4), round(float(y), 4), round(float(left.max()), 3)))
        for middle in ((row, col), highest):
            left[np.hypot(rows - middle[0], cols - middle[1]) <= reach] = 0
    return places


def gain_by_swapping(views: Sequence[View], phrases: Sequence[str], source: MapSource) -> float:
    """How much higher phrases score, on the mean of their maps' highest values, if red and blue are exchanged.

    A value above `SWAP_MARGIN` says that the pictures were probably read as BGR. Phrases should name the colours of
    things that are on the table, and not only green, gray, black or white ones.

    Raises:
        ValueError: there is no phrase.
    """
    if not phrases:
        raise ValueError("phrases is empty: name some things on the table with their colours")
    swapped = [replace(view, rgb=np.ascontiguousarray(view.rgb[..., ::-1])) for view in views]
    given, exchanged = source.embed(views), source.embed(swapped)
    gains = [source.map(exchanged, phrase).max() - source.map(given, phrase).max() for phrase in phrases]
    return float(np.mean(gains))
