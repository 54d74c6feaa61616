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
    """Embeddings at the positions of a part of a picture.

    Attributes:
        values: (D, h, w) float32, unit length.
        shape: of the picture in pixels, (H, W).
        rows, cols: the embedded part of the picture.
    """

    values: torch.Tensor
    shape: tuple[int, int]
    rows: slice
    cols: slice

    def score(self, embedding: torch.Tensor) -> np.ndarray:
        """The cosine of every position with one embedding (D,): (H, W) float32, 0 outside the embedded part.

        It is interpolated between the positions.
        """
        cosines = torch.einsum("dhw,d->hw", self.values, embedding.to(self.values))
        scores = np.zeros(self.shape, np.float32)
        part = scores[self.rows, self.cols]
        part[:] = F.interpolate(cosines[None, None], part.shape, mode="bilinear")[0, 0].numpy()
        return scores


def embed_view(view: View, inside: np.ndarray, clip: Clip, config: PatchConfig) -> PositionEmbeddings:
    """Embed the positions of a view, in the smallest rectangle that holds its pixels of the workspace.

    Args:
        inside: (H_n, W_n) bool, these pixels; the others get the table's colour.
    """
    rows, cols = _bounds(inside), _bounds(inside.T)
    picture = patches.paint_outside(view.rgb, inside)[rows, cols]
    patch = patches.side_grid(view.camera, config).patch
    return PositionEmbeddings(clip.embed_positions(picture, patch), view.camera.size, rows, cols)


def _bounds(cells: np.ndarray) -> slice:
    """From the first to the last row that holds a True; all rows if there is none."""
    places = np.flatnonzero(cells.any(axis=1))
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0, len(cells))


def embed_scene(views: Sequence[View], clip: Clip, config: PatchConfig) -> SceneEmbedding:
    """Fuse the views, and embed the positions of each."""
    return semantic_map.embed_views(views, clip, config, lambda view, inside: embed_view(view, inside, clip, config))
