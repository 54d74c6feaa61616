import dataclasses
import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gem_lite import demonstrations, language
from gem_lite.demonstrations import collect, data_hash, load, read_manifest, save, write_whole
from gem_lite.tabletop import tasks

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


def change_manifest(folder, **changes):
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_what_was_collected_is_loaded(demo_set):
    folder, collected = demo_set
    loaded = load(folder)
    assert len(loaded) == len(collected) == 2
    for a, b in zip(collected, loaded, strict=True):
        assert_same(a, b)


def test_loading_and_saving_again_changes_nothing(demo_set, tmp_path):
    save(load(demo_set[0]), tmp_path)
    assert data_hash(tmp_path) == data_hash(demo_set[0])


def test_an_episode_holds_what_the_expert_saw_and_did(demo_set, world):
    demonstration = demo_set[1][0]
    task = tasks.make(TASK, "train")
    observation = world.reset(task, demonstration.seed)
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
    assert (tmp_path / "episode-0000.npz").read_bytes() == (demo_set[0] / "episode-0001.npz").read_bytes()
    assert data_hash(tmp_path) != data_hash(demo_set[0])


@pytest.mark.parametrize(("name", "episodes"), [(TASK, 0), (TASK, -1), ("no-such-task", 1)])
def test_collect_refuses_before_it_writes(tmp_path, name, episodes):
    with pytest.raises(ValueError, match="episodes must be at least 1" if name == TASK else "no-such-task"):
        collect(name, episodes, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_cut_off_episode(copied):
    path = copied / "episode-0001.npz"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"episode-0001\.npz is cut off or changed"):
        load(copied)


def test_edited_episode(copied):
    path = copied / "episode-0000.npz"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1  # a single bit
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"episode-0000\.npz is cut off or changed"):
        load(copied)


def test_missing_episode(copied):
    (copied / "episode-0001.npz").unlink()
    with pytest.raises(FileNotFoundError, match=r"episode-0001\.npz is missing"):
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
    with pytest.raises(ValueError, match="schema 99; this version reads schema 2: collect"):
        load(copied)


def test_cut_off_manifest(copied):
    path = copied / "manifest.json"
    path.write_text(path.read_text()[:-20])
    with pytest.raises(ValueError, match=r"manifest\.json is cut off or no JSON"):
        load(copied)


@pytest.mark.parametrize("part", ["depth-0-2", "trace-0", "meta"])
def test_episode_that_lacks_a_part(copied, part):
    # Its sum is right, so it was saved like this, by another program perhaps.
    path = copied / "episode-0000.npz"
    with np.load(path) as arrays:
        np.savez(path, **{name: arrays[name] for name in arrays.files if name != part})
    files = read_manifest(copied)["files"] | {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}
    change_manifest(copied, files=files)
    with pytest.raises(ValueError, match=r"episode-0000\.npz lacks a part"):
        load(copied)


@pytest.mark.parametrize("content", ['{"schema": 2}', "[]"])
def test_manifest_of_another_shape(copied, content):
    (copied / "manifest.json").write_text(content)
    with pytest.raises(ValueError, match=r"manifest\.json"):
        load(copied)


def test_write_whole_makes_folders_and_leaves_nothing_else(tmp_path):
    write_whole(tmp_path / "a" / "b.bin", b"new")
    assert (tmp_path / "a" / "b.bin").read_bytes() == b"new"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b.bin"]


def test_interrupted_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    path, write = tmp_path / "file.bin", Path.write_bytes
    write_whole(path, b"old content")

    def interrupted(self, content):
        write(self, content[: len(content) // 2])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, b"new content")
    assert path.read_bytes() == b"old content"
    monkeypatch.undo()
    write_whole(path, b"new content")  # what the interruption left behind is in nobody's way
    assert path.read_bytes() == b"new content"


def test_verify_exits_with_2_and_one_line(tmp_path):
    command = [sys.executable, "-m", "gem_lite.demonstrations", "verify", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert f"{tmp_path} holds no demonstrations" in done.stderr


def test_verify_says_what_it_found(demo_set, monkeypatch, capsys):
    folder, collected = demo_set
    monkeypatch.setattr(sys, "argv", ["demonstrations", "verify", str(folder)])
    demonstrations.main()
    steps = sum(len(demonstration.steps) for demonstration in collected)
    assert f"2 episodes, {steps} steps, data hash {data_hash(folder)[:12]}" in capsys.readouterr().out


def test_collect_by_command_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["demonstrations", "collect", "no-such-task", str(tmp_path / "new")])
    with pytest.raises(SystemExit) as exit_:
        demonstrations.main()
    assert exit_.value.code == 2
    assert "no task is named 'no-such-task'" in capsys.readouterr().err
