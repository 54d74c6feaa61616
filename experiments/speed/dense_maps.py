"""The time of a scene's dense map, beside that of its patches, for the embedded CLIP and for one of ViT-B/32's size.

The ViT has the sizes of openai/clip-vit-base-patch32 and random weights: its maps mean nothing, its time does. Its
patches would take minutes, so that only some of them are timed.

python -m experiments.speed.dense_maps
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from transformers import CLIPConfig, CLIPModel

from gem_lite import clip, tasks
from gem_lite.clip import Clip
from gem_lite.maps import dense, patches, semantic_map
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.heightmap import sort_points
from gem_lite.rgbd.observation import Observation
from gem_lite.simulation.world import World

TASK, SCENES, TIMED_PATCHES = "put-block-in-bowl-seen-colors", 3, 128


def random_vit(folder: Path) -> Clip:
    """A CLIP with the sizes of ViT-B/32, random weights, and the embedded model's tokenizer."""
    text = {"vocab_size": 49408, "eos_token_id": 3, "max_position_embeddings": 77}
    CLIPModel(CLIPConfig(text_config=text, vision_config={}, projection_dim=512)).save_pretrained(folder)
    for name in ("tokenizer.json", "tokenizer_config.json"):
        shutil.copy(clip.EMBEDDED / name, folder)
    preprocessing = {"size": 224, "image_mean": [0.5] * 3, "image_std": [0.5] * 3}
    (folder / "preprocessor_config.json").write_text(json.dumps(preprocessing))
    return clip.load(folder)


def scene_seconds(embed: Callable[..., object], scenes: Sequence[Observation], model: Clip) -> float:
    """The median time of a scene, of which the CLIP remembers nothing. The first one warms up."""
    times = []
    for scene in scenes:
        model.to("cpu")  # It forgets what it has embedded.
        start = time.perf_counter()
        embed(scene.views, model, LITE)
        times.append(time.perf_counter() - start)
    return float(np.median(times[1:]))


def count_patches(observation: Observation) -> int:
    """How many different patches of a scene's views show the workspace: so many are embedded."""
    count = 0
    for view, inside in zip(observation.views, sort_points(observation.views, LITE.workspace).kept, strict=True):
        grid = patches.side_grid(view.camera, LITE)
        picture = patches.paint_outside(view.rgb, inside)
        count += len(
            np.unique(patches.patchify(picture, grid, grid.meets(inside)).reshape(-1, 3 * grid.patch**2), axis=0)
        )
    return count


def main() -> None:
    task = tasks.make(TASK, "val")
    with World() as world:
        scenes = [world.reset(task, tasks.episode_seed("val", index))[0] for index in range(SCENES + 1)]
    embedded = clip.load()
    by_patches = scene_seconds(semantic_map.embed_scene, scenes, embedded)
    by_views = scene_seconds(dense.embed_scene, scenes, embedded)
    print(f"the embedded CLIP, a scene of three views (median of {SCENES}):")
    print(f"  patches {by_patches:.2f} s, dense {by_views:.2f} s, ratio {by_patches / by_views:.2f}")
    with tempfile.TemporaryDirectory() as folder:
        vit = random_vit(Path(folder))
        by_views = scene_seconds(dense.embed_scene, scenes, vit)
        pictures = np.random.default_rng(0).integers(0, 255, (TIMED_PATCHES, LITE.patch, LITE.patch, 3), np.uint8)
        start = time.perf_counter()
        vit.embed_images(pictures)
        a_patch = (time.perf_counter() - start) / TIMED_PATCHES
        needed = count_patches(scenes[1])
        by_patches = needed * a_patch
        print(f"ViT-B/32's size, {vit.parameter_count / 1e6:.0f} M random parameters:")
        print(f"  dense {by_views:.2f} s a scene; a patch {1000 * a_patch:.0f} ms, {needed} patches in a scene")
        print(f"  patches, by these numbers, {by_patches:.0f} s, ratio {by_patches / by_views:.0f}")


if __name__ == "__main__":
    main()
