"""What lies on a table: each thing gets the best of given names, by CLIP's scores of the views and of the height map.

The policy's maps see a thing from the sides, blurred by patches that show its neighbours, too. The height map's patches
see it from above, alone. Together they name more things rightly than either does (experiments/planning).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from gem_lite.maps import refusal, things
from gem_lite.maps.query_maps import phrase_map
from gem_lite.maps.semantic_map import SceneEmbedding, single_view_map
from gem_lite.maps.sources import MapSource
from gem_lite.rgbd.heightmap import HeightMap

STANDS_OUT = 0.1
"""A policy seldom picks another thing if the phrase scores at least this much higher on the right one. It was chosen on
scenes with other seeds than those of experiments/planning."""


@dataclass(frozen=True, eq=False)
class NamedThing:
    """A thing on a table and the name that fits it best.

    Attributes:
        name: the best of the given names.
        x, y: the thing's middle (m).
        score: the name's value on the thing, about 1 on a match: the mean of both maps.
        mask: (H, W) bool, the thing's cells.
    """

    name: str
    x: float
    y: float
    score: float
    mask: np.ndarray


def named_things(scene: SceneEmbedding, names: Sequence[str], source: MapSource) -> list[NamedThing]:
    """The things on a table with their names.

    Args:
        names: what things may be called. They are only candidates: most of them may be on no table.

    Raises:
        ValueError: there is no name.
    """
    if not names:
        raise ValueError("names is empty: give the names that things on the table may have")
    masks = whole_things(scene.heightmap)
    if not masks:
        return []
    source.clip.embed_texts(list(names))  # All at once is faster than one by one, and the CLIP keeps them.
    scores = np.array([name_scores(scene, name, source, masks) for name in names])  # (names, things)
    best = scores.argmax(axis=0)
    middles = [things.middle(mask, scene.heightmap.workspace) for mask in masks]
    return [
        NamedThing(names[number], *middles[thing], float(scores[number, thing]), masks[thing])
        for thing, number in enumerate(best)
    ]


def name_scores(scene: SceneEmbedding, name: str, source: MapSource, masks: Sequence[np.ndarray]) -> np.ndarray:
    """How well a name fits each thing, a mask (H, W): the mean over the source's map and that of the height map."""
    maps = source.map(scene, name), single_view_map(scene, name, source.clip)
    return np.mean([refusal.thing_scores(semantic, masks) for semantic in maps], axis=0)


Found = tuple[SceneEmbedding, NamedThing]
"""A thing, and the table on which it lies."""


def phrase_scores(found: Sequence[Found], phrase: str, source: MapSource) -> np.ndarray:
    """The scores (N,) of things, on one table or several, on the map of a phrase that a policy looks at."""
    maps = {id(scene): phrase_map(scene, phrase, source) for scene, _ in found}
    return np.array([refusal.thing_scores(maps[id(scene)], [thing.mask])[0] for scene, thing in found])


def telling_phrase(number: int, found: Sequence[Found], source: MapSource) -> str:
    """The phrase that tells the thing of this number from all others: its name, or its name with a colour.

    A colour is said if the name alone scores less than `STANDS_OUT` higher on the thing than on another one: that
    colour with which it stands out most.
    """

    def lead(phrase: str) -> float:
        scores = phrase_scores(found, phrase, source)
        return float(scores[number] - np.delete(scores, number).max(initial=-np.inf))

    name = found[number][1].name
    if lead(name) >= STANDS_OUT:
        return name
    return max([name, *(f"{color} {name}" for color in refusal.OTHER_COLORS)], key=lead)


def whole_things(heightmap: HeightMap) -> list[np.ndarray]:
    """The things of `maps.things`, (H, W) bool each. A flat part of a thing that rises, such as a blade, is its."""
    rising, flat = things.things(heightmap)
    alone = []
    for part in flat:
        around = ndimage.binary_dilation(part, iterations=things.BESIDE + 1)
        touching = [number for number, mask in enumerate(rising) if (mask & around).any()]
        if touching:
            rising[touching[0]] = rising[touching[0]] | part
        else:
            alone.append(part)
    return rising + alone


def lies_in(thing: NamedThing, place: NamedThing) -> bool:
    """Whether a thing's middle lies within the outline of a place on the same table, such as the walls of a box."""
    rows, cols = np.nonzero(thing.mask)
    return bool(ndimage.binary_fill_holes(place.mask)[round(rows.mean()), round(cols.mean())])
