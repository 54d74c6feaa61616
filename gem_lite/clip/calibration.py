"""The numbers that belong to one CLIP: the scale of its scores and its retrieval threshold.

A real CLIP's cosines between a picture and a matching text lie near 0.3, another model's near 0.8. The
maps are scaled by constants of the model in use, never by the minimum and maximum of the image at hand.
"""

from __future__ import annotations

import dataclasses
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from gem_lite import colors
from gem_lite.config import LITE, Config

if TYPE_CHECKING:
    from gem_lite.clip import Clip

SCENES = 8
"""Calibration uses the first scenes of the validation split: no training and no test scene."""


@dataclass(frozen=True)
class Calibration:
    """Linear scales that send the typical empty cell to 0 and the typical match to 1, and a threshold.

    ``retrieval_threshold`` is the cosine above which two phrases mean the same (0.965 for OpenAI's
    ViT-B/32 in the paper).

    Raises ValueError for what is no cosine, or a scale whose match is not above its empty cell.
    """

    text_low: float
    text_high: float
    image_low: float
    image_high: float
    retrieval_threshold: float

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not -1.001 <= value <= 1.001:
                raise ValueError(f"{name} must be a cosine in [-1, 1], got {value!r}")
        for kind, low, high in (("text", self.text_low, self.text_high), ("image", self.image_low, self.image_high)):
            if not low < high:
                raise ValueError(f"{kind}_high must lie above {kind}_low, got {high} and {low}")

    def scale_text(self, cosine: np.ndarray) -> np.ndarray:
        """Scale text-to-image cosines."""
        return ((cosine - self.text_low) / (self.text_high - self.text_low)).astype(np.float32)

    def scale_image(self, cosine: np.ndarray) -> np.ndarray:
        """Scale image-to-image cosines."""
        return ((cosine - self.image_low) / (self.image_high - self.image_low)).astype(np.float32)


def calibrate(clip: Clip, config: Config = LITE, scenes: int = SCENES) -> Calibration:
    """Measure a CLIP's numbers on validation scenes and on phrases in seen colours.

    Low is the median of the unscaled maps, high the mean of their peaks, over the phrases of each
    scene's own instruction. Three views are embedded a scene: seconds with the embedded CLIP, minutes
    with a ViT-B/32 on a CPU.
    """
    from gem_lite import language, tasks
    from gem_lite.maps import crop_memory, semantic_map
    from gem_lite.simulation.world import World

    text_maps, image_maps = [], []
    with World() as world:
        for index in tqdm(range(scenes), desc=f"calibrating {clip.name}", unit="scene", leave=False):
            task = tasks.make("put-block-in-bowl-seen-colors", "val")
            views = world.reset(task, tasks.episode_seed("val", index)).views
            scene = semantic_map.embed_scene(views, clip, config)
            phrases, action = language.parse(task.instruction), task.expert(world).action
            for phrase, pose in ((phrases.pick, action.pick), (phrases.place, action.place)):
                words = clip.embed_texts([phrase])[0].cpu()
                text_maps.append(scene.points.project([side.score(words) for side in scene.sides])[0])
                crop = crop_memory.cut(scene.heightmap, pose, config.top_patch)
                image_maps.append(scene.top.score(clip.embed_images(crop[None])[0].cpu()))

    def low(maps: list[np.ndarray]) -> float:
        return float(np.median(maps))

    def high(maps: list[np.ndarray]) -> float:
        return float(np.mean([m.max() for m in maps]))

    return Calibration(low(text_maps), high(text_maps), low(image_maps), high(image_maps), retrieval_threshold(clip))


_NOUNS = {"block": "cube", "bowl": "dish", "letter E shape": None, "letter L shape": None}
_PARTS = (
    "spoon head", "spoon handle", "fork tines", "fork handle", "brush bristles", "brush handle", "spatula head",
    "spatula handle", "lamp base", "lamp shade", "chair seat", "chair legs", "mushroom cap", "mushroom stem",
)  # fmt: skip
_REWORDED = ("the {}", "a {}", "{}s", "a picture of the {}")


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
            phrases.append((named, [template.format(named) for template in _REWORDED] + more))
    return phrases + [(part, [template.format(part) for template in _REWORDED]) for part in _PARTS]


def retrieval_threshold(clip: Clip) -> float:
    """The cosine that parts rewordings of a phrase from the nearest phrase of another colour, object or part.

    It lies as many standard deviations below the one group's mean as above the other's.
    """
    phrases = retrieval_phrases()
    reworded = [words for _, rewordings in phrases for words in rewordings]
    owner = np.repeat(np.arange(len(phrases)), [len(rewordings) for _, rewordings in phrases])
    similarity = (clip.embed_texts(reworded) @ clip.embed_texts([plain for plain, _ in phrases]).T).cpu().numpy()
    mine = owner[:, None] == np.arange(len(phrases))
    same, nearest_other = similarity[mine], np.where(mine, -1, similarity).max(axis=1)
    spread = same.std() + nearest_other.std()
    return float((same.mean() * nearest_other.std() + nearest_other.mean() * same.std()) / spread)


def path_for(clip: Clip) -> Path:
    """Where a CLIP's calibration is kept: beside an embedded model, in the user's cache for others."""
    from gem_lite.clip import DATA

    if clip.folder is not None and clip.folder.resolve().parent == DATA.resolve():
        return clip.folder / "calibration.json"
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "gem_lite"
    return cache / f"calibration-{clip.fingerprint}.json"


def load_or_measure(clip: Clip) -> Calibration:
    """A CLIP's calibration from its file; measured and filed if there is none yet.

    Raises:
        ValueError: the file is damaged.
    """
    from gem_lite.files import read_json, write_whole

    path = path_for(clip)
    if path.exists():
        values = read_json(path.read_bytes(), path)
        try:
            return Calibration(**values)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} is no calibration ({error}): remove it, and it is measured again") from error
    calibration = calibrate(clip)
    write_whole(path, json.dumps(dataclasses.asdict(calibration), indent=1).encode())
    return calibration
