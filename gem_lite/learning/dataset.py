"""Prepared steps in files: computed one at a time, written once, and read when a training draws them.

The need for memory does not grow with the number of demonstrations: only one step is in memory at a time. The folder
holds one safetensors file for each step, and a manifest. The manifest names every file with its SHA-256 and is
rewritten after each step, so that a stopped preparation can continue.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import safetensors.torch
import torch
from safetensors import safe_open
from typing_extensions import override

from gem_lite import files
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.learning.mixture import Joined
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.samples import PreparedStep, Sample


class StoredSteps(files.FileSequence[PreparedStep]):
    """The prepared steps of a folder."""

    @override
    def decode(self, path: Path, content: bytes) -> PreparedStep:
        return _decode(path)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the whole content of the steps: pictures, maps, words and labels."""
        return _combined(self.sums.values())


def fingerprint(steps: Sequence[PreparedStep]) -> str:
    """SHA-256 of the whole content of steps. It is the same for steps in memory and in files."""
    if isinstance(steps, StoredSteps):
        return steps.fingerprint
    if isinstance(steps, Joined):
        return _combined(fingerprint(part) for part in steps.parts)
    return _combined(hashlib.sha256(_encode(step)).hexdigest() for step in steps)


def _combined(digests: Iterable[str]) -> str:
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def store(
    steps_from: Callable[[int], Iterable[PreparedStep]], folder: Path, source: Mapping[str, object], code: str = ""
) -> StoredSteps:
    """Write steps one at a time. Steps that are already in ``folder`` are kept.

    Args:
        steps_from: called with the number of existing steps; returns the other steps in their order.
        source: the facts that decide the content of the steps, ready for JSON.
        code: identifies the version of the program. Steps of another version are removed and computed again.

    Raises:
        ValueError: ``folder`` holds steps with another source.
        OSError: a step cannot be written; the steps before it stay.
    """
    manifest = _open_manifest(folder, dict(source), code)
    sums = manifest["files"]
    if not manifest["whole"]:
        for number, step in enumerate(steps_from(len(sums)), len(sums)):
            content = _encode(step)
            name = f"step-{number:06d}.safetensors"
            files.write_atomically(folder / name, content)
            sums[name] = hashlib.sha256(content).hexdigest()
            _write_manifest(folder, manifest)
        manifest["whole"] = True
        _write_manifest(folder, manifest)
    return StoredSteps(folder, sums)


def prepare(policy: PickPlacePolicy, demos: DemonstrationSet, folder: Path) -> StoredSteps:
    """Prepare demonstrations for training: fill the policy's memory, and `store` the prepared steps.

    Raises: see `prepare_steps`.
    """
    policy.remember(demos)
    return prepare_steps(policy, demos, folder, {})


def prepare_tasks(policy: PickPlacePolicy, sets: Sequence[DemonstrationSet], folder: Path) -> Joined[PreparedStep]:
    """`prepare` the demonstrations of several tasks for one policy. It may retrieve crops of every task.

    Raises: see `prepare_steps`.
    """
    policy.remember(Joined(sets))
    memory = {"memory": [demos.digest for demos in sets]}
    return Joined([prepare_steps(policy, demos, folder / str(number), memory) for number, demos in enumerate(sets)])


def prepare_steps(
    policy: PickPlacePolicy, demos: DemonstrationSet, folder: Path, more: Mapping[str, object]
) -> StoredSteps:
    """`store` the prepared steps of demonstrations.

    Args:
        more: further facts that decide the content of the steps, ready for JSON.

    Raises:
        ValueError: ``folder`` holds steps of other demonstrations, or for another method, configuration or CLIP; or a
            step lacks the view of a camera.
        OSError: a step cannot be written; the steps before it stay.
    """
    parser = getattr(policy.parser, "__qualname__", type(policy.parser).__qualname__)
    source = {
        "data": demos.digest, "method": policy.name, "config": policy.config.as_dict(),
        "clip": policy.clip.fingerprint, "parser": parser, **more,
    }  # fmt: skip
    return store(functools.partial(policy.prepare, demos), folder, source, code_digest())


def code_digest() -> str:
    """SHA-256 of the library's source files. It changes with every change of the code, also of the preparation."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _open_manifest(folder: Path, source: dict, code: str) -> dict:
    """The manifest of an earlier preparation in ``folder``, or a new one."""
    path = folder / "manifest.json"
    if path.exists():
        manifest = files.read_json(path.read_bytes(), path)
        old_source = manifest.get("source")
        if old_source != source:
            values = old_source if isinstance(old_source, dict) else {}
            differing = sorted(key for key in source if values.get(key) != source[key])
            raise ValueError(
                f"{folder} holds steps prepared from another {', '.join(differing)}; give another run, or remove it"
            )
        if manifest["code"] == code:
            return manifest
        print(f"the program has changed: the steps in {folder} are prepared again")
    shutil.rmtree(folder, ignore_errors=True)
    return {"source": source, "code": code, "whole": False, "files": {}}


def _write_manifest(folder: Path, manifest: dict) -> None:
    files.write_atomically(folder / "manifest.json", json.dumps(manifest).encode())


def _encode(step: PreparedStep) -> bytes:
    """A step as one safetensors file: each tensor once. The metadata hold all other values and the tensors' names."""
    tensors: dict[str, torch.Tensor] = {}
    names: dict[tuple, str] = {}  # the name of each tensor, by its content

    def encode_value(name: str, value: object) -> object:
        if isinstance(value, torch.Tensor):
            content = (value.dtype, value.shape, value.numpy().tobytes())
            if content not in names:
                names[content] = name
                tensors[name] = value.contiguous()
            return {"tensor": names[content]}
        if isinstance(value, dict):
            return {"members": {key: encode_value(f"{name}.{key}", member) for key, member in value.items()}}
        return value

    samples = {
        role.name: {
            field.name: encode_value(f"{role.name}.{field.name}", getattr(getattr(step, role.name), field.name))
            for field in dataclasses.fields(Sample)
        }
        for role in dataclasses.fields(step)
    }
    # Equal steps must have equal bytes, so there is one key of metadata: safetensors keeps no order of keys.
    return safetensors.torch.save(tensors, {"samples": json.dumps(samples)})


def _decode(path: Path) -> PreparedStep:
    """The inverse of `_encode`."""
    with safe_open(path, "pt") as file:
        samples = json.loads(file.metadata()["samples"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118

    def decode_value(value: object) -> object:
        if isinstance(value, list):
            return tuple(value)
        if not isinstance(value, dict):
            return value
        if "tensor" in value:
            return tensors[value["tensor"]]
        return {key: decode_value(member) for key, member in value["members"].items()}

    roles = {
        role: Sample(**{name: decode_value(value) for name, value in sample.items()})
        for role, sample in samples.items()
    }  # fmt: skip
    return PreparedStep(**roles)
