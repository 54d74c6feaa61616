"""A query's maps as policies use them: Eq. 1-4, then the words of ours that no patch shows, "left" and "and".

The networks of GEM read these maps. Rivals can be restricted by them (`gem_lite.policies.gates`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gem_lite import language
from gem_lite.config import FLAG, RADIUS, TEXT, Allowed, number, or_none
from gem_lite.language import Query
from gem_lite.maps import location_words, semantic_map
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource


@dataclass(frozen=True)
class MapConfig(PatchConfig):
    """The numbers that decide a query's maps.

    Attributes:
        text_weight, image_weight: w1 and w2 of Eq. 4.
        conjuncts: whether "green and blue blocks" is two phrases, whose maps are joined.
        semantic_map: the name of a registered map source (`gem_lite.maps.sources`).
        peak_margin, peak_radius: a pick lies at most ``peak_radius`` (m) from a thing on which its map is at most
            ``peak_margin`` below its highest value (`policies.gates`); with a margin of None it may lie anywhere.
    """

    AFTER_PREPARATION: ClassVar[frozenset[str]] = PatchConfig.AFTER_PREPARATION | {"peak_margin", "peak_radius"}

    ALLOWED: ClassVar[Mapping[str, Allowed]] = {
        **PatchConfig.ALLOWED, "text_weight": number(0, 10), "image_weight": number(0, 10), "conjuncts": FLAG,
        "semantic_map": TEXT, "peak_margin": or_none(number(0, 10)), "peak_radius": RADIUS,
    }  # fmt: skip

    text_weight: float = 0.8
    image_weight: float = 0.2
    conjuncts: bool = True
    semantic_map: str = "multi-view"
    peak_margin: float | None = 0.1
    peak_radius: float = 0.0125


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
    of a phrase (`location_words.located`). A whole sentence (`Config.parsing`) is one query and has neither.

    Args:
        scene: of ``source``.
        memory: the crops to retrieve; without them, only a picture has an image-conditioned map.
        hidden: an episode whose crops must not be retrieved; in training, the step's own.
    """
    phrases: Sequence[Query] = [query]
    if config.conjuncts and config.parsing and isinstance(query, str):
        phrases = language.conjuncts(query)
    return joined([_located_maps(source, scene, phrase, config, memory, hidden) for phrase in phrases])


def _located_maps(
    source: MapSource, scene: SceneEmbedding, query: Query, config: MapConfig, memory: CropMemory | None,
    hidden: EpisodeKey | None,
) -> QueryMaps:  # fmt: skip
    word = None
    if config.parsing and isinstance(query, str):
        word = location_words.location_word(query)
        query = location_words.canonical(query)
    maps = _member_maps(source, scene, query, config, memory, hidden)
    if word is None or not config.locations:
        return maps
    text = location_words.located(maps.text, word, config.workspace)
    return QueryMaps(text, maps.image, location_words.located(maps.fused, word, config.workspace))


def _member_maps(
    source: MapSource, scene: SceneEmbedding, query: Query, config: MapConfig, memory: CropMemory | None,
    hidden: EpisodeKey | None,
) -> QueryMaps:  # fmt: skip
    text = source.map(scene, query)
    if not source.uses_views or config.image_weight == 0:
        return QueryMaps(text, None, text)
    image = semantic_map.image_conditioned_map(scene, query, source.clip, memory, hidden)
    return QueryMaps(text, image, semantic_map.fuse(text, image, config.text_weight, config.image_weight))


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
