"""The numbers of a CLIP: the scale of its scores and its retrieval threshold.

The cosine between a picture and a matching text is near 0.3 for OpenAI's CLIP and near 0.8 for other models. So maps
are scaled by constants of the model, never by the minimum and maximum of the present image.
`gem_lite.evaluation.calibrating` measures these constants.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from gem_lite.foundations.files import DATA, cache_folder, read_json, write_atomically


class Model(Protocol):
    """What the numbers of a `gem_lite.clip.Clip` are filed by: its name, its folder and its fingerprint."""

    name: str
    folder: Path | None
    fingerprint: str


@dataclass(frozen=True)
class Calibration:
    """Two linear scales and a threshold. A scale maps the score of a typical empty cell to 0 and of a match to 1.

    Attributes:
        text_low, text_high: text-to-image cosine of an empty cell, and of a match.
        image_low, image_high: image-to-image cosine of an empty cell, and of a match.
        retrieval_threshold: two phrases mean the same if their cosine is above it (0.965 for OpenAI's ViT-B/32 in
            the paper).

    Raises:
        ValueError: a number is not a cosine, or a high value is not above its low value.
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


Kind = Literal["patches", "dense"]
"""What is compared with a query: embeddings of patches, or of a picture's positions (`Clip.embed_positions`)."""


def path_for(clip: Model, kind: Kind = "patches") -> Path:
    """The file of a CLIP's calibration: in the folder of an embedded model; for others in the user's cache."""
    stem = "calibration" if kind == "patches" else f"calibration-{kind}"
    if clip.folder is not None and clip.folder.resolve().parent == DATA.resolve():
        return clip.folder / f"{stem}.json"
    return cache_folder() / f"{stem}-{clip.fingerprint}.json"


def read(clip: Model, kind: Kind = "patches") -> Calibration:
    """Read a CLIP's calibration from its file.

    Raises:
        FileNotFoundError: it was never measured; the message names the command that measures it.
        ValueError: the file is damaged.
    """
    path = path_for(clip, kind)
    command = f"`gem-lite clip calibrate {clip.folder or clip.name}`"
    if not path.exists():
        raise FileNotFoundError(f"the CLIP {clip.name!r} has no calibration yet: measure it with {command}")
    values = read_json(path.read_bytes(), path)
    try:
        return Calibration(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is no calibration ({error}): measure it again with {command}") from error


def write(clip: Model, calibration: Calibration, kind: Kind = "patches") -> Path:
    """Write a CLIP's calibration to its file. Returns the file's path."""
    path = path_for(clip, kind)
    write_atomically(path, json.dumps(dataclasses.asdict(calibration), indent=1).encode())
    return path
