"""Semantic maps of a scene (Sec. 3.1): conditioned on a text (Eq. 1), on a picture (Eq. 2-3), and their blend (Eq. 4).

Each map is made for a query (`gem_lite.language.ThingQuery`): a phrase or a picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import torch
from scipy import sparse

from gem_lite.clip import Clip
from gem_lite.language import ImageQuery, ThingQuery
from gem_lite.maps import patches
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey
from gem_lite.maps.patches import PatchConfig, PatchEmbeddings
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap, SortedPoints, fuse_views, sort_points


@dataclass(frozen=True)
class SceneEmbedding:
    """Everything that the maps of one scene share for all queries, computed once for each observation.

    Attributes:
        heightmap: the table from above.
        points: the views' points, sorted into the height map's cells: the fusion from above.
        sides: the embedding of each view; `embed_scene` makes `PatchEmbeddings`.
        embed_top: computes `top`.
        exposures: ``sides`` once more for each of `PatchConfig.more_exposures`.
    """

    heightmap: HeightMap
    points: SortedPoints
    sides: tuple[Any, ...]
    embed_top: Callable[[], PatchEmbeddings]
    exposures: tuple[tuple[Any, ...], ...] = field(default=(), kw_only=True)

    @cached_property
    def top(self) -> PatchEmbeddings:
        """The height map's own patches, embedded at first use, since the text-conditioned map does not need them."""
        return self.embed_top()

    def fuse(self, labels: Sequence[np.ndarray]) -> np.ndarray:
        """Labels of each view's pixels, (H_n, W_n), fused from above by point cloud: (H, W) float32."""
        return self.points.project(labels)

    @cached_property
    def spread(self) -> sparse.csr_array:
        """P⁻¹ of Eq. 1 and the fusion from above as one matrix: (H * W, number of all views' patches) float32.

        It depends on no query, so that a map costs only its product with the patches' scores. The rows of cells that no
        camera saw are empty.
        """
        pixels, values = zip(*(patches.blocks(side.grid) for side in self.sides), strict=True)
        starts = np.cumsum([0, *(value.shape[0] for value in values)])
        groups = [numbers + start for numbers, start in zip(pixels, starts, strict=False)]
        return self.points.shares(groups, int(starts[-1])) @ sparse.block_diag(values, "csr")

    def cosine(self, embedding: torch.Tensor, exposure: int = 0) -> np.ndarray:
        """The cosines of the views' patches with one embedding (D,), fused from above: (H, W) float32.

        Args:
            exposure: 0 for the views as they are, else the number of one of ``exposures``, from 1.
        """
        sides = (self.sides, *self.exposures)[exposure]
        scores = torch.cat([(side.values @ embedding.to(side.values)).flatten() for side in sides])
        return self.points.filled((self.spread @ scores.numpy()).reshape(self.heightmap.height.shape))


def embed_views(
    views: Sequence[View], clip: Clip, config: PatchConfig, embed_view: Callable[[View, np.ndarray], Any] | None = None
) -> SceneEmbedding:
    """Fuse the views and embed each by ``embed_view``. The height map's patches are embedded at first use.

    Args:
        embed_view: gets a view and its pixels inside the workspace, (H_n, W_n) bool; without it ``sides`` is empty.
    """
    points = sort_points(views, config.workspace)
    heightmap = fuse_views(views, config.workspace, points)
    sides = tuple(embed_view(*pair) for pair in zip(views, points.kept, strict=True)) if embed_view else ()
    return SceneEmbedding(
        heightmap, points, sides, partial(patches.embed_patches, heightmap.rgb, patches.top_grid(config), clip)
    )


def embed_scene(views: Sequence[View], clip: Clip, config: PatchConfig) -> SceneEmbedding:
    """Fuse the views and embed the patches of each view. The height map's patches are embedded at first use."""

    def embed_view(view: View, inside: np.ndarray, factor: float = 1.0) -> PatchEmbeddings:
        picture = patches.exposed(patches.paint_outside(view.rgb, inside), factor)
        return patches.embed_patches(picture, patches.side_grid(view.camera, config), clip, inside)

    scene = embed_views(views, clip, config, embed_view)
    exposures = tuple(
        tuple(embed_view(view, inside, factor) for view, inside in zip(views, scene.points.kept, strict=True))
        for factor in config.more_exposures
    )
    return replace(scene, exposures=exposures)


def embed_query(query: ThingQuery, clip: Clip) -> torch.Tensor:
    """A text's or a picture's embedding (D,), on the CPU, as the CLIP gives it.

    Raises:
        ValueError: an empty text.
    """
    if isinstance(query, ImageQuery):
        return clip.embed_images(query.picture[None])[0].cpu()
    return clip.embed_texts([query])[0].cpu()


def embed_phrase(phrase: str, clip: Clip) -> torch.Tensor:
    """A phrase's embedding (D,), on the CPU, with unit length to the last bit. Raises ValueError if it is empty."""
    return torch.nn.functional.normalize(clip.embed_texts([phrase])[0], dim=0).cpu()


def _score(cosine: Callable[[torch.Tensor], np.ndarray], query: ThingQuery, clip: Clip) -> np.ndarray:
    """The cosines with a query, on the CLIP's scale for texts or for pictures."""
    if isinstance(query, ImageQuery):
        return clip.calibration.scale_image(cosine(embed_query(query, clip)))
    return clip.calibration.scale_text(cosine(embed_phrase(query, clip)))


EXPOSURE_LEAD = 0.08
"""Another exposure has to be better by this much on the map's scale. Chosen on validation scenes of kits and pyramids:
with less, more maps of our own scenes change."""


def text_conditioned_map(scene: SceneEmbedding, query: ThingQuery, clip: Clip) -> np.ndarray:
    """M_text (Eq. 1): every view's patches scored against a query, fused from above by point cloud.

    A picture may stand in the phrase's place; then the scale is that of pictures. Of a scene with several exposures,
    the map is that of the exposure with the highest value, if this is `EXPOSURE_LEAD` above that of the views as they
    are: CLIP may know things better in a light like that of the pictures that it learned from.

    Returns:
        (H, W) float32; about 0 where nothing matches and 1 on a match, by the CLIP's calibration.
    """
    exposures = range(1 + len(scene.exposures))
    as_it_is, *others = (_score(partial(scene.cosine, exposure=number), query, clip) for number in exposures)
    surest = max(others, key=np.max, default=as_it_is)
    return surest if surest.max() >= as_it_is.max() + EXPOSURE_LEAD else as_it_is


def single_view_map(scene: SceneEmbedding, query: ThingQuery, clip: Clip) -> np.ndarray:
    """The text-conditioned map from the height map's own patches: the paper's "without multi-view" (A.2).

    Returns:
        (H, W) float32 on the scale of `text_conditioned_map`, by the same calibration.
    """
    return _score(scene.top.score, query, clip)


def image_conditioned_map(
    scene: SceneEmbedding, query: ThingQuery, clip: Clip, memory: CropMemory | None, hidden: EpisodeKey | None = None
) -> np.ndarray | None:
    """M_image (Eq. 2-3): a crop's embedding against the height map's patches.

    The crop is the query's own picture, or the demonstrations' crop for a phrase.

    Args:
        memory: crops to search for a phrase; None if there are none. A picture needs no search.
        hidden: an episode whose crops must not be retrieved; in training, the step's own.

    Returns:
        (H, W) float32 on the scale of `text_conditioned_map`, or None if no crop's phrase is near enough.
    """
    if isinstance(query, ImageQuery):
        return _score(scene.top.score, query, clip)
    if memory is None:
        return None
    crop = memory.retrieve(embed_phrase(query, clip), clip.calibration.retrieval_threshold, hidden)
    return None if crop is None else clip.calibration.scale_image(scene.top.score(crop))


def fuse(text: np.ndarray, image: np.ndarray | None, w1: float, w2: float) -> np.ndarray:
    """The weighted average of Eq. 4, before depth; the text map alone where there is no image map."""
    if w1 < 0 or w2 < 0 or w1 + w2 == 0:
        raise ValueError(f"w1 and w2 must not be negative nor both 0, got {w1} and {w2}")
    return text if image is None else (w1 * text + w2 * image) / (w1 + w2)


PLATEAU = 0.2
"""Cells at most this far below a map's peak belong to its plateau, where a match is 1 (chosen on validation scenes)."""


def plateau_centre(semantic: np.ndarray, config: PatchConfig) -> tuple[float, float]:
    """The centre (row, col) of a map's highest plateau. The map points at it, since patches blur the map's peak.

    It is found by mean shift from the brightest cell: the mean of the cells within half a patch, weighted by their
    height above the plateau's foot, is taken again and again until it does not move. Two objects side by side
    share a plateau; half a patch holds one of them.

    Args:
        semantic: (H, W), of ``config``'s resolution.
    """
    weight = np.maximum(semantic.astype(np.float64) - semantic.max() + PLATEAU, 0)
    rows, cols = np.mgrid[: semantic.shape[0], : semantic.shape[1]]
    reach = config.top_patch / 2 / config.pixel
    row, col = (float(i) for i in np.unravel_index(semantic.argmax(), semantic.shape))
    for _ in range(50):
        near = weight * (np.hypot(rows - row, cols - col) <= reach)
        last = row, col
        row = float((near * rows).sum() / near.sum())
        col = float((near * cols).sum() / near.sum())
        if np.hypot(row - last[0], col - last[1]) < 0.01:
            break
    return row, col
