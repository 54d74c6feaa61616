"""What a dense map needs: one pass of CLIP's image tower for each view, in place of thousands of patches.

It is what makes a full-size CLIP usable without a GPU. This part is ours; the paper's maps are made of patches (Eq. 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F

from gem_lite.clip import Clip
from gem_lite.maps import patches, semantic_map
from gem_lite.maps.patches import PatchConfig
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.rgbd.camera import View


@dataclass(frozen=True)
class PositionEmbeddings:
    """Embeddings at the positions of a picture.

    Attributes:
        values: (D, h, w) float32, unit length.
        shape: of the picture in pixels, (H, W).
    """

    values: torch.Tensor
    shape: tuple[int, int]

    def score(self, embedding: torch.Tensor) -> np.ndarray:
        """The cosine of every position with one embedding (D,), interpolated between positions: (H, W) float32."""
        cosines = torch.einsum("dhw,d->hw", self.values, embedding.to(self.values))
        return F.interpolate(cosines[None, None], self.shape, mode="bilinear")[0, 0].numpy()


def embed_view(view: View, inside: np.ndarray, clip: Clip, config: PatchConfig) -> PositionEmbeddings:
    """Embed the positions of a view.

    Args:
        inside: (H_n, W_n) bool, the pixels inside the workspace; the others get the table's colour.
    """
    picture = patches.paint_outside(view.rgb, inside)
    patch = patches.side_grid(view.camera, config).patch
    return PositionEmbeddings(clip.embed_positions(picture, patch), view.camera.size)


def embed_scene(views: Sequence[View], clip: Clip, config: PatchConfig) -> SceneEmbedding:
    """Fuse the views, and embed the positions of each."""
    return semantic_map.embed_views(views, clip, config, lambda view, inside: embed_view(view, inside, clip, config))
