"""Sets of demonstrations: what is collected, saved and loaded, and what is refused."""

import dataclasses
import io
import json
import os
import shutil
import tracemalloc
import weakref
import zipfile
from pathlib import Path

import numpy as np
import pytest
from damages import archive_names, contents, png_that_claims, stop_at_write

from gem_lite import clip, language, tasks
from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.demonstrations import DemonstrationSet, load, packed, read_manifest, save
from gem_lite.evaluation import collecting
from gem_lite.evaluation.collecting import collect
from gem_lite.foundations.registry import Registry
from gem_lite.policies.checkpoints import read_card
from gem_lite.rgbd.observation import DEPTH_SCALE, Observation
from gem_lite.se2 import Pose2
from gem_lite.simulation import looks

TASK = "put-block-in-bowl-seen-colors"
SHIPPED = clip.DATA / "demos" / f"{TASK}-10"


@pytest.fixture
def copied(demo_set, tmp_path):
    """A copy of the shared set, free to be damaged."""
    return Path(shutil.copytree(demo_set[0], tmp_path / "copy"))


@pytest.fixture
def archives(tmp_path):
    """A set of an earlier version, with two episodes, free to be damaged."""
    folder = Path(shutil.copytree(SHIPPED, tmp_path / "packed"))
    change_manifest(folder, files=dict(list(read_manifest(folder).files.items())[2:4]))
    return folder


def seeds(demos):
    return [demonstration.seed for demonstration in demos]


def episode(folder, number):
    return next(folder.glob(f"episode-{number:04d}-*"))


def change_json(path, **changes):
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def change_manifest(folder, **changes):
    change_json(folder / "manifest.json", **changes)


# Collecting


def test_an_episode_holds_what_the_expert_saw_and_did(demo_set, world):
    demonstration = load(demo_set[0])[1]
    assert archive_names([collecting.roll_out(world, TASK, "train", 1)]) == archive_names([demonstration])
    assert (demonstration.task, demonstration.split, demonstration.seed) == (TASK, "train", 1)
    assert sum(step.reward for step in demonstration.steps) == pytest.approx(1.0)
    task = tasks.make(TASK, "train")
    (observation,) = world.reset(task, demonstration.seed)
    first = demonstration.steps[0]
    assert (first.instruction, first.phrases) == (task.instruction, language.parse(task.instruction))
    assert first.expert == task.expert(world)
    for kept, fresh in zip(first.observation.views, observation.views, strict=True):
        np.testing.assert_array_equal(kept.rgb, fresh.rgb)
        assert abs(kept.depth - fresh.depth).max() < 0.51 * DEPTH_SCALE


def test_collect_refuses_before_it_writes(tmp_path):
    with pytest.raises(ValueError, match="episodes must be at least 1"):
        collect(TASK, 0, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_collection_that_was_stopped_goes_on(demo_set, tmp_path, monkeypatch):
    played = []

    def roll_out(world, name, split, index):
        played.append(index)
        if played == [0, 1]:
            raise KeyboardInterrupt
        return demo_set[1][index]

    monkeypatch.setattr(collecting, "roll_out", roll_out)
    with pytest.raises(KeyboardInterrupt):
        collect(TASK, 2, tmp_path)
    assert seeds(load(tmp_path)) == [0], "what was played is a whole set"
    assert len(collect(TASK, 2, tmp_path)) == 2
    assert played == [0, 1, 1]
    assert load(tmp_path).digest == load(demo_set[0]).digest
    assert len(collect(TASK, 1, tmp_path)) == 1
    assert played == [0, 1, 1] and len(load(tmp_path)) == 2, "a set that holds more is left as it is"


def test_a_collection_goes_on_behind_archives_and_behind_episodes_that_failed(archives, demo_set, monkeypatch):
    change_manifest(archives, next=2)
    good, played = dataclasses.replace(demo_set[1][0], world="varied"), []

    def roll_out(world, name, split, index):
        played.append(index)
        if index == 4:
            raise KeyboardInterrupt
        failed = tuple(dataclasses.replace(step, reward=0.0) for step in good.steps)
        return dataclasses.replace(good, seed=index, steps=failed if index == 2 else good.steps)

    monkeypatch.setattr(collecting, "roll_out", roll_out)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            collect(TASK, 5, archives, world="varied")
    assert seeds(load(archives)) == [2, 3, 3]
    assert played == [2, 3, 4, 4]


def test_collect_refuses_a_folder_with_another_set(copied, tmp_path):
    before, digest = contents(copied), load(copied).digest
    save(load(copied), tmp_path / "saved")
    assert load(tmp_path / "saved").digest == digest, "loading and saving again changes nothing"
    refused = [(copied, "bars-in-box", "train", 0), (copied, TASK, "val", 0), (copied, TASK, "train", 1)]
    for folder, name, split, start in (*refused, (tmp_path / "saved", TASK, "train", 0)):
        with pytest.raises(ValueError, match="holds another set"):
            collect(name, 3, folder, split, start)
    assert contents(copied) == before


def test_the_world_is_kept_with_the_set(demo_set, tmp_path, monkeypatch):
    monkeypatch.setattr(looks, "WORLDS", Registry("world"))
    looks.register(looks.HOME)
    looks.register(looks.Look("elsewhere"))
    monkeypatch.setattr(collecting, "roll_out", lambda *_: dataclasses.replace(demo_set[1][0], world="elsewhere"))
    collect(TASK, 1, tmp_path, world="elsewhere")
    assert read_manifest(tmp_path).world == load(tmp_path)[0].world == "elsewhere"
    assert read_manifest(demo_set[0]).world == demo_set[1][0].world == "home"
    with pytest.raises(ValueError, match="holds another set"):
        collect(TASK, 2, tmp_path)
    with pytest.raises(ValueError, match="no world is named 'mars'; the nearest names: "):
        collect(TASK, 1, tmp_path / "new", world="mars")


# Sets that are damaged


def cut(path):
    os.truncate(path, path.stat().st_size - 20)


def flip_a_bit(folder):
    path = episode(folder, 0) / "step-1" / "action.json"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


DAMAGES = {
    r"episode-0000-\w+ is cut off or changed": flip_a_bit,
    r"episode-0000-\w+ is cut off or changed:": lambda folder: (episode(folder, 0) / "episode.json").unlink(),
    r"episode-0001-\w+ is missing": lambda folder: shutil.rmtree(episode(folder, 1)),
    r"copy is no whole set: it holds episode-0000-\w+, but no manifest\.json": (
        lambda folder: (folder / "manifest.json").unlink()
    ),
    "copy holds no demonstrations": lambda folder: shutil.rmtree(folder),
    r"manifest\.json schema must be 3 or 4, got 99": lambda folder: change_manifest(folder, schema=99),
    r"manifest\.json is cut off or no JSON": lambda folder: cut(folder / "manifest.json"),
}
"""By what the message says: what happens to a set."""


@pytest.mark.parametrize("message", DAMAGES)
def test_a_damaged_set_is_refused_by_name(message, copied):
    DAMAGES[message](copied)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        load(copied)


@pytest.mark.parametrize(
    "changes",
    [
        {"files": {"../../outside.npz": "0" * 64}}, {"files": {"../episode-0000-0123456789ab": "0" * 64}},
        {"files": {"episode-0000-0123456789ab.npz": 3}}, {"files": {}}, {"task": 3}, {"world": None}, {"next": "7"},
        {"start": -1}, {"start": True}, {"next": None}, {"start": float("nan")}, b"[]", b"", b"\0", b'{"schema": 3}',
    ],
)  # fmt: skip
def test_a_wrong_manifest_is_refused(copied, changes):
    path = copied / "manifest.json"
    path.write_bytes(changes) if isinstance(changes, bytes) else change_json(path, **changes)
    with pytest.raises(ValueError, match=r"manifest\.json .*(must|lacks|no JSON)"):
        load(copied)


def test_episodes_are_read_when_they_are_asked_for_and_checked_then(copied):
    both = load(copied)
    second = both[1:]
    assert isinstance(second, DemonstrationSet) and len(second) == 1 and len(both[:100]) == 2
    assert second[0].seed == both[-1].seed == 1
    assert seeds(both[::-1]) == [1, 0]
    earlier = weakref.ref(both[0])
    assert earlier() is None, "no episode stays in memory"
    flip_a_bit(copied)
    with pytest.raises(ValueError, match="cut off or changed"):
        both[0]
    assert second[0].seed == 1, "a slice reads only its own files"
    for empty in (slice(0, 0), slice(5, None)):
        with pytest.raises(ValueError, match=r"is empty: .* has 2 files"):
            both[empty]
    with pytest.raises(IndexError):
        both[2]


# Saving


@pytest.fixture
def small(demo_set):
    """An episode of one step with one view: few files."""
    step = demo_set[1][1].steps[0]
    step = dataclasses.replace(step, observation=Observation(step.observation.views[:1]))
    return dataclasses.replace(demo_set[1][1], seed=7, steps=(step,))


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()], ids=["full disk", "kill"])
def test_a_stopped_save_loses_nothing(copied, small, monkeypatch, error):
    """Two demonstrations are replaced by one other, stopped at each of its writes and renames in turn."""
    old = load(copied).digest
    with monkeypatch.context() as patch:
        writes = stop_at_write(patch, 1000, error)
        save([small], copied.parent / "counted")
    assert len(writes) == 13  # five files and the manifest, each written and renamed, and the folder of the episode
    for number in range(len(writes)):
        with monkeypatch.context() as patch:
            stop_at_write(patch, number, error)
            with pytest.raises(type(error)):
                save([small], copied)
        assert load(copied).digest == old
        for name in {path.name for path in copied.glob("episode-*")} - load(copied).sums.keys():
            shutil.rmtree(copied / name)  # A whole episode, if the manifest was not written. It is in nobody's way.
    assert seeds(load(copied)) == [0, 1]
    save([small], copied)
    assert seeds(load(copied)) == [7]
    assert {path.name for path in copied.iterdir()} == {*load(copied).sums, "manifest.json"}, "the old episodes go"


def test_a_save_that_is_refused_or_cannot_remove_the_old_files_loses_nothing(copied, small, monkeypatch):
    before, mixed = contents(copied), [small, dataclasses.replace(small, world="elsewhere")]
    for demonstrations, message in ((mixed, "one task, split and world"), ([], "there is nothing to save")):
        with pytest.raises(ValueError, match=message):
            save(demonstrations, copied)
    assert contents(copied) == before

    def denied(path, *args, **kwargs):
        if path.exists():
            raise PermissionError("denied")

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", denied)
        with pytest.raises(PermissionError):
            save([small], copied)
    assert seeds(load(copied)) == [7]


def test_files_that_the_manifest_does_not_name_stay_and_a_damaged_episode_is_written_again(copied, demo_set, small):
    flip_a_bit(copied)
    save(demo_set[1], copied)
    assert load(copied).digest == load(demo_set[0]).digest
    foreign = copied / "episode-0007-0123456789ab"
    foreign.mkdir()
    (foreign / "notes.txt").write_text("of somebody else")
    save([small], copied)
    assert (foreign / "notes.txt").read_text() == "of somebody else"
    assert len(list(copied.glob("episode-*"))) == 2


def test_hidden_folders_are_no_episodes_and_no_steps(copied, tmp_path):
    whole = load(copied)
    (episode(copied, 0) / "step-1" / ".ipynb_checkpoints").mkdir()
    (episode(copied, 0) / "step-1" / ".ipynb_checkpoints" / "action.json").write_text("{}")
    assert seeds(load(copied)) == seeds(whole)
    recorded = tmp_path / "my-task"
    step = whole[0].steps[0]
    step.save(recorded / "episode-1" / "step-1")
    for folder in (recorded, recorded / "episode-1"):
        (folder / ".ipynb_checkpoints").mkdir()
    (own,) = load(recorded)
    assert len(own.steps) == 1
    view = step.observation.views[0]
    hidden = Observation((dataclasses.replace(view, camera=dataclasses.replace(view.camera, name=".front")),))
    with pytest.raises(ValueError, match="without a dot in front"):
        hidden.save(tmp_path / "hidden")


@pytest.mark.parametrize(
    "action",
    [PickPlace(Pose2(0.4, 0.1, 0.2), Pose2(0.6, -0.1, 1.2), 1, 0), Push(Pose2(0.4, 0.1), Pose2(0.5, 0.0), table=2)],
)
def test_both_kinds_of_action_are_kept(small, tmp_path, action):
    step = dataclasses.replace(small.steps[0], expert=ExpertAction(action, np.pi, np.pi / 2))
    save([dataclasses.replace(small, steps=(step,))], tmp_path)
    (found,) = load(tmp_path)[0].steps
    assert (found.expert, found.trace, found.reward) == (step.expert, step.trace, step.reward)


def test_a_second_writer_is_refused_while_a_set_is_saved_or_collected(demo_set, tmp_path, monkeypatch):
    def rivals():
        for rival in (lambda: save(demo_set[1][1:], tmp_path), lambda: collect(TASK, 1, tmp_path)):
            with pytest.raises(OSError, match=f"another process writes into {tmp_path}: wait for it, or give another"):
                rival()

    class Episodes(list):
        def __iter__(self):
            yield self[0]
            rivals()
            yield self[1]

    save(Episodes(demo_set[1]), tmp_path)
    assert load(tmp_path).digest == load(demo_set[0]).digest
    shutil.rmtree(tmp_path)
    monkeypatch.setattr(collecting, "roll_out", lambda world, name, split, index: rivals() or demo_set[1][index])
    collect(TASK, 2, tmp_path)
    assert load(tmp_path).digest == load(demo_set[0]).digest


# Archives of earlier versions


def test_the_shipped_policy_was_trained_on_the_shipped_demonstrations():
    policy = read_card(clip.DATA / "gem-put-block-in-bowl.safetensors")
    shipped = load(SHIPPED)
    assert policy["data_sha256"] == shipped.digest and policy["demos"] == len(shipped) == 10


def read_archive(arrays=(), **entries):
    """The first shipped archive with other arrays, where None takes one away, and other entries of its first step."""
    with np.load(SHIPPED / next(iter(read_manifest(SHIPPED).files))) as archive:
        found = dict(archive)
    description = json.loads(found["meta"].tobytes())
    description["steps"][0] |= entries
    found |= {"meta": np.frombuffer(json.dumps(description).encode(), np.uint8), **dict(arrays)}
    buffer = io.BytesIO()
    np.savez(buffer, **{name: array for name, array in found.items() if array is not None})
    return packed.read(Path("mine.npz"), buffer.getvalue())


def test_an_archive_holds_the_same_as_a_folder(archives, tmp_path):
    save(load(archives), tmp_path / "folders")
    assert archive_names(load(tmp_path / "folders")) == archive_names(load(archives))
    (view, *_) = load(tmp_path / "folders")[0].steps[0].observation.views
    assert view.rgb.dtype == np.uint8 and view.depth.dtype == np.float32
    # Without a kind, an action is a pick and place on the only table.
    before = load(SHIPPED)[0].steps[0].expert
    poses = {name: dataclasses.asdict(getattr(before.action, name)) for name in ("pick", "place")}
    assert read_archive(expert=dataclasses.asdict(before) | {"action": poses}).steps[0].expert == before


@pytest.mark.parametrize(
    ("arrays", "entries", "message"),
    [
        *(({name: None}, {}, r"mine\.npz lacks a part") for name in ("depth-0-2", "trace-0", "meta")),
        ({}, {"reward": float("nan")}, "NaN is no finite number"), ({}, {"reward": 10**400}, "is no finite number"),
        ({}, {"reward": "1.0"}, "reward must be a valid number, got '1.0'"),
        ({}, {"instruction": []}, r"sentence must be a valid string, got \[\]"), ({}, {"expert": 3}, "TypeError"),
        ({}, {"cameras": [{"pose": [[1.0]]}]}, "cameras 0 lacks name"),
        ({"depth-0-0": np.frombuffer(png_that_claims(60000, 60000), np.uint8)}, {}, "at most 67108864 pixels"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_an_archive_is_refused(arrays, entries, message):
    with pytest.raises(ValueError, match=message):
        read_archive(arrays, **entries)


def test_an_archive_that_unpacks_to_too_much_is_refused_before_it_is_unpacked(monkeypatch):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("meta.npy", bytes(2**24))
    monkeypatch.setattr(packed, "LARGEST", 2**20)
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"bomb\.npz .*unpacks to 16777216 bytes, and at most 1048576 are allowed"):
        packed.read(Path("bomb.npz"), buffer.getvalue())
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()
