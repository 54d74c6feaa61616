"""A table of one's own: scenes in folders, wrong cameras, and what a shipped policy sees in foreign scenes.

The scenes are rendered by another simulator (experiments/foreign_table/make_scenes.py). Their sentences were written
before a policy had seen the scenes.
"""

import json
import math
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gem_lite import clip
from gem_lite.cli import main
from gem_lite.maps import places
from gem_lite.policies import checkpoints
from gem_lite.rgbd import camera_check
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.observation import Observation, read_raw
from gem_lite.se2 import Workspace

FOREIGN = clip.DATA / "foreign-scenes"
SENTENCES = json.loads((FOREIGN / "sentences.json").read_text())
SCENES = tuple(SENTENCES)


def things(scene):
    """The true things of a scene by name: (x, y) in metres."""
    entries = json.loads((FOREIGN / scene / "truth.json").read_text())["things"]
    return {f"{entry['color']} {entry['kind']}": (entry["x"], entry["y"]) for entry in entries}


@pytest.fixture
def copied(tmp_path):
    """A folder that a test may damage."""
    return shutil.copytree(FOREIGN / "workbench", tmp_path / "scene")


def with_entry(folder, **changes):
    """Change the first camera's entry in cameras.json."""
    content = json.loads((folder / "cameras.json").read_text())
    content["cameras"][0] |= changes
    (folder / "cameras.json").write_text(json.dumps(content))


# Scenes in folders and from arrays.


def test_a_saved_observation_is_loaded_again(tmp_path):
    before = Observation.load(FOREIGN / "kitchen")
    assert [view.rgb.shape for view in before.views] == [(480, 640, 3), (360, 640, 3), (480, 640, 3)]
    before.save(tmp_path / "scene", depth_scale=2e-4)
    after = Observation.load(tmp_path / "scene")
    for old, new in zip(before.views, after.views, strict=True):
        assert new.camera == old.camera
        assert np.array_equal(new.rgb, old.rgb)
        assert np.abs(new.depth - old.depth).max() < 1e-4


def test_arrays_make_the_same_observation_as_a_folder():
    loaded = Observation.load(FOREIGN / "desk")
    columns = zip(*((v.rgb, v.depth, v.camera.matrix, np.array(v.camera.pose)) for v in loaded.views), strict=True)
    made = Observation.from_arrays(*columns, [view.camera.name for view in loaded.views])
    for old, new in zip(loaded.views, made.views, strict=True):
        assert new.camera == old.camera and np.array_equal(new.depth, old.depth)


def test_pixels_without_a_depth_are_no_points():
    view = Observation.load(FOREIGN / "desk").views[0]
    rgb, pose = view.rgb, np.array(view.camera.pose)
    holes = np.where(np.indices(view.depth.shape)[1] < 320, np.nan, view.depth)
    (half,) = Observation.from_arrays([rgb], [holes], [view.camera.matrix], [pose]).views
    whole, found = fuse_views([view], Workspace()), fuse_views([half], Workspace())
    assert whole.seen.mean() > 0.9 and 0.3 < found.seen.mean() < 0.6
    assert np.allclose(found.height[found.seen], whole.height[found.seen], atol=0.05)


def test_a_single_view_is_enough():
    views = Observation.load(FOREIGN / "desk").views
    for view in views:
        assert fuse_views([view], Workspace()).seen.mean() > 0.5


def damaged_png(folder):
    path = folder / "left.color.png"
    path.write_bytes(path.read_bytes()[:5000])


def gray_color(folder):
    cv2.imwrite(str(folder / "left.color.png"), np.zeros((360, 640), np.uint8))


DAMAGES = {
    "is missing, though cameras.json names it as depth": lambda folder: (folder / "right.depth.png").unlink(),
    "left.color.png is cut off or no PNG": damaged_png,
    "must be 8-bit with 3 channels, got 8-bit with 1": gray_color,
    "depth_scale must be the metres of one step": lambda folder: with_entry(folder, depth_scale=1.0),
    "no camera sees a point inside the workspace": lambda folder: with_entries_moved(folder, 5.0),
    "lacks pose": lambda folder: without_key(folder, "pose"),
    "must be 4 rows of 4 numbers": lambda folder: with_entry(folder, pose=[[1, 0, 0, 0]]),
    "must be a rotation and a position": lambda folder: with_entry(folder, pose=np.diag([2, 1, 1, 1]).tolist()),
    "must have positive focal lengths": lambda folder: with_entry(folder, intrinsics=np.zeros((3, 3)).tolist()),
    "holds no scene: there is no cameras.json": lambda folder: (folder / "cameras.json").unlink(),
    "must have version 1, got 2": lambda folder: (folder / "cameras.json").write_text('{"version": 2}'),
    "colour is 640 x 480 and depth 320 x 240": lambda folder: small_depth(folder),
}
"""By what the message says: what happens to a folder."""


def with_entries_moved(folder, metres):
    content = json.loads((folder / "cameras.json").read_text())
    for entry in content["cameras"]:
        entry["pose"][0][3] += metres
    (folder / "cameras.json").write_text(json.dumps(content))


def without_key(folder, key):
    content = json.loads((folder / "cameras.json").read_text())
    del content["cameras"][0][key]
    (folder / "cameras.json").write_text(json.dumps(content))


def small_depth(folder):
    depth = cv2.imread(str(folder / "overhead.depth.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(folder / "overhead.depth.png"), depth[::2, ::2])


@pytest.mark.parametrize("message", DAMAGES)
def test_a_damaged_folder_ends_in_one_sentence(message, copied, capsys, tmp_path):
    DAMAGES[message](copied)
    assert main(["look", str(copied), "red block", "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert message in printed.err and printed.err.count("\n") == 1 and printed.out == ""
    assert not (tmp_path / "out").exists()


def test_views_that_cannot_be_saved_are_refused(tmp_path):
    views = Observation.load(FOREIGN / "desk").views
    with pytest.raises(ValueError, match="different names"):
        Observation((views[0], views[0])).save(tmp_path / "twice")
    with pytest.raises(ValueError, match=r"16 bits reach 0\.66 m"):
        Observation(views).save(tmp_path / "far", depth_scale=1e-5)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="must be equally many"):
        Observation.from_arrays([], [], [], [])
    view = views[0]
    with pytest.raises(ValueError, match="must be metres as floating point numbers, got uint16"):
        Observation.from_arrays(
            [view.rgb], [(1000 * view.depth).astype(np.uint16)], [view.camera.matrix], [view.camera.pose]
        )


# What is wrong with the cameras?


def changed_pose(view, change):
    pose = np.array(view.pose)
    return replace(view, pose=tuple(map(tuple, change(pose).tolist())))


def changed_rotation(view, change):
    def change_pose(pose):
        pose[:3, :3] = change(pose[:3, :3])
        return pose

    return changed_pose(view, change_pose)


def in_degrees(form):
    """A rotation made from angles in degrees that are read as radians; ``form`` is "rotvec" or an order of axes."""

    def change(matrix):
        rotation = Rotation.from_matrix(matrix)
        if form == "rotvec":
            return Rotation.from_rotvec(np.degrees(rotation.as_rotvec())).as_matrix()
        return Rotation.from_euler(form, np.degrees(rotation.as_euler(form))).as_matrix()

    return lambda view: changed_rotation(view, change)


def along_ray(view):
    height, width = view.depth.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(np.array(view.intrinsics)).T
    return replace(view, depth=view.depth * np.linalg.norm(rays, axis=-1).astype(np.float32))


def in_millimetres(pose):
    pose[:3, 3] *= 1000
    return pose


SWAPPED = np.eye(3)[[1, 0, 2]], np.eye(3)[[2, 0, 1]]
MISTAKES = {
    "axes flipped": [
        lambda v: changed_rotation(v, lambda matrix: matrix @ np.diag([1, -1, -1])),
        lambda v: changed_rotation(v, lambda matrix: matrix @ np.diag([1, -1, 1])),
    ],
    "axes swapped": [lambda v, s=swap: changed_rotation(v, lambda matrix: matrix @ s) for swap in SWAPPED],
    "inverse pose": [lambda v: changed_pose(v, np.linalg.inv)],
    "degrees for radians": [in_degrees("rotvec"), in_degrees("xyz"), in_degrees("ZYX")],
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
    assert camera_check.check(views, Workspace()) == []
    for view in views:
        assert camera_check.check([view], Workspace()) == []


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("scene", SCENES)
def test_a_mistake_of_all_cameras_or_of_one_is_named(scene, mistake):
    views = read_raw(FOREIGN / scene)
    for make in MISTAKES[mistake]:
        everywhere = camera_check.check([make(view) for view in views], Workspace())
        assert {finding.mistake for finding in everywhere} == {mistake}
        assert sorted(name for finding in everywhere for name in finding.cameras) == ["left", "overhead", "right"]
        (alone,) = camera_check.check([make(views[0]), *views[1:]], Workspace())
        assert (alone.mistake, alone.cameras) == (mistake, ("overhead",))


SHELF = read_raw(FOREIGN / "workbench")


def tilted(degrees):
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    return lambda view: changed_rotation(view, lambda matrix: turn @ matrix)


def shifted(*metres):
    return lambda view: changed_pose(view, lambda pose: pose + np.column_stack([np.zeros((4, 3)), [*metres, 0]]))


def reordered(shift):
    """A rotation from a quaternion in another order."""
    return lambda view: changed_rotation(
        view, lambda matrix: Rotation.from_quat(np.roll(Rotation.from_matrix(matrix).as_quat(), shift)).as_matrix()
    )


@pytest.mark.parametrize("scene", SCENES)
def test_other_mistakes_of_a_camera_are_named(scene):
    views = read_raw(FOREIGN / scene)

    def named(make, number):
        changed = [make(view) if i == number else view for i, view in enumerate(views)]
        (finding,) = camera_check.check(changed, Workspace())
        return finding.mistake, finding.cameras

    for number, name in enumerate(("overhead", "left", "right")):
        assert named(shifted(0.05, 0, 0), number) == ("views disagree", (name,))
        assert named(shifted(0, 0, 0.02), number) == ("calibration", (name,))
        assert named(tilted(4), number) == ("calibration", (name,))
        assert named(reordered(1), number) == named(reordered(-1), number) == ("quaternion order", (name,))
        assert named(lambda view: replace(view, depth=view.depth / 4), number) == ("depth scale", (name,))
    others = [views[0], replace(views[1], pose=views[2].pose), replace(views[2], pose=views[1].pose)]
    (finding,) = camera_check.check(others, Workspace())
    assert finding.mistake == "poses exchanged"


def test_the_sentences_hold_numbers():
    (finding,) = camera_check.check([replace(view, depth=view.depth / 4) for view in SHELF], Workspace())
    factors = re.findall(r"[\d.]+", finding.sentence)
    assert len(factors) == 3 and all(abs(float(factor) - 4) < 0.1 for factor in factors)
    (finding,) = camera_check.check([SHELF[0], shifted(0, 0, 0.02)(SHELF[1]), SHELF[2]], Workspace())
    assert re.search(r"tilted by 0\.[012] degrees and lies (19|20|21) mm from z = 0", finding.sentence)


def test_what_the_check_does_not_find():
    roll = Rotation.from_euler("z", 3, degrees=True).as_matrix()  # about the viewing axis
    for number in range(3):
        views = [changed_rotation(view, lambda r: r @ roll) if i == number else view for i, view in enumerate(SHELF)]
        assert camera_check.check(views, Workspace()) == []
    everywhere = [shifted(0.05, 0, 0)(view) for view in SHELF]
    assert camera_check.check(everywhere, Workspace()) == [], "all cameras 5 cm sideways"


def test_a_camera_without_any_depth_is_named():
    blind = replace(SHELF[1], depth=np.zeros_like(SHELF[1].depth))
    (finding,) = camera_check.check([SHELF[0], blind, SHELF[2]], Workspace())
    assert (finding.mistake, finding.cameras) == ("no depth", ("left",))


def test_a_table_at_another_height_is_not_explained_by_a_mistake():
    views = [shifted(0, 0, 0.15)(view) for view in SHELF]
    (finding,) = camera_check.check(views, Workspace())
    assert finding.mistake == "table not found" and "is the table at z = 0" in finding.sentence


# What a shipped policy sees there, without a change.


@pytest.fixture(scope="module")
def policy():
    return checkpoints.load_policy(clip.DATA / "gem-multi.safetensors", clip.load()).eval()


@pytest.mark.parametrize("scene", SCENES)
def test_pictures_that_were_read_as_bgr_are_found(scene, policy):
    views = Observation.load(FOREIGN / scene).views
    gain = places.gain_by_swapping(views, tuple(things(scene)), policy.source)
    assert gain < 0, "as they are, the words fit better"
    assert -gain > places.SWAP_MARGIN, "exchanged, they are found"


def test_maps_and_picks_find_the_named_things_of_foreign_scenes(policy):
    pointed = picked = 0
    for scene, sentences in SENTENCES.items():
        observation, known = Observation.load(FOREIGN / scene), things(scene)
        embedded = policy.embed(observation.views)
        for sentence in sentences:
            phrase = policy.read(sentence).pick
            x, y = known[phrase]
            best = places.best_places(policy.maps(embedded, phrase).fused, policy.config)[0]
            pointed += math.hypot(best.x - x, best.y - y) <= 0.02
            pick = policy.act(observation, sentence).pick
            nearest = min(known, key=lambda name: math.hypot(pick.x - known[name][0], pick.y - known[name][1]))
            picked += nearest == phrase
    assert pointed >= 17, f"the map's centre is within 20 mm in {pointed} of 20"
    assert picked >= 16, f"the pick is nearest to the named thing in {picked} of 20"


# The two commands.


def test_check_cameras_says_what_is_wrong(copied, capsys, tmp_path):
    arguments = ["check-cameras", str(copied), "red block", "blue bowl", "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert "no mistake found" in capsys.readouterr().out
    assert (tmp_path / "out" / "table.png").stat().st_size > 10_000
    for path in copied.glob("*.color.png"):
        cv2.imwrite(str(path), cv2.imread(str(path))[..., ::-1])
    assert main(arguments) == 2
    assert "the pictures are BGR" in capsys.readouterr().err
    content = json.loads((copied / "cameras.json").read_text())
    for entry in content["cameras"]:
        entry["pose"] = np.linalg.inv(np.array(entry["pose"])).tolist()
    (copied / "cameras.json").write_text(json.dumps(content))
    assert main(arguments) == 2
    assert "overhead, left, right: the pose is inverted" in capsys.readouterr().err


def test_another_rectangle_of_the_table_is_looked_at(capsys, tmp_path):
    words = [str(FOREIGN / "workbench"), "--out", str(tmp_path), "--rectangle", "0.2", "0.72", "-0.3", "0.5"]
    assert main(["check-cameras", *words]) == 0
    assert main(["look", *words, "put the red block in the blue bowl"]) == 0
    found = json.loads((tmp_path / "look.json").read_text())
    x, y = things("workbench")["red block"]
    assert math.hypot(found["action"]["pick"]["x"] - x, found["action"]["pick"]["y"] - y) < 0.02
    assert main(["look", *words[:-4], "0.7", "0.2", "-0.3", "0.5", "red block"]) == 2
    assert "the rectangle's x must go from a smaller number to a larger one" in capsys.readouterr().err


def test_look_writes_maps_places_and_an_action(capsys, tmp_path):
    out = ["--out", str(tmp_path)]
    assert main(["look", str(FOREIGN / "workbench"), "put the red block in the blue bowl", *out]) == 0
    found = json.loads((tmp_path / "look.json").read_text())
    assert list(found["places"]) == ["red block", "blue bowl"]
    x, y = things("workbench")["red block"]
    assert math.hypot(found["action"]["pick"]["x"] - x, found["action"]["pick"]["y"] - y) < 0.02
    scores = [place["score"] for place in found["places"]["red block"]]
    assert scores == sorted(scores, reverse=True) and len(scores) == 5
    for name in ("look", "maps", "table"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    assert main(["look", str(FOREIGN / "kitchen"), "red mug", *out]) == 0
    assert json.loads((tmp_path / "look.json").read_text())["action"] is None
    assert found["refusals"] == {"red block": None, "blue bowl": None}
    assert main(["look", str(FOREIGN / "kitchen"), "banana", *out]) == 0
    reason = json.loads((tmp_path / "look.json").read_text())["refusals"]["banana"]
    assert reason.startswith('there is no "banana"') and reason in capsys.readouterr().out
    cliport = ["--policy", str(tmp_path / "none.safetensors")]
    assert main(["look", str(FOREIGN / "kitchen"), "red mug", *out, *cliport]) == 2
    assert "none.safetensors" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the instruction is empty"),
        ("grab the red block", "names no place"),
        ("throw the red block away", "does not begin with a known verb"),
        ("put the red block next to the bowl", "leftover words 'next to the bowl'"),
    ],
)
def test_look_says_why_a_text_is_neither_sentence_nor_thing(text, reason, capsys, tmp_path):
    assert main(["look", str(FOREIGN / "kitchen"), text, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("text must be a sentence or name a thing: ") and reason in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_look_reads_a_thing_as_in_a_sentence(tmp_path):
    assert main(["look", str(FOREIGN / "kitchen"), "the mug on the left", "--out", str(tmp_path)]) == 0
    assert list(json.loads((tmp_path / "look.json").read_text())["places"]) == ["left mug"]
