"""The map source "regions": each thing on the table is one region, which CLIP sees as one picture.

A detector has such maps, too (A.6): what it proposes is filled, and all else is 0. Here `things` proposes the regions,
without any words: what rises, and what is flat and has another colour than the table. So two things that touch are one
region, and a part of a thing is none, unless it is flat and the rest is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy import ndimage
from typing_extensions import override

from gem_lite.clip import Clip
from gem_lite.language import ImageQuery, ThingQuery
from gem_lite.maps import semantic_map
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import SOURCES, MapSource
from gem_lite.maps.things import things
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap

MARGIN = 0.1
"""A crop reaches beyond its region on each side by at least this share of the region's longer side."""


@dataclass(frozen=True)
class RegionScene(SceneEmbedding):
    """A scene with its regions.

    Attributes:
        regions: N masks (H, W) bool, the largest first. A thing's holes belong to it, such as the inside of a bowl, so
            that a thing in a hole shares its cells; it stands later.
        pictures: (N, D) float32, unit length: the embedding of each region's crop.
    """

    regions: tuple[np.ndarray, ...]
    pictures: torch.Tensor


@SOURCES.register("regions")
class Regions(MapSource):
    """The things on the table, each filled with CLIP's score of one picture of it; 0 elsewhere."""

    @override
    def embed(self, views: Sequence[View]) -> RegionScene:
        scene = super().embed(views)
        proposed = self.propose(scene.heightmap)
        regions = sorted(map(ndimage.binary_fill_holes, proposed), key=np.sum, reverse=True)
        pictures = embed_regions(scene.heightmap.rgb, regions, self.clip)
        return RegionScene(
            scene.heightmap, scene.points, scene.sides, scene.embed_top, regions=tuple(regions), pictures=pictures
        )

    def propose(self, heightmap: HeightMap) -> list[np.ndarray]:
        """The cells (H, W) bool of each thing that is to be a region: what rises, and flat things of another colour."""
        rising, flat = things(heightmap)
        return rising + flat

    @override
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        if not isinstance(scene, RegionScene):
            raise TypeError(f"scene must be what embed of the source 'regions' returns, got {type(scene).__name__}")
        semantic = np.zeros(scene.heightmap.height.shape, np.float32)
        for region, score in zip(scene.regions, region_scores(scene.pictures, query, self.clip), strict=True):
            semantic[region] = score
        return semantic


def embed_regions(rgb: np.ndarray, regions: Sequence[np.ndarray], clip: Clip) -> torch.Tensor:
    """The embeddings (N, D) of the `square` crops of N regions, each a mask (H, W), of a picture (H, W, 3) uint8."""
    # One by one, since crops have different sizes.
    embedded = [clip.embed_known_images(square(rgb, region)[None]) for region in regions]
    return torch.cat([torch.zeros(0, clip.dim), *embedded])


def square(rgb: np.ndarray, region: np.ndarray) -> np.ndarray:
    """The square crop (S, S, 3) around a region (H, W) with its `MARGIN`, moved inside the picture at its border.

    A region that is longer than the picture is wide is cut to the middle square of its bounding box.
    """
    rows, cols = np.nonzero(region)
    longer = max(np.ptp(rows), np.ptp(cols)) + 1
    side = min(longer + 2 * int(np.ceil(MARGIN * longer)), *region.shape)
    top, left = (
        int(np.clip((cells.min() + cells.max() + 1 - side) // 2, 0, length - side))
        for cells, length in zip((rows, cols), region.shape, strict=True)
    )
    return np.ascontiguousarray(rgb[top : top + side, left : left + side])


def region_scores(pictures: torch.Tensor, query: ThingQuery, clip: Clip) -> np.ndarray:
    """The score (N,) of each picture's embedding (N, D) for a query, on the CLIP's scale, at least 0."""
    if isinstance(query, ImageQuery):
        scores = clip.calibration.scale_image((pictures @ semantic_map.embed_query(query, clip)).numpy())
    else:
        scores = clip.calibration.scale_text((pictures @ semantic_map.embed_phrase(query, clip)).numpy())
    # Nothing is less likely than the bare table.
    return np.maximum(scores, 0)
