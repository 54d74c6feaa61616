"""Folders of scenes and recorded steps that a stranger made: what they hold is read, or refused in one sentence."""

import math
import shutil

import cv2
import numpy as np
import pytest
from damages import change_cameras, png_that_claims

from gem_lite import clip
from gem_lite.actions import ExpertAction, PickPlace
from gem_lite.cli import main
from gem_lite.demonstrations import Demonstration, DemonstrationStep, quantized
from gem_lite.rgbd.camera import Camera, View, checked_intrinsics
from gem_lite.rgbd.observation import Observation, read_raw
from gem_lite.se2 import Pose2

WORKBENCH = clip.DATA / "foreign-scenes" / "workbench"


def scene(depth=1.0):
    camera = Camera.pinhole("front", (0.5, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), size=(8, 10))
    colors = np.arange(240, dtype=np.uint8).reshape(8, 10, 3)
    return Observation((View(camera, colors, np.full((8, 10), depth, np.float32)),))


@pytest.fixture
def folder(tmp_path):
    scene().save(tmp_path / "scene")
    return tmp_path / "scene"


def test_pictures_are_kept_as_they_always_were(folder):
    """The bytes decide the names of episodes, and what checkpoints say of their data."""
    (loaded,), (view,) = Observation.load(folder).views, scene().views
    assert np.array_equal(loaded.rgb, view.rgb) and (loaded.depth == 1).all()
    pictures = {"depth": np.round(view.depth / 1e-4).astype(np.uint16), "color": view.rgb[..., ::-1]}  # BGR
    for name, picture in pictures.items():
        expected = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
        assert (folder / f"front.{name}.png").read_bytes() == expected


# Pictures


@pytest.mark.parametrize("key", ["color", "depth"])
def test_a_picture_outside_the_folder_is_refused(folder, key):
    name = f"front.{key}.png"
    shutil.copy(folder / name, folder.parent / "secret.png")
    (folder / "below").mkdir()
    shutil.copy(folder / name, folder / "below" / "picture.png")
    for outside in ("../secret.png", str(folder.parent / "secret.png"), "below/../../secret.png", ".."):
        change_cameras(folder, lambda entry, outside=outside: entry.update({key: outside}))
        with pytest.raises(ValueError, match=rf"cameras 0 {key} must be a picture in the folder, got ") as caught:
            Observation.load(folder)
        assert outside in str(caught.value)
    change_cameras(folder, lambda entry: entry.update({key: "below/picture.png"}))
    assert len(Observation.load(folder).views) == 1


@pytest.mark.parametrize("size", [(60000, 60000), (2**31 - 1, 2**31 - 1), (2**26 + 1, 1)])
@pytest.mark.parametrize("key", ["color", "depth"])
def test_a_picture_that_claims_to_be_huge_is_refused(folder, key, size):
    (folder / f"front.{key}.png").write_bytes(png_that_claims(*size))
    with pytest.raises(ValueError, match=rf"front\.{key}\.png must have at most 67108864 pixels, got {size[0]} x"):
        Observation.load(folder)


JPEG = cv2.imencode(".jpg", np.zeros((8, 10, 3), np.uint8))[1].tobytes() + b"IEND\xaeB`\x82"


@pytest.mark.parametrize(
    "content", [b"", b"\x89PNG\r\n\x1a\n", b"IEND", png_that_claims(0, 0), png_that_claims(10, 8)[:-20], JPEG]
)
def test_what_is_no_picture_is_refused(folder, content):
    (folder / "front.depth.png").write_bytes(content)
    with pytest.raises(ValueError, match=r"front\.depth\.png is cut off or no PNG"):
        Observation.load(folder)


# Depth and its scale


def test_arrays_have_no_depth_that_is_negative_or_infinite():
    depth = np.array([[1.0, -0.1, np.nan], [np.inf, -np.inf, 0.0], [1e300, 2.0, -1e300]])
    colors, matrix = np.zeros((3, 3, 3), np.uint8), np.diag([450.0, 450, 1])
    (view,) = Observation.from_arrays([colors], [depth], [matrix], [np.eye(4)]).views
    assert view.depth.dtype == np.float32 and view.depth.tolist() == [[1, 0, 0], [0, 0, 0], [0, 2, 0]]


@pytest.mark.parametrize(
    ("colors", "depth"),
    [((3, 4, 3), (3, 4, 1)), ((3, 4, 3), (1, 3, 4)), ((3, 3, 4), (3, 4)), ((3, 4, 4), (3, 4)), ((3, 4), (3, 4))],
)
def test_arrays_of_another_shape_are_named_with_the_right_one(colors, depth):
    with pytest.raises(ValueError) as refused:
        Observation.from_arrays([np.zeros(colors, np.uint8)], [np.ones(depth)], [np.eye(3)], [np.eye(4)])
    assert str(refused.value) == f"colors must be (H, W, 3) and depths (H, W), got {colors} and {depth} for 'camera 0'"


@pytest.mark.parametrize("scale", [0.0, -0.001, 1.0, float("nan")])
def test_a_scale_that_could_not_be_loaded_is_not_saved(tmp_path, scale):
    with pytest.raises(ValueError, match="depth_scale must be the metres of one step, above 0 and at most"):
        scene().save(tmp_path / "new", scale)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("value", [0.0, 7.0, 6.5537, 1e30, -0.1, -7.0, math.nan, math.inf, -math.inf])
def test_depth_that_no_picture_can_hold_was_not_measured(tmp_path, value):
    (view,) = scene().views
    view.depth[:5] = value
    view.depth[5] = 6.5535
    view.depth[6] = 0.71234
    given = Observation((view,))
    given.save(tmp_path)
    for found in (Observation.load(tmp_path), quantized(given)):
        depth = found.views[0].depth
        assert (depth[:5] == 0).all() and depth[5:8, 0] == pytest.approx([6.5535, 0.7123, 1.0])


def test_what_is_not_measured_anywhere_can_be_saved_and_far_depth_in_larger_steps_alone(tmp_path):
    for nothing in (0.0, math.nan):
        scene(nothing).save(tmp_path / "empty")
        assert (Observation.load(tmp_path / "empty").views[0].depth == 0).all()
    scene(60.0).save(tmp_path / "scene", 0.001)
    assert Observation.load(tmp_path / "scene").views[0].depth == pytest.approx(60.0)
    for refused in (lambda: scene(60.0).save(tmp_path / "new"), lambda: quantized(scene(60.0))):
        with pytest.raises(ValueError, match=r"'front' sees nothing nearer than 60\.00 m, but 16 bits reach 6\.55 m"):
            refused()
    assert not (tmp_path / "new").exists()


# Poses


def test_a_reflected_camera_is_no_observation_but_its_mistake_is_found(tmp_path, capsys):
    folder, mirror = shutil.copytree(WORKBENCH, tmp_path / "workbench"), np.diag([1, -1, 1, 1])
    change_cameras(folder, lambda entry: entry.update(pose=(np.array(entry["pose"]) @ mirror).tolist()))
    with pytest.raises(ValueError, match=r"pose of camera 'overhead' must be .*\(no reflection\)"):
        Observation.load(folder)
    assert len(read_raw(folder)) == 3
    assert main(["check-cameras", str(folder), "--out", str(tmp_path / "out")]) == 2
    assert "the camera's axes are flipped" in capsys.readouterr().err


# Recorded steps


def step(place=0.1, **symmetry):
    action = PickPlace(Pose2(0.4, 0.0, 0.1), Pose2(0.6, place, 0.2))
    return DemonstrationStep(scene(), "put the red block in the blue bowl", ExpertAction(action, **symmetry))


def test_poses_are_finite_symmetries_are_kept_and_a_superscript_in_a_name_is_no_number(tmp_path):
    for value in (math.nan, math.inf):
        with pytest.raises(ValueError, match="place must have finite numbers, got Pose2"):
            step(value)
    for copies in (1, 7, 360):
        step(pick_symmetry=2 * math.pi / copies).save(tmp_path)
        assert DemonstrationStep.load(tmp_path).expert.pick_symmetry == 2 * math.pi / copies
        step(place_symmetry=round(2 * math.pi / copies, 8)).save(tmp_path)
    for name in ("step-2", "step-10", "step-²"):
        step().save(tmp_path / "mine" / "episode" / name)
    assert len(Demonstration.load(tmp_path / "mine" / "episode").steps) == 3


def test_intrinsics_that_no_camera_has_are_refused():
    skewed = [[600.0, 2.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
    assert checked_intrinsics(skewed, "K").tolist() == skewed
    for row, column in ((1, 0), (2, 0)):
        wrong = np.array(skewed)
        wrong[row, column] = 1.0
        with pytest.raises(ValueError, match="with positive focal lengths, 0 in row 2, column 1, and"):
            checked_intrinsics(wrong, "K")
