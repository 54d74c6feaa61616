"""Files that are whole or not there, in one piece or in a group, and numbers that are none."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from damages import stop_at_write

from gem_lite.actions import ExpertAction, PickPlace
from gem_lite.demonstrations import DemonstrationStep
from gem_lite.foundations.files import read_json, write_atomically, write_together, writing
from gem_lite.rgbd.camera import Camera, View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2

IMPORTS = """
import sys, time
from pathlib import Path
from gem_lite.foundations.files import write_atomically, writing
"""
WRITER = """
path, letter = Path(sys.argv[1]), sys.argv[2].encode()
for number in range(60):
    write_atomically(path, letter * (1000 + 500 * number))
"""


def start(program, *arguments):
    words = [sys.executable, "-c", IMPORTS + program, *map(str, arguments)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def end(process):
    output, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    return output


def test_two_writers_of_one_file_leave_it_whole_at_every_moment(tmp_path):
    path = tmp_path / "file.bin"
    path.write_bytes(b"a" * 1000)
    writers = [start(WRITER, path, letter) for letter in "ab"]
    while any(writer.poll() is None for writer in writers):
        content = path.read_bytes()
        assert len(set(content)) == 1 and len(content) % 500 == 0, "a mixture, or a part"
    for writer in writers:
        end(writer)
    assert [file.name for file in tmp_path.iterdir()] == ["file.bin"]


def test_content_reaches_the_disk_before_its_name(tmp_path, monkeypatch):
    order, sync, rename = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda descriptor: (order.append("sync"), sync(descriptor)))
    monkeypatch.setattr(os, "replace", lambda old, new: (order.append(Path(new).name), rename(old, new)))
    write_together({tmp_path / "a": b"1", tmp_path / "b": b"2"})
    assert order == ["sync", "sync", "a", "b", "sync"], "both contents, both names, then the folder"


@pytest.mark.parametrize("number", range(6))
def test_a_group_is_all_old_after_a_rename_that_failed(tmp_path, monkeypatch, number):
    names = ("one", "two", "three")
    old = {tmp_path / name: name.encode() for name in names}
    write_together(old)
    rename, calls = os.replace, []

    def replace(temporary, path):
        calls.append(path)
        if len(calls) == number + 1:  # those after it work
            raise PermissionError("denied")
        rename(temporary, path)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(PermissionError):
        write_together({path: b"new" for path in old})
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == old


def test_a_new_group_is_not_there_in_part_after_an_error(tmp_path):
    (tmp_path / "last").mkdir()
    with pytest.raises(OSError, match="last"):
        write_together({tmp_path / "first": b"new", tmp_path / "last": b"new"})
    assert [path.name for path in tmp_path.iterdir()] == ["last"]


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()], ids=["full disk", "stopped"])
def test_a_write_that_failed_leaves_no_temporary_file(tmp_path, monkeypatch, error):
    write_atomically(tmp_path / "file", b"old")
    stop_at_write(monkeypatch, 0, error)
    with pytest.raises(type(error)):
        write_together({tmp_path / "file": b"new", tmp_path / "other": b"new"})
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"old")]


def save_and_die(folder, number):
    """In a process of its own: save another step, and die at the rename ``number``. Returns whether it died."""
    process = os.fork()
    if process:
        code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        assert code in (0, 7)
        return code == 7
    rename, calls = os.replace, []

    def replace(old, new):
        calls.append(new)
        if len(calls) > number:
            os._exit(7)
        rename(old, new)

    try:
        os.replace = replace
        recording(200, 0.3).save(folder)
        os._exit(0)
    finally:
        os._exit(1)  # What is left of the tests is not this process's.


def recording(gray, x):
    """A small step: both cameras show ``gray`` at ``x`` m, and the pick is at ``x`` m."""
    views = []
    for name in ("one", "two"):
        camera = Camera.pinhole(name, (x, -0.5, 0.5), (1.0, 0.0, 0.0, 0.0), size=(8, 8))
        views.append(View(camera, np.full((8, 8, 3), gray, np.uint8), np.full((8, 8), x, np.float32)))
    action = PickPlace(Pose2(x, 0.0), Pose2(x, 0.1))
    return DemonstrationStep(Observation(tuple(views)), "put the red block in the blue bowl", ExpertAction(action))


def parts_of(observation):
    for view in observation.views:
        yield 100 if view.rgb[0, 0, 0] == 100 else 200
        yield 100 if abs(view.depth[0, 0] - 0.6) < 0.01 else 200
        yield 100 if abs(view.camera.position[0] - 0.6) < 0.01 else 200


def test_a_save_that_is_killed_never_leaves_a_mixture(tmp_path):
    number, folder = 0, tmp_path / "0"
    recording(100, 0.6).save(folder)
    while save_and_die(folder, number):
        for kind in (Observation, DemonstrationStep):
            try:
                loaded = kind.load(folder)
            except FileNotFoundError as error:
                assert "there is no" in str(error)
                continue
            seen = set(parts_of(loaded if kind is Observation else loaded.observation))
            if kind is DemonstrationStep:
                seen.add(100 if loaded.expert.action.pick.x == 0.6 else 200)
            assert len(seen) == 1, f"a mixture, killed at rename {number}"
        number += 1
        folder = tmp_path / str(number)
        recording(100, 0.6).save(folder)
    assert number >= 5
    recording(200, 0.3).save(tmp_path / "0")
    for whole in (tmp_path / "0", folder):  # What the dead one left is in no way.
        assert set(parts_of(DemonstrationStep.load(whole).observation)) == {200}


def test_a_scene_that_changes_while_it_is_read_is_refused(tmp_path, monkeypatch):
    recording(100, 0.6).save(tmp_path)
    read, calls = Path.read_bytes, []

    def slow(path):
        content = read(path)
        calls.append(path)
        if path.name == "one.color.png" and len(calls) < 10:
            calls.extend([path] * 10)
            recording(200, 0.6).save(tmp_path)
        return content

    monkeypatch.setattr(Path, "read_bytes", slow)
    with pytest.raises(ValueError, match="was written while it was read"):
        Observation.load(tmp_path)
    assert set(parts_of(Observation.load(tmp_path))) == {100, 200}


HOLDER = """
with writing(Path(sys.argv[1])):
    print("in", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused_until_the_first_has_ended(tmp_path):
    first = start(HOLDER, tmp_path / "set")
    assert first.stdout.readline() == "in\n"
    with pytest.raises(OSError, match="another process writes into"), writing(tmp_path / "set"):
        pass
    with pytest.raises(OSError, match="another process writes into"):
        recording(100, 0.6).save(tmp_path / "set")
    first.kill()
    first.communicate()
    deadline = time.time() + 60
    while time.time() < deadline:
        try:
            recording(100, 0.6).save(tmp_path / "set")
            break
        except OSError:
            time.sleep(0.1)
    assert DemonstrationStep.load(tmp_path / "set").instruction
    assert not (tmp_path / "set" / ".lock").exists()


COUNTER = """
folder = Path(sys.argv[1])
count = 0
while count < 100:
    try:
        with writing(folder):
            number = int((folder / "number").read_text())
            time.sleep(0.001)
            (folder / "number").write_text(str(number + 1))
            count += 1
    except BlockingIOError:
        pass
"""


def test_no_two_processes_are_ever_in_one_folder(tmp_path):
    (tmp_path / "number").write_text("0")
    for process in [start(COUNTER, tmp_path) for _ in range(3)]:
        end(process)
    assert (tmp_path / "number").read_text() == "300"
    assert [path.name for path in tmp_path.iterdir()] == ["number"]


@pytest.mark.parametrize("number", ["1e999", "-1e999", "1" + 400 * "0", "1" * 5000, "NaN", "Infinity", "-Infinity"])
def test_a_number_that_is_not_finite_is_refused(number):
    with pytest.raises(ValueError, match=r"my\.json is cut off or no JSON: .* is no") as caught:
        read_json(f'{{"a": [{number}]}}', "my.json")
    assert len(str(caught.value)) < 200
    assert read_json('{"a": 1e308, "b": 10000000000000000000000000000000}', "my.json") == {"a": 1e308, "b": 10**31}


@pytest.mark.parametrize("entry", ["depth_scale", "intrinsics", "pose"])
def test_a_camera_with_a_huge_number_is_refused(tmp_path, entry):
    recording(100, 0.6).save(tmp_path)
    path = tmp_path / "cameras.json"
    content = json.loads(path.read_text())
    content["cameras"][0][entry] = 10**400 if entry == "depth_scale" else [[10**400] * 3] * 3
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"cameras\.json cameras 0 {entry} .*must be a finite number, got 10"):
        Observation.load(tmp_path)
