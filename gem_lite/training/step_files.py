"""Prepared steps in files: computed one at a time, written once, and read when a training draws them.

The need for memory does not grow with the number of demonstrations: only one step is in memory at a time. The folder
holds one compressed safetensors file for each step, and a manifest. The manifest names every file with its SHA-256. It
is rewritten after each step, so that a stopped preparation can continue.

Trainings may share a folder. Then each set of steps has a subfolder, named by a hash of everything that decides the
steps. So trainings that differ only in what comes after the preparation read the same files.
"""

from __future__ import annotations

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

import filelock
import safetensors.torch
import torch
from typing_extensions import override

from gem_lite.demonstrations import DemonstrationSet
from gem_lite.foundations import files, registry
from gem_lite.policies.base import Policy
from gem_lite.policies.inputs import PreparedStep, Sample
from gem_lite.training.mixture import Joined

LIBRARIES = ("numpy", "scipy", "torch", "transformers")
"""The libraries that compute prepared steps. With other versions, steps may differ in their last bits."""
_PROCESS = uuid.uuid4().hex
"""Stands for the code of modules without a file, such as a notebook: each process may have other code there."""


class StoredSteps(files.FileSequence[PreparedStep]):
    """The prepared steps of a folder."""

    @override
    def decode(self, path: Path, content: bytes) -> PreparedStep:
        return _decode(content)

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
        code: identifies the version of the program. Steps of another version are removed and computed again. So are
            all steps if a file is missing.

    Raises:
        ValueError: ``folder`` holds steps with another source.
        OSError: a step cannot be written; the steps before it stay.
    """
    manifest = _open_manifest(folder, dict(source), code)
    sums = manifest["files"]
    if not manifest["whole"]:
        for number, step in enumerate(steps_from(len(sums)), len(sums)):
            content = _encode(step)
            name = f"step-{number:06d}.safetensors.zlib"
            files.write_atomically(folder / name, content)
            sums[name] = hashlib.sha256(content).hexdigest()
            _write_manifest(folder, manifest)
        manifest["whole"] = True
        _write_manifest(folder, manifest)
    return StoredSteps(folder, sums)


def share(
    steps_from: Callable[[int], Iterable[PreparedStep]], folder: Path, source: Mapping[str, object], code: str
) -> StoredSteps:
    """`store` in a subfolder of ``folder`` that is named by a hash of ``source`` and ``code``.

    Of several processes that need the same steps, one makes them, and the others wait and then read them.

    Raises:
        OSError: a step cannot be written; the steps before it stay.
    """
    facts = json.dumps({"source": source, "code": code}, sort_keys=True)
    own = folder / hashlib.sha256(facts.encode()).hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    # Beside the subfolder, since `store` may begin with removing the subfolder.
    lock = filelock.FileLock(own.with_suffix(".lock"))
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        print(f"another process prepares the same steps in {own}: waiting for it")
        lock.acquire()
    try:
        return store(steps_from, own, source, code)
    finally:
        lock.release()


def prepare(policy: Policy, demos: DemonstrationSet, folder: Path, shared: bool = False) -> StoredSteps:
    """Prepare demonstrations for training: fill the policy's memory, and `store` the prepared steps.

    Args:
        shared: whether ``folder`` is for the steps of many trainings, see `share`.

    Raises: see `prepare_steps`.
    """
    policy.remember(demos)
    return prepare_steps(policy, demos, folder, [demos], shared)


def prepare_tasks(
    policy: Policy, sets: Sequence[DemonstrationSet], folder: Path, shared: bool = False
) -> Joined[PreparedStep]:
    """`prepare` the demonstrations of several tasks for one policy. It may retrieve crops of every task.

    Raises: see `prepare_steps`.
    """
    policy.remember(Joined(sets))
    return Joined([
        prepare_steps(policy, demos, folder if shared else folder / str(number), sets, shared)
        for number, demos in enumerate(sets)
    ])  # fmt: skip


def prepare_steps(
    policy: Policy, demos: DemonstrationSet, folder: Path, remembered: Sequence[DemonstrationSet],
    shared: bool = False,
) -> StoredSteps:  # fmt: skip
    """`store` or `share` the prepared steps of demonstrations.

    Args:
        remembered: the demonstrations that the policy was given to remember, in their order.
        shared: see `prepare`.

    Raises:
        ValueError: a step lacks the view of a camera; or ``folder`` is not shared, and holds steps of other
            demonstrations, or for another method, configuration or CLIP.
        OSError: a step cannot be written; the steps before it stay.
    """
    put = share if shared else store
    source = identity(policy, demos, remembered)
    return put(functools.partial(policy.prepare, demos), folder, source, code_digest(policy))


def identity(policy: Policy, demos: DemonstrationSet, remembered: Sequence[DemonstrationSet]) -> dict[str, object]:
    """The facts that decide the prepared steps, except for the program; ready for JSON.

    Entries of the configuration that the preparation does not read are left out (`Config.preparation`). What is
    remembered counts only for a method that remembers: without a memory, the steps of a task are the same, whether it
    is trained alone or with others. A parser counts by its name, so two different ones need different names.

    Args:
        remembered: see `prepare_steps`.
    """
    kind = type(policy)
    parser = policy.parser if hasattr(policy.parser, "__qualname__") else type(policy.parser)
    remembers = kind.remember is not Policy.remember
    return {
        "data": demos.digest,
        "method": f"{kind.__module__}.{kind.__qualname__}",
        "config": policy.config.preparation,
        "clip": policy.clip.fingerprint,
        "device": policy.clip.device.type,
        "parser": f"{parser.__module__}.{parser.__qualname__}",
        "memory": [known.digest for known in remembered] if remembers else None,
    }


def code_digest(policy: Policy) -> str:
    """SHA-256 of the program that prepares steps for a policy. It changes with every change of the library's code.

    It also changes with the files of modules outside the library that define the policy or register something, and with
    the versions of `LIBRARIES`. Other modules that these import are not looked at.
    """
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    for name in _outside_modules(policy):
        file = getattr(sys.modules.get(name), "__file__", None)
        digest.update(name.encode() + (Path(file).read_bytes() if file else _PROCESS.encode()))
    for library in LIBRARIES:
        digest.update(f"{library} {metadata.version(library)}".encode())
    return digest.hexdigest()


def _outside_modules(policy: Policy) -> list[str]:
    """The modules outside the library that define the policy's class or parser, or register something."""
    parser = getattr(policy.parser, "__module__", type(policy.parser).__module__)
    names = {*registry.modules(), parser, *(kind.__module__ for kind in type(policy).__mro__)}
    known = {"gem_lite", "torch", *sys.stdlib_module_names}
    return sorted(name for name in names if name.partition(".")[0] not in known)


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
                f"{folder} holds steps prepared from another {', '.join(differing)}: give another folder by --state, "
                "or remove it"
            )
        missing = [name for name in manifest["files"] if not (folder / name).exists()]
        if manifest["code"] == code and not missing:
            return manifest
        reason = f"{missing[0]} is missing" if missing else "the program has changed"
        print(f"{reason}: the steps in {folder} are prepared again")
    shutil.rmtree(folder, ignore_errors=True)
    return {"source": source, "code": code, "whole": False, "files": {}}


def _write_manifest(folder: Path, manifest: dict) -> None:
    files.write_atomically(folder / "manifest.json", json.dumps(manifest).encode())


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

    def decode_value(value: object) -> object:
        if isinstance(value, list):
            return tuple(value)
        if not isinstance(value, dict):
            return value
        if "tensor" in value:
            return tensors[value["tensor"]]
        return {key: decode_value(member) for key, member in value["members"].items()}

    return tuple(Sample(**{name: decode_value(value) for name, value in sample.items()}) for sample in samples)
