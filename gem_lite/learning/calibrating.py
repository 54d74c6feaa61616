"""Measure the numbers of a CLIP (`gem_lite.clip.calibration`) on scenes in which it is known what lies where."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from gem_lite import clip, colors, language, tasks
from gem_lite.clip import calibration
from gem_lite.clip.calibration import Calibration
from gem_lite.maps import crop_memory, semantic_map
from gem_lite.maps.patches import PatchConfig
from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2
from gem_lite.simulation.world import World

SCENES = 8
"""Calibration uses the first scenes of the validation split: no training and no test scene."""


class NamedScene(NamedTuple):
    """Views of a table, and phrases with the pose of what each of them names."""

    views: Sequence[View]
    named: Sequence[tuple[str, Pose2]]


def rendered_scenes(count: int = SCENES) -> Iterator[NamedScene]:
    """The library's own source of scenes: blocks and bowls in seen colours, with the phrases of their sentence."""
    with World() as world:
        for index in range(count):
            task = tasks.make("put-block-in-bowl-seen-colors", "val")
            views = world.reset(task, tasks.episode_seed("val", index)).views
            phrases, action = language.parse(task.instruction), task.expert(world).action
            yield NamedScene(views, ((phrases.pick, action.pick), (phrases.place, action.place)))


def calibrate(model: clip.Clip, scenes: Iterable[NamedScene], config: PatchConfig = PatchConfig()) -> Calibration:
    """Measure a CLIP's numbers: any scenes will do whose phrases and poses are known.

    Low is the median of the unscaled maps of the scenes' phrases, high the mean of their peaks. The views of each
    scene are embedded: seconds with the embedded CLIP, minutes with a ViT-B/32 on a CPU.

    Raises:
        ValueError: no scene, or no phrase in any of them.
    """
    text_maps, image_maps = [], []
    for views, named in tqdm(scenes, desc=f"calibrating {model.name}", unit="scene", leave=False):
        scene = semantic_map.embed_scene(views, model, config)
        for phrase, pose in named:
            words = semantic_map.embed_query(phrase, model)
            text_maps.append(scene.fuse([side.score(words) for side in scene.sides]))
            crop = crop_memory.cut(scene.heightmap, pose, config.top_patch)
            image_maps.append(scene.top.score(model.embed_images(crop[None])[0].cpu()))
    if not text_maps:
        raise ValueError("scenes must have at least one phrase with its pose, got none")

    def low(maps: list[np.ndarray]) -> float:
        return float(np.median(maps))

    def high(maps: list[np.ndarray]) -> float:
        return float(np.mean([scores.max() for scores in maps]))

    threshold = retrieval_threshold(model)
    return Calibration(low(text_maps), high(text_maps), low(image_maps), high(image_maps), threshold)


_NOUNS = {"block": "cube", "bowl": "dish", "letter E shape": None, "letter L shape": None}
_PARTS = (
    "spoon head", "spoon handle", "fork tines", "fork handle", "brush bristles", "brush handle", "spatula head",
    "spatula handle", "lamp base", "lamp shade", "chair seat", "chair legs", "mushroom cap", "mushroom stem",
)  # fmt: skip
_REWORDINGS = ("the {}", "a {}", "{}s", "a picture of the {}")


def retrieval_phrases() -> list[tuple[str, list[str]]]:
    """What the retrieval threshold is measured on: phrases, each with its rewordings.

    The seen colours of four nouns, and the parts of seven objects, so that near misses are among them: one
    letter for another, one part of a thing for its other part.
    """
    phrases = []
    for color in colors.SEEN:
        for noun, synonym in _NOUNS.items():
            named = f"{color} {noun}"
            more = [f"{color} {synonym}"] if synonym else []
            phrases.append((named, [template.format(named) for template in _REWORDINGS] + more))
    return phrases + [(part, [template.format(part) for template in _REWORDINGS]) for part in _PARTS]


def retrieval_threshold(model: clip.Clip) -> float:
    """The cosine that parts rewordings of a phrase from the nearest phrase of another colour, object or part.

    It lies as many standard deviations below the one group's mean as above the other's.
    """
    phrases = retrieval_phrases()
    reworded = [words for _, rewordings in phrases for words in rewordings]
    owner = np.repeat(np.arange(len(phrases)), [len(rewordings) for _, rewordings in phrases])
    similarity = (model.embed_texts(reworded) @ model.embed_texts([plain for plain, _ in phrases]).T).cpu().numpy()
    own = owner[:, None] == np.arange(len(phrases))
    same = similarity[own]
    nearest_other = np.where(own, -1, similarity).max(axis=1)
    spread = same.std() + nearest_other.std()
    return float((same.mean() * nearest_other.std() + nearest_other.mean() * same.std()) / spread)


def main() -> None:
    """Command line: see ``python -m gem_lite.learning.calibrating --help``."""
    parser = argparse.ArgumentParser(
        description="Measure the scale of a CLIP's scores and its retrieval threshold, and keep them.",
        epilog="example: python -m gem_lite.learning.calibrating openai/clip-vit-base-patch32",
    )
    parser.add_argument("clip", help="Hugging Face name or folder of a CLIP")
    args = parser.parse_args()
    try:
        model = clip.load(args.clip)
        numbers = calibrate(model, rendered_scenes())
        path = calibration.write(model, numbers)
    except (OSError, ValueError) as error:
        parser.exit(2, f"{error}\n")
    print(f"{numbers}\nwrote {path}")


if __name__ == "__main__":
    main()
