"""Map sources turn camera views and a query into a semantic map. A configuration names one of `SOURCES`.

A new source is a class that is registered by its name. A source that scores the pixels of single views derives from
`ViewSource`, which fuses the views' scores from above. Others, such as one that detects boxes, derive from
`MapSource`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Generic, TypeVar

import numpy as np
from typing_extensions import override

from gem_lite.clip import Clip
from gem_lite.foundations.registry import Registry
from gem_lite.language import ImageQuery, ThingQuery
from gem_lite.maps import dense, semantic_map
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.rgbd.camera import Camera, View

ViewEmbedding = TypeVar("ViewEmbedding")


class MapSource(ABC):
    """Turns camera views and a query into a map.

    Attributes:
        uses_views: whether its maps depend on the camera views.
    """

    uses_views: ClassVar[bool] = True

    def __init__(self, clip: Clip, config: PatchConfig) -> None:
        self.clip = clip
        self.config = config

    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        """Compute everything that does not depend on the query: here only the height map."""
        return semantic_map.embed_views(views, self.clip, self.config)

    @abstractmethod
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        """The map of a query in a scene of `embed`.

        Returns:
            (H, W) float32; about 0 where nothing matches and about 1 on a match.
        """


class ViewSource(MapSource, Generic[ViewEmbedding]):
    """A source that scores the pixels of each view; the scores are fused by point cloud."""

    @abstractmethod
    def embed_view(self, view: View, inside: np.ndarray) -> ViewEmbedding:
        """Compute what `score_view` needs of a view for any query, for instance its features.

        Args:
            inside: (H_n, W_n) bool, the pixels inside the workspace; scores of the others are not used.
        """

    @abstractmethod
    def score_view(self, embedded: ViewEmbedding, query: ThingQuery) -> np.ndarray:
        """A score (H_n, W_n) for each pixel of a view: about 0 where nothing matches and about 1 on a match."""

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        return semantic_map.embed_views(views, self.clip, self.config, self.embed_view)

    @override
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        return scene.fuse([self.score_view(side, query) for side in scene.sides])


SOURCES: Registry[type[MapSource]] = Registry("map source")
"""Map sources by their names."""


@SOURCES.register("multi-view")
class MultiView(MapSource):
    """The paper's (Eq. 1): CLIP's cosines with the patches of every view, fused from above.

    It remembers the last scene: who asks first whether a thing is there, and then acts, shows the same pictures twice.
    """

    _last: tuple[list[tuple[Camera, bytes, bytes]], SceneEmbedding] | None = None

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        # By content: a driver may write its next pictures into the same arrays.
        shown = [(view.camera, view.rgb.tobytes(), view.depth.tobytes()) for view in views]
        last = self._last
        if last is None or last[0] != shown:
            last = (shown, semantic_map.embed_scene(views, self.clip, self.config))
            self._last = last
        return last[1]

    @override
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        return semantic_map.text_conditioned_map(scene, query, self.clip)


@SOURCES.register("single-view")
class SingleView(MapSource):
    """CLIP's cosines with the patches of the height map: the paper's "without multi-view" (A.2)."""

    @override
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        return semantic_map.single_view_map(scene, query, self.clip)


@SOURCES.register("dense")
class Dense(MapSource):
    """CLIP's cosines with the positions of every view, each view in one pass, fused from above."""

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        return dense.embed_scene(views, self.clip, self.config)

    @override
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        words = semantic_map.embed_query(query, self.clip)
        cosines = scene.fuse([side.score(words) for side in scene.sides])
        scale = self.clip.dense_calibration
        return scale.scale_image(cosines) if isinstance(query, ImageQuery) else scale.scale_text(cosines)


@SOURCES.register("none")
class NoMap(MapSource):
    """1 everywhere: the paper's "without semantic map" (A.2)."""

    uses_views = False

    @override
    def map(self, scene: SceneEmbedding, query: ThingQuery) -> np.ndarray:
        return np.ones(self.config.workspace.shape, np.float32)
