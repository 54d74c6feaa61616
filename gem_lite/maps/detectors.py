"""Map sources from open-vocabulary object detectors, in the place of CLIP's patches (A.6): OWL-ViT and Grounding DINO.

The model is the configuration's entry ``detector``. Each box that the detector finds in a view, with a score above
`THRESHOLD`, fills its pixels; the views are fused as always. A model of the library transformers is loaded from this
machine if it is there. It stays as it is, and runs on the CPU. CLIP still embeds the crops of image-conditioned maps.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import torch
from typing_extensions import override

from gem_lite.clip import Clip, loading, unit
from gem_lite.language import ImageQuery, ThingQuery
from gem_lite.maps.query_maps import MapConfig
from gem_lite.maps.sources import SOURCES, ViewSource
from gem_lite.rgbd.camera import View

THRESHOLD = 0.1
"""A box counts if its score is above this (A.6)."""
AT_THRESHOLD = 0.5
"""The value of a map in a box whose score is just above `THRESHOLD`."""

Asked = TypeVar("Asked")


@dataclass(frozen=True)
class Detector:
    """A frozen detector.

    Attributes:
        model: one of transformers' classes for object detection.
        tokenizer: of its texts.
        image_processor: prepares its pictures, and reads the boxes and scores from its outputs.
        longest: how many tokens of a text the model reads, with those of its beginning and its end.
        name: the model's name, or its folder.
    """

    model: Any
    tokenizer: Any
    image_processor: Any
    longest: int
    name: str

    def prepared(self, picture: np.ndarray) -> Mapping[str, torch.Tensor]:
        """The model's input from a picture (H, W, 3) uint8 of any size."""
        return self.image_processor(images=picture, input_data_format="channels_last", return_tensors="pt")

    def tokens(self, text: str, **settings: object) -> Mapping[str, torch.Tensor]:
        """The model's input from a text.

        Raises:
            ValueError: an empty text, or one with more than `longest` tokens.
        """
        if not text.strip():
            raise ValueError(f"a phrase must not be empty, got {text!r}")
        count = len(self.tokenizer(text, verbose=False)["input_ids"])
        if count > self.longest:  # Its end would be left out, and with it perhaps the noun.
            raise ValueError(
                f"a phrase may have at most {self.longest} tokens for the detector {self.name!r}, got {count}: "
                f"{text!r:.100}"
            )
        return self.tokenizer(text, return_tensors="pt", **settings)


def load(name: str, kinds: Mapping[str, str]) -> Detector:
    """Load a detector through transformers, always with float32 weights.

    Args:
        name: a Hugging Face name such as ``google/owlvit-base-patch32`` (the paper's), or a folder in that format.
        kinds: the allowed values of ``model_type`` in the model's config.json, and what they are called.

    Raises:
        ValueError: an empty name; or, by a name, a model of another kind or with missing weights.
        OSError: the same in a folder, or a part of the model is missing there or damaged; or there is no such folder,
            and the model is not in the local cache and cannot be downloaded.
    """
    allowed = " or ".join(kinds.values())
    if not name.strip():
        raise ValueError(f"detector must be the Hugging Face name or the folder of a model of {allowed}, got {name!r}")
    read = partial(_from_pretrained, name, kinds)
    if Path(name).is_dir():
        return loading.read_folder(Path(name), "detector", partial(read, True))
    try:
        return loading.offline_first(name, read)
    except OSError as error:
        raise OSError(
            f"the detector {name!r} could not be loaded: no such folder, and not in the local cache or reachable"
        ) from error


def _from_pretrained(name: str, kinds: Mapping[str, str], offline: bool) -> Detector:
    # Below the import of gem_lite.clip.loading, which quietens it.
    import transformers

    kind = transformers.AutoConfig.from_pretrained(name, local_files_only=offline).model_type
    if kind not in kinds:
        raise ValueError(
            f"detector must be a model of {' or '.join(kinds.values())}, got {name!r} of the kind {kind!r}"
        )
    model, found = transformers.AutoModelForZeroShotObjectDetection.from_pretrained(
        name, local_files_only=offline, dtype=torch.float32, output_loading_info=True
    )
    if found["missing_keys"]:  # transformers would fill them with random numbers.
        raise ValueError(
            f"the detector's weights lack {len(found['missing_keys'])} tensors, such as {min(found['missing_keys'])}"
        )
    model.eval().requires_grad_(False)
    tokenizer = transformers.AutoTokenizer.from_pretrained(name, local_files_only=offline)
    # Pictures are resized by Pillow on every machine, so that the maps do not depend on what else is installed.
    image_processor = transformers.AutoImageProcessor.from_pretrained(name, local_files_only=offline, backend="pil")
    limits = (tokenizer.model_max_length, model.config.text_config.max_position_embeddings)
    longest = min(*limits, getattr(model.config, "max_text_len", limits[1]))
    return Detector(model, tokenizer, image_processor, longest, name)


@dataclass(frozen=True)
class SeenView:
    """A view as a detector needs it for any query.

    Attributes:
        shape: (H_n, W_n) of the view.
        inputs: tensors, by names that the source chooses.
    """

    shape: tuple[int, int]
    inputs: Mapping[str, torch.Tensor]


class DetectorSource(ViewSource[SeenView], Generic[Asked]):
    """Boxes of a detector, filled with their scores. What a query becomes for the model is an ``Asked``.

    Attributes:
        kinds: the allowed kinds of models, see `load`.
    """

    kinds: ClassVar[Mapping[str, str]]
    config: MapConfig

    def __init__(self, clip: Clip, config: MapConfig) -> None:
        super().__init__(clip, config)
        self.detector = load(config.detector, self.kinds)
        self._last: tuple[ThingQuery, Asked] | None = None

    @abstractmethod
    def ask(self, query: ThingQuery) -> Asked:
        """What a query is for the model. Raises ValueError if the model cannot read it."""

    @abstractmethod
    def detect(self, embedded: SeenView, asked: Asked) -> tuple[torch.Tensor, torch.Tensor]:
        """All boxes of a view: their logits (1, N, L), of which the largest counts, and (1, N, 4) middle and size."""

    @torch.inference_mode()
    @override
    def score_view(self, embedded: SeenView, query: ThingQuery) -> np.ndarray:
        last = self._last
        if last is None or last[0] != query:  # All views of a scene are asked in turn.
            last = (query, self.ask(query))
            self._last = last
        logits, boxes = self.detect(embedded, last[1])
        (found,) = self.detector.image_processor.post_process_object_detection(
            SimpleNamespace(logits=logits, pred_boxes=boxes), threshold=THRESHOLD, target_sizes=[embedded.shape]
        )
        return filled(found["boxes"].numpy(), calibrated(found["scores"].numpy()), embedded.shape)


def calibrated(scores: np.ndarray) -> np.ndarray:
    """Scores above `THRESHOLD` on the maps' scale: `AT_THRESHOLD` there, 1 for a score of 1, linear in the logarithm.

    A detector's score of a true match may be 0.15 or 0.8, so the rule is one of ratios: twice the score is always 0.15
    more. It knows no other box. A scale by the highest box of the scene would give 1 to the best of all wrong boxes
    where nothing matches. No published weights were run here, so that the two ends are chosen, not measured.

    Returns:
        As ``scores``, float32 in [`AT_THRESHOLD`, 1]; 0 for scores at the threshold or below.
    """
    above = np.clip(scores, THRESHOLD, 1)
    values = 1 - (1 - AT_THRESHOLD) * np.log(above) / np.log(THRESHOLD)
    return np.where(scores > THRESHOLD, values, 0).astype(np.float32)


def filled(boxes: np.ndarray, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) float32 with the highest value of all boxes that hold their centre, 0 where there is none.

    Args:
        boxes: (N, 4) left, top, right, bottom, in pixels from the picture's upper left edge; they may leave it.
        values: (N,) not negative.
    """
    pixels = np.zeros(shape, np.float32)
    # The centre of pixel i lies at i + 1/2; a centre on the right or the lower side is outside.
    ends = np.clip(np.ceil(boxes - 0.5), 0, (shape[1], shape[0]) * 2).astype(int)
    for index in np.argsort(values):
        left, top, right, bottom = ends[index]
        pixels[top:bottom, left:right] = values[index]
    return pixels


@SOURCES.register("owl-vit")
class OwlVit(DetectorSource[torch.Tensor]):
    """OWL-ViT or OWLv2. A picture may stand in a phrase's place: its image-guided detection.

    A view's features and boxes are computed once for all queries.
    """

    kinds = {"owlvit": "OWL-ViT", "owlv2": "OWLv2"}  # noqa: RUF012 (the base class says that it is the class's)

    def _features(self, picture: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """The features of a picture (H, W, 3): (1, N, C), and as a grid (1, h, w, C)."""
        grid, _ = self.detector.model.image_embedder(pixel_values=self.detector.prepared(picture)["pixel_values"])
        return grid.flatten(1, 2), grid

    @torch.inference_mode()
    @override
    def embed_view(self, view: View, inside: np.ndarray) -> SeenView:
        features, grid = self._features(view.rgb)
        boxes = self.detector.model.box_predictor(features, grid)
        return SeenView(view.camera.size, {"features": features, "boxes": boxes})

    @override
    def ask(self, query: ThingQuery) -> torch.Tensor:
        """The query's embedding (1, 1, D)."""
        if isinstance(query, ImageQuery):
            embedding, _, _ = self.detector.model.embed_image_query(*self._features(query.picture))
            if embedding is None:
                raise ValueError(f"the detector {self.detector.name!r} finds no thing in the picture of {query}")
            return embedding
        tokens = self.detector.tokens(query, padding="max_length", max_length=self.detector.longest)
        words = {name: tokens[name] for name in ("input_ids", "attention_mask")}
        # The text and image encoders, which the two models name differently.
        encoders = getattr(self.detector.model, self.detector.model.base_model_prefix)
        return unit(encoders.get_text_features(**words))[None]

    @override
    def detect(self, embedded: SeenView, asked: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        logits, _ = self.detector.model.class_predictor(embedded.inputs["features"], asked)
        return logits, embedded.inputs["boxes"]


@SOURCES.register("grounding-dino")
class GroundingDino(DetectorSource[Mapping[str, torch.Tensor]]):
    """Grounding DINO. Its image encoder reads the words, so that every query runs the whole model on every view."""

    kinds = {"grounding-dino": "Grounding DINO"}  # noqa: RUF012 (as above)

    @override
    def embed_view(self, view: View, inside: np.ndarray) -> SeenView:
        return SeenView(view.camera.size, self.detector.prepared(view.rgb))

    @override
    def ask(self, query: ThingQuery) -> Mapping[str, torch.Tensor]:
        """The tokens of the phrase as the model learned phrases: in small letters, with a full stop."""
        if isinstance(query, ImageQuery):
            raise ValueError(f"Grounding DINO finds phrases only, got {query}: a picture needs another map source")
        phrase = query.strip().lower().rstrip(".")
        return self.detector.tokens(f"{phrase}." if phrase else "", return_token_type_ids=True)

    @override
    def detect(self, embedded: SeenView, asked: Mapping[str, torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        outputs = self.detector.model(**embedded.inputs, **asked)
        return outputs.logits, outputs.pred_boxes
