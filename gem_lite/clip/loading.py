"""The parts of a CLIP, from a folder or by a name: its model, its tokenizer, and how its pictures are prepared."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

import torch

os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")

import huggingface_hub
import transformers
from safetensors import SafetensorError
from transformers import PreTrainedTokenizerBase
from transformers.image_processing_base import ImageProcessingMixin
from transformers.image_utils import OPENAI_CLIP_MEAN, OPENAI_CLIP_STD

from gem_lite.clip.resnet_clip import ResNetClip

BICUBIC = 3
RESAMPLING = {2: "bilinear", BICUBIC: "bicubic"}
"""How a picture is resized, by the number of preprocessor_config.json."""


@dataclass(frozen=True)
class Preprocessing:
    """How pictures become a model's input: resized to ``size`` (pixels), then (value - mean) / std for each channel."""

    size: int
    mean: tuple[float, ...]
    std: tuple[float, ...]
    resample: int

    @classmethod
    def read(cls, entries: dict) -> Preprocessing:
        """From the entries of preprocessor_config.json. Raises ValueError for what is missing or not supported."""
        size = entries.get("crop_size") or entries.get("size")
        if isinstance(size, dict):
            size = size.get("height") or size.get("shortest_edge")
        resample = int(entries.get("resample", BICUBIC))
        mean, std = (entries.get(key) or () for key in ("image_mean", "image_std"))
        if not size:
            raise ValueError(f"preprocessor_config.json must have a size, got {size!r}")
        for name, values in (("image_mean", mean), ("image_std", std)):
            if len(values) != 3:
                raise ValueError(f"preprocessor_config.json must have {name} with three numbers, got {values!r}")
        if resample not in RESAMPLING:
            raise ValueError(f"resample of preprocessor_config.json must be in {sorted(RESAMPLING)}, got {resample}")
        return cls(int(size), tuple(mean), tuple(std), resample)

    @classmethod
    def standard(cls, model: torch.nn.Module) -> Preprocessing:
        """What a model's kind expects: OpenAI's colours or, for `ResNetClip`, one half."""
        size = int(cast(Any, model).config.vision_config.image_size)
        if isinstance(model, ResNetClip):
            return cls(size, (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), BICUBIC)
        return cls(size, tuple(OPENAI_CLIP_MEAN), tuple(OPENAI_CLIP_STD), BICUBIC)


WANTED = {
    "configuration": ("config.json",),
    "weights": (
        "model.safetensors", "model.safetensors.index.json", "pytorch_model.bin", "pytorch_model.bin.index.json",
    ),
    "tokenizer": ("tokenizer.json", "vocab.json"),
    "preprocessing": ("preprocessor_config.json", "processor_config.json"),
}  # fmt: skip
"""What a model's folder must hold: for each part one of these files."""

Loaded = TypeVar("Loaded")
Parts = tuple[torch.nn.Module, PreTrainedTokenizerBase, dict]
"""A model, its tokenizer, and the entries of its preprocessing."""


def _from_pretrained(name: str, offline: bool) -> Parts:
    # Always float32: half precision is slow on a CPU, and too rough for maps that are compared to 1e-4.
    model, found = transformers.AutoModel.from_pretrained(
        name, local_files_only=offline, dtype=torch.float32, output_loading_info=True
    )
    if found["missing_keys"]:  # transformers would fill them with random numbers.
        raise ValueError(f"its weights lack {len(found['missing_keys'])} tensors, such as {min(found['missing_keys'])}")
    tokenizer = transformers.AutoTokenizer.from_pretrained(name, local_files_only=offline)
    return model, tokenizer, ImageProcessingMixin.get_image_processor_dict(name, local_files_only=offline)[0]


def from_folder(folder: Path) -> Parts:
    """Load a CLIP from a folder. If something is missing or damaged, raises OSError that says what."""
    return read_folder(folder, "CLIP", partial(_from_pretrained, str(folder), offline=True))


def by_name(name: str) -> Parts:
    """Load a CLIP by name, see `offline_first`."""
    return offline_first(name, partial(_from_pretrained, name))


def read_folder(folder: Path, kind: str, read: Callable[[], Loaded]) -> Loaded:
    """What ``read`` finds in a model's folder.

    Args:
        kind: of the model, in messages.

    Raises:
        OSError: something is missing or damaged; the message says what.
    """
    for part, names in WANTED.items():
        if not any((folder / name).is_file() for name in names):
            raise OSError(f"the {kind} folder {str(folder)!r} has no {part}: {names[0]} is missing")
    transformers.utils.logging.disable_progress_bar()
    try:
        return read()
    except SafetensorError as error:
        raise OSError(f"the weights in the {kind} folder {str(folder)!r} are cut off or damaged: {error}") from error
    except (OSError, ValueError, RuntimeError, EOFError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise OSError(f"the {kind} folder {str(folder)!r} could not be read: {reason}") from error


def offline_first(name: str, read: Callable[[bool], Loaded]) -> Loaded:
    """What ``read`` finds by a name on this machine. If it is not there, print a message and ask the network.

    Args:
        read: gets whether it must not ask the network, and raises OSError for what it does not find.
    """
    transformers.utils.logging.disable_progress_bar()
    try:
        return read(True)
    except OSError:
        pass
    print(f"{name} is not on this machine; asking Hugging Face (half a minute without a network) ...")
    transformers.utils.logging.enable_progress_bar()
    huggingface_hub.utils.logging.set_verbosity_error()
    return read(False)
