"""Scenes in folders, wrong cameras, and what a shipped policy sees in scenes that another simulator rendered."""

import json
import math
import os
import re
import shutil
from dataclasses import replace

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest
from damages import change_cameras
from scipy.spatial.transform import Rotation
from tiers import for_a_release

from gem_lite import clip
from gem_lite.cli import main, own_table
from gem_lite.drawing import plots
from gem_lite.maps import places
from gem_lite.policies import robot_plan
from gem_lite.rgbd import camera_check
from gem_lite.rgbd.heightmap import HeightMap, fuse_views
from gem_lite.rgbd.observation import Observation, RawView, read_raw
from gem_lite.se2 import Workspace

FOREIGN = clip.DATA / "foreign-scenes"
SENTENCES = json.loads((FOREIGN / "sentences.json").read_text())
SCENES = tuple(SENTENCES)
WORKSPACE = Workspace()


def things(scene):
    """The true things of a scene by name: (x, y) in metres."""
    entries = json.loads((FOREIGN / scene / "truth.json").read_text())["things"]
    return {f"{entry['color']} {entry['kind']}": (entry["x"], entry["y"]) for entry in entries}


@pytest.fixture
def copied(tmp_path):
    return shutil.copytree(FOREIGN / "workbench", tmp_path / "scene")


def test_a_saved_observation_is_loaded_again(tmp_path):
    before = Observation.load(FOREIGN / "kitchen")
    assert [view.rgb.shape for view in before.views] == [(480, 640, 3), (360, 640, 3), (480, 640, 3)]
    before.save(tmp_path / "scene", depth_scale=2e-4)
    after = Observation.load(tmp_path / "scene")
    rows = ((v.rgb, v.depth, v.camera.matrix, np.array(v.camera.pose), v.camera.name) for v in before.views)
    made = Observation.from_arrays(*zip(*rows, strict=True))
    for old, new, array in zip(before.views, after.views, made.views, strict=True):
        assert new.camera == array.camera == old.camera
        assert np.array_equal(new.rgb, old.rgb) and np.array_equal(array.depth, old.depth)
        assert np.abs(new.depth - old.depth).max() < 1e-4


def test_a_single_view_is_enough_and_pixels_without_a_depth_are_no_points():
    views = Observation.load(FOREIGN / "desk").views
    maps = [fuse_views([view], WORKSPACE) for view in views]
    assert all(one.seen.mean() > 0.5 for one in maps) and maps[0].seen.mean() > 0.9
    view = views[0]
    holes = np.where(np.indices(view.depth.shape)[1] < 320, np.nan, view.depth)
    (half,) = Observation.from_arrays([view.rgb], [holes], [view.camera.matrix], [view.camera.pose]).views
    found = fuse_views([half], WORKSPACE)
    assert 0.3 < found.seen.mean() < 0.6
    assert np.allclose(found.height[found.seen], maps[0].height[found.seen], atol=0.05)


def written(name, shape, dtype=np.uint8):
    return lambda folder: cv2.imwrite(str(folder / name), np.ones(shape, dtype))


FILES = {
    "right.depth.png is missing, though cameras.json names it": lambda folder: (folder / "right.depth.png").unlink(),
    "left.color.png is cut off or no PNG": lambda folder: os.truncate(folder / "left.color.png", 5000),
    "must be 8-bit with 3 channels, got 8-bit with 1": written("left.color.png", (360, 640)),
    "holds no scene: there is no cameras.json": lambda folder: (folder / "cameras.json").unlink(),
    "version must be 1, got 2": lambda folder: (folder / "cameras.json").write_text('{"version": 2}'),
    "colour is 640 x 480 and depth 320 x 240": written("overhead.depth.png", (240, 320), np.uint16),
}
ENTRIES = {
    "depth_scale must be less than or equal to 0.01, got 1.0": lambda entry: entry.update(depth_scale=1.0),
    "no camera sees a point inside the workspace": lambda entry: entry["pose"][0].__setitem__(3, 5.0),
    "cameras 0 lacks pose": lambda entry: entry.pop("pose"),
    "cameras 0 pose must be a (4, 4) pose": lambda entry: entry.update(pose=[[1, 0, 0, 0]]),
    "a rotation, a position and the last row": lambda entry: entry.update(pose=np.diag([2, 1, 1, 1]).tolist()),
    "must be (3, 3) finite numbers with positive": lambda entry: entry.update(intrinsics=np.zeros((3, 3)).tolist()),
}
"""By what the message says: what happens to a folder, and to the entries of its cameras."""


@pytest.mark.parametrize("message", [*FILES, *ENTRIES])
def test_a_damaged_folder_ends_in_one_sentence(message, copied, capsys, tmp_path):
    if message in FILES:
        FILES[message](copied)
    else:
        change_cameras(copied, ENTRIES[message])
    assert main(["look", str(copied), "red block", "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert message in printed.err and printed.err.count("\n") == 1 and printed.out == ""
    assert not (tmp_path / "out").exists()


def test_views_that_cannot_be_saved_and_arrays_that_do_not_fit_are_refused(tmp_path):
    views = Observation.load(FOREIGN / "desk").views
    with pytest.raises(ValueError, match="different names"):
        Observation((views[0], views[0])).save(tmp_path / "twice")
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="must be equally many"):
        Observation.from_arrays([], [], [], [])
    arrays = [np.zeros((8, 8, 3), np.uint8)], [np.ones((8, 8), np.uint16)], [np.diag([9.0, 9, 1])], [np.eye(4)]
    with pytest.raises(ValueError, match="must be metres as floating point numbers, got uint16"):
        Observation.from_arrays(*arrays)


def changed_pose(view, change):
    pose = np.array(view.pose)
    return replace(view, pose=tuple(map(tuple, change(pose).tolist())))


def changed_rotation(view, change):
    def change_pose(pose):
        pose[:3, :3] = change(pose[:3, :3])
        return pose

    return changed_pose(view, change_pose)


def remade(change):
    """A rotation that is made anew from what ``change`` gives of it."""
    return lambda view: changed_rotation(view, lambda matrix: change(Rotation.from_matrix(matrix)).as_matrix())


def angles_in_degrees(axes):
    return remade(lambda rotation: Rotation.from_euler(axes, np.degrees(rotation.as_euler(axes))))


def along_ray(view):
    seen = view.view()
    distance = np.linalg.norm(seen.points() - seen.camera.position, axis=-1)
    return replace(view, depth=distance.astype(np.float32))


def in_millimetres(pose):
    pose[:3, 3] *= 1000
    return pose


def turned(axes):
    return lambda view: changed_rotation(view, lambda matrix: matrix @ axes)


MISTAKES = {
    "axes flipped": [turned(np.diag([1, -1, -1])), turned(np.diag([1, -1, 1]))],
    "axes swapped": [turned(np.eye(3)[[1, 0, 2]]), turned(np.eye(3)[[2, 0, 1]])],
    "inverse pose": [lambda v: changed_pose(v, np.linalg.inv)],
    "degrees for radians": [
        remade(lambda rotation: Rotation.from_rotvec(np.degrees(rotation.as_rotvec()))),
        angles_in_degrees("xyz"), angles_in_degrees("ZYX"),
    ],
    "millimetres (pose)": [lambda v: changed_pose(v, in_millimetres)],
    "millimetres (depth)": [
        lambda v: replace(v, depth=1000 * v.depth), lambda v: replace(v, depth=v.depth / np.float32(1000)),
    ],
    "depth along the ray": [along_ray],
    "sizes differ": [lambda v: replace(v, depth=v.depth[::2, ::2])],
}  # fmt: skip
"""By the name that the check must give: the ways to make the mistake."""


@pytest.mark.parametrize("scene", SCENES)
def test_right_cameras_give_no_warning(scene):
    views = read_raw(FOREIGN / scene)
    for given in (views, *([view] for view in views)):
        assert camera_check.check(given, WORKSPACE) == []


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("scene", for_a_release(SCENES, lambda scene: scene not in ("desk", "kitchen")))
def test_a_mistake_of_all_cameras_or_of_one_is_named(scene, mistake):
    views = read_raw(FOREIGN / scene)
    for make in MISTAKES[mistake]:
        everywhere = camera_check.check([make(view) for view in views], WORKSPACE)
        assert {finding.mistake for finding in everywhere} == {mistake}
        assert sorted(name for finding in everywhere for name in finding.cameras) == ["left", "overhead", "right"]
        (alone,) = camera_check.check([make(views[0]), *views[1:]], WORKSPACE)
        assert (alone.mistake, alone.cameras) == (mistake, ("overhead",))


SHELF = read_raw(FOREIGN / "workbench")


def tilted(degrees):
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    return lambda view: changed_rotation(view, lambda matrix: turn @ matrix)


def shifted(*metres):
    return lambda view: changed_pose(view, lambda pose: pose + np.column_stack([np.zeros((4, 3)), [*metres, 0]]))


def reordered(shift):
    return remade(lambda rotation: Rotation.from_quat(np.roll(rotation.as_quat(), shift)))


@pytest.mark.parametrize("scene", ["workbench", "kitchen"])
def test_other_mistakes_of_a_camera_are_named(scene):
    views = read_raw(FOREIGN / scene)

    def named(make, number):
        changed = [make(view) if i == number else view for i, view in enumerate(views)]
        (finding,) = camera_check.check(changed, WORKSPACE)
        return finding.mistake, finding.cameras

    for number, name in enumerate(("overhead", "left", "right")):
        assert named(shifted(0.05, 0, 0), number) == ("views disagree", (name,))
        assert named(shifted(0, 0, 0.02), number) == ("calibration", (name,))
        assert named(tilted(4), number) == ("calibration", (name,))
        assert named(reordered(1), number) == named(reordered(-1), number) == ("quaternion order", (name,))
        assert named(lambda view: replace(view, depth=view.depth / 4), number) == ("depth scale", (name,))
    others = [views[0], replace(views[1], pose=views[2].pose), replace(views[2], pose=views[1].pose)]
    (finding,) = camera_check.check(others, WORKSPACE)
    assert finding.mistake == "poses exchanged"


def test_sentences_hold_numbers_and_what_no_mistake_explains_is_named():
    (finding,) = camera_check.check([replace(view, depth=view.depth / 4) for view in SHELF], WORKSPACE)
    factors = re.findall(r"[\d.]+", finding.sentence)
    assert len(factors) == 3 and all(abs(float(factor) - 4) < 0.1 for factor in factors)
    (finding,) = camera_check.check([SHELF[0], shifted(0, 0, 0.02)(SHELF[1]), SHELF[2]], WORKSPACE)
    assert re.search(r"tilted by 0\.[012] degrees and lies (19|20|21) mm from z = 0", finding.sentence)


def test_what_the_check_does_not_find():
    roll = Rotation.from_euler("z", 3, degrees=True).as_matrix()  # about the viewing axis
    for number in range(3):
        views = [changed_rotation(view, lambda r: r @ roll) if i == number else view for i, view in enumerate(SHELF)]
        assert camera_check.check(views, WORKSPACE) == []
    everywhere = [shifted(0.05, 0, 0)(view) for view in SHELF]
    assert camera_check.check(everywhere, WORKSPACE) == [], "all cameras 5 cm sideways"
    blind = replace(SHELF[1], depth=np.zeros_like(SHELF[1].depth))
    (finding,) = camera_check.check([SHELF[0], blind, SHELF[2]], WORKSPACE)
    assert (finding.mistake, finding.cameras) == ("no depth", ("left",))
    (finding,) = camera_check.check([shifted(0, 0, 0.15)(view) for view in SHELF], WORKSPACE)
    assert finding.mistake == "table height" and re.search(r"lies at z = 0\.(149|15[01]) m", finding.sentence)
    assert "depth_scale" not in finding.sentence, "three cameras at other heights would see other tables"


SIDEWAYS = np.eye(4)
SIDEWAYS[:3, :3] = Rotation.from_euler("xy", (25, 17), degrees=True).as_matrix()


def flat_table(height, focal=600.0, size=(480, 640), z=0.0):
    """A camera that looks straight down from a height (m) on a bare table at z (m)."""
    matrix = [[focal, 0, size[1] / 2], [0, focal, size[0] / 2], [0, 0, 1]]
    pose = np.array([[1, 0, 0, 0.5], [0, -1, 0, 0], [0, 0, -1, height], [0, 0, 0, 1.0]])
    noise = np.random.default_rng(0).normal(0, 0.001, size)
    depth = (height - z + noise).astype(np.float32)
    return RawView("down", np.full((*size, 3), 120, np.uint8), depth, matrix, pose)


def test_a_right_pose_that_sees_little_of_the_rectangle_fits(tmp_path, capsys):
    view = flat_table(0.8, focal=1200.0)
    assert camera_check.fit([camera_check.cloud(view)], WORKSPACE).covered[0] < camera_check.COVERED
    assert camera_check.check([view], WORKSPACE) == []
    Observation((view.view(),)).save(tmp_path)
    assert main(["check-cameras", str(tmp_path), "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    limits = re.search(r"down: sees .* what it sees fits --rectangle (\S+) (\S+) (\S+) (\S+)\n", shown).groups()
    assert np.allclose([float(limit) for limit in limits], (0.287, 0.713, -0.16, 0.16), atol=0.015)


@pytest.mark.parametrize("sideways", [0.55, 1.5], ids=["at the edge", "beside it"])
def test_a_right_pose_that_sees_nothing_of_the_rectangle_is_told_where_it_looks(sideways):
    (finding,) = camera_check.check([shifted(sideways, 0, 0)(flat_table(0.6, focal=900.0))], WORKSPACE)
    assert finding.mistake == "rectangle not seen" and "the pose fits the table" in finding.sentence
    limits = [
        float(limit) for limit in re.search(r"fits --rectangle (\S+) (\S+) (\S+) (\S+)$", finding.sentence).groups()
    ]
    assert np.allclose(limits, (0.5 + sideways - 0.213, 0.5 + sideways + 0.213, -0.16, 0.16), atol=0.015)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_view_with_a_few_measured_pixels_ends_in_a_sentence(count):
    view = flat_table(0.9)
    depth = np.zeros_like(view.depth)
    depth[200, 300 : 300 + count] = 0.9
    (finding,) = camera_check.check([replace(view, depth=depth)], WORKSPACE)
    assert finding.mistake == "table not found" and "is seen in little of the workspace" in finding.sentence


@pytest.mark.parametrize("z", [0.16, -0.10])
def test_a_level_table_at_another_height_has_two_explanations(z):
    (finding,) = camera_check.check([flat_table(0.9, z=z)], WORKSPACE)
    assert finding.mistake == "table height"
    assert f"lies at z = {z:.3f} m" in finding.sentence and "set-up robot" in finding.sentence
    factor = float(re.search(r"multiply it by about ([\d.]+)", finding.sentence)[1])
    assert abs(factor - 0.9 / (0.9 - z)) < 0.01


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[900, 0, 640], [0, 900, 360], [0, 0, 1]], r"principal point \(640, 360\) .* 640 x 480 .* another resolution"),
        ([[600, 0, 5000], [0, 600, 240], [0, 0, 1]], r"principal point \(5000, 240\)"),
        ([[600, 0, -320], [0, 600, 240], [0, 0, 1]], r"principal point \(-320, 240\)"),
        ([[0.94, 0, 0.5], [0, 1.25, 0.5], [0, 0, 1]], "focal length of 0.94 .* in pixels"),
    ],
)
def test_intrinsics_that_are_not_the_pictures_are_named(matrix, words):
    (finding,) = camera_check.check([replace(flat_table(0.9), intrinsics=matrix)], WORKSPACE)
    assert finding.mistake == "intrinsics" and re.search(words, finding.sentence)


def test_a_level_table_is_never_called_turned():
    (finding,) = camera_check.check([changed_pose(flat_table(0.9), lambda pose: pose @ SIDEWAYS)], WORKSPACE)
    assert finding.mistake == "degrees for radians", "it is turned, and as far away as it should be"
    for view in (flat_table(0.9, z=0.3), tilted(6)(flat_table(0.9))):
        (finding,) = camera_check.check([view], WORKSPACE)
        assert finding.mistake in ("table height", "calibration"), finding.sentence
    assert camera_check.check([tilted(3)(flat_table(0.9))], WORKSPACE) == [], "it lies within 13 mm of z = 0"


@pytest.mark.parametrize("scene", for_a_release(["desk", "workshop"], lambda scene: scene == "desk"))
def test_pictures_that_were_read_as_bgr_are_found(scene, multi):
    views = Observation.load(FOREIGN / scene).views
    gain = places.gain_by_swapping(views, tuple(things(scene))[:3], multi.source)
    assert -gain > places.SWAP_MARGIN, "as they are, the words fit better: exchanged, they are found"


@pytest.mark.parametrize(("scene", "sentences"), for_a_release(SENTENCES.items(), lambda pair: pair[0] != "desk"))
def test_nothing_is_picked_or_placed_where_no_camera_saw(scene, sentences, multi):
    views = Observation.load(FOREIGN / scene).views
    for view in views:
        for sentence in sentences:
            choice = multi.decide(Observation((view,)), sentence)
            assert not choice.heightmap.seen.all()
            assert choice.heightmap.seen[choice.pick_cell[1:]], (view.camera.name, sentence)
            assert choice.heightmap.seen[choice.place_cell[1:]], (view.camera.name, sentence)


@pytest.mark.release
def test_maps_and_picks_find_the_named_things_of_foreign_scenes(multi):
    pointed = picked = 0
    for scene, sentences in SENTENCES.items():
        observation, known = Observation.load(FOREIGN / scene), things(scene)
        embedded = multi.embed(observation.views)
        seen = embedded.heightmap.seen
        for sentence in sentences:
            phrase = multi.read(sentence).pick
            best = places.best_places(multi.maps(embedded, phrase).fused, seen, multi.config)[0]
            pointed += math.dist((best.x, best.y), known[phrase]) <= 0.02
            pick = multi.act(observation, sentence).pick
            picked += min(known, key=lambda name: math.dist((pick.x, pick.y), known[name])) == phrase
    assert pointed >= 17, f"the map's centre is within 20 mm in {pointed} of 20"
    assert picked >= 16, f"the pick is nearest to the named thing in {picked} of 20"


def test_check_cameras_says_what_is_wrong(copied, capsys, tmp_path, multi, monkeypatch):
    monkeypatch.setattr(own_table, "load", lambda *_: multi)
    arguments = ["check-cameras", str(copied), "red block", "blue bowl", "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert "no mistake found" in capsys.readouterr().out
    assert (tmp_path / "out" / "table.png").stat().st_size > 10_000
    for path in copied.glob("*.color.png"):
        cv2.imwrite(str(path), cv2.imread(str(path))[..., ::-1])
    assert main(arguments) == 0
    assert (
        "no other mistake found, but a doubt: the words fit much better with red and blue exchanged"
        in capsys.readouterr().out
    )
    (tmp_path / "out" / "table.png").unlink()
    change_cameras(copied, lambda entry: entry.update(pose=np.linalg.inv(np.array(entry["pose"])).tolist()))
    assert main(arguments) == 2
    assert "overhead, left, right: the pose is inverted" in capsys.readouterr().err


def test_check_cameras_draws_a_table_with_mistakes_if_it_can(copied, capsys, tmp_path):
    change_cameras(copied, lambda entry: entry.update(depth_scale=1.04 * entry["depth_scale"]))
    assert main(["check-cameras", str(copied), "--out", str(tmp_path / "out")]) == 2
    assert "z = 0" in capsys.readouterr().err
    assert (tmp_path / "out" / "table.png").stat().st_size > 10_000


def test_look_does_not_act_on_a_thing_that_is_not_there(capsys, tmp_path, multi, monkeypatch):
    monkeypatch.setattr(own_table, "load", lambda *_: multi)
    monkeypatch.setattr(multi, "decide_in", None)
    sentence = "put the banana in the blue bowl"
    assert main(["look", str(FOREIGN / "workbench"), sentence, "--out", str(tmp_path)]) == 1
    shown = capsys.readouterr()
    assert 'there is no "banana"' in shown.out and "PickPlace" not in shown.out and shown.err == ""
    content = json.loads((tmp_path / "look.json").read_text())
    assert content["action"] is None and content["refusals"]["blue bowl"] is None


def test_look_names_a_camera_that_sees_nothing_of_the_rectangle(capsys, tmp_path, multi, monkeypatch):
    monkeypatch.setattr(own_table, "load", lambda *_: multi)
    first, *others = Observation.load(FOREIGN / "workbench").views
    away = replace(first, depth=np.zeros_like(first.depth))
    Observation((away, *others)).save(tmp_path / "scene")
    assert main(["look", str(tmp_path / "scene"), "red block", "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.count("sees nothing of the rectangle") == 1


@pytest.mark.release
def test_another_rectangle_of_the_table_is_looked_at(capsys, tmp_path):
    words = [str(FOREIGN / "workbench"), "--out", str(tmp_path), "--rectangle", "0.2", "0.72", "-0.3", "0.5"]
    assert main(["check-cameras", *words]) == 0
    assert main(["look", *words, "red block"]) == 0
    best = json.loads((tmp_path / "look.json").read_text())["places"]["red block"][0]
    assert math.dist((best["x"], best["y"]), things("workbench")["red block"]) < 0.02
    assert main(["look", *words[:-4], "0.7", "0.2", "-0.3", "0.5", "red block"]) == 2
    assert "the rectangle's x must go from a smaller number to a larger one" in capsys.readouterr().err


def test_look_writes_maps_places_and_an_action(capsys, tmp_path, multi, monkeypatch):
    missing = str(tmp_path / "none.safetensors")
    assert main(["look", str(FOREIGN / "kitchen"), "red mug", "--policy", missing]) == 2
    assert "none.safetensors" in capsys.readouterr().err
    monkeypatch.setattr(own_table, "load", lambda *_: multi)

    def look(scene, text, code=0):
        assert main(["look", str(FOREIGN / scene), text, "--out", str(tmp_path)]) == code
        return json.loads((tmp_path / "look.json").read_text())

    found = look("workbench", "put the red block in the blue bowl")
    assert list(found["places"]) == ["red block", "blue bowl"]
    assert found["refusals"] == {"red block": None, "blue bowl": None}
    pick = found["action"]["pick"]
    assert math.dist((pick["x"], pick["y"]), things("workbench")["red block"]) < 0.02
    scores = [place["score"] for place in found["places"]["red block"]]
    assert scores == sorted(scores, reverse=True) and len(scores) == 5
    for name in ("look", "maps", "table"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    found = look("kitchen", "the mug on the left")
    assert found["action"] is None and list(found["places"]) == ["left mug"], "read as in a sentence"
    assert "renderings alone" not in capsys.readouterr().out, "these are renderings"
    reason = look("kitchen", "banana", code=1)["refusals"]["banana"]
    assert reason.startswith('there is no "banana"') and reason in capsys.readouterr().out


def test_look_says_what_it_sees_of_other_peoples_pictures(capsys, tmp_path, multi, monkeypatch):
    monkeypatch.setattr(own_table, "load", lambda *_: multi)
    (left,) = (view for view in Observation.load(FOREIGN / "kitchen").views if view.camera.name == "left")
    narrow = left.depth.copy()
    narrow[:, : narrow.shape[1] // 2] = 0
    Observation((replace(left, depth=narrow),)).save(tmp_path / "half")
    assert main(["look", str(tmp_path / "half"), "put the red mug in the red bowl", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "maps by the embedded CLIP, which has seen renderings alone" in shown
    unseen = int(re.search(r"no camera sees (\d+) % of the table: nothing is picked or placed there", shown)[1])
    limits = [float(limit) for limit in re.search(r"what is seen fits --rectangle (.+)", shown)[1].split()]
    seen = fuse_views([replace(left, depth=narrow)], WORKSPACE).seen
    assert unseen == round(100 * (1 - seen.mean())) > 25
    rows, cols = np.indices(seen.shape)
    x, y = WORKSPACE.to_world(rows, cols)
    inside = (x > limits[0]) & (x < limits[1]) & (y > limits[2]) & (y < limits[3])
    assert inside.sum() > 1000 and seen[inside].mean() > 0.9, "but for the shadows of things"
    planned = robot_plan.plan(multi.decide(Observation.load(tmp_path / "half"), "put the red mug in the red bowl"))
    for part, chance in (("pick", planned.unseen_pick), ("place", planned.unseen_place)):
        said = (
            f"with probability {chance:.2f}, the policy wanted another {part}, where no camera sees; this is forbidden"
        )
        assert (said in shown) == (chance >= robot_plan.WANTED_ELSEWHERE)


def test_look_says_why_a_text_is_neither_sentence_nor_thing(multi):
    for text, reason in (
        ("", "the instruction is empty"),
        ("grab the red block", "names no place"),
        ("throw the red block away", "does not begin with a known verb"),
    ):
        with pytest.raises(ValueError, match=f"^text must be a sentence or name a thing: .*{reason}"):
            own_table.read(multi, text)


@pytest.mark.parametrize(
    ("limits", "x_labels", "y_labels"),
    [
        ((0.25, 0.75, -0.5, 0.5), ["0.3", "0.5", "0.7"], ["-0.4", "-0.2", "0.0", "0.2", "0.4"]),
        ((-0.7, -0.1, -1.2, -0.6), ["-0.7", "-0.5", "-0.3", "-0.1"], ["-1.2", "-1.0", "-0.8", "-0.6"]),
    ],
)
def test_a_height_map_has_numbers_wherever_the_table_lies(limits, x_labels, y_labels):
    workspace = Workspace.covering(*limits)
    shape = workspace.shape
    empty = HeightMap(workspace, np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32), np.ones(shape, bool))
    figure = plots.show_heightmap(empty)
    for ax in figure.axes[:2]:
        assert [label.get_text() for label in ax.get_xticklabels()] == x_labels
        assert [label.get_text().replace("-0.0", "0.0") for label in ax.get_yticklabels()] == y_labels
    plt.close(figure)
