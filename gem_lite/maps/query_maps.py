"""A query's maps as policies use them: Eq. 1-4, then the words of ours that no patch shows, "left" and "and".

The networks of GEM read these maps. Rivals can be restricted by them (`gem_lite.policies.choosing`).

"left star hole" is the leftmost of the places that look like a star hole. CLIP gives all star holes the same score; and
training turns the pictures, so a network cannot learn what "left" is. Here the word acts on the map of the unturned
table: it chooses one of the strongest responses and lowers the others. Training then turns the map with the picture.
For the same reason, "left of green bowl" has a map of its own (`relations`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from gem_lite import language
from gem_lite.config import FLAG, TEXT, entry, number
from gem_lite.language import Query, Spot, ThingQuery
from gem_lite.maps import relations, semantic_map
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource
from gem_lite.se2 import Workspace

WITHIN = 0.1
"""A response is a local maximum of a map that is at most this far below the highest value."""
SPACING = 0.03
"""Two responses are at least this far (m) apart."""
LOWERED = 0.3
"""Afterwards, the other responses are at least this far below the chosen one."""
_Keys = Callable[[np.ndarray, np.ndarray], np.ndarray]
_SMALLEST: dict[str, _Keys] = {
    "left": lambda x, y: x,
    "right": lambda x, y: -x,
    "top": lambda x, y: -y,
    "bottom": lambda x, y: y,
    "middle": lambda x, y: np.hypot(x - x.mean(), y - y.mean()),
}
"""For each word, what is smallest at the response that the word means; x and y in the world."""


@dataclass(frozen=True)
class MapConfig(PatchConfig):
    """What decides a query's maps.

    Attributes:
        text_weight, image_weight: w1 and w2 of Eq. 4.
        conjuncts: whether "green and blue blocks" is two phrases, whose maps are joined.
        semantic_map: the name of a registered map source (`gem_lite.maps.sources`).
        detector: the model of a map source that detects things, as a Hugging Face name or a folder
            (`gem_lite.maps.detectors`); no other source reads it.
        own_crop: whether training may retrieve a crop of the step's own demonstration.
    """

    text_weight: float = entry(0.8, number(0, 10))
    image_weight: float = entry(0.2, number(0, 10))
    conjuncts: bool = entry(True, FLAG)
    semantic_map: str = entry("multi-view", TEXT)
    detector: str = entry("", TEXT, added=True)
    own_crop: bool = entry(False, FLAG)


@dataclass(frozen=True)
class QueryMaps:
    """The semantic maps of one query, (H, W) float32; ``image`` is None if there is no picture to compare with."""

    text: np.ndarray
    image: np.ndarray | None
    fused: np.ndarray


def query_maps(
    source: MapSource, scene: SceneEmbedding, query: Query, config: MapConfig, memory: CropMemory | None = None,
    hidden: EpisodeKey | None = None,
) -> QueryMaps:  # fmt: skip
    """A query's maps: Eq. 1-4 without the depth, which the networks add.

    A phrase with "and" is several phrases, whose maps are joined. A location word chooses among the strongest responses
    of a phrase (`located`). A relation has one map (`relation_map`), and so has a spot (`relations.spot_map`). A whole
    sentence (`Config.parsing`) is one query and has none of them.

    Args:
        scene: of ``source``.
        memory: the crops to retrieve; without them, only a picture has an image-conditioned map.
        hidden: an episode whose crops must not be retrieved; in training, the step's own.
    """

    def of_one(query: ThingQuery) -> QueryMaps:
        word = None
        if config.parsing and isinstance(query, str):
            word, _ = language.split_location(query)
            query = language.location_in_front(query)
        text = source.map(scene, query)
        image = None
        fused = text
        if source.uses_views and config.image_weight > 0:
            image = semantic_map.image_conditioned_map(scene, query, source.clip, memory, hidden)
            fused = semantic_map.fuse(text, image, config.text_weight, config.image_weight)
        if word is None or not config.locations:
            return QueryMaps(text, image, fused)
        return QueryMaps(located(text, word, config.workspace), image, located(fused, word, config.workspace))

    if isinstance(query, Spot):
        place = relations.spot_map(query, scene.heightmap)
        return QueryMaps(place, None, place)
    if config.parsing and isinstance(query, str) and language.is_relation(query):
        place = relation_map(scene, query, source)
        return QueryMaps(place, None, place)
    phrases: Sequence[ThingQuery] = [query]
    if config.conjuncts and config.parsing and isinstance(query, str):
        phrases = language.conjuncts(query)
    return joined([of_one(phrase) for phrase in phrases])


def relation_map(scene: SceneEmbedding, query: str, source: MapSource) -> np.ndarray:
    """The map of a place beside things, such as "left of green bowl", from the text-conditioned maps of these things.

    Returns:
        (H, W) float32, see `relations.place_map`; 0 everywhere if no place is free.

    Raises:
        ValueError: the query is no relation.
    """
    relation, anchors = language.split_relation(query)
    if relation is None:
        raise ValueError(f"query must be a relation, such as 'left of green bowl', got {query!r}")
    maps = [phrase_map(scene, anchor, source) for anchor in anchors]
    return relations.place_map(relation, maps, scene.heightmap, source.config)


def phrase_map(scene: SceneEmbedding, phrase: str, source: MapSource) -> np.ndarray:
    """The text-conditioned map (H, W) of a phrase, of which a location word chooses among its strongest responses."""
    word, _ = language.split_location(phrase)
    semantic = source.map(scene, language.location_in_front(phrase))
    return semantic if word is None else located(semantic, word, scene.heightmap.workspace)


def joined(members: Sequence[QueryMaps]) -> QueryMaps:
    """The maps of "X and Y": the members' maps are scaled to equally high peaks; each cell gets the largest value.

    CLIP's cosines may be lower for X than for Y. Without the scaling, X would be darker than Y in the joined map.
    """
    images = [member.image for member in members if member.image is not None]
    return QueryMaps(
        _scaled_maximum([member.text for member in members]),
        _scaled_maximum(images) if images else None,
        _scaled_maximum([member.fused for member in members]),
    )


def _scaled_maximum(maps: Sequence[np.ndarray]) -> np.ndarray:
    """The maximum (H, W) of maps (H, W), each scaled to the highest peak, unless it is nowhere positive."""
    peaks = [member.max() for member in maps]
    highest = float(max(peaks))
    scaled = [
        member * np.float32(highest / peak) if peak > 0 else member for member, peak in zip(maps, peaks, strict=True)
    ]
    return np.maximum.reduce(scaled)


def responses(semantic: np.ndarray, workspace: Workspace) -> tuple[np.ndarray, int]:
    """A map's strongest responses: its local maxima at most `WITHIN` below the highest value.

    Maxima nearer than `SPACING` to each other, such as the cells of a flat peak, are one response. A map that hardly
    rises above its median, which is the bare table's value, has no response.

    Args:
        semantic: (H, W).

    Returns:
        (H, W) int, the number of the response to which each maximum belongs, from 1 on, and 0 elsewhere; and how many
        there are.
    """
    if semantic.max() - np.median(semantic) <= WITHIN:
        return np.zeros(semantic.shape, int), 0
    reach = round(SPACING / workspace.pixel)
    highest_around = ndimage.maximum_filter(semantic, size=2 * reach + 1, mode="nearest")
    maxima = (semantic == highest_around) & (semantic >= semantic.max() - WITHIN)
    # Two cells are in one region if each lies within half the reach of the region's cells.
    regions, count = ndimage.label(ndimage.binary_dilation(maxima, np.ones((reach, reach))), np.ones((3, 3)))
    return np.where(maxima, regions, 0), count


def located(semantic: np.ndarray, word: str, workspace: Workspace) -> np.ndarray:
    """A map with all responses lowered but the one that a location word means.

    Args:
        semantic: (H, W) float32.
        word: "left" (smaller x), "right", "top" (larger y), "bottom" or "middle" (nearest to all responses' mean).

    Returns:
        (H, W) float32. Cells nearer to another response are cut off at the chosen one minus `LOWERED`. A map without
        responses stays as it is.

    Raises:
        ValueError: an unknown word.
    """
    if word not in _SMALLEST:
        raise ValueError(f"word must be one of {', '.join(_SMALLEST)}, got {word!r}")
    regions, count = responses(semantic, workspace)
    if count < 2:
        return semantic
    numbers = np.arange(1, count + 1)
    middles = np.array(ndimage.center_of_mass(regions > 0, regions, numbers))  # (N, 2) cells
    x, y = workspace.to_world(middles[:, 0], middles[:, 1])
    chosen = numbers[int(np.argmin(_SMALLEST[word](x, y)))]
    # For every cell the nearest maximum of any response.
    rows, cols = ndimage.distance_transform_edt(regions == 0, return_distances=False, return_indices=True)
    of_another = regions[rows, cols] != chosen
    ceiling = np.float32(semantic[regions == chosen].max() - LOWERED)
    return np.where(of_another, np.minimum(semantic, ceiling), semantic)
