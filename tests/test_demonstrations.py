import dataclasses
import hashlib
import json
import os
import shutil
import struct
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from collections import deque
from pathlib import Path

import cv2
import numpy as np
import pytest

from gem_lite import clip, demonstrations, language, tasks
from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.cli import main
from gem_lite.demonstrations import DemonstrationSet, data_hash, load, read_manifest, save
from gem_lite.evaluation import collecting
from gem_lite.evaluation.collecting import collect
from gem_lite.foundations import files
from gem_lite.foundations.files import write_atomically
from gem_lite.foundations.registry import Registry
from gem_lite.policies.checkpoints import read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2
from gem_lite.simulation import looks

TASK = "put-block-in-bowl-seen-colors"


@pytest.fixture
def copied(demo_set, tmp_path):
    """A copy of the shared set, free to be damaged."""
    return Path(shutil.copytree(demo_set[0], tmp_path / "copy"))


def assert_same(a, b):
    assert (a.task, a.split, a.seed, len(a.steps)) == (b.task, b.split, b.seed, len(b.steps))
    for one, two in zip(a.steps, b.steps, strict=True):
        plain = [dataclasses.replace(step, observation=None) for step in (one, two)]
        assert plain[0] == plain[1]
        for left, right in zip(one.observation.views, two.observation.views, strict=True):
            assert left.camera == right.camera
            np.testing.assert_array_equal(left.rgb, right.rgb)
            np.testing.assert_array_equal(left.depth, right.depth)
            assert right.rgb.dtype == np.uint8 and right.depth.dtype == np.float32


def episode_file(folder, number):
    return next(folder.glob(f"episode-{number:04d}-*.npz"))


def reseal(folder, number, content):
    """Put ``content`` in an episode's place, with its right sum: as another program would have saved it."""
    files = list(read_manifest(folder)["files"].items())
    digest = hashlib.sha256(content).hexdigest()
    files[number] = (f"episode-{number:04d}-{digest[:12]}.npz", digest)
    (folder / files[number][0]).write_bytes(content)
    change_manifest(folder, files=dict(files))


def change_manifest(folder, **changes):
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_what_was_collected_is_loaded(demo_set, world):
    loaded = load(demo_set[0])
    assert len(loaded) == 2
    for index, demonstration in enumerate(loaded):
        assert_same(collecting.roll_out(world, TASK, "train", index), demonstration)


def test_loading_and_saving_again_changes_nothing(demo_set, tmp_path):
    save(load(demo_set[0]), tmp_path)
    assert data_hash(tmp_path) == data_hash(demo_set[0])


def test_an_episode_holds_what_the_expert_saw_and_did(demo_set, world):
    demonstration = demo_set[1][0]
    task = tasks.make(TASK, "train")
    (observation,) = world.reset(task, demonstration.seed)
    first = demonstration.steps[0]
    assert first.instruction == task.instruction
    assert first.phrases == language.parse(task.instruction)
    assert first.expert == task.expert(world)
    for kept, fresh in zip(first.observation.views, observation.views, strict=True):
        np.testing.assert_array_equal(kept.rgb, fresh.rgb)
        # Depth is rounded to 0.1 mm: off by half of it at most.
        assert abs(kept.depth - fresh.depth).max() < 0.51 * demonstrations.DEPTH_UNIT


def test_collected_episodes_succeed(demo_set):
    for demonstration in demo_set[1]:
        assert (demonstration.task, demonstration.split) == (TASK, "train")
        assert sum(step.reward for step in demonstration.steps) == pytest.approx(1.0)
    assert len({demonstration.seed for demonstration in demo_set[1]}) == 2


def test_the_same_seeds_give_the_same_hash(demo_set, tmp_path):
    collect(TASK, 2, tmp_path)
    assert data_hash(tmp_path) == data_hash(demo_set[0])


def test_an_episode_does_not_depend_on_those_before_it(demo_set, tmp_path):
    seed = demo_set[1][1].seed
    collect(TASK, 1, tmp_path, start=seed)
    assert episode_file(tmp_path, 0).read_bytes() == episode_file(demo_set[0], 1).read_bytes()
    assert data_hash(tmp_path) != data_hash(demo_set[0])


@pytest.mark.parametrize(("name", "episodes"), [(TASK, 0), (TASK, -1), ("no-such-task", 1)])
def test_collect_refuses_before_it_writes(tmp_path, name, episodes):
    with pytest.raises(ValueError, match="episodes must be at least 1" if name == TASK else "no-such-task"):
        collect(name, episodes, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_cut_off_episode(copied):
    path = episode_file(copied, 1)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"episode-0001-\w+\.npz is cut off or changed"):
        load(copied)


def test_edited_episode(copied):
    path = episode_file(copied, 0)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1  # a single bit
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"episode-0000-\w+\.npz is cut off or changed"):
        load(copied)


def test_missing_episode(copied):
    episode_file(copied, 1).unlink()
    with pytest.raises(FileNotFoundError, match=r"episode-0001-\w+\.npz is missing"):
        load(copied)


def test_missing_manifest(copied):
    (copied / "manifest.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"no manifest\.json"):
        load(copied)


def test_missing_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        load(tmp_path / "nowhere")


def test_wrong_schema(copied):
    change_manifest(copied, schema=99)
    with pytest.raises(ValueError, match="schema 99; this version reads schema 3: remove the set and collect"):
        load(copied)


def test_cut_off_manifest(copied):
    path = copied / "manifest.json"
    path.write_text(path.read_text()[:-20])
    with pytest.raises(ValueError, match=r"manifest\.json is cut off or no JSON"):
        load(copied)


@pytest.mark.parametrize("part", ["depth-0-2", "trace-0", "meta"])
def test_episode_that_lacks_a_part(copied, part):
    with np.load(episode_file(copied, 0)) as arrays:
        np.savez(copied / "other.npz", **{name: arrays[name] for name in arrays.files if name != part})
    reseal(copied, 0, (copied / "other.npz").read_bytes())
    with pytest.raises(ValueError, match=r"episode-0000-\w+\.npz lacks a part"):
        load(copied)[0]
    assert load(copied)[1].task == TASK


def with_changed_description(folder, number, change):
    with np.load(episode_file(folder, number)) as arrays:
        parts = dict(arrays)
    meta = json.loads(parts["meta"].tobytes())
    change(meta)
    parts["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    np.savez(folder / "other.npz", **parts)
    reseal(folder, number, (folder / "other.npz").read_bytes())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda meta: meta["steps"][0].update(reward=float("nan")), "NaN is no finite number"),
        (lambda meta: meta["steps"][0].update(reward="1.0"), "a finite number is needed, got '1.0'"),
        (lambda meta: meta["steps"][0]["expert"]["action"]["pick"].update(x=None), "a finite number is needed"),
        (lambda meta: meta["steps"][0].update(instruction=[]), r"a text is needed, got \[\]"),
        (lambda meta: meta["steps"][0]["cameras"][0].update(size=[8, 8]), "uint8 of shape"),
        (lambda meta: meta.update(seed=-1), "a whole number from 0 on"),
        (lambda meta: meta.update(steps=3), "TypeError"),
    ],
)
def test_a_wrong_value_in_an_episode_is_refused(copied, change, message):
    with_changed_description(copied, 0, change)
    with pytest.raises(ValueError, match=message):
        load(copied)[0]


def test_nested_lists_become_nested_tuples():
    camera = {"name": "front", "pose": [[1, 0.5], [0, 1]], "size": [480, 640], "far": 10.0}
    found = {name: files.as_tuples(value) for name, value in camera.items()}
    assert found == {"name": "front", "pose": ((1, 0.5), (0, 1)), "size": (480, 640), "far": 10.0}
    with pytest.raises(ValueError, match="finite"):
        files.as_tuples([[1.0, float("inf")]])


@pytest.mark.parametrize("content", ['{"schema": 3}', '{"schema": 3, "files": {}}', "[]", "", "\0", '{"schema": NaN}'])
def test_manifest_of_another_shape(copied, content):
    (copied / "manifest.json").write_text(content)
    with pytest.raises(ValueError, match=r"manifest\.json"):
        load(copied)


@pytest.mark.parametrize(
    "changes",
    [
        {"files": {"../../outside.npz": "0" * 64}},
        {"files": {"episode-0000-0123456789ab.npz": 3}},
        {"task": 3},
        {"world": None},
        {"next": "7"},
        {"start": -1},
        {"start": True},
    ],
)
def test_a_manifest_with_a_wrong_value_is_refused(copied, changes):
    change_manifest(copied, **changes)
    with pytest.raises(ValueError, match=r"manifest\.json (lists|has a wrong)"):
        load(copied)


def stop_at_write(monkeypatch, number, error):
    """From write or removal ``number`` on, counted from 0, nothing reaches the disk and ``error`` is raised."""
    calls = []

    def counted(honest):
        def call(*args, **kwargs):
            calls.append(args)
            if len(calls) > number:
                if isinstance(args[-1], bytes):
                    honest(args[0], args[-1][: len(args[-1]) // 2])  # a half-written file
                raise error
            return honest(*args, **kwargs)

        return call

    monkeypatch.setattr(Path, "write_bytes", counted(Path.write_bytes))
    monkeypatch.setattr(os, "replace", counted(os.replace))
    return calls


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()], ids=["full disk", "kill"])
def test_a_stopped_save_loses_nothing(copied, demo_set, monkeypatch, error):
    """Two demonstrations are replaced by one other, stopped at each of its writes and renames in turn."""
    old, new = data_hash(copied), [dataclasses.replace(demo_set[1][1], seed=7)]
    with monkeypatch.context() as patch:
        writes = stop_at_write(patch, 1000, error)
        save(new, copied.parent / "counted")
    assert len(writes) == 4  # episode and manifest, each written and renamed
    for number in range(len(writes)):
        with monkeypatch.context() as patch:
            stop_at_write(patch, number, error)
            with pytest.raises(type(error)):
                save(new, copied)
        assert data_hash(copied) == old
        assert [demonstration.seed for demonstration in load(copied)] == [0, 1]
    save(new, copied)
    assert [demonstration.seed for demonstration in load(copied)] == [7]
    assert len(list(copied.glob("*.npz"))) == 1, "the old set's files go when the new set is whole"


def test_a_save_that_cannot_remove_the_old_files_leaves_the_new_set_whole(copied, demo_set, monkeypatch):
    def denied(*args, **kwargs):
        raise PermissionError("denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", denied)
        with pytest.raises(PermissionError):
            save(demo_set[1][1:], copied)
    assert [demonstration.seed for demonstration in load(copied)] == [1]


def test_save_refuses_a_mixture_and_keeps_the_old_set(copied, demo_set):
    old = data_hash(copied)
    mixed = [demo_set[1][0], dataclasses.replace(demo_set[1][1], world="elsewhere")]
    with pytest.raises(ValueError, match="one task, split and world"):
        save(mixed, copied)
    assert data_hash(copied) == old and len(load(copied)) == 2


def test_a_slice_is_lazy_and_an_empty_one_is_refused(copied):
    both = load(copied)
    second = both[1:]
    assert isinstance(second, DemonstrationSet) and len(second) == 1
    assert second[0].seed == both[-1].seed == 1
    assert [demonstration.seed for demonstration in both[::-1]] == [1, 0]
    assert len(both[:100]) == 2
    episode_file(copied, 0).unlink()
    assert second[0].seed == 1, "a slice reads only its own files"
    with pytest.raises(FileNotFoundError, match=r"episode-0000-\w+\.npz is missing"):
        both[0]
    for empty in (slice(0, 0), slice(5, None)):
        with pytest.raises(ValueError, match=r"is empty: .* has 2 files"):
            both[empty]
    with pytest.raises(IndexError):
        both[2]


@pytest.mark.parametrize("episodes", [0, -1])
def test_the_hash_of_no_episodes_is_refused(demo_set, episodes):
    with pytest.raises(ValueError, match=f"episodes must be at least 1, got {episodes}"):
        data_hash(demo_set[0], episodes)


def test_an_episode_that_changes_after_load_is_refused(copied):
    both = load(copied)
    episode_file(copied, 1).write_bytes(episode_file(copied, 0).read_bytes())
    assert both[0].seed == 0
    with pytest.raises(ValueError, match="cut off or changed"):
        both[1]


def peak_of_reading(folder):
    """Bytes at most held at once while a set is loaded and gone through twice."""
    tracemalloc.start()
    for _ in range(2):
        deque(load(folder), maxlen=0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_memory_does_not_grow_with_the_number_of_episodes(demo_set, tmp_path):
    one = demo_set[1][0]
    save([one] * 2, tmp_path / "few")
    save([one] * 6, tmp_path / "many")
    pictures = sum(view.rgb.nbytes + view.depth.nbytes for step in one.steps for view in step.observation.views)
    few, many = peak_of_reading(tmp_path / "few"), peak_of_reading(tmp_path / "many")
    assert few > pictures, "what is read must be seen by this measure"
    assert many < few + 0.5 * pictures


def test_a_collection_that_was_stopped_goes_on(demo_set, tmp_path, monkeypatch):
    """Stopped while the second episode is played, then asked for again: the same set as without the stop."""
    honest, played = collecting.roll_out, []

    def stopped(world, name, split, index):
        if index == 1:
            raise KeyboardInterrupt
        return honest(world, name, split, index)

    def counted(world, name, split, index):
        played.append(index)
        return honest(world, name, split, index)

    monkeypatch.setattr(collecting, "roll_out", stopped)
    with pytest.raises(KeyboardInterrupt):
        collect(TASK, 2, tmp_path)
    assert [demonstration.seed for demonstration in load(tmp_path)] == [0], "what was played is a whole set"
    monkeypatch.setattr(collecting, "roll_out", counted)
    assert len(collect(TASK, 2, tmp_path)) == 2
    assert played == [1]
    assert data_hash(tmp_path) == data_hash(demo_set[0])
    assert len(collect(TASK, 1, tmp_path)) == 1
    assert played == [1] and len(load(tmp_path)) == 2, "a set that holds more is left as it is"


def test_a_collection_goes_on_behind_episodes_that_failed(demo_set, tmp_path, monkeypatch):
    """The third episode fails, and the collection is stopped after it: it is not played again."""
    shutil.copytree(demo_set[0], tmp_path / "set")
    good, played = demo_set[1][0], []

    def roll_out(world, name, split, index):
        played.append(index)
        if index == 4:
            raise KeyboardInterrupt
        failed = tuple(dataclasses.replace(step, reward=0.0) for step in good.steps)
        return dataclasses.replace(good, seed=index, steps=failed if index == 2 else good.steps)

    monkeypatch.setattr(collecting, "roll_out", roll_out)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            collect(TASK, 5, tmp_path / "set")
    assert [demonstration.seed for demonstration in load(tmp_path / "set")] == [0, 1, 3]
    assert played == [2, 3, 4, 4]


@pytest.mark.parametrize(
    "arguments", [("bars-in-box", 2), (TASK, 3, "val"), (TASK, 3, "train", 1)], ids=["task", "split", "start"]
)
def test_collect_refuses_a_folder_with_another_set(copied, arguments):
    name, episodes, *rest = arguments
    before = {path.name: path.read_bytes() for path in copied.iterdir()}
    with pytest.raises(ValueError, match="holds another set"):
        collect(name, episodes, copied, *rest)
    assert {path.name: path.read_bytes() for path in copied.iterdir()} == before


def test_a_saved_set_is_not_taken_for_the_beginning_of_a_collection(demo_set, tmp_path):
    save(demo_set[1], tmp_path)
    with pytest.raises(ValueError, match="holds another set"):
        collect(TASK, 3, tmp_path)


def test_the_world_is_kept_with_the_set(demo_set, tmp_path, monkeypatch):
    monkeypatch.setattr(looks, "WORLDS", Registry("world"))
    looks.register(looks.HOME)
    looks.register(looks.Look("elsewhere"))
    collect(TASK, 1, tmp_path, world="elsewhere")
    assert read_manifest(tmp_path)["world"] == load(tmp_path)[0].world == "elsewhere"
    assert read_manifest(demo_set[0])["world"] == demo_set[1][0].world == "home"
    with pytest.raises(ValueError, match="holds another set"):
        collect(TASK, 2, tmp_path)
    with pytest.raises(ValueError, match="no world is named 'mars'; the nearest names: "):
        collect(TASK, 1, tmp_path / "new", world="mars")


def test_write_atomically_makes_folders_and_leaves_nothing_else(tmp_path):
    write_atomically(tmp_path / "a" / "b.bin", b"new")
    assert (tmp_path / "a" / "b.bin").read_bytes() == b"new"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b.bin"]


def test_interrupted_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    path, write = tmp_path / "file.bin", Path.write_bytes
    write_atomically(path, b"old content")

    def interrupted(self, content):
        write(self, content[: len(content) // 2])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, b"new content")
    assert path.read_bytes() == b"old content"
    monkeypatch.undo()
    write_atomically(path, b"new content")  # what the interruption left behind is in nobody's way
    assert path.read_bytes() == b"new content"


def test_verify_exits_with_2_and_one_line(tmp_path):
    command = [sys.executable, "-m", "gem_lite.cli", "verify", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert f"{tmp_path} holds no demonstrations" in done.stderr


def test_verify_says_what_it_found(demo_set, capsys):
    folder, collected = demo_set
    assert main(["verify", str(folder)]) == 0
    steps = sum(len(demonstration.steps) for demonstration in collected)
    assert f"2 episodes, {steps} steps, data hash {data_hash(folder)[:12]}" in capsys.readouterr().out


def test_collect_by_command_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    def stopped(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(collecting, "roll_out", stopped)
    assert main(["collect", TASK, str(tmp_path / "new"), "--episodes", "1"]) == 130
    assert f"the same command goes on from the episodes in {tmp_path / 'new'}" in capsys.readouterr().err


def test_collect_by_command_says_what_is_wrong(tmp_path, capsys):
    assert main(["collect", "no-such-task", str(tmp_path / "new")]) == 2
    assert "no task is named 'no-such-task'" in capsys.readouterr().err


# Actions


@pytest.mark.parametrize(
    "action",
    [PickPlace(Pose2(0.4, 0.1, 0.2), Pose2(0.6, -0.1, 1.2), 1, 0), Push(Pose2(0.4, 0.1), Pose2(0.5, 0.0), table=2)],
)
def test_both_kinds_of_action_are_kept(demo_set, tmp_path, action):
    episode = demo_set[1][0]
    step = dataclasses.replace(episode.steps[0], expert=ExpertAction(action, np.pi, np.pi / 2))
    save([dataclasses.replace(episode, steps=(step,))], tmp_path)
    assert load(tmp_path)[0].steps[0].expert == ExpertAction(action, np.pi, np.pi / 2)


def entry(**changes):
    """A pick and place as older files hold it."""
    pose = {"x": 0.4, "y": 0.1, "yaw": 0.2}
    return {"pick": pose, "place": pose} | changes


def test_an_action_without_a_kind_is_a_pick_and_place_on_the_only_table():
    pose = Pose2(0.4, 0.1, 0.2)
    assert demonstrations._decode_action(entry()) == PickPlace(pose, pose, 0, 0)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (entry(kind="throw"), "kind must be one of pick-place, push, got 'throw'"),
        (entry(kind="pick-place", pick_table=-1), "a whole number from 0 on is needed, got -1"),
        (entry(pick={"x": "0.4", "y": 0.1}), "a finite number is needed, got '0.4'"),
    ],
)
def test_a_wrong_action_is_named(wrong, said):
    with pytest.raises(ValueError, match=said):
        demonstrations._decode_action(wrong)


# One process at a time, and the files of others

SAVER = """
import sys, time
from pathlib import Path
from gem_lite import demonstrations
source, folder = Path(sys.argv[1]), Path(sys.argv[2])
episodes = list(demonstrations.load(source))[:: int(sys.argv[3])]
saved = 0
while saved < 8:
    try:
        demonstrations.save(episodes, folder)
        saved += 1
    except BlockingIOError as error:
        assert "another process writes into" in str(error), error
    time.sleep(0.01)
"""


def test_two_processes_that_save_into_one_folder_lose_nothing(demo_set, tmp_path):
    words = [sys.executable, "-c", SAVER, str(demo_set[0]), str(tmp_path / "set")]
    savers = [subprocess.Popen([*words, order], stderr=subprocess.PIPE, text=True) for order in ("1", "-1")]
    for saver in savers:
        _, errors = saver.communicate(timeout=600)
        assert saver.returncode == 0, errors
    assert sorted(demonstration.seed for demonstration in load(tmp_path / "set")) == [0, 1]
    assert len(list((tmp_path / "set").glob("*.npz"))) == 2


def test_a_second_writer_is_refused_while_a_set_is_saved(demo_set, tmp_path):
    class Episodes(list):
        def __iter__(self):
            yield self[0]
            with pytest.raises(OSError, match=f"another process writes into {tmp_path}: wait for it, or give another"):
                save(demo_set[1][1:], tmp_path)
            yield self[1]

    save(Episodes(demo_set[1]), tmp_path)
    assert [demonstration.seed for demonstration in load(tmp_path)] == [0, 1]


def test_a_second_writer_is_refused_while_a_collection_runs(demo_set, tmp_path, monkeypatch):
    honest = collecting.roll_out

    def with_rivals(world, name, split, index):
        with pytest.raises(OSError, match="another process writes into"):
            save(demo_set[1], tmp_path)
        with pytest.raises(OSError, match="another process writes into"):
            collect(TASK, 1, tmp_path)
        return honest(world, name, split, index)

    monkeypatch.setattr(collecting, "roll_out", with_rivals)
    assert len(collect(TASK, 2, tmp_path)) == 2
    assert data_hash(tmp_path) == data_hash(demo_set[0])


def test_files_that_the_manifest_does_not_name_stay(copied, demo_set):
    foreign = copied / "episode-0007-0123456789ab.npz"
    foreign.write_bytes(b"of somebody else")
    save([dataclasses.replace(demo_set[1][0], seed=7)], copied)
    assert foreign.read_bytes() == b"of somebody else"
    assert len(list(copied.glob("*.npz"))) == 2


def test_a_save_that_is_refused_leaves_no_episode_behind(copied, demo_set):
    before = {path.name: path.read_bytes() for path in copied.iterdir()}
    other = dataclasses.replace(demo_set[1][0], seed=7)
    with pytest.raises(ValueError, match="one task, split and world"):
        save([other, dataclasses.replace(other, world="elsewhere")], copied)
    assert {path.name: path.read_bytes() for path in copied.iterdir()} == before


# Depth


def with_depth(demonstration, change):
    """The first step alone, with the depth of its first view changed in place by ``change``."""
    step = demonstration.steps[0]
    view = step.observation.views[0]
    depth = view.depth.copy()
    change(depth)
    views = (dataclasses.replace(view, depth=depth), *step.observation.views[1:])
    return dataclasses.replace(demonstration, steps=(dataclasses.replace(step, observation=Observation(views)),))


@pytest.mark.parametrize("value", [7.0, 6.5537, 1e30, -0.1, -7.0, float("nan"), float("inf"), float("-inf")])
def test_depth_that_no_picture_can_hold_was_not_measured(demo_set, tmp_path, value):
    """In a set, in `quantized`, and in a folder of a scene alike."""

    def change(depth):
        depth[:5] = value
        depth[5] = 6.5535

    changed = with_depth(demo_set[1][0], change)
    save([changed], tmp_path / "set")
    observation = changed.steps[0].observation
    observation.save(tmp_path / "scene")
    found = [
        load(tmp_path / "set")[0].steps[0].observation, demonstrations.quantized(observation),
        Observation.load(tmp_path / "scene"),
    ]  # fmt: skip
    for one in found:
        depth = one.views[0].depth
        assert (depth[:5] == 0).all() and depth[5] == pytest.approx(6.5535)
        assert abs(depth[6:] - observation.views[0].depth[6:]).max() < 0.51 * demonstrations.DEPTH_UNIT
        assert np.array_equal(depth, found[0].views[0].depth)


def test_depth_in_millimetres_is_refused_everywhere(demo_set, tmp_path):
    def change(depth):
        depth *= 1000

    changed = with_depth(demo_set[1][0], change)
    for refused in (
        lambda: save([changed], tmp_path / "set"),
        lambda: demonstrations.quantized(changed.steps[0].observation),
        lambda: changed.steps[0].observation.save(tmp_path / "scene"),
    ):
        with pytest.raises(ValueError, match=r"sees nothing nearer than \d+\.\d\d m, but 16 bits reach 6\.55 m"):
            refused()
    assert not list(tmp_path.rglob("*.npz")) and not (tmp_path / "scene").exists()


def test_depth_in_range_is_kept_as_it_always_was(demo_set):
    """The bytes decide the names of files, and what checkpoints say of their data."""
    with np.load(episode_file(demo_set[0], 0)) as arrays:
        for number, view in enumerate(demo_set[1][0].steps[0].observation.views):
            depth = np.round(view.depth / 1e-4).astype(np.uint16)
            colors = {"depth": depth, "rgb": view.rgb[..., ::-1]}
            for name, picture in colors.items():
                png = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].reshape(-1)
                assert np.array_equal(arrays[f"{name}-0-{number}"], png)


# Hostile files


def png_that_claims(width, height):
    """A small file whose header says ``width`` x ``height``, gray, 16 bits."""

    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )


def test_an_archive_that_unpacks_to_too_much_is_refused_before_it_is_unpacked(copied, monkeypatch):
    with zipfile.ZipFile(copied / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("meta.npy", bytes(2**24))
    reseal(copied, 0, (copied / "bomb.npz").read_bytes())
    monkeypatch.setattr(demonstrations, "LARGEST_EPISODE", 2**20)
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"episode-0000-\w+\.npz .*unpacks to 16777216 bytes, and at most 1048576 are"):
        load(copied)[0]
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


@pytest.mark.parametrize("size", [(60000, 60000), (30000, 30000), (0, 5)])
def test_a_picture_that_claims_to_be_huge_is_refused(copied, size):
    with np.load(episode_file(copied, 0)) as arrays:
        parts = dict(arrays)
    parts["depth-0-0"] = np.frombuffer(png_that_claims(*size), np.uint8)
    np.savez(copied / "other.npz", **parts)
    reseal(copied, 0, (copied / "other.npz").read_bytes())
    with pytest.raises(
        ValueError, match=r"depth-0-0 (must have at most 67108864 pixels, got \d+ x|is cut off or no PNG)"
    ):
        load(copied)[0]


@pytest.mark.parametrize("where", ["reward", "size", "seed"])
def test_a_huge_number_in_an_episode_is_refused(copied, where):
    def change(meta):
        place = {"reward": meta["steps"][0], "size": meta["steps"][0]["cameras"][0], "seed": meta}[where]
        place[where] = [10**400, 10**400] if where == "size" else 10**400

    with_changed_description(copied, 0, change)
    with pytest.raises(ValueError, match="is no finite number"):
        load(copied)[0]


def test_the_shipped_policy_was_trained_on_the_shipped_demonstrations():
    policy = read_card(clip.DATA / "gem-put-block-in-bowl.safetensors")
    shipped = clip.DATA / "demos" / f"{TASK}-10"
    assert policy["data_sha256"] == data_hash(shipped) and policy["demos"] == len(load(shipped)) == 10
