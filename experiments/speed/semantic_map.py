"""Seconds from three views to maps, each beside the straightforward way: python -m experiments.speed.semantic_map

New pictures, in batches and patch by patch; and the same pictures again. Also printed: how many patches are left.
"""

import numpy as np
import torch

from experiments.speed.timing import seconds
from gem_lite import clip, tasks
from gem_lite.maps import semantic_map
from gem_lite.maps.patches import PatchEmbeddings, PatchGrid, embed_patches, paint_outside, patchify
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
    """Print the times and the largest difference of the maps."""
    model = clip.load()
    with World() as world:
        views = world.reset(tasks.make("put-block-in-bowl-seen-colors", "val"), tasks.episode_seed("val", 300))[0].views
    grid = PatchGrid(views[0].rgb.shape[:2], LITE.patch, LITE.stride)
    points = sort_points(views, LITE.workspace)
    painted = [paint_outside(view.rgb, kept) for view, kept in zip(views, points.kept, strict=True)]
    for name, pictures in (("as they are", [view.rgb for view in views]), ("outside painted", painted)):
        cut = [patchify(picture, grid, grid.meets(kept)) for picture, kept in zip(pictures, points.kept, strict=True)]
        different = sum(len(np.unique(patches.reshape(len(patches), -1), axis=0)) for patches in cut)
        print(f"{name}: {sum(map(len, cut))} patches meet the workspace, {different} of them are different")
    words = model.embed_texts([PHRASE])[0]

    def all_patches(embed=embed_patches) -> np.ndarray:
        model.to("cpu")  # It forgets the pictures of the last run.
        return points.project([embed(view.rgb, grid, model).score(words) for view in views])

    def library(forget: bool = True) -> np.ndarray:
        if forget:
            model.to("cpu")
        return semantic_map.text_conditioned_map(semantic_map.embed_scene(views, model, LITE), PHRASE, model)

    all_patches()  # warm up
    print(f"{model.name}, {torch.get_num_threads()} threads; seconds for three views")
    slow, by_patch = seconds(lambda: all_patches(one_by_one), 1)
    fast, by_batch = seconds(all_patches, REPEATS)
    print(f"patch by patch {slow:.2f}, in batches {fast:.2f}; difference {np.abs(by_batch - by_patch).max():.1e}")
    print(f"the workspace alone, equal patches once (the library): {seconds(library, REPEATS)[0]:.2f}")
    print(f"the same pictures again: {seconds(lambda: library(forget=False), REPEATS)[0]:.2f}")


if __name__ == "__main__":
    main()
