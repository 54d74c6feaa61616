"""A damaged file is read or refused in one sentence, and no other file suffers.

One example damages one file: bytes of it, values in its JSON, or members of its archive. In half of the cases the
sums beside it are made right again, as if another program had written the file.
"""

import copy
import dataclasses
import functools
import hashlib
import io
import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy
from damages import archive, archive_names, contents
from hypothesis import given
from hypothesis import strategies as st
from small import SMALL

from gem_lite import clip, demonstrations
from gem_lite.clip import calibration
from gem_lite.demonstrations import sets
from gem_lite.evaluation.results import file_rows, read_rows
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.policies import checkpoints
from gem_lite.policies.gem import Gem
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.observation import Observation

ROW = {
    "method": "gem", "task": "bars-in-box", "subset": "all", "episodes": 2, "mean": 50.0, "ci95": [1.3, 98.7],
    "world": "home", "split": "test", "start": 0, "skipped": [], "demos": 10, "data_sha256": "0a", "seed": 0,
    "steps": 1500, "config": "lite", "config_hash": "1b", "clip_fingerprint": "2c", "checkpoint_sha256": "3d",
    "rewards": {"0": 1.0, "1": 0.0},
}  # fmt: skip
VALUES = st.one_of(
    st.sampled_from(
        [None, True, -1, 0, 10**9, 10**30, 10**400, -0.5, 1e308, float("nan"), float("inf"), "", "x", [], {}, [[]]]
    ),
    st.text(max_size=5),
)
SHAPES = st.sampled_from([(), (0,), (3,), (2, 2), (1, 2, 3, 4), (2, 40, 40, 3), (5, 4)])
TYPES = st.sampled_from(["uint8", "float32", "float64", "int64", "bool"])


@pytest.fixture(scope="module")
def whole(demo_set, model, tmp_path_factory):
    """A folder with one of every kind of file."""
    folder = tmp_path_factory.mktemp("whole")
    step = demo_set[1][0].steps[0]
    views = [
        View(dataclasses.replace(view.camera, size=(8, 8)), view.rgb[:8, :8].copy(), view.depth[:8, :8].copy())
        for view in step.observation.views[:2]
    ]
    step = dataclasses.replace(step, observation=Observation(tuple(views)))
    episodes = [dataclasses.replace(demo_set[1][0], seed=seed, steps=(step,)) for seed in (0, 1)]
    demonstrations.save(episodes, folder / "demos")
    (folder / "archives").mkdir()
    names = archive_names(episodes)
    for name, episode in zip(names, episodes, strict=True):
        (folder / "archives" / name).write_bytes(archive(episode))
    manifest = json.loads((folder / "demos" / "manifest.json").read_text())
    (folder / "archives" / "manifest.json").write_text(json.dumps(manifest | {"schema": 3, "files": names}))
    step.save(folder / "step")
    picture = np.arange(20 * 20 * 3, dtype=np.uint8).reshape(20, 20, 3)
    memory = CropMemory(
        [CropEntry("red block", picture, "t", 0), CropEntry("green bowl", picture[::-1], "t", 1)], model
    )
    checkpoints.save_policy(Gem(SMALL, model, memory), folder / "policy.safetensors", {"task": "bars-in-box"})
    file_rows([ROW, ROW | {"seed": 1}], folder / "rows.jsonl")
    shutil.copy(calibration.path_for(model), folder / "calibration.json")
    return folder


def damaged_bytes(draw: Callable, content: bytes, other: bytes) -> bytes:
    kind = draw(st.sampled_from(["cut", "flip", "empty", "longer", "swap"]))
    at = draw(st.integers(0, max(0, len(content) - 1)))
    match kind:
        case "cut":
            return content[:at]
        case "flip":
            return content[:at] + bytes([content[at] ^ draw(st.integers(1, 255))]) + content[at + 1 :]
        case "empty":
            return b""
        case "longer":
            return content + draw(st.binary(min_size=1, max_size=20))
    return other


def damaged_json(draw: Callable, value: object) -> object:
    """The same with one value at any depth deleted or replaced."""
    value = copy.deepcopy(value)
    at = value
    while True:
        if not isinstance(at, dict | list) or not at:
            return draw(VALUES)
        key = draw(st.sampled_from(sorted(at) if isinstance(at, dict) else range(len(at))))
        action = draw(st.sampled_from(["deeper", "deeper", "delete", "replace"]))
        if action == "deeper" and isinstance(at[key], dict | list) and at[key]:
            at = at[key]
        elif action == "delete":
            del at[key]
            return value
        else:
            at[key] = draw(VALUES)
            return value


def damaged_arrays(draw: Callable, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    name = draw(st.sampled_from(sorted(arrays)))
    changed = dict(arrays)
    match draw(st.sampled_from(["delete", "shape", "nan", "swap"])):
        case "delete":
            del changed[name]
        case "shape":
            changed[name] = np.zeros(draw(SHAPES), draw(TYPES))
        case "nan":
            changed[name] = np.full(arrays[name].shape, np.nan, np.float32)
        case "swap":
            changed[name] = arrays[draw(st.sampled_from(sorted(arrays)))]
    return changed


def damage_text_or_bytes(draw: Callable, path: Path, other: bytes) -> None:
    content = path.read_bytes()
    if path.suffix == ".json" and draw(st.booleans()):
        path.write_text(json.dumps(damaged_json(draw, json.loads(content))))
    else:
        path.write_bytes(damaged_bytes(draw, content, other))


def damage_demonstrations(draw: Callable, folder: Path) -> None:
    path = draw(st.sampled_from(sorted(path for path in (folder / "demos").rglob("*") if path.is_file())))
    damage_text_or_bytes(draw, path, (folder / "calibration.json").read_bytes())
    if path.name != "manifest.json" and draw(st.booleans()):
        episode = path.relative_to(folder / "demos").parts[0]
        seal(folder / "demos", episode, sets._sum_of(folder / "demos" / episode))


def damage_archives(draw: Callable, folder: Path) -> None:
    path = draw(st.sampled_from(sorted((folder / "archives").glob("*.npz"))))
    content = path.read_bytes()
    with np.load(path) as archive:
        arrays = dict(archive)
    match draw(st.sampled_from(["bytes", "arrays", "description"])):
        case "bytes":
            content = damaged_bytes(draw, content, (folder / "calibration.json").read_bytes())
        case "arrays":
            content = packed_again(damaged_arrays(draw, arrays))
        case "description":
            meta = damaged_json(draw, json.loads(arrays["meta"].tobytes()))
            content = packed_again(arrays | {"meta": np.frombuffer(json.dumps(meta).encode(), np.uint8)})
    path.write_bytes(content)
    seal(folder / "archives", path.name, hashlib.sha256(content).hexdigest())


def packed_again(arrays: dict[str, np.ndarray]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def seal(folder: Path, episode: str, digest: str) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["files"][episode] = digest
    (folder / "manifest.json").write_text(json.dumps(manifest))


def read_demonstrations(folder: Path, model: clip.Clip, name: str = "demos") -> None:
    for demonstration in demonstrations.load(folder / name):
        assert isinstance(demonstration, demonstrations.Demonstration)
        assert all(np.isfinite(step.reward) for step in demonstration.steps)


def damage_step(draw: Callable, folder: Path) -> None:
    path = draw(st.sampled_from(sorted((folder / "step").glob("*.png")) + sorted((folder / "step").glob("*.json"))))
    damage_text_or_bytes(draw, path, (folder / "rows.jsonl").read_bytes())


def read_step(folder: Path, model: clip.Clip) -> None:
    for view in demonstrations.DemonstrationStep.load(folder / "step").observation.views:
        assert np.isfinite(view.points()).all()


def damage_checkpoint(draw: Callable, folder: Path) -> None:
    path, card_file = folder / "policy.safetensors", folder / "policy.json"
    match draw(st.sampled_from(["bytes", "card", "weights", "missing"])):
        case "bytes":
            damage_text_or_bytes(draw, path, (folder / "calibration.json").read_bytes())
        case "card":
            damage_text_or_bytes(draw, card_file, path.read_bytes())
        case "weights":
            content = safetensors.numpy.save(damaged_arrays(draw, safetensors.numpy.load(path.read_bytes())))
            card = json.loads(card_file.read_text()) | {"sha256": hashlib.sha256(content).hexdigest()}
            path.write_bytes(content)
            card_file.write_text(json.dumps(card))
        case "missing":
            draw(st.sampled_from([path, card_file])).unlink()


def read_checkpoint(folder: Path, model: clip.Clip) -> None:
    assert checkpoints.load_policy(folder / "policy.safetensors", model).roles


def damage_rows(draw: Callable, folder: Path) -> None:
    path = folder / "rows.jsonl"
    content = path.read_bytes()
    if draw(st.booleans()):
        path.write_bytes(damaged_bytes(draw, content, (folder / "calibration.json").read_bytes()))
    else:
        rows = [json.loads(line) for line in content.splitlines()]
        path.write_text("".join(json.dumps(damaged_json(draw, row)) + "\n" for row in rows))


def read_and_file_rows(folder: Path, model: clip.Clip) -> None:
    path = folder / "rows.jsonl"
    assert all(isinstance(row, dict) for row in read_rows(path))
    content = path.read_bytes()
    added = ROW | {"method": "random", "episodes": 10**31}  # No damaged row is longer.
    file_rows([added], path)
    assert read_rows(path)[-1] == added
    path.write_bytes(content)


def read_calibration(folder: Path, model: clip.Clip) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "path_for", lambda model, kind: folder / "calibration.json")
        found = calibration.read(model)
    assert np.isfinite(found.scale_text(np.zeros(1))).all()


def damage_calibration(draw: Callable, folder: Path) -> None:
    damage_text_or_bytes(draw, folder / "calibration.json", (folder / "policy.json").read_bytes())


KINDS = {
    "demonstrations": (damage_demonstrations, read_demonstrations),
    "archives": (damage_archives, functools.partial(read_demonstrations, name="archives")),
    "recorded step": (damage_step, read_step),
    "checkpoint": (damage_checkpoint, read_checkpoint),
    "rows": (damage_rows, read_and_file_rows),
    "calibration": (damage_calibration, read_calibration),
}
"""By kind: how a copy of the folder is damaged, and how it is then read as a user does."""


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_whole_is_read(kind, whole, model):
    KINDS[kind][1](whole, model)


@given(st.sampled_from(sorted(KINDS)), st.data())
def test_a_damaged_file_is_read_or_refused(whole, model, kind, data):
    damage, read = KINDS[kind]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "copy"
        shutil.copytree(whole, folder)
        damage(data.draw, folder)
        before = contents(folder)
        try:
            read(folder, model)
        except (ValueError, OSError) as error:
            assert str(folder) in str(error), "the sentence names the file"
        assert contents(folder) == before, "reading changes nothing"
        if kind == "demonstrations":
            demonstrations.save(demonstrations.load(whole / "demos"), folder / "demos")
            assert len(demonstrations.load(folder / "demos")) == 2, "a new set takes a damaged one's place"
