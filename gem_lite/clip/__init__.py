"""A frozen CLIP: a published one by its name, one in a local folder, or the embedded one in data/clip-tabletop."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
import torch.nn.functional as F
from transformers import PreTrainedTokenizerBase

from gem_lite.clip import loading
from gem_lite.clip.calibration import Calibration, read
from gem_lite.clip.loading import RESAMPLING, Preprocessing
from gem_lite.clip.resnet_clip import ResNetClip
from gem_lite.foundations.files import DATA

EMBEDDED = DATA / "clip-tabletop"
ENVIRONMENT_VARIABLE = "GEM_LITE_CLIP"

REMEMBERED = 20_000
"""A CLIP remembers the embeddings of this number of small pictures: some 20 MB."""
PRECISIONS = (torch.float32, torch.float16, torch.bfloat16)
"""The types that a CLIP's weights may have (`Clip.to`)."""
INNER_QUARTERS = (3, 2, 1)
"""After which quarters of the image tower `Clip.inner_features` are taken."""


class Clip:
    """A frozen image and text encoder with unit-length embeddings. `load` makes one.

    Attributes:
        name: the model's name in figures and results.
        dim: the number of entries of an embedding.
        width: the number of features at each position of a picture, before they are pooled and projected.
        inner_widths: the same for the features of `inner_features`.
        fingerprint: a short hash of the weights and of an unusual preprocessing, which identifies the model.
        longest: how many tokens of a text the model reads, with those of its beginning and its end.
        folder: the local folder with the model's files, if there is one.

    Raises:
        ValueError: the preprocessing lacks an entry, or has one that is not supported.
    """

    def __init__(
        self, name: str, model: torch.nn.Module, tokenizer: PreTrainedTokenizerBase, preprocessing: dict,
        folder: Path | None,
    ) -> None:  # fmt: skip
        self.name = name
        self.folder = folder
        prepared = Preprocessing.read(preprocessing)
        self.fingerprint = _fingerprint(model, prepared)
        model.eval().requires_grad_(False)
        if isinstance(model, ResNetClip):
            model.fold_batch_norms()
        self._model = cast(Any, model)  # a CLIPModel, or another class with the same methods
        self._model.to(memory_format=torch.channels_last)
        self.tokenizer = tokenizer
        self.longest = min(tokenizer.model_max_length, self._model.config.text_config.max_position_embeddings)
        self._size = prepared.size
        self._resampling = RESAMPLING[prepared.resample]
        mean, std = (255 * torch.tensor(values).view(3, 1, 1) for values in (prepared.mean, prepared.std))
        self._scale = 1 / std
        self._shift = -mean / std
        self.dim = int(self._model.config.projection_dim)
        self.width = int(self._model.visual_projection.in_features)
        self.inner_widths = tuple(self._inner_width(quarter) for quarter in INNER_QUARTERS)
        self._texts: dict[str, torch.Tensor] = {}
        self._pictures: dict[tuple[tuple[int, ...], bytes], torch.Tensor] = {}  # by shape and hash, the oldest first

    @cached_property
    def calibration(self) -> Calibration:
        """The scale of this model's scores and its retrieval threshold.

        Raises:
            FileNotFoundError: they were never measured; the message names the command that measures them.
            ValueError: their file is damaged.
        """
        return read(self)

    @cached_property
    def dense_calibration(self) -> Calibration:
        """The same for `embed_positions`. Raises the same errors."""
        return read(self, "dense")

    @property
    def parameter_count(self) -> int:
        """The number of parameters of the model."""
        return sum(parameter.numel() for parameter in self._model.parameters())

    @property
    def device(self) -> torch.device:
        """The device of the model."""
        return next(self._model.parameters()).device

    def to(self, device: str | torch.device, dtype: torch.dtype | None = None) -> Clip:
        """Move the model to a device. Embeddings that were kept are dropped.

        Args:
            dtype: the type of its weights; by default it is not changed. Half precision (``torch.float16`` on a GPU)
                takes half the memory. Embeddings are float32 all the same, but less exact. A checkpoint does not store
                the type: use the same one for training and acting.

        Raises:
            ValueError: ``dtype`` is not one of `PRECISIONS`.
        """
        if dtype not in (None, *PRECISIONS):
            raise ValueError(f"dtype must be one of {', '.join(map(str, PRECISIONS))}, got {dtype}")
        self._model.to(device, dtype)
        self._texts.clear()
        self._pictures.clear()
        return self

    @torch.inference_mode()
    def embed_texts(self, phrases: Sequence[str]) -> torch.Tensor:
        """Embed phrases. Each phrase is encoded once, and its embedding is kept.

        Returns:
            (N, dim) float32, unit length.

        Raises:
            ValueError: a phrase is empty, or has more tokens than `longest`.
        """
        if any(not phrase.strip() for phrase in phrases):
            raise ValueError(f"phrases must not be empty, got {list(phrases)!r}")
        known = {phrase: feature for phrase in phrases if (feature := self._texts.get(phrase)) is not None}
        new = [phrase for phrase in dict.fromkeys(phrases) if phrase not in known]
        if new:
            tokens = self.tokenizer(new, padding=True, return_tensors="pt", verbose=False).to(self.device)
            for phrase, count in zip(new, tokens["attention_mask"].sum(dim=1).tolist(), strict=True):
                if count > self.longest:  # Its end would be left out, and with it perhaps the noun.
                    raise ValueError(
                        f"a phrase may have at most {self.longest} tokens for {self.name}, got {count}: {phrase!r:.100}"
                    )
            words = {name: tokens[name] for name in ("input_ids", "attention_mask")}
            features = self._model.get_text_features(**words)
            for phrase, feature in zip(new, unit(features), strict=True):
                # A copy: as a row of the whole batch it would keep, and pickle, the whole batch.
                known[phrase] = self._texts[phrase] = feature.clone()
        return torch.stack([known[phrase] for phrase in phrases])

    @torch.inference_mode()
    def embed_images(self, images: np.ndarray | torch.Tensor, batch_size: int = 64) -> torch.Tensor:
        """Embed several pictures of the same size.

        Args:
            images: (N, H, W, 3) uint8.

        Returns:
            (N, dim) float32, unit length.
        """
        images = torch.as_tensor(images)
        if images.ndim != 4 or images.shape[-1] != 3 or images.dtype != torch.uint8:
            raise ValueError(f"images must be (N, H, W, 3) uint8, got {tuple(images.shape)} {images.dtype}")
        if len(images) == 0:
            return torch.zeros(0, self.dim)
        features = [
            unit(self._model.get_image_features(pixel_values=self._pixels(part))) for part in images.split(batch_size)
        ]
        return torch.cat(features)

    def embed_known_images(self, images: np.ndarray) -> torch.Tensor:
        """As `embed_images`, but pictures that were embedded before are looked up: the last `REMEMBERED` are kept.

        Between two actions, a camera without noise sees most parts of a table unchanged.
        """
        keys = [(images.shape[1:], hashlib.sha256(image.tobytes()).digest()) for image in images]
        # Looked up once, since another thread may forget some of them meanwhile.
        known = {key: embedding for key in keys if (embedding := self._pictures.get(key)) is not None}
        new = [index for index, key in enumerate(keys) if key not in known]
        if new:
            for index, embedding in zip(new, self.embed_images(images[new]).cpu(), strict=True):
                known[keys[index]] = self._pictures[keys[index]] = embedding.clone()  # as with texts
        for key in list(self._pictures)[: max(0, len(self._pictures) - REMEMBERED)]:
            self._pictures.pop(key, None)
        return torch.stack([known[key] for key in keys])

    @torch.inference_mode()
    def dense_features(self, image: np.ndarray, patch: int) -> torch.Tensor:
        """The last features before pooling, at all positions of a picture, from one forward pass.

        They are coarser than the embeddings of single patches, and the features of a position also depend on its
        surroundings. The picture is resized so that ``patch`` pixels become as wide as the model's training pictures.

        Args:
            image: (H, W, 3) uint8.

        Returns:
            (width, h, w) float32 on the CPU, with mean square 1 at every position. The picture is divided into
            h x w equal parts, and position (i, j) is the centre of part (i, j).
        """
        return _equally_strong(self._features(image, patch))

    @torch.inference_mode()
    def inner_features(self, image: np.ndarray, patch: int, count: int = 2) -> list[torch.Tensor]:
        """As `dense_features`, but from inside the image tower: after its third, second and first quarter.

        In a ResNet, these are finer than the last features: (inner_widths[i], h, w), with twice, four and eight times
        as many positions in each direction.

        Args:
            count: how many, from 0 to 3.
        """
        return [_equally_strong(self._features(image, patch, quarter)) for quarter in INNER_QUARTERS[:count]]

    @torch.inference_mode()
    def embed_dense(self, image: np.ndarray, patch: int) -> torch.Tensor:
        """`dense_features`, projected to embeddings, which can be compared with texts: (dim, h, w), unit length."""
        features = self._model.visual_projection(self._features(image, patch))  # (h, w, dim)
        return F.normalize(features.float(), dim=-1).permute(2, 0, 1).cpu().contiguous()

    @torch.inference_mode()
    def embed_positions(self, image: np.ndarray, patch: int) -> torch.Tensor:
        """What there is at each position of a picture, from one pass: (dim, h, w), unit length, on the CPU.

        A ResNet pools the mean of its positions. So each position here is the mean of as many neighbours as a training
        picture has: where something lies, it resembles the embedding of the patch around it. A vision transformer pools
        by attention to one token; here each token keeps its own values of the last attention, as in MaskCLIP (Zhou et
        al., ECCV 2022).

        Args:
            image: (H, W, 3) uint8.
            patch: so many pixels become as wide as a ResNet's training pictures. A transformer gets the picture as it
                is: enlarged, it would have a hundred times as many tokens.
        """
        if isinstance(self._model, ResNetClip):
            features = self._features(image, patch).permute(2, 0, 1)[None]
            window = -(-self._size // 2**self._model.stages)  # positions in a training picture, in each direction
            pooled = F.avg_pool2d(features, window, 1, window // 2, count_include_pad=False)[0]
            embeddings = self._model.visual_projection(pooled.permute(1, 2, 0))
        else:
            embeddings = self._model.visual_projection(self._last_values(image))
        return F.normalize(embeddings.float(), dim=-1).permute(2, 0, 1).cpu().contiguous()

    def _last_values(self, image: np.ndarray) -> torch.Tensor:
        """The values of a transformer's last attention, (h, w, channels), as if each token attended to itself alone."""
        side = self._model.config.vision_config.patch_size
        counts = [max(1, round(length / side)) for length in image.shape[:2]]
        size = [side * count for count in counts]
        pixels = self._pixels(torch.from_numpy(np.ascontiguousarray(image))[None], size)
        tower = self._model.vision_model
        states = tower(pixel_values=pixels, interpolate_pos_encoding=True, output_hidden_states=True).hidden_states
        last = tower.encoder.layers[-1]
        values = last.self_attn.out_proj(last.self_attn.v_proj(last.layer_norm1(states[-2][:, 1:])))
        return tower.post_layernorm(values).unflatten(1, counts)[0]

    def _features(self, image: np.ndarray, patch: int, quarter: int = 4) -> torch.Tensor:
        """The features (h, w, channels) after a quarter of the image tower, from 1 to 4."""
        size = [round(length * self._size / patch) for length in image.shape[:2]]
        pixels = self._pixels(torch.from_numpy(np.ascontiguousarray(image))[None], size)
        if isinstance(self._model, ResNetClip):
            return self._model.feature_map(pixels, quarter * self._model.stages // 4)[0]
        tower = self._model.vision_model
        states = tower(pixel_values=pixels, interpolate_pos_encoding=True, output_hidden_states=True).hidden_states
        tokens = states[quarter * (len(states) - 1) // 4][:, 1:]
        if quarter == 4:
            tokens = tower.post_layernorm(tokens)
        side = self._model.config.vision_config.patch_size
        return tokens.unflatten(1, [length // side for length in size])[0]

    def _inner_width(self, quarter: int) -> int:
        vision = self._model.config.vision_config
        if isinstance(self._model, ResNetClip):
            return vision.hidden_sizes[quarter * self._model.stages // 4 - 1]
        return vision.hidden_size

    def _pixels(self, images: torch.Tensor, size: Sequence[int] | None = None) -> torch.Tensor:
        size = size or (self._size, self._size)
        pixels = images.to(self.device).permute(0, 3, 1, 2).float()  # (N, 3, H, W), channels last
        if pixels.shape[-2:] != tuple(size):
            pixels = F.interpolate(pixels, tuple(size), mode=self._resampling, antialias=True).clamp(0, 255)
        return torch.addcmul(self._shift.to(pixels), pixels, self._scale.to(pixels)).to(self._model.dtype)


def _fingerprint(model: torch.nn.Module, preprocessing: Preprocessing) -> str:
    digest = hashlib.sha256()
    for name, value in sorted(model.state_dict().items()):
        digest.update(name.encode() + value.cpu().float().numpy().tobytes())
    # Only an unusual preprocessing counts: fingerprints are in checkpoints and rows that are older than this rule.
    if preprocessing != Preprocessing.standard(model):
        digest.update(repr(preprocessing).encode())
    return digest.hexdigest()[:16]


def _equally_strong(features: torch.Tensor) -> torch.Tensor:
    """Features (h, w, channels) as (channels, h, w) on the CPU, with mean square 1 at every position."""
    channels = features.shape[-1]
    return (channels**0.5 * F.normalize(features.float(), dim=-1)).permute(2, 0, 1).cpu().contiguous()


def unit(features: object) -> torch.Tensor:
    """The result of ``get_image_features`` or ``get_text_features`` as unit-length float32 vectors."""
    # Newer transformers wrap the projected features in an output object.
    tensor = features if isinstance(features, torch.Tensor) else cast(Any, features).pooler_output
    return F.normalize(tensor.float(), dim=-1)


def load(name_or_path: str | Path | None = None) -> Clip:
    """Load a frozen CLIP through transformers.

    Args:
        name_or_path: a Hugging Face name such as ``openai/clip-vit-base-patch32`` (the paper's) or a
            folder in that format. The default is the environment variable GEM_LITE_CLIP; if it is not set, the
            embedded CLIP, which this project trained itself on rendered table scenes.

    Raises:
        OSError: a part of the model is missing in the folder or damaged; or there is no such folder, and the model is
            not in the local cache and cannot be downloaded.
    """
    name = str(name_or_path or os.environ.get(ENVIRONMENT_VARIABLE) or EMBEDDED)
    folder = Path(name) if Path(name).is_dir() else None
    try:
        model, tokenizer, preprocessing = loading.from_folder(folder) if folder else loading.by_name(name)
    except (OSError, ValueError) as error:
        if folder:
            raise
        raise OSError(
            f"the CLIP {name!r} could not be loaded: no such folder, and not in the local cache or reachable.\n"
            f"Give a folder that holds the model, connect once to download it, or unset {ENVIRONMENT_VARIABLE} "
            "to use the embedded CLIP."
        ) from error
    label = f"embedded {folder.name}" if folder and folder.resolve().parent == DATA else name
    try:
        return Clip(label, model, tokenizer, preprocessing, folder)
    except ValueError as error:
        raise OSError(f"the CLIP {name!r} could not be loaded: {error}") from error
