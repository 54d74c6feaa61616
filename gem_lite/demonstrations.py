"""Expert demonstrations: collect, save, load, verify."""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from gem_lite import language
from gem_lite.se2 import Action, Pose2
from gem_lite.tabletop import tasks
from gem_lite.tabletop.cameras import Camera, View
from gem_lite.tabletop.gripper import GripperState
from gem_lite.tabletop.tasks import ExpertAction
from gem_lite.tabletop.world import Observation, World

SCHEMA = 2
DEPTH_UNIT = 1e-4
"""Depth is kept in steps of 0.1 mm, up to 6.5535 m, as 16-bit PNG."""


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
    """One expert episode."""

    task: str
    split: str
    seed: int
    steps: tuple[DemonstrationStep, ...]


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
    task_name: str, episodes: int, folder: Path, split: tasks.Split = "train", start: int = 0
) -> list[Demonstration]:
    """Collect ``episodes`` successful expert episodes and save them; an episode that fails is skipped.

    Raises:
        ValueError: unknown task or split, or ``episodes`` below 1.
        RuntimeError: the expert failed in more than half of the episodes tried, and 20 of them.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    tasks.make(task_name, split)
    found: list[Demonstration] = []
    index = start
    with World() as world, tqdm(total=episodes, desc=f"{task_name} ({split})", unit="episode") as bar:
        while len(found) < episodes:
            demonstration = roll_out(world, task_name, split, index)
            index += 1
            if sum(step.reward for step in demonstration.steps) > 0.99:
                found.append(demonstration)
                bar.update()
            else:
                bar.write(f"episode {index - 1}: the expert failed, skipped")
                failed = index - start - len(found)
                if failed >= 20 and failed > len(found):
                    raise RuntimeError(f"the expert failed in {failed} of {index - start} episodes of {task_name}")
    save(found, folder)
    return found


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
    meta = {"task": demonstration.task, "split": demonstration.split, "seed": demonstration.seed, "steps": steps}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _decode(content: bytes) -> Demonstration:
    arrays = np.load(io.BytesIO(content))
    meta = json.loads(arrays["meta"].tobytes())
    steps = []
    for i, step in enumerate(meta["steps"]):
        views = []
        for j, camera in enumerate(step["cameras"]):
            camera = Camera(**{key: tuple(v) if isinstance(v, list) else v for key, v in camera.items()})
            rgb = cv2.imdecode(arrays[f"rgb-{i}-{j}"], cv2.IMREAD_COLOR)[..., ::-1].copy()
            depth = cv2.imdecode(arrays[f"depth-{i}-{j}"], cv2.IMREAD_UNCHANGED)
            views.append(View(camera, rgb, depth.astype(np.float32) * np.float32(DEPTH_UNIT)))
        expert, action = step["expert"], step["expert"]["action"]
        expert = ExpertAction(
            Action(Pose2(**action["pick"]), Pose2(**action["place"])),
            expert["pick_symmetry"],
            expert["place_symmetry"],
        )
        steps.append(
            DemonstrationStep(
                Observation(tuple(views)), step["instruction"], language.Phrases(**step["phrases"]), expert,
                _unpack(arrays[f"trace-{i}"]), step["reward"],
            )
        )  # fmt: skip
    return Demonstration(meta["task"], meta["split"], meta["seed"], tuple(steps))


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
    """Write one file an episode and, last, the manifest with their SHA-256 sums."""
    if not demonstrations:
        raise ValueError("demonstrations is empty: there is nothing to save")
    files = {}
    for number, demonstration in enumerate(demonstrations):
        content = _encode(demonstration)
        name = f"episode-{number:04d}.npz"
        write_whole(folder / name, content)
        files[name] = hashlib.sha256(content).hexdigest()
    manifest = {"schema": SCHEMA, "task": demonstrations[0].task, "split": demonstrations[0].split, "files": files}
    write_whole(folder / "manifest.json", json.dumps(manifest, indent=1).encode())


def read_manifest(folder: Path) -> dict:
    """The manifest of a set. Raises FileNotFoundError or ValueError with what is wrong."""
    path = Path(folder) / "manifest.json"
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no demonstrations: there is no manifest.json in it")
    try:
        manifest = json.loads(path.read_text())
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is cut off or no JSON: {error}") from error
    if not isinstance(manifest, dict) or manifest.get("schema") != SCHEMA:
        found = manifest.get("schema") if isinstance(manifest, dict) else manifest
        raise ValueError(f"{path} has schema {found!r}; this version reads schema {SCHEMA}: collect the set again")
    if not isinstance(manifest.get("files"), dict):
        raise ValueError(f"{path} lists no files: it is not a whole manifest")
    return manifest


def data_hash(folder: Path, episodes: int | None = None) -> str:
    """One SHA-256 for a set, or for its first ``episodes``, from its manifest."""
    files = sorted(read_manifest(folder)["files"].items())[:episodes]
    return hashlib.sha256(json.dumps(dict(files)).encode()).hexdigest()


def load(folder: Path) -> list[Demonstration]:
    """Load and verify a set.

    Raises:
        FileNotFoundError: the folder, its manifest or one of its episodes is missing.
        ValueError: another schema, or a file that is not what was saved (cut off, edited).
    """
    folder, found = Path(folder), []
    for name, digest in read_manifest(folder)["files"].items():
        path = folder / name
        if not path.exists():
            raise FileNotFoundError(f"the demonstration {path} is missing, though the manifest names it")
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != digest:
            raise ValueError(f"the demonstration {path} is cut off or changed: its SHA-256 is not the manifest's")
        try:
            found.append(_decode(content))
        except (KeyError, zipfile.BadZipFile) as error:
            raise ValueError(f"the demonstration {path} lacks a part: {error}") from error
    return found


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
    verifying = commands.add_parser("verify", help="load a set and check every file's sum")
    verifying.add_argument("folder", type=Path)
    args = parser.parse_args()
    try:
        if args.command == "collect":
            found = collect(args.task, args.episodes, args.folder, args.split)
        else:
            found = load(args.folder)
    except (OSError, ValueError) as error:
        parser.exit(2, f"{error}\n")
    steps = sum(len(demonstration.steps) for demonstration in found)
    print(f"{args.folder}: {len(found)} episodes, {steps} steps, data hash {data_hash(args.folder)[:12]}")


if __name__ == "__main__":
    main()
