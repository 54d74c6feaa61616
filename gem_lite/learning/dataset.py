"""Prepared steps in files: computed one at a time, written once, and read when a training draws them.

Memory does not grow with the number of demonstrations: no more than one step is held at a time. The folder holds one
safetensors file a step and a manifest, which names every file with its SHA-256 and is written anew after each step.
So a preparation that was stopped goes on where it was.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import overload

import safetensors.torch
import torch
from safetensors import safe_open

from gem_lite import files
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.policies.base import PickPlacePolicy, numbered_steps
from gem_lite.policies.samples import PreparedStep, Sample


class StoredSteps(Sequence[PreparedStep]):
    """The prepared steps of a folder. Each is read when it is asked for, and not kept; a slice is such a set, too.

    Attributes:
        folder: where the files are.
        sums: the files' names and their SHA-256, in the order of the steps.
    """

    def __init__(self, folder: Path, sums: Mapping[str, str]) -> None:
        self.folder = folder
        self.sums = dict(sums)

    def __len__(self) -> int:
        return len(self.sums)

    @overload
    def __getitem__(self, index: int) -> PreparedStep: ...

    @overload
    def __getitem__(self, index: slice) -> StoredSteps: ...

    def __getitem__(self, index: int | slice) -> PreparedStep | StoredSteps:
        """A step, or the set of several.

        Raises:
            FileNotFoundError: the step's file has gone.
            ValueError: the step's file is cut off or changed.
        """
        chosen = list(self.sums.items())[index]
        if isinstance(index, slice):
            return StoredSteps(self.folder, dict(chosen))
        name, digest = chosen
        path = self.folder / name
        if not path.exists():
            raise FileNotFoundError(f"the prepared step {path} is missing, though the manifest names it")
        if hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            raise ValueError(f"the prepared step {path} is cut off or changed: remove {self.folder}")
        return _decode(path)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all that the steps hold: pictures, maps, words and labels."""
        return _joined(self.sums.values())


def fingerprint(steps: Sequence[PreparedStep]) -> str:
    """SHA-256 of all that steps hold, the same for steps in memory and in files."""
    if isinstance(steps, StoredSteps):
        return steps.fingerprint
    return _joined(hashlib.sha256(_encode(step)).hexdigest() for step in steps)


def _joined(digests: Iterable[str]) -> str:
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def store(
    steps_from: Callable[[int], Iterable[PreparedStep]], folder: Path, source: Mapping[str, object], code: str = ""
) -> StoredSteps:
    """Write steps one at a time; those that ``folder`` holds already are kept.

    Args:
        steps_from: called with the number of steps that are there; gives the others, in their order.
        source: what the steps are made of, ready for JSON.
        code: stands for the program that makes them. Steps of another program are removed and made anew.

    Raises:
        ValueError: ``folder`` holds steps that are made of something else.
        OSError: a step cannot be written; those before it stay.
    """
    manifest = _begun(folder, dict(source), code)
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
    """What training needs of demonstrations: fills the policy's memory and `store`s the prepared steps.

    Raises:
        ValueError: ``folder`` holds steps of other demonstrations, or for another method, configuration or CLIP; a
            step lacks a camera's view.
        OSError: a step cannot be written; those before it stay.
    """
    policy.remember(demos)
    parser = getattr(policy.parser, "__qualname__", type(policy.parser).__qualname__)
    source = {
        "data": demos.digest, "method": policy.name, "config": policy.config.as_dict(),
        "clip": policy.clip.fingerprint, "parser": parser,
    }  # fmt: skip

    def steps_from(start: int) -> Iterator[PreparedStep]:
        for episode, step in itertools.islice(numbered_steps(demos), start, None):
            yield policy.prepare_step(step, episode)

    return store(steps_from, folder, source, code_digest())


def code_digest() -> str:
    """SHA-256 of the library's own source files: what prepares steps in another way has another one."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _begun(folder: Path, source: dict, code: str) -> dict:
    """The manifest of a preparation that was begun here, or a fresh one."""
    path = folder / "manifest.json"
    if path.exists():
        manifest = files.read_json(path.read_bytes(), path)
        found = manifest.get("source")
        if found != source:
            differing = sorted(key for key in source if not isinstance(found, dict) or found.get(key) != source[key])
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
    """A step as one safetensors file: every tensor once, and as metadata what refers to them and all other values."""
    tensors: dict[str, torch.Tensor] = {}
    names: dict[tuple, str] = {}  # of the tensors, by their content

    def plain(name: str, value: object) -> object:
        if isinstance(value, torch.Tensor):
            content = (value.dtype, value.shape, value.numpy().tobytes())
            if content not in names:
                names[content] = name
                tensors[name] = value.contiguous()
            return {"tensor": names[content]}
        if isinstance(value, dict):
            return {"members": {key: plain(f"{name}.{key}", member) for key, member in value.items()}}
        return value

    samples = {
        role.name: {
            field.name: plain(f"{role.name}.{field.name}", getattr(getattr(step, role.name), field.name))
            for field in dataclasses.fields(Sample)
        }
        for role in dataclasses.fields(step)
    }
    # One key of metadata only: safetensors keeps no order of several, and equal steps have equal bytes.
    return safetensors.torch.save(tensors, {"samples": json.dumps(samples)})


def _decode(path: Path) -> PreparedStep:
    """The inverse of `_encode`."""
    with safe_open(path, "pt") as file:
        samples = json.loads(file.metadata()["samples"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118

    def whole(value: object) -> object:
        if isinstance(value, list):
            return tuple(value)
        if not isinstance(value, dict):
            return value
        if "tensor" in value:
            return tensors[value["tensor"]]
        return {key: whole(member) for key, member in value["members"].items()}

    return PreparedStep(**{
        role: Sample(**{name: whole(value) for name, value in sample.items()}) for role, sample in samples.items()
    })  # fmt: skip
