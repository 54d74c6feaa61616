"""A trained policy as two files: safetensors with weights and crop memory, and a JSON, its card."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import safetensors.torch
import torch

from gem_lite import language
from gem_lite.clip import Clip
from gem_lite.foundations.files import read_json, write_together
from gem_lite.maps.crop_memory import CropMemory
from gem_lite.policies import methods
from gem_lite.policies.base import Policy

SUFFIX = ".safetensors"


def card_path(path: Path | str) -> Path:
    """Where the card of a checkpoint is: beside it, with the same name up to the ending.

    Raises:
        ValueError: ``path`` does not end in ".safetensors". With other endings, two checkpoints could share a card.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise ValueError(f"the name of a checkpoint must end in {SUFFIX}, got {str(path)!r}")
    return path.with_suffix(".json")


def save_policy(policy: Policy, path: Path, facts: dict) -> None:
    """Write ``path`` (safetensors: weights and crop memory) and beside it a JSON that describes it.

    Args:
        facts: further entries of the JSON: task, seed, demonstrations, data hash, seconds.

    Raises:
        ValueError: ``path`` does not end in ".safetensors".
        OSError: a file cannot be written. The old files stay.
    """
    path = Path(path)
    card_file = card_path(path)
    tensors = {name: value.detach().cpu().contiguous() for name, value in policy.named_parameters()}
    entries: list[dict] = []
    if policy.memory is not None:
        images, entries = policy.memory.pack()
        tensors["memory.images"] = torch.from_numpy(images)
    content = safetensors.torch.save(tensors)
    card = {
        "method": policy.name,
        "config": policy.config.as_dict(),
        "clip": {"name": policy.clip.name, "fingerprint": policy.clip.fingerprint},
        "memory": entries,
        "sha256": hashlib.sha256(content).hexdigest(),
        "versions": {"torch": torch.__version__, "python": platform.python_version()},
        "date": datetime.now(UTC).date().isoformat(),
        **facts,
    }
    write_together({path: content, card_file: json.dumps(card, indent=1).encode()})


def read_card(path: Path) -> dict:
    """A checkpoint's JSON.

    Raises:
        FileNotFoundError: it or the checkpoint is missing.
        ValueError: it is damaged, or ``path`` does not end in ".safetensors".
    """
    card_file = card_path(path)
    for file in (Path(path), card_file):
        if not file.exists():
            raise FileNotFoundError(f"the checkpoint {path} is not complete: {file} is missing")
    card = read_json(card_file.read_bytes(), card_file)
    types = {"method": str, "sha256": str, "config": dict, "clip": dict, "memory": list}
    wrong = [key for key, kind in types.items() if not isinstance(card.get(key), kind)]
    if wrong:
        raise ValueError(f"{card_file} is no whole description of a checkpoint: see its {', '.join(wrong)}")
    return card


def load_policy(path: Path, model: Clip, parser: language.Parser | None = None) -> Policy:
    """Load and verify a checkpoint of `save_policy`; its method's class comes from its JSON.

    Args:
        parser: a reader of instructions; by default the one that the configuration names.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: cut off or changed, of an unknown method, or trained with another CLIP; or ``path`` does not end in
            ".safetensors".
    """
    path = Path(path)
    card = read_card(path)
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != card["sha256"]:
        raise ValueError(f"the checkpoint {path} is cut off or changed: its SHA-256 is not the one in its JSON")
    try:
        method, config = methods.of_card(card)
    except ValueError as error:
        raise ValueError(f"the checkpoint {path} cannot be used: {error}") from error
    if card["clip"].get("fingerprint") != model.fingerprint:
        raise ValueError(
            f"the checkpoint {path} was trained with the CLIP {card['clip'].get('name')!r}, "
            f"not with the weights of {model.name!r}"
        )
    try:
        tensors = safetensors.torch.load(content)
        memory = None
        if card["memory"]:
            memory = CropMemory.unpack(tensors["memory.images"].numpy(), card["memory"], model)
        policy = method(config, model, memory, parser=parser)
        _copy_weights(tensors, policy)
    except Exception as error:  # Networks that a damaged configuration describes can fail in any way.
        raise ValueError(
            f"the weights in {path} and the configuration in its JSON do not fit: {type(error).__name__}: {error}"
        ) from error
    return policy


def begin_with(policy: Policy, path: Path) -> str:
    """Give a new policy the weights of a checkpoint, so that its training continues from there.

    Returns:
        The SHA-256 of the checkpoint.

    Raises:
        FileNotFoundError, ValueError: see `load_policy`. The checkpoint's method must be the policy's, and its networks
            as large.
    """
    start = load_policy(path, policy.clip)
    if start.name != policy.name:
        raise ValueError(f"the training of {policy.name} cannot begin with the checkpoint {path} of {start.name}")
    try:
        _copy_weights(dict(start.named_parameters()), policy)
    except (KeyError, ValueError) as error:
        raise ValueError(f"the training cannot begin with the checkpoint {path}: {error}") from error
    return read_card(path)["sha256"]


def _copy_weights(weights: Mapping[str, torch.Tensor], policy: Policy) -> None:
    """Copy weights into a policy. Raises KeyError if one is missing, and ValueError if one does not fit."""
    with torch.no_grad():
        for name, value in policy.named_parameters():
            weight = weights[name]
            if weight.shape != value.shape or not torch.isfinite(weight).all():
                raise ValueError(f"{name} must be finite and of shape {tuple(value.shape)}")
            value.copy_(weight)
