"""Expert demonstrations: their records, and how a set is saved, loaded and verified.

A set is a folder with one file for each episode and a manifest. The manifest is written last. It names every file with
its SHA-256. The name of a file holds the beginning of its SHA-256, so the files of a new set never overwrite those of
an old set. The old set stays complete until the new manifest is written. Only one process at a time writes into a
folder (`gem_lite.foundations.files.writing`), and files that no manifest names are left alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from typing_extensions import override

from gem_lite import language
from gem_lite.actions import Action, ExpertAction, GripperState, PickPlace, Push
from gem_lite.foundations.files import (
    FileSequence,
    as_number,
    as_text,
    as_tuples,
    as_whole_number,
    read_json,
    read_verified,
    write_atomically,
    writing,
)
from gem_lite.rgbd import png
from gem_lite.rgbd.camera import Camera, View
from gem_lite.rgbd.observation import DEPTH_SCALE, Observation, depth_steps
from gem_lite.rgbd.recordings import Recording
from gem_lite.se2 import Pose2

SCHEMA = 3
DEPTH_UNIT = DEPTH_SCALE
"""Depth is kept in steps of 0.1 mm, up to 6.5535 m, as 16-bit PNG; see `depth_steps`."""
LARGEST_EPISODE = 2**30
"""A file that unpacks to more bytes is refused: a small archive may claim any size, and would fill the memory."""
_KINDS: dict[type[Action], str] = {PickPlace: "pick-place", Push: "push"}
_EPISODE_FILE = re.compile(r"episode-\d{4,}-[0-9a-f]{12}\.npz")
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class DemonstrationStep:
    """One step of an episode. Every map, label and crop can be computed from it.

    Attributes:
        observation: the pictures before the action.
        instruction: the sentence.
        expert: the expert's action.
        trace: the states of the gripper during the action.
        reward: the change of the task's score, in [-1, 1].
    """

    observation: Observation
    instruction: str
    expert: ExpertAction
    trace: tuple[GripperState, ...]
    reward: float

    @property
    def phrases(self) -> language.Queries:
        """The instruction, parsed by the library's grammar. Raises ValueError if the grammar does not cover it."""
        return language.parse(self.instruction)


OWN_WORLD = "own"
"""The world of demonstrations that were recorded on a table outside this library."""


@dataclass(frozen=True)
class Demonstration:
    """One expert episode; ``world`` is the name of its world, see `gem_lite.simulation.looks`, or `OWN_WORLD`."""

    task: str
    split: str
    seed: int
    steps: tuple[DemonstrationStep, ...]
    world: str = "home"

    @classmethod
    def load(cls, folder: Path | str) -> Demonstration:
        """One recorded episode: its steps are the folder's subfolders (`Recording.load`), in the order of their names.

        Numbers in names count as numbers: step-2 comes before step-10. The name of the folder above is the task's.

        Raises:
            FileNotFoundError: there is no such folder, no step in it, or a step lacks a file.
            ValueError: see `Recording.load`.
        """
        folder = Path(folder).resolve()
        if not folder.is_dir():
            raise FileNotFoundError(f"{folder} is no folder")
        parts = sorted((part for part in folder.iterdir() if part.is_dir()), key=natural_order)
        if not parts:
            raise FileNotFoundError(f"{folder} holds no recorded episode: there is no folder of a step in it")
        steps = []
        for part in parts:
            recording = Recording.load(part)
            share = 1 / len(parts)  # The episode is taken as solved, and each step as an equal part of that.
            steps.append(
                DemonstrationStep(
                    quantized(recording.observation), recording.sentence, recording.expert, recording.trace, share
                )
            )
        return cls(folder.parent.name, "train", 0, tuple(steps), OWN_WORLD)


def natural_order(path: Path) -> list[tuple[int, str]]:
    """A key that sorts names as people do: step-2 before step-10."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


class DemonstrationSet(FileSequence[Demonstration]):
    """The demonstrations of a folder, as `load` gives them."""

    @property
    def digest(self) -> str:
        """One SHA-256 for the whole set, equal to `data_hash` of its folder."""
        return hashlib.sha256(json.dumps(self.sums).encode()).hexdigest()

    @override
    def decode(self, path: Path, content: bytes) -> Demonstration:
        try:
            return _decode(content)
        except Exception as error:  # A file of another program can have any error.
            raise ValueError(
                f"the demonstration {path} lacks a part or has a wrong one: {type(error).__name__}: {error}"
            ) from error


def quantized(observation: Observation) -> Observation:
    """The observation with its depth as the files hold it. Raises ValueError: see `depth_steps`."""
    views = []
    for view in observation.views:
        depth = depth_steps(view, DEPTH_UNIT).astype(np.float32) * np.float32(DEPTH_UNIT)
        views.append(dataclasses.replace(view, depth=depth))
    return Observation(tuple(views))


def pack(trace: Sequence[GripperState]) -> np.ndarray:
    """The states as a (T, 4) float32 array: x, y, yaw, holding."""
    return np.array(trace, np.float32).reshape(-1, 4)


def unpack(trace: np.ndarray) -> tuple[GripperState, ...]:
    """The inverse of `pack`: the states of a (T, 4) array."""
    return tuple(GripperState(x, y, yaw, bool(holding)) for x, y, yaw, holding in trace.tolist())


def _encode(demonstration: Demonstration) -> bytes:
    arrays: dict[str, np.ndarray] = {}
    steps = []
    for i, step in enumerate(demonstration.steps):
        for j, view in enumerate(step.observation.views):
            arrays[f"rgb-{i}-{j}"] = np.frombuffer(png.encode(view.rgb), np.uint8)
            arrays[f"depth-{i}-{j}"] = np.frombuffer(png.encode(depth_steps(view, DEPTH_UNIT)), np.uint8)
        arrays[f"trace-{i}"] = pack(step.trace)
        steps.append({
            "instruction": step.instruction,
            "expert": {
                "action": _encode_action(step.expert.action),
                "pick_symmetry": step.expert.pick_symmetry,
                "place_symmetry": step.expert.place_symmetry,
            },
            "reward": step.reward,
            "cameras": [dataclasses.asdict(view.camera) for view in step.observation.views],
        })  # fmt: skip
    meta = {name: getattr(demonstration, name) for name in ("task", "split", "seed", "world")} | {"steps": steps}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _decode(content: bytes) -> Demonstration:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > LARGEST_EPISODE:
        raise ValueError(f"it unpacks to {size} bytes, and at most {LARGEST_EPISODE} are allowed")
    arrays = np.load(io.BytesIO(content))
    meta = read_json(arrays["meta"].tobytes(), "its description")
    return Demonstration(
        as_text(meta["task"]), as_text(meta["split"]), as_whole_number(meta["seed"]),
        tuple(_decode_step(step, i, arrays) for i, step in enumerate(meta["steps"])), as_text(meta["world"]),
    )  # fmt: skip


def _decode_step(step: dict, i: int, arrays: Mapping[str, np.ndarray]) -> DemonstrationStep:
    views = []
    for j, camera in enumerate(step["cameras"]):
        rgb = png.decode(arrays[f"rgb-{i}-{j}"].tobytes(), 3, np.uint8, f"rgb-{i}-{j}")
        depth = png.decode(arrays[f"depth-{i}-{j}"].tobytes(), 1, np.uint16, f"depth-{i}-{j}")
        numbers: dict[str, Any] = {name: as_tuples(value) for name, value in camera.items()}
        camera = Camera(**numbers)
        views.append(View(camera, rgb, depth.astype(np.float32) * np.float32(DEPTH_UNIT)))
    expert = step["expert"]
    trace = arrays[f"trace-{i}"]
    if trace.dtype != np.float32 or trace.ndim != 2 or trace.shape[1] != 4 or not np.isfinite(trace).all():
        raise ValueError(f"the trace of step {i} must be finite (T, 4) float32, got {trace.shape} {trace.dtype}")
    return DemonstrationStep(
        Observation(tuple(views)),
        as_text(step["instruction"]),
        ExpertAction(
            _decode_action(expert["action"]), as_number(expert["pick_symmetry"]), as_number(expert["place_symmetry"])
        ),
        unpack(trace),
        as_number(step["reward"]),
    )


def _encode_action(action: Action) -> dict:
    return {"kind": _KINDS[type(action)]} | dataclasses.asdict(action)


def _decode_action(entry: dict) -> Action:
    """Read an action. Older files have no kind and no tables: their action is a pick and place on the only table."""
    match entry.get("kind", "pick-place"):
        case "pick-place":
            tables = [as_whole_number(entry.get(name, 0)) for name in ("pick_table", "place_table")]
            return PickPlace(_decode_pose(entry["pick"]), _decode_pose(entry["place"]), *tables)
        case "push":
            return Push(_decode_pose(entry["start"]), _decode_pose(entry["end"]), as_whole_number(entry["table"]))
        case kind:
            raise ValueError(f"an action's kind must be one of {', '.join(_KINDS.values())}, got {kind!r}")


def _decode_pose(entry: dict) -> Pose2:
    return Pose2(**{name: as_number(value) for name, value in entry.items()})


def save(demonstrations: Sequence[Demonstration], folder: Path) -> None:
    """Write a set. The files of an old set in ``folder`` are removed after the new one is complete; others stay.

    Raises:
        ValueError: there are no demonstrations, or they have different tasks, splits or worlds.
        OSError: a file cannot be written, or another process writes into the folder. The old set stays.
    """
    if not demonstrations:
        raise ValueError("demonstrations is empty: there is nothing to save")
    folder = Path(folder)
    with writing(folder):
        old = _named_files(folder)
        files: dict[str, str] = {}
        facts: dict[str, str] = {}
        try:
            for number, demonstration in enumerate(demonstrations):
                own = {name: getattr(demonstration, name) for name in ("task", "split", "world")}
                facts = facts or own
                if own != facts:
                    raise ValueError(f"demonstrations must be of one task, split and world, got {facts} and {own}")
                files |= write_episode(folder, number, demonstration)
        except BaseException:
            _remove(folder, files.keys() - old)
            raise
        write_manifest(folder, facts, files)
        _remove(folder, old - files.keys())


def _named_files(folder: Path) -> set[str]:
    """The names of the files of the set in a folder; none if there is no set, or its manifest is damaged."""
    try:
        return set(read_manifest(folder)["files"])
    except (FileNotFoundError, ValueError):
        return set()


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        (folder / name).unlink(missing_ok=True)


def write_episode(folder: Path, number: int, demonstration: Demonstration) -> dict[str, str]:
    """Write the file of an episode, inside `files.writing`. Returns the file's name and its SHA-256."""
    content = _encode(demonstration)
    digest = hashlib.sha256(content).hexdigest()
    name = f"episode-{number:04d}-{digest[:12]}.npz"
    write_atomically(folder / name, content)
    return {name: digest}


def write_manifest(folder: Path, facts: Mapping[str, object], files: Mapping[str, str]) -> None:
    """Write the manifest of a set, inside `files.writing`: the ``facts`` about it, and its files' SHA-256."""
    manifest = {"schema": SCHEMA, **facts, "files": files}
    write_atomically(folder / "manifest.json", json.dumps(manifest, indent=1).encode())


def read_manifest(folder: Path) -> dict:
    """Read and check the manifest of a set. Raises FileNotFoundError or ValueError; the message names the problem."""
    path = Path(folder) / "manifest.json"
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no demonstrations: there is no manifest.json in it")
    manifest = read_json(path.read_bytes(), path)
    if manifest.get("schema") != SCHEMA:
        raise ValueError(
            f"{path} has schema {manifest.get('schema')!r}; this version reads schema {SCHEMA}: remove the set and "
            "collect it again"
        )
    files = manifest.get("files")
    if not isinstance(files, dict) or not files:
        raise ValueError(f"{path} lists no files: it is not a complete manifest")
    for name, digest in files.items():
        # A name that contains a folder could point outside the set.
        if not _EPISODE_FILE.fullmatch(name) or not isinstance(digest, str) or not _SHA256.fullmatch(digest):
            raise ValueError(f"{path} lists {name!r} with the SHA-256 {digest!r}: that is not a file of a set")
    try:
        for name in ("task", "split", "world"):
            as_text(manifest.get(name))
        for name in {"start", "next"} & manifest.keys():
            as_whole_number(manifest[name])
    except ValueError as error:
        raise ValueError(f"{path} has a wrong {name}: {error}") from error
    if ("start" in manifest) != ("next" in manifest):
        raise ValueError(f"{path} must have both start and next, or neither")
    return manifest


def data_hash(folder: Path, episodes: int | None = None) -> str:
    """One SHA-256 for a set or for its first ``episodes``, from its manifest. Raises ValueError if episodes < 1."""
    if episodes is not None and episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    files = list(read_manifest(folder)["files"].items())[:episodes]
    return DemonstrationSet(folder, dict(files)).digest


def load(folder: Path) -> DemonstrationSet:
    """Load a set and verify the SHA-256 of each file. An episode is decoded when it is accessed.

    Raises:
        FileNotFoundError: the folder, its manifest or one of its episodes is missing.
        ValueError: the manifest has another schema, or a file has changed since it was saved.
    """
    folder = Path(folder)
    sums = read_manifest(folder)["files"]
    for name, digest in sums.items():
        read_verified(folder / name, digest)
    return DemonstrationSet(folder, sums)
