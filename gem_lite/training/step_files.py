"""Prepared steps in files: computed one at a time, written once, and read when a training draws them.

The need for memory does not grow with the number of demonstrations: only one step is in memory at a time. A set of
steps has a folder, which is named by a hash of everything that decides the steps. So trainings that differ only in what
comes after the preparation read the same files. The folder holds one compressed safetensors file for each step, and a
manifest. The manifest names every file with its SHA-256. It is rewritten after each step, so that a stopped preparation
can continue.
"""

from __future__ import annotations

import copy
import functools
import hashlib
import json
import shutil
import sys
import uuid
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, cast, get_args

import filelock
import safetensors.torch
import torch
from torch.utils.data import ConcatDataset
from typing_extensions import override

from gem_lite.clip import Clip, calibration
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.foundations import files, registry
from gem_lite.policies.base import Policy
from gem_lite.policies.inputs import PreparedStep, Sample

ABOVE = ("cli", "drawing", "evaluation", "page", "serving", "simulation", "tasks")
"""The rooms of the library above this one. No preparation imports them, so their code decides no step."""
LIBRARIES = ("numpy", "scipy", "torch", "transformers")
"""The libraries that compute prepared steps. With other versions, steps may differ in their last bits."""
_PROCESS = uuid.uuid4().hex
"""Stands for the code of modules without a file, such as a notebook: each process may have other code there."""


class StoredSteps(files.FileSequence[PreparedStep]):
    """The prepared steps of a folder."""

    @override
    def item(self, path: Path, digest: str) -> PreparedStep:
        return _decode(files.read_verified(path, digest))


Steps = Sequence[PreparedStep] | ConcatDataset[PreparedStep]
"""Prepared steps of one task; or of several, which a training draws equally often."""


def fingerprint(steps: Steps) -> str:
    """SHA-256 of the whole content of steps: pictures, maps, words and labels. Files and memory give the same."""
    digests: Iterable[str]
    if isinstance(steps, StoredSteps):
        digests = steps.sums.values()
    elif isinstance(steps, ConcatDataset):
        digests = map(fingerprint, cast("list[Steps]", steps.datasets))
    else:
        digests = (hashlib.sha256(_encode(step)).hexdigest() for step in steps)
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def store(
    steps_from: Callable[[int], Iterable[PreparedStep]], folder: Path, facts: Mapping[str, object]
) -> StoredSteps:  # fmt: skip
    """Write steps one at a time into a subfolder of ``folder`` that is named by a hash of ``facts``.

    Steps that are already there are kept; if a file of them is missing, all are made again. Of several processes that
    need the same steps, one makes them, and the others wait and then read them.

    Args:
        steps_from: called with the number of existing steps; returns the other steps in their order.
        facts: all that decides the content of the steps, ready for JSON.

    Raises:
        OSError: a step cannot be written; the steps before it stay.
    """
    own = folder / hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    # Beside the subfolder, since that may be removed.
    lock = filelock.FileLock(own.with_suffix(".lock"))
    try:
        held = lock.acquire(timeout=0)
    except filelock.Timeout:
        print(f"another process prepares the same steps in {own}: waiting for it")
        held = lock.acquire()
    with held:
        return _stored(steps_from, own, facts)


def _stored(
    steps_from: Callable[[int], Iterable[PreparedStep]], folder: Path, facts: Mapping[str, object]
) -> StoredSteps:  # fmt: skip
    """`store` in the subfolder, which no other process uses meanwhile."""
    path = folder / "manifest.json"
    manifest: dict[str, Any] = {"facts": facts, "whole": False, "files": {}}
    if path.exists():
        manifest = files.read_json(path.read_bytes(), path)
        missing = [name for name in manifest["files"] if not (folder / name).exists()]
        if missing:
            print(f"{missing[0]} is missing: the steps in {folder} are prepared again")
            shutil.rmtree(folder)
            manifest |= {"whole": False, "files": {}}
    sums = manifest["files"]
    if manifest["whole"]:
        return StoredSteps(folder, sums)
    for number, step in enumerate(steps_from(len(sums)), len(sums)):
        content = _encode(step)
        name = f"step-{number:06d}.safetensors.zlib"
        files.write_atomically(folder / name, content)
        sums[name] = hashlib.sha256(content).hexdigest()
        files.write_atomically(path, json.dumps(manifest).encode())
    files.write_atomically(path, json.dumps(manifest | {"whole": True}).encode())
    return StoredSteps(folder, sums)


def prepare(policy: Policy, sets: Sequence[DemonstrationSet], folder: Path) -> Steps:
    """Prepare demonstrations for training: fill the policy's memory, and `store` the prepared steps.

    Args:
        sets: the demonstrations of each task. A policy of several tasks may retrieve crops of every task.

    Raises:
        ValueError: a step lacks the view of a camera.
        OSError: a step cannot be written; the steps before it stay.
    """
    # The policy that makes inputs has only the part of its configuration that decides them: no other entry is there.
    maker = copy.copy(policy)
    vars(maker)["config"] = policy.config.inputs
    maker.remember(ConcatDataset(sets))  # type: ignore[arg-type]  # Nothing is copied, and any sequence is a data set.
    policy.memory = maker.memory
    code = code_digest(policy)
    parts = [
        store(functools.partial(maker.prepare, demos), folder, identity(policy, demos, sets) | {"code": code})
        for demos in sets
    ]
    return parts[0] if len(parts) == 1 else ConcatDataset(parts)  # type: ignore[arg-type]


def identity(policy: Policy, demos: DemonstrationSet, remembered: Sequence[DemonstrationSet]) -> dict[str, object]:
    """The facts that decide the prepared steps, except for the program; ready for JSON.

    What is remembered counts only for a method that remembers: without a memory, the steps of a task are the same,
    whether it is trained alone or with others. A parser counts by its name, so two different ones need different names.

    Args:
        remembered: the demonstrations that the policy was given to remember, in their order.
    """
    kind = type(policy)
    parser = policy.parser if hasattr(policy.parser, "__qualname__") else type(policy.parser)
    remembers = kind.remember is not Policy.remember
    return {
        "data": demos.digest,
        "method": f"{kind.__module__}.{kind.__qualname__}",
        "config": policy.config.inputs.as_dict(),
        "clip": policy.clip.fingerprint,
        "calibrations": _calibrations(policy.clip),
        "device": policy.clip.device.type,
        "parser": f"{parser.__module__}.{parser.__qualname__}",
        "memory": [known.digest for known in remembered] if remembers else None,
    }


def _calibrations(clip: Clip) -> dict[str, str]:
    """The SHA-256 of each file of a CLIP's calibration that exists: it scales maps and decides what is retrieved."""
    paths = {kind: calibration.path_for(clip, kind) for kind in get_args(calibration.Kind)}
    return {kind: hashlib.sha256(path.read_bytes()).hexdigest() for kind, path in paths.items() if path.exists()}


def code_digest(policy: Policy) -> str:
    """SHA-256 of the program that prepares steps for a policy: of the library's rooms, without those `ABOVE` this one.

    It also changes with the files of modules outside the library that define the policy or register something, and with
    the versions of `LIBRARIES`. Other modules that these import are not looked at.
    """
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package)
        if name.parts[0] not in ABOVE:
            digest.update(name.as_posix().encode() + path.read_bytes())
    parser = getattr(policy.parser, "__module__", type(policy.parser).__module__)
    modules = {*registry.modules(), parser, *(kind.__module__ for kind in type(policy).__mro__)}
    known = {"gem_lite", "torch", *sys.stdlib_module_names}
    for module in sorted(name for name in modules if name.partition(".")[0] not in known):
        file = getattr(sys.modules.get(module), "__file__", None)
        digest.update(module.encode() + (Path(file).read_bytes() if file else _PROCESS.encode()))
    for library in LIBRARIES:
        digest.update(f"{library} {metadata.version(library)}".encode())
    return digest.hexdigest()


def _encode(step: PreparedStep) -> bytes:
    """A step as one compressed safetensors file: each tensor once.

    The tensor "samples" is JSON: all other values, and the tensors' names. Compression loses nothing, and the files are
    a third as large: colours have few values, and cells that no camera saw copy their neighbours.
    """
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

    samples = [
        {name: encode_value(f"{number}.{name}", value) for name, value in vars(sample).items()}
        for number, sample in enumerate(step)
    ]
    tensors["samples"] = torch.frombuffer(bytearray(json.dumps(samples).encode()), dtype=torch.uint8)
    return zlib.compress(safetensors.torch.save(tensors), level=1)


def _decode(content: bytes) -> PreparedStep:
    """The inverse of `_encode`."""
    tensors = safetensors.torch.load(zlib.decompress(content))
    samples = json.loads(tensors.pop("samples").numpy().tobytes())

    def decode_value(value: Any) -> Any:  # noqa: ANN401 (what JSON holds)
        if isinstance(value, list):
            return tuple(value)
        if not isinstance(value, dict):
            return value
        if "tensor" in value:
            return tensors[value["tensor"]]
        return {key: decode_value(member) for key, member in value["members"].items()}

    return tuple(Sample(**{name: decode_value(value) for name, value in sample.items()}) for sample in samples)
