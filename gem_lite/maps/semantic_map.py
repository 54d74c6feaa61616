"""Patch-level semantic maps (Sec. 3.1): text-conditioned, image-conditioned, their blend, their equivariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch

from gem_lite.clip import Clip
from gem_lite.config import Config
from gem_lite.maps.crop_memory import CropMemory
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap, PointLabels, fuse_views, sort_points
from gem_lite.se2 import angle_bins, rotate_image


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
        found = []
        for length in self.shape:
            start = np.arange(0, length - self.patch + 1, self.stride)
            last = length - self.patch
            found.append(start if start[-1] == last else np.append(start, last))
        return found[0], found[1]

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


def patchify(image: np.ndarray, grid: PatchGrid, wanted: np.ndarray | None = None) -> np.ndarray:
    """P of Eq. 1: an (H, W, C) image to its (m, n, patch, patch, C) patches.

    With ``wanted`` (m, n) bool, only those patches: (N, patch, patch, C).
    """
    if image.shape[:2] != grid.shape:
        raise ValueError(f"image must be {grid.shape} in height and width, got {image.shape}")
    (height, width), channels = grid.shape, image.shape[2]
    rows, cols = grid.starts()
    # Over rows of bytes, so that a row of a patch is copied at once.
    lines = np.ascontiguousarray(image).reshape(height, width * channels)
    windows = np.lib.stride_tricks.sliding_window_view(lines, (grid.patch, grid.patch * channels))
    which = np.ix_(rows, cols * channels)
    if wanted is not None:
        i, j = np.nonzero(wanted)
        which = rows[i], cols[j] * channels
    patches = windows[which]
    return patches.reshape(*patches.shape[:-1], grid.patch, channels)


def unpatchify(scores: np.ndarray, grid: PatchGrid) -> np.ndarray:
    """P⁻¹ of Eq. 1: (m, n) scores to (H, W), each pixel the mean of the patches that cover it."""
    rows, cols = grid.coverage()
    total = _product(rows, scores, cols.T)
    return total / (rows.sum(axis=1)[:, None] * cols.sum(axis=1)[None, :])


def _product(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    # By torch: NumPy's own BLAS threads would go on spinning and take the cores from the network that comes next.
    return torch.linalg.multi_dot([torch.from_numpy(m.astype(np.float32)) for m in (a, b, c)]).numpy()


@dataclass(frozen=True)
class PatchEmbeddings:
    """CLIP embeddings of an image's patches: (m, n, D) float32, unit length, 0 where ``wanted`` was False."""

    grid: PatchGrid
    values: torch.Tensor

    def score(self, embedding: torch.Tensor) -> np.ndarray:
        """Cosine of every patch with one embedding (D,), spread back over the pixels: (H, W)."""
        return unpatchify((self.values @ embedding.to(self.values)).numpy(), self.grid)


def embed_patches(image: np.ndarray, grid: PatchGrid, clip: Clip, wanted: np.ndarray | None = None) -> PatchEmbeddings:
    """Embed the patches of an image in batches; equal ones, such as bare table without noise, once.

    Args:
        image: (H, W, 3) uint8.
        wanted: (H, W) bool; patches that meet no wanted pixel are skipped, since nobody will read them.
    """
    chosen = grid.meets(np.ones(grid.shape, bool) if wanted is None else wanted)
    values = torch.zeros(*chosen.shape, clip.dim)
    if chosen.any():
        patches = patchify(image, grid, chosen)  # (N, patch, patch, 3)
        as_bytes = patches.reshape(len(patches), -1).view(np.dtype((np.void, patches[0].nbytes))).ravel()
        _, first, again = np.unique(as_bytes, return_index=True, return_inverse=True)
        values[torch.from_numpy(chosen)] = clip.embed_images(patches[first]).cpu()[torch.from_numpy(again)]
    return PatchEmbeddings(grid, values)


@dataclass(frozen=True)
class SceneEmbedding:
    """All that the maps of one scene share, whatever the phrase: computed once an observation."""

    heightmap: HeightMap
    points: PointLabels
    sides: tuple[PatchEmbeddings, ...]
    embed_top: Callable[[], PatchEmbeddings]

    @cached_property
    def top(self) -> PatchEmbeddings:
        """The height map's own patches, embedded at first use: the text-conditioned map does not need them."""
        return self.embed_top()


def embed_scene(views: Sequence[View], clip: Clip, config: Config) -> SceneEmbedding:
    """Fuse the views and embed the patches of each view; those of the height map when they are asked for."""
    points = sort_points(views, config.workspace)
    heightmap = fuse_views(views, config.workspace, points)
    sides = tuple(
        embed_patches(paint_outside(view.rgb, kept), PatchGrid(kept.shape, config.patch, config.stride), clip, kept)
        for view, kept in zip(views, points.kept, strict=True)
    )
    return SceneEmbedding(heightmap, points, sides, lambda: embed_patches(heightmap.rgb, top_grid(config), clip))


def paint_outside(rgb: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) with what lies outside the workspace in the table's colour.

    So a patch at the table's edge tells nothing of the floor or of what stands beside the table. Most of these
    patches then equal the bare table, which `embed_patches` embeds once.

    Args:
        inside: (H, W) bool, the pixels inside the workspace; the table's colour is their median.
    """
    if not inside.any():
        return rgb
    return np.where(inside[..., None], rgb, np.median(rgb[inside], axis=0).astype(np.uint8))


def with_top_patches(scene: SceneEmbedding, clip: Clip, config: Config) -> SceneEmbedding:
    """The same scene with its height map cut into the patches of another configuration of the same resolution."""
    return replace(scene, embed_top=lambda: embed_patches(scene.heightmap.rgb, top_grid(config), clip))


def top_grid(config: Config) -> PatchGrid:
    """The patches of the height map: the same size in metres at every resolution."""
    patch, stride = (round(length / config.pixel) for length in (config.top_patch, config.top_stride))
    return PatchGrid(config.workspace.shape, patch, stride)


TEMPLATES = ("{}", "a {}", "the {}", "a photo of a {}", "a picture of the {}")
"""Wordings whose mean embedding can stand for a phrase (CLIP's prompt ensemble)."""


def embed_phrase(phrase: str, clip: Clip, templates: Sequence[str] = ()) -> torch.Tensor:
    """A phrase's embedding (D,), on the CPU: its own or, with templates, the mean of its wordings' embeddings.

    Raises:
        ValueError: an empty phrase, or a template without ``{}``.
    """
    if any("{}" not in template for template in templates):
        raise ValueError(f"each of templates must have a place {{}} for the phrase, got {list(templates)}")
    if not phrase.strip():
        raise ValueError(f"phrase must not be empty, got {phrase!r}")
    wordings = [template.format(phrase) for template in templates] or [phrase]
    return torch.nn.functional.normalize(clip.embed_texts(wordings).mean(dim=0), dim=0).cpu()


def text_conditioned_map(
    scene: SceneEmbedding, phrase: str, clip: Clip, templates: Sequence[str] = (), against: Sequence[str] = ()
) -> np.ndarray:
    """M_text (Eq. 1): every view's patches scored against a phrase, fused from above by point cloud.

    Args:
        templates: wordings to average, such as `TEMPLATES`; the paper has none.
        against: other phrases. Where one of them scores above the empty table, that much is taken off:
            "yellow screwdriver" against "yellow block" fades on the block. The paper has none.

    Returns:
        (H, W) float32; about 0 where nothing matches and 1 on a match, by the CLIP's calibration.
    """

    def score(words: str) -> np.ndarray:
        embedding = embed_phrase(words, clip, templates)
        fused, _ = scene.points.project([side.score(embedding) for side in scene.sides])
        return clip.calibration.scale_text(fused)

    own = score(phrase)
    return own - np.maximum.reduce([score(other) for other in against] + [np.zeros_like(own)]) if against else own


def single_view_map(scene: SceneEmbedding, phrase: str, clip: Clip) -> np.ndarray:
    """The text-conditioned map from the height map's own patches: the paper's "without multi-view" (A.2).

    Returns:
        (H, W) float32 on the scale of `text_conditioned_map`, by the same calibration.
    """
    return clip.calibration.scale_text(scene.top.score(embed_phrase(phrase, clip)))


def image_conditioned_map(
    scene: SceneEmbedding, phrase: str, clip: Clip, memory: CropMemory | None, exclude_episode: int | None = None
) -> np.ndarray | None:
    """M_image (Eq. 2-3): the demonstrations' crop for this phrase against the height map's patches.

    Args:
        memory: crops to search; None means there are none.
        exclude_episode: an episode whose crops must not be found (training's own).

    Returns:
        (H, W) float32 on the scale of `text_conditioned_map`, or None if no crop's phrase is near enough.
    """
    if memory is None:
        return None
    crop = memory.retrieve(embed_phrase(phrase, clip), clip.calibration.retrieval_threshold, exclude_episode)
    return None if crop is None else clip.calibration.scale_image(scene.top.score(crop))


def fuse(text: np.ndarray, image: np.ndarray | None, w1: float, w2: float) -> np.ndarray:
    """The weighted average of Eq. 4, before depth; the text map alone where there is no image map."""
    if w1 < 0 or w2 < 0 or w1 + w2 == 0:
        raise ValueError(f"w1 and w2 must not be negative nor both 0, got {w1} and {w2}")
    return text if image is None else (w1 * text + w2 * image) / (w1 + w2)


PLATEAU = 0.2
"""Cells at most this far below a map's peak belong to its plateau, where a match is 1 (chosen on validation scenes)."""


def plateau_centre(semantic: np.ndarray, config: Config) -> tuple[float, float]:
    """The centre (row, col) of a map's highest plateau: where the map points, since patches blur its peak.

    From the brightest cell, mean shift: the mean of the cells within half a patch, weighted by how far they
    rise above the plateau's foot, again and again until it stays. Two objects side by side share a
    plateau; half a patch holds one of them.

    Args:
        semantic: (H, W), of ``config``'s resolution.
    """
    weight = np.maximum(semantic.astype(np.float64) - semantic.max() + PLATEAU, 0)
    rows, cols = np.mgrid[: semantic.shape[0], : semantic.shape[1]]
    reach = config.top_patch / 2 / config.pixel
    row, col = (float(i) for i in np.unravel_index(semantic.argmax(), semantic.shape))
    for _ in range(50):
        near = weight * (np.hypot(rows - row, cols - col) <= reach)
        before, row, col = (row, col), float((near * rows).sum() / near.sum()), float((near * cols).sum() / near.sum())
        if np.hypot(row - before[0], col - before[1]) < 0.01:
            break
    return row, col


def frame_averaged(
    score: Callable[[np.ndarray], np.ndarray], image: np.ndarray, rotations: int
) -> tuple[np.ndarray, np.ndarray]:
    """Average a map over the rotations C_n of its picture (A.8.5): (1/n) sum_g g^-1 score(g image).

    The result is equivariant: exactly to quarter turns if 4 divides n, to the other turns of C_n up to
    interpolation. What turning brings in from outside shows the picture's median colour, and what it
    moves out of the picture is left out of the average.

    Args:
        score: maps an (S, S, 3) uint8 picture to an (S, S) map.
        image: (S, S, 3) uint8, a square crop of a height map.
        rotations: n, at least 1.

    Returns:
        The averaged map (S, S) float32, and (S, S) bool: cells that no rotation moves out of the picture.

    Raises:
        ValueError: the picture is not square or not uint8, or n is less than 1.
    """
    if image.ndim != 3 or image.shape[0] != image.shape[1] or image.dtype != np.uint8:
        raise ValueError(f"image must be a square (S, S, 3) uint8 picture, got {image.shape} {image.dtype}")
    if rotations < 1:
        raise ValueError(f"rotations must be at least 1, got {rotations}")
    outside = np.round(np.median(image, axis=(0, 1)))
    # Relative to the outside's colour, the zeros that rotate_image fills in are that colour. Doubles, so
    # that a picture and its quarter turn are rounded to the same bytes.
    relative = torch.from_numpy(image - outside).permute(2, 0, 1)[None]
    total, weight = np.zeros(image.shape[:2]), np.zeros(image.shape[:2])
    inside = np.ones(image.shape[:2], bool)
    for angle in torch.from_numpy(angle_bins(rotations)):
        turned = rotate_image(relative, angle[None])[0].permute(1, 2, 0).numpy() + outside
        there = torch.from_numpy(score(np.round(turned).astype(np.uint8)).astype(np.float64))
        # The map and its mask turn back together, so a cell cut by the border still averages to its map.
        back, kept = rotate_image(torch.stack([there, torch.ones_like(there)])[None], -angle[None])[0].numpy()
        total, weight, inside = total + back, weight + kept, inside & (kept > 1 - 1e-4)
    return (total / weight).astype(np.float32), inside


def equivariance_error(score: Callable[[np.ndarray], np.ndarray], image: np.ndarray, rotations: int) -> float:
    """Mean absolute difference of a plain map and its `frame_averaged` one (A.8.5: 0.02).

    Taken over the cells that no rotation moves out of the picture, in the units of ``score``; the
    arguments are those of `frame_averaged`.
    """
    averaged, inside = frame_averaged(score, image, rotations)
    return float(np.abs(score(image) - averaged)[inside].mean())
