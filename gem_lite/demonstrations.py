"""Records of expert demonstrations: what one holds; save, load and verify a set.

A set is a folder of one file an episode and a manifest, which is written last and names every file with its
SHA-256. A file's name holds the beginning of its sum, so that a new set never writes over an old one's files: until
its manifest is there, the old set is whole.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, overload

import cv2
import numpy as np

from gem_lite import language
from gem_lite.files import read_json, write_whole
from gem_lite.rgbd.camera import Camera, View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Action, Pose2

SCHEMA = 3
DEPTH_UNIT = 1e-4
"""Depth is kept in steps of 0.1 mm, up to 6.5535 m, as 16-bit PNG."""
_EPISODE_FILE = re.compile(r"episode-\d{4,}-[0-9a-f]{12}\.npz")
_SHA256 = re.compile(r"[0-9a-f]{64}")


class GripperState(NamedTuple):
    """What a tool knows of itself, and nothing else: where it is (m, radians) and whether it holds something."""

    x: float
    y: float
    yaw: float
    holding: bool


@dataclass(frozen=True)
class ExpertAction:
    """An expert's action and its yaw symmetries.

    ``pick_symmetry`` and ``place_symmetry`` are the smallest turns (radians) that change nothing:
    pi/2 for the yaw of a cube's grasp, 0 where every yaw is as good, 2 pi where one yaw is right.
    ``place_symmetry`` is that of the relative angle.
    """

    action: Action
    pick_symmetry: float
    place_symmetry: float


@dataclass(frozen=True)
class DemonstrationStep:
    """What the robot saw, was told and did: enough to recompute every map, label and crop.

    ``observation`` was made before the action; ``trace`` is the gripper's log during it.
    """

    observation: Observation
    instruction: str
    phrases: language.Queries
    expert: ExpertAction
    trace: tuple[GripperState, ...]
    reward: float


@dataclass(frozen=True)
class Demonstration:
    """One expert episode; ``world`` names the looks of the world it was played in."""

    task: str
    split: str
    seed: int
    steps: tuple[DemonstrationStep, ...]
    world: str = "home"


class DemonstrationSet(Sequence[Demonstration]):
    """The demonstrations of a folder. Each is read when it is asked for, and not kept.

    A slice is such a set, too. An episode whose file has gone or changed since `load` raises what `load` raises.

    Attributes:
        folder: where the files are.
        files: their names and SHA-256 sums, in the order of the episodes.
    """

    def __init__(self, folder: Path, files: Mapping[str, str]) -> None:
        self.folder = folder
        self.files = dict(files)

    def __len__(self) -> int:
        return len(self.files)

    @property
    def digest(self) -> str:
        """One SHA-256 for all that the set holds, the same as `data_hash` of its folder."""
        return hashlib.sha256(json.dumps(self.files).encode()).hexdigest()

    @overload
    def __getitem__(self, index: int) -> Demonstration: ...

    @overload
    def __getitem__(self, index: slice) -> DemonstrationSet: ...

    def __getitem__(self, index: int | slice) -> Demonstration | DemonstrationSet:
        """An episode, or the set of several. Raises ValueError if a slice holds none."""
        chosen = list(self.files.items())[index]
        if isinstance(index, slice):
            if not chosen:
                raise ValueError(
                    f"the episodes [{index.start}:{index.stop}:{index.step}] of {self.folder} are none: "
                    f"it holds {len(self)}, and at least 1 is needed"
                )
            return DemonstrationSet(self.folder, dict(chosen))
        name, digest = chosen
        path = self.folder / name
        content = _verified(path, digest)
        try:
            return _decode(content)
        except Exception as error:  # A file that another program wrote can be wrong in any way.
            raise ValueError(
                f"the demonstration {path} lacks a part or has a wrong one: {type(error).__name__}: {error}"
            ) from error


def quantized(observation: Observation) -> Observation:
    """Depth as the files hold it."""
    views = []
    for view in observation.views:
        depth = np.round(np.clip(view.depth / DEPTH_UNIT, 0, 65535)).astype(np.uint16)
        views.append(dataclasses.replace(view, depth=depth.astype(np.float32) * np.float32(DEPTH_UNIT)))
    return Observation(tuple(views))


def pack(trace: Sequence[GripperState]) -> np.ndarray:
    """(T, 4) float32: x, y, yaw, holding."""
    return np.array(trace, np.float32).reshape(-1, 4)


def unpack(trace: np.ndarray) -> tuple[GripperState, ...]:
    """`pack`'s (T, 4) array as states again."""
    return tuple(GripperState(x, y, yaw, bool(holding)) for x, y, yaw, holding in trace.tolist())


def _png(image: np.ndarray) -> np.ndarray:
    return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].reshape(-1)


def _encode(demonstration: Demonstration) -> bytes:
    arrays: dict[str, np.ndarray] = {}
    steps = []
    for i, step in enumerate(demonstration.steps):
        for j, view in enumerate(step.observation.views):
            arrays[f"rgb-{i}-{j}"] = _png(view.rgb[..., ::-1])
            arrays[f"depth-{i}-{j}"] = _png(np.round(view.depth / DEPTH_UNIT).astype(np.uint16))
        arrays[f"trace-{i}"] = pack(step.trace)
        steps.append({
            "instruction": step.instruction,
            "phrases": dataclasses.asdict(step.phrases),
            "expert": dataclasses.asdict(step.expert),
            "reward": step.reward,
            "cameras": [dataclasses.asdict(view.camera) for view in step.observation.views],
        })  # fmt: skip
    meta = {name: getattr(demonstration, name) for name in ("task", "split", "seed", "world")} | {"steps": steps}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _decode(content: bytes) -> Demonstration:
    arrays = np.load(io.BytesIO(content))
    meta = read_json(arrays["meta"].tobytes(), "its description")
    return Demonstration(
        _text(meta["task"]), _text(meta["split"]), _whole_number(meta["seed"]),
        tuple(_decode_step(step, i, arrays) for i, step in enumerate(meta["steps"])), _text(meta["world"]),
    )  # fmt: skip


def _decode_step(step: dict, i: int, arrays: Mapping[str, np.ndarray]) -> DemonstrationStep:
    views = []
    for j, camera in enumerate(step["cameras"]):
        rgb = cv2.imdecode(arrays[f"rgb-{i}-{j}"], cv2.IMREAD_COLOR)[..., ::-1].copy()
        depth = cv2.imdecode(arrays[f"depth-{i}-{j}"], cv2.IMREAD_UNCHANGED)
        camera = Camera(**{name: _tuples(value) for name, value in camera.items()})
        views.append(View(camera, rgb, depth.astype(np.float32) * np.float32(DEPTH_UNIT)))
    expert = step["expert"]
    pick, place = (Pose2(**{k: _number(v) for k, v in expert["action"][end].items()}) for end in ("pick", "place"))
    trace = arrays[f"trace-{i}"]
    if trace.dtype != np.float32 or trace.ndim != 2 or trace.shape[1] != 4 or not np.isfinite(trace).all():
        raise ValueError(f"the trace of step {i} must be finite (T, 4) float32, got {trace.shape} {trace.dtype}")
    return DemonstrationStep(
        Observation(tuple(views)),
        _text(step["instruction"]),
        language.Queries(**{role: _text(phrase) for role, phrase in step["phrases"].items()}),
        ExpertAction(Action(pick, place), _number(expert["pick_symmetry"]), _number(expert["place_symmetry"])),
        unpack(trace),
        _number(step["reward"]),
    )


def _tuples(value: object) -> object:
    """JSON's lists as tuples, at every depth; the numbers in them must be finite."""
    if isinstance(value, list):
        return tuple(_tuples(part) for part in value)
    return value if isinstance(value, str) else _number(value)


def _text(value: object) -> str:
    if not isinstance(value, str) or not value:
        raise ValueError(f"a text is needed, got {value!r}")
    return value


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"a finite number is needed, got {value!r}")
    return value


def _whole_number(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"a whole number from 0 on is needed, got {value!r}")
    return value


def save(demonstrations: Sequence[Demonstration], folder: Path) -> None:
    """Write a set; one that is in ``folder`` already stays whole until the new one is, and then goes.

    Raises:
        ValueError: no demonstrations, or of several tasks, splits or worlds.
    """
    if not demonstrations:
        raise ValueError("demonstrations is empty: there is nothing to save")
    folder = Path(folder)
    files: dict[str, str] = {}
    facts: dict[str, str] = {}
    for number, demonstration in enumerate(demonstrations):
        present = {name: getattr(demonstration, name) for name in ("task", "split", "world")}
        facts = facts or present
        if present != facts:
            raise ValueError(f"demonstrations must be of one task, split and world, got {facts} and {present}")
        files |= write_episode(folder, number, demonstration)
    write_manifest(folder, facts, files)
    for path in folder.glob("episode-*.npz"):
        if path.name not in files:
            path.unlink()


def write_episode(folder: Path, number: int, demonstration: Demonstration) -> dict[str, str]:
    """Write an episode's file; returns its name and its SHA-256."""
    content = _encode(demonstration)
    digest = hashlib.sha256(content).hexdigest()
    name = f"episode-{number:04d}-{digest[:12]}.npz"
    write_whole(folder / name, content)
    return {name: digest}


def write_manifest(folder: Path, facts: Mapping[str, object], files: Mapping[str, str]) -> None:
    """Write a set's manifest: ``facts`` of it, and its files with their SHA-256."""
    manifest = {"schema": SCHEMA, **facts, "files": files}
    write_whole(folder / "manifest.json", json.dumps(manifest, indent=1).encode())


def read_manifest(folder: Path) -> dict:
    """The manifest of a set. Raises FileNotFoundError or ValueError with what is wrong."""
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
        raise ValueError(f"{path} lists no files: it is not a whole manifest")
    for name, digest in files.items():
        # A name with a folder in it would lead out of the set.
        if not _EPISODE_FILE.fullmatch(name) or not isinstance(digest, str) or not _SHA256.fullmatch(digest):
            raise ValueError(f"{path} lists {name!r} with the sum {digest!r}: that is no file of a set")
    try:
        for name in ("task", "split", "world"):
            _text(manifest.get(name))
        for name in {"start", "next"} & manifest.keys():
            _whole_number(manifest[name])
    except ValueError as error:
        raise ValueError(f"{path} has a wrong {name}: {error}") from error
    if ("start" in manifest) != ("next" in manifest):
        raise ValueError(f"{path} has one of start and next, and not the other")
    return manifest


def data_hash(folder: Path, episodes: int | None = None) -> str:
    """One SHA-256 for a set, or for its first ``episodes``, from its manifest. Raises ValueError below 1 episode."""
    if episodes is not None and episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    files = list(read_manifest(folder)["files"].items())[:episodes]
    return DemonstrationSet(folder, dict(files)).digest


def load(folder: Path) -> DemonstrationSet:
    """Verify the sums of a set's files, one file after the other; episodes are decoded when they are asked for.

    Raises:
        FileNotFoundError: the folder, its manifest or one of its episodes is missing.
        ValueError: another schema, or a file that is not what was saved (cut off, edited).
    """
    folder = Path(folder)
    files = read_manifest(folder)["files"]
    for name, digest in files.items():
        _verified(folder / name, digest)
    return DemonstrationSet(folder, files)


def _verified(path: Path, digest: str) -> bytes:
    """A file's content, if its SHA-256 is ``digest``."""
    if not path.exists():
        raise FileNotFoundError(f"the demonstration {path} is missing, though the manifest names it")
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise ValueError(f"the demonstration {path} is cut off or changed: its SHA-256 is not the manifest's")
    return content
