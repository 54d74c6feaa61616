"""Square patches of a picture, cut and put together again (P and its inverse in Eq. 1), and their CLIP embeddings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from scipy import sparse

from gem_lite.clip import Clip
from gem_lite.config import COUNT, FACTORS, LENGTH, InputConfig, entry
from gem_lite.rgbd.camera import Camera

WIDTH, FOCAL = 640, 450.0
"""The width and the focal length (pixels) of a picture whose patches have the side that `PatchConfig` says."""


@dataclass(frozen=True)
class PatchConfig(InputConfig):
    """What decides the patches that CLIP embeds.

    Attributes:
        patch, stride: CLIP patches of the side views (pixels of a 480 x 640 view; see `side_grid` for wider ones). The
            paper's are 40 and 20. In `lite` a patch is about as wide as a block, so that some patches show one of two
            blocks that touch.
        top_patch, top_stride: CLIP patches of the height map (m).
        more_exposures: CLIP also sees the views brighter or darker by each of these factors, and a query's map may be
            that of the exposure at which CLIP is surest (`text_conditioned_map`). Only "multi-view" maps read it.
    """

    patch: int = entry(20, COUNT)
    stride: int = entry(10, COUNT)
    top_patch: float = entry(0.125, LENGTH, grows=True)
    top_stride: float = entry(0.0625, LENGTH, grows=True)
    more_exposures: tuple[float, ...] = entry((), FACTORS, added=True)


@dataclass(frozen=True)
class PatchGrid:
    """Where P cuts an (H, W) image: square patches of side ``patch`` every ``stride`` pixels.

    Where the stride does not divide the image, one more row and column of patches reaches the border,
    so every pixel is covered.
    """

    shape: tuple[int, int]
    patch: int
    stride: int

    def __post_init__(self) -> None:
        if not 1 <= self.patch <= min(self.shape):
            raise ValueError(f"patch must be in [1, {min(self.shape)}] for an image of {self.shape}, got {self.patch}")
        if not 1 <= self.stride <= self.patch:
            raise ValueError(f"stride must be in [1, patch = {self.patch}], got {self.stride}")

    def starts(self) -> tuple[np.ndarray, np.ndarray]:
        """First row of each row of patches, first column of each column of patches."""
        return self._starts(self.shape[0]), self._starts(self.shape[1])

    def _starts(self, length: int) -> np.ndarray:
        last = length - self.patch
        starts = np.arange(0, last + 1, self.stride)
        return starts if starts[-1] == last else np.append(starts, last)

    def coverage(self) -> tuple[np.ndarray, np.ndarray]:
        """(H, m) and (W, n) float32: 1 where a row (column) of pixels meets a row (column) of patches."""
        matrices = []
        for length, start in zip(self.shape, self.starts(), strict=True):
            pixel = np.arange(length)[:, None]
            matrices.append(((pixel >= start) & (pixel < start + self.patch)).astype(np.float32))
        return matrices[0], matrices[1]

    def meets(self, pixels: np.ndarray) -> np.ndarray:
        """(m, n) bool: the patches that contain at least one of some ``pixels``, (H, W) bool."""
        rows, cols = self.coverage()
        return _product(rows.T, pixels, cols) > 0


def patchify(image: np.ndarray, grid: PatchGrid, selected: np.ndarray | None = None) -> np.ndarray:
    """P of Eq. 1: an (H, W, C) image to its (m, n, patch, patch, C) patches.

    With ``selected`` (m, n) bool, only those patches: (N, patch, patch, C).
    """
    if image.shape[:2] != grid.shape:
        raise ValueError(f"image must be {grid.shape} in height and width, got {image.shape}")
    (height, width), channels = grid.shape, image.shape[2]
    rows, cols = grid.starts()
    # Over rows of bytes, so that a row of a patch is copied at once.
    lines = np.ascontiguousarray(image).reshape(height, width * channels)
    windows = np.lib.stride_tricks.sliding_window_view(lines, (grid.patch, grid.patch * channels))
    which = np.ix_(rows, cols * channels)
    if selected is not None:
        i, j = np.nonzero(selected)
        which = rows[i], cols[j] * channels
    patches = windows[which]
    return patches.reshape(*patches.shape[:-1], grid.patch, channels)


def unpatchify(scores: np.ndarray, grid: PatchGrid) -> np.ndarray:
    """P⁻¹ of Eq. 1: (m, n) scores to (H, W), each pixel the mean of the patches that cover it."""
    rows, cols = grid.coverage()
    total = _product(rows, scores, cols.T)
    return total / (rows.sum(axis=1)[:, None] * cols.sum(axis=1)[None, :])


@lru_cache(maxsize=16)
def blocks(grid: PatchGrid) -> tuple[np.ndarray, sparse.csr_array]:
    """P⁻¹ of Eq. 1 as a matrix. Pixels that the same patches cover are one block, and get the same value.

    Returns:
        (H, W) int, the block of each pixel; and (blocks, m * n) float32, which turns the flat scores of all patches
        into the values of the blocks. `unpatchify` is the value of its block at each pixel.
    """
    (rows, row_of), (cols, col_of) = (np.unique(part, axis=0, return_inverse=True) for part in grid.coverage())
    means = [sparse.csr_array(part / part.sum(axis=1, keepdims=True)) for part in (rows, cols)]
    return row_of[:, None] * len(cols) + col_of, sparse.csr_array(sparse.kron(*means))


def _product(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    # By torch: NumPy's BLAS threads keep spinning afterwards, and slow down the network that runs next.
    return torch.linalg.multi_dot([torch.from_numpy(m.astype(np.float32)) for m in (a, b, c)]).numpy()


@dataclass(frozen=True)
class PatchEmbeddings:
    """CLIP embeddings of an image's patches: (m, n, D) float32, unit length, 0 for patches that were not embedded."""

    grid: PatchGrid
    values: torch.Tensor

    def score(self, embedding: torch.Tensor) -> np.ndarray:
        """Cosine of every patch with one embedding (D,), spread back over the pixels: (H, W)."""
        return unpatchify((self.values @ embedding.to(self.values)).numpy(), self.grid)


def embed_patches(image: np.ndarray, grid: PatchGrid, clip: Clip, needed: np.ndarray | None = None) -> PatchEmbeddings:
    """Embed the patches of an image in batches. Equal patches, such as bare table without noise, are embedded once.

    Patches that an earlier image had are not embedded again (`Clip.embed_known_images`).

    Args:
        image: (H, W, 3) uint8.
        needed: (H, W) bool; patches without a needed pixel are skipped.
    """
    chosen = grid.meets(np.ones(grid.shape, bool) if needed is None else needed)
    values = torch.zeros(*chosen.shape, clip.dim)
    if chosen.any():
        patches = patchify(image, grid, chosen)  # (N, patch, patch, 3)
        as_bytes = patches.reshape(len(patches), -1).view(np.dtype((np.void, patches[0].nbytes))).ravel()
        _, first, number = np.unique(as_bytes, return_index=True, return_inverse=True)
        values[torch.from_numpy(chosen)] = clip.embed_known_images(patches[first])[torch.from_numpy(number)]
    return PatchEmbeddings(grid, values)


def exposed(rgb: np.ndarray, factor: float) -> np.ndarray:
    """A picture (H, W, 3) uint8 that is brighter by a factor, as after a longer exposure; what is too bright is cut."""
    return np.clip(rgb * np.float32(factor), 0, 255).astype(np.uint8)


def paint_outside(rgb: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) with all pixels outside the workspace in the table's colour.

    So a patch at the table's edge shows neither the floor nor things beside the table. Most of these patches then equal
    the bare table, which `embed_patches` embeds once.

    Args:
        inside: (H, W) bool, the pixels inside the workspace; the table's colour is their median.
    """
    if not inside.any():
        return rgb
    painted = rgb.copy()
    painted[~inside] = np.median(rgb[inside], axis=0).astype(np.uint8)
    return painted


def side_grid(camera: Camera, config: PatchConfig) -> PatchGrid:
    """The patches of a camera's view.

    In a picture wider than `WIDTH` pixels, they grow with it, but no more than its focal length does: a wide picture
    may be finer, or show more. So a patch shows the same part of the table however fine the picture is. The points keep
    the picture's full resolution.
    """
    scale = max(1.0, min(camera.size[1] / WIDTH, camera.focal / FOCAL))
    return PatchGrid(camera.size, round(config.patch * scale), round(config.stride * scale))


def top_grid(config: PatchConfig) -> PatchGrid:
    """The patches of the height map: the same size in metres at every resolution."""
    patch, stride = (round(length / config.pixel) for length in (config.top_patch, config.top_stride))
    return PatchGrid(config.workspace.shape, patch, stride)
