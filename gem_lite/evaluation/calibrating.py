"""Measure the numbers of a CLIP (`gem_lite.clip.calibration`) on scenes whose objects and poses are known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, get_args

import numpy as np
from tqdm import tqdm

from gem_lite import clip, language, tasks
from gem_lite.clip.calibration import Calibration, Kind
from gem_lite.foundations import colors
from gem_lite.maps import crop_memory, dense, semantic_map
from gem_lite.maps.patches import PatchConfig
from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2
from gem_lite.simulation.world import World

LITE = PatchConfig()
"""The patches of the configuration `lite`, for every method."""
SCENES = 8
"""Calibration uses this number of scenes, the first of the validation split. None is a training or test scene."""


class NamedScene(NamedTuple):
    """Views of a table, and phrases with the poses of the objects that they name."""

    views: Sequence[View]
    named: Sequence[tuple[str, Pose2]]


def rendered_scenes(count: int = SCENES) -> Iterator[NamedScene]:
    """Rendered scenes: blocks and bowls in seen colours, with the phrases of the sentence."""
    with World() as world:
        for index in range(count):
            task = tasks.make("put-block-in-bowl-seen-colors", "val")
            views = world.reset(task, tasks.episode_seed("val", index))[0].views
            phrases, action = language.parse(task.instruction), task.expert(world).action
            yield NamedScene(views, ((phrases.pick, action.pick), (phrases.place, action.place)))


def calibrations(model: clip.Clip, count: int = SCENES) -> Iterator[tuple[Kind, Calibration]]:
    """A CLIP's numbers of each kind, measured on ``count`` rendered scenes."""
    for kind in get_args(Kind):
        yield kind, calibrate(model, rendered_scenes(count), kind=kind)


def calibrate(
    model: clip.Clip, scenes: Iterable[NamedScene], config: PatchConfig = LITE, kind: Kind = "patches"
) -> Calibration:  # fmt: skip
    """Measure a CLIP's numbers on scenes with known phrases and poses, from any source.

    The low value is the median of the unscaled maps of all phrases, the high value is the mean of their maxima. The
    views of each scene are embedded: this takes seconds with the embedded CLIP, minutes with a ViT-B/32 on a CPU.

    Args:
        kind: "dense" for the map source of this name.

    Raises:
        ValueError: there is no scene, or no scene has a phrase.
    """
    text_maps = []
    image_maps = []
    for views, named in tqdm(scenes, desc=f"calibrating {model.name}", unit="scene", leave=False):
        scene = (dense if kind == "dense" else semantic_map).embed_scene(views, model, config)
        for phrase, pose in named:
            words = semantic_map.embed_query(phrase, model)
            text_maps.append(scene.fuse([side.score(words) for side in scene.sides]))
            crop = model.embed_images(crop_memory.cut(scene.heightmap, pose, config.top_patch)[None])[0].cpu()
            if kind == "dense":  # a picture as a query is compared with the views
                image_maps.append(scene.fuse([side.score(crop) for side in scene.sides]))
            else:
                image_maps.append(scene.top.score(crop))
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
_PARAPHRASES = ("the {}", "a {}", "{}s", "a picture of the {}")


def retrieval_phrases() -> list[tuple[str, list[str]]]:
    """The phrases for measuring the retrieval threshold, each with its paraphrases.

    They are four nouns in the seen colours, and the parts of seven objects. So some differ very little: in one
    letter, or in the part of the same object.
    """
    phrases = []
    for color in colors.SEEN:
        for noun, synonym in _NOUNS.items():
            phrase = f"{color} {noun}"
            with_synonym = [f"{color} {synonym}"] if synonym else []
            phrases.append((phrase, [template.format(phrase) for template in _PARAPHRASES] + with_synonym))
    return phrases + [(part, [template.format(part) for template in _PARAPHRASES]) for part in _PARTS]


def retrieval_threshold(model: clip.Clip) -> float:
    """The cosine that separates the paraphrases of a phrase from the nearest phrase of another colour, object or part.

    Its distances from the means of the two groups are equal if measured in the groups' standard deviations.
    """
    phrases = retrieval_phrases()
    paraphrases = [paraphrase for _, group in phrases for paraphrase in group]
    phrase_index = np.repeat(np.arange(len(phrases)), [len(group) for _, group in phrases])
    phrase_texts = [phrase for phrase, _ in phrases]
    similarity = (model.embed_texts(paraphrases) @ model.embed_texts(phrase_texts).T).cpu().numpy()
    is_same = phrase_index[:, None] == np.arange(len(phrases))
    same = similarity[is_same]
    nearest_other = np.where(is_same, -1, similarity).max(axis=1)
    spread = same.std() + nearest_other.std()
    return float((same.mean() * nearest_other.std() + nearest_other.mean() * same.std()) / spread)
