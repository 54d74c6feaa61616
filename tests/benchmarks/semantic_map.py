"""Seconds from three views to maps, each beside the straightforward way: python tests/benchmarks/semantic_map.py

New pictures, in batches and patch by patch; the same pictures again; and the maps of a refusal.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import torch
from timing import seconds

from gem_lite import clip, tasks
from gem_lite.maps import refusal, semantic_map
from gem_lite.maps.patches import PatchEmbeddings, PatchGrid, embed_patches, paint_outside, patchify
from gem_lite.maps.sources import MultiView
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.heightmap import sort_points
from gem_lite.simulation.world import World

PHRASE = "red block"
REPEATS = 3


def one_by_one(image: np.ndarray, grid: PatchGrid, model: clip.Clip) -> PatchEmbeddings:
    """What `embed_patches` computes, with one call of CLIP a patch."""
    patches = patchify(image, grid)
    values = [torch.stack([model.embed_images(patch[None].copy())[0] for patch in row]) for row in patches]
    return PatchEmbeddings(grid, torch.stack(values))


def main() -> None:
    """Print both times, their ratio, and the largest difference of the two maps."""
    model = clip.load()
    with World() as world:
        views = world.reset(tasks.make("put-block-in-bowl-seen-colors", "val"), tasks.episode_seed("val", 300))[0].views
    grid = PatchGrid(views[0].rgb.shape[:2], LITE.patch, LITE.stride)
    rows, cols = (len(starts) for starts in grid.starts())
    words = model.embed_texts([PHRASE])[0]
    inside = sort_points(views, LITE.workspace).kept

    def fused(embed: Callable[[np.ndarray, PatchGrid, clip.Clip], PatchEmbeddings]) -> np.ndarray:
        model.to("cpu")  # It forgets the pictures of the last run.
        points = sort_points(views, LITE.workspace)
        return points.project([embed(view.rgb, grid, model).score(words) for view in views])[0]

    def library() -> np.ndarray:
        model.to("cpu")
        return semantic_map.text_conditioned_map(semantic_map.embed_scene(views, model, LITE), PHRASE, model)

    for name, pictures in (
        ("as they are", [view.rgb for view in views]),
        ("outside painted", [paint_outside(view.rgb, kept) for view, kept in zip(views, inside, strict=True)]),
    ):
        cut = [patchify(picture, grid, grid.meets(kept)) for picture, kept in zip(pictures, inside, strict=True)]
        different = sum(len(np.unique(patches.reshape(len(patches), -1), axis=0)) for patches in cut)
        print(f"{name}: {sum(map(len, cut))} patches meet the workspace, {different} of them are different")
    fused(embed_patches)  # warm up
    print(f"{model.name}, {torch.get_num_threads()} threads; three views of {rows} x {cols} = {rows * cols} patches")
    fast, by_batch = seconds(lambda: fused(embed_patches), REPEATS)
    lean, _ = seconds(library, REPEATS)
    slow, by_patch = seconds(lambda: fused(one_by_one), 1)
    print(f"in batches, every patch:                                         {fast:5.2f} s")
    print(f"as the library does it (the workspace alone, equal patches once): {lean:5.2f} s")
    print(f"patch by patch:                                                  {slow:5.2f} s")
    print(f"patch by patch takes {slow / fast:.1f} times as long as batches, {slow / lean:.1f} times as the library")
    print(f"largest difference of the fused maps: {np.abs(by_batch - by_patch).max():.1e}")

    source = MultiView(model, LITE)
    scene = source.embed(views)
    again, _ = seconds(lambda: source.embed(views), REPEATS)
    print(f"the same pictures again: {again:.3f} s, embedded anew {lean:.3f} s: {lean / again:.0f} times as long")

    phrases = [PHRASE, *refusal.alternatives(PHRASE)]
    model.embed_texts(phrases)

    def pixel_by_pixel() -> np.ndarray:
        embeddings = [model.embed_texts([phrase])[0] for phrase in phrases]
        fused = [scene.fuse([side.score(words) for side in scene.sides]) for words in embeddings]
        return model.calibration.scale_text(np.stack(fused))

    def by_matrix() -> np.ndarray:
        fresh = dataclasses.replace(scene)  # without the matrix
        return np.stack([source.map(fresh, phrase) for phrase in phrases])

    slow, straight = seconds(pixel_by_pixel, REPEATS)
    fast, made = seconds(by_matrix, REPEATS)
    print(f"{len(phrases)} maps of a refusal: by one sparse matrix {fast:.3f} s, pixel by pixel {slow:.3f} s: ", end="")
    print(f"{slow / fast:.0f} times as long; largest difference {np.abs(straight - made).max():.1e}")


if __name__ == "__main__":
    main()
