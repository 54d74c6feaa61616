"""Map sources: what turns camera views and a query into a semantic map. A configuration names one of `SOURCES`.

A new one is a class, registered by its name. `ViewSource` is made for those that score the pixels of one view: it
fuses the views' scores from above. Others, such as one that finds boxes, derive from `MapSource`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from typing_extensions import override

from gem_lite.clip import Clip
from gem_lite.language import Query
from gem_lite.maps import semantic_map
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.registry import Registry
from gem_lite.rgbd.camera import View


class MapSource(ABC):
    """Camera views and a query to a map.

    Attributes:
        sees: whether its maps tell anything of the scene.
    """

    sees: ClassVar[bool] = True

    def __init__(self, clip: Clip, config: PatchConfig) -> None:
        self.clip = clip
        self.config = config

    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        """All that does not depend on the query. Here that is the height map alone."""
        return semantic_map.embed_views(views, self.clip, self.config)

    @abstractmethod
    def map(self, scene: SceneEmbedding, query: Query) -> np.ndarray:
        """Where a query lies in a scene that `embed` made.

        Returns:
            (H, W) float32; about 0 where nothing matches and about 1 on a match.
        """


class ViewSource(MapSource):
    """A scorer of one view, and the fusion by point cloud that all such sources share."""

    def embed_view(self, view: View, inside: np.ndarray) -> Any:
        """What `score_view` needs of a view, whatever the query. Here that is its picture, (H_n, W_n, 3) uint8.

        Args:
            inside: (H_n, W_n) bool, the pixels inside the workspace; nobody reads the scores of the others.
        """
        return view.rgb

    @abstractmethod
    def score_view(self, embedded: Any, query: Query) -> np.ndarray:
        """How well each pixel of a view matches, (H_n, W_n): about 0 where it does not, about 1 where it does."""

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        return semantic_map.embed_views(views, self.clip, self.config, self.embed_view)

    @override
    def map(self, scene: SceneEmbedding, query: Query) -> np.ndarray:
        return scene.fuse([self.score_view(side, query) for side in scene.sides])


SOURCES: Registry[type[MapSource]] = Registry("map source")
"""Map sources by their names."""
register = SOURCES.register


@register("multi-view")
class MultiView(MapSource):
    """The paper's (Eq. 1): CLIP's cosines with the patches of every view, fused from above."""

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        return semantic_map.embed_scene(views, self.clip, self.config)

    @override
    def map(self, scene: SceneEmbedding, query: Query) -> np.ndarray:
        return semantic_map.text_conditioned_map(scene, query, self.clip)


@register("single-view")
class SingleView(MapSource):
    """CLIP's cosines with the patches of the height map: the paper's "without multi-view" (A.2)."""

    @override
    def map(self, scene: SceneEmbedding, query: Query) -> np.ndarray:
        return semantic_map.single_view_map(scene, query, self.clip)


@register("none")
class NoMap(MapSource):
    """1 everywhere: the paper's "without semantic map" (A.2)."""

    sees = False

    @override
    def map(self, scene: SceneEmbedding, query: Query) -> np.ndarray:
        return np.ones(self.config.workspace.shape, np.float32)
