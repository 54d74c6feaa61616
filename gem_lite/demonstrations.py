"""Expert demonstrations: collect, save, load, verify.

A set is a folder of one file an episode and a manifest, which is written last and names every file with its
SHA-256. A file's name holds the beginning of its sum, so that a new set never writes over an old one's files: until
its manifest is there, the old set is whole.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import io
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, overload

import cv2
import numpy as np
from tqdm import tqdm

from gem_lite import language
from gem_lite.rgbd.camera import Camera, View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Action, Pose2
from gem_lite.tabletop import tasks
from gem_lite.tabletop.gripper import GripperState
from gem_lite.tabletop.tasks import ExpertAction
from gem_lite.tabletop.world import World
from gem_lite.tabletop.worlds import WORLDS

SCHEMA = 3
DEPTH_UNIT = 1e-4
"""Depth is kept in steps of 0.1 mm, up to 6.5535 m, as 16-bit PNG."""
_EPISODE_FILE = re.compile(r"episode-\d{4,}-[0-9a-f]{12}\.npz")
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class DemonstrationStep:
    """What the robot saw, was told and did: enough to recompute every map, label and crop.

    ``observation`` was made before the action; ``trace`` is the gripper's log during it.
    """

    observation: Observation
    instruction: str
    phrases: language.Phrases
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


def _quantized(observation: Observation) -> Observation:
    """Depth as the files hold it."""
    views = []
    for view in observation.views:
        depth = np.round(np.clip(view.depth / DEPTH_UNIT, 0, 65535)).astype(np.uint16)
        views.append(dataclasses.replace(view, depth=depth.astype(np.float32) * np.float32(DEPTH_UNIT)))
    return Observation(tuple(views))


def _pack(trace: Sequence[GripperState]) -> np.ndarray:
    """(T, 4) float32: x, y, yaw, holding."""
    return np.array(trace, np.float32).reshape(-1, 4)


def _unpack(trace: np.ndarray) -> tuple[GripperState, ...]:
    return tuple(GripperState(x, y, yaw, bool(holding)) for x, y, yaw, holding in trace.tolist())


def roll_out(world: World, task_name: str, split: tasks.Split, index: int) -> Demonstration:
    """Let the expert do episode ``index`` of a split."""
    task, seed = tasks.make(task_name, split), tasks.episode_seed(split, index)
    observation = world.reset(task, seed)
    steps = []
    for _ in range(task.max_steps):
        expert = task.expert(world)
        if expert is None:
            break
        instruction = task.instruction  # the step may bring the next one
        result = world.step(expert.action)
        # Observation and trace as the files hold them, so that fresh and loaded demonstrations are equal.
        steps.append(
            DemonstrationStep(
                _quantized(observation), instruction, language.parse(instruction), expert,
                _unpack(_pack(result.trace)), result.reward,
            )
        )  # fmt: skip
        observation = result.observation
        if result.done:
            break
    return Demonstration(task_name, split, seed, tuple(steps))


def collect(
    task_name: str, episodes: int, folder: Path, split: tasks.Split = "train", start: int = 0, world: str = "home"
) -> DemonstrationSet:
    """Collect ``episodes`` successful expert episodes; an episode that fails is skipped.

    Each episode is saved at once. If ``folder`` holds the beginning of the same collection, its episodes are kept
    and the rest is added; if it holds more than ``episodes``, the first of them are returned and nothing is changed.

    Args:
        start: the index in the split of the first episode to try.
        world: how the world looks, one of `gem_lite.tabletop.worlds.WORLDS`.

    Raises:
        ValueError: unknown task, split or world, ``episodes`` below 1, or ``folder`` holds another set.
        RuntimeError: the expert failed in more than half of the episodes tried, and 20 of them.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    if world not in WORLDS:
        raise ValueError(f"world must be one of {', '.join(WORLDS)}, got {world!r}")
    tasks.make(task_name, split)
    folder = Path(folder)
    facts = {"task": task_name, "split": split, "world": world, "start": start}
    files: dict[str, str] = {}
    index = start
    if (folder / "manifest.json").exists():
        files, index = _begun(folder, facts)
    label = f"{task_name} ({split})"
    with World(style=WORLDS[world]) as table, tqdm(None, label, episodes, initial=len(files), unit="episode") as bar:
        while len(files) < episodes:
            demonstration = dataclasses.replace(roll_out(table, task_name, split, index), world=world)
            index += 1
            if sum(step.reward for step in demonstration.steps) > 0.99:
                files |= _write_episode(folder, len(files), demonstration)
                _write_manifest(folder, {**facts, "next": index}, files)
                bar.update()
            else:
                bar.write(f"episode {index - 1}: the expert failed, skipped")
                failed = index - start - len(files)
                if failed >= 20 and failed > len(files):
                    raise RuntimeError(f"the expert failed in {failed} of {index - start} episodes of {task_name}")
    return load(folder)[:episodes]


def _begun(folder: Path, facts: dict) -> tuple[dict[str, str], int]:
    """The files of a collection that was stopped, and the index of the next episode to try."""
    manifest = read_manifest(folder)
    there = {name: manifest.get(name) for name in facts}
    if there != facts:
        raise ValueError(f"{folder} holds another set ({there}, not {facts}): give another folder, or remove it")
    return load(folder).files, manifest["next"]


def _png(image: np.ndarray) -> np.ndarray:
    return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].reshape(-1)


def _encode(demonstration: Demonstration) -> bytes:
    arrays: dict[str, np.ndarray] = {}
    steps = []
    for i, step in enumerate(demonstration.steps):
        for j, view in enumerate(step.observation.views):
            arrays[f"rgb-{i}-{j}"] = _png(view.rgb[..., ::-1])
            arrays[f"depth-{i}-{j}"] = _png(np.round(view.depth / DEPTH_UNIT).astype(np.uint16))
        arrays[f"trace-{i}"] = _pack(step.trace)
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
        language.Phrases(**{role: _text(phrase) for role, phrase in step["phrases"].items()}),
        ExpertAction(Action(pick, place), _number(expert["pick_symmetry"]), _number(expert["place_symmetry"])),
        _unpack(trace),
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


def read_json(content: bytes | str, name: object) -> dict:
    """A JSON object from a file's content.

    Args:
        name: what the content is, for the error.

    Raises:
        ValueError: cut off, no JSON, no object, or a number in it is not finite.
    """

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is no JSON number")

    try:
        found = json.loads(content, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name} is cut off or no JSON: {error}") from error
    if not isinstance(found, dict):
        raise ValueError(f"{name} must hold a JSON object, got {type(found).__name__}")
    return found


def write_whole(path: Path, content: bytes) -> None:
    """Write to a temporary name, then rename: an interrupted run or a full disk leaves the old file whole."""
    write_together({path: content})


def write_together(contents: dict[Path, bytes]) -> None:
    """`write_whole` for files that belong together: no old one is replaced before every new one is on the disk."""
    partial = {path: path.with_name(path.name + ".part") for path in contents}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            partial[path].write_bytes(content)
    except OSError:
        for left in partial.values():
            left.unlink(missing_ok=True)
        raise
    for path, whole in partial.items():
        os.replace(whole, path)


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
        files |= _write_episode(folder, number, demonstration)
    _write_manifest(folder, facts, files)
    for path in folder.glob("episode-*.npz"):
        if path.name not in files:
            path.unlink()


def _write_episode(folder: Path, number: int, demonstration: Demonstration) -> dict[str, str]:
    """Write an episode's file; returns its name and its SHA-256."""
    content = _encode(demonstration)
    digest = hashlib.sha256(content).hexdigest()
    name = f"episode-{number:04d}-{digest[:12]}.npz"
    write_whole(folder / name, content)
    return {name: digest}


def _write_manifest(folder: Path, facts: Mapping[str, object], files: Mapping[str, str]) -> None:
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
    return hashlib.sha256(json.dumps(dict(files)).encode()).hexdigest()


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


def main() -> None:
    """Command line: see ``python -m gem_lite.demonstrations --help``."""
    parser = argparse.ArgumentParser(
        description="Collect or verify expert demonstrations.",
        epilog="example: python -m gem_lite.demonstrations collect put-block-in-bowl-seen-colors data/demos/bowl-10",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    collecting = commands.add_parser("collect", help="let the expert do episodes and save them")
    collecting.add_argument("task", help=f"one of {', '.join(tasks.NAMES)}")
    collecting.add_argument("folder", type=Path, help="where to save them")
    collecting.add_argument("--episodes", type=int, default=10, help="how many (default 10)")
    collecting.add_argument("--split", default="train", choices=list(tasks.SEED_START), help="default train")
    collecting.add_argument("--world", default="home", choices=list(WORLDS), help="how it looks (default home)")
    verifying = commands.add_parser("verify", help="load a set and check every file's sum")
    verifying.add_argument("folder", type=Path)
    args = parser.parse_args()
    try:
        if args.command == "collect":
            found = collect(args.task, args.episodes, args.folder, args.split, world=args.world)
        else:
            found = load(args.folder)
        steps = sum(len(demonstration.steps) for demonstration in tqdm(found, "verifying", unit="episode"))
    except (OSError, ValueError, RuntimeError) as error:
        parser.exit(2, f"{error}\n")
    except KeyboardInterrupt:
        parser.exit(130, f"\nstopped; the same command goes on from the episodes in {args.folder}\n")
    print(f"{args.folder}: {len(found)} episodes, {steps} steps, data hash {data_hash(args.folder)[:12]}")


if __name__ == "__main__":
    main()
