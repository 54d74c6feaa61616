import dataclasses

import numpy as np
import pytest
import torch
from frame_averaging import frame_averaged

from gem_lite import tasks
from gem_lite.maps import crop_memory, semantic_map
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.maps.patches import PatchGrid, embed_patches, exposed, paint_outside, patchify, side_grid
from gem_lite.maps.semantic_map import fuse, plateau_centre
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.camera import View
from gem_lite.simulation.rendering import AZURE_AND_D455, CAMERAS


@pytest.fixture(scope="module")
def scene_and_truth(model, world):
    task = tasks.make("put-block-in-bowl-unseen-colors", "val")
    (observation,) = world.reset(task, tasks.episode_seed("val", 50))
    scene = semantic_map.embed_scene(observation.views, model, LITE)
    return scene, task, task.expert(world).action, observation


def test_bad_grids_and_weights_are_named():
    for patch, stride, name in ((50, 5, "patch"), (0, 1, "patch"), (8, 0, "stride"), (8, 9, "stride")):
        with pytest.raises(ValueError, match=name):
            PatchGrid((40, 60), patch, stride)
    text, image = np.full((2, 2), 1.0), np.full((2, 2), 0.5)
    assert np.allclose(fuse(text, image, 0.8, 0.2), 0.9) and fuse(text, None, 0.8, 0.2) is text
    with pytest.raises(ValueError, match="w1 and w2"):
        fuse(text, image, 0, 0)


def test_patches_are_embedded_as_each_alone_and_unwanted_ones_change_no_wanted_pixel(model):
    image = np.random.default_rng(1).integers(0, 255, (80, 100, 3), np.uint8)
    grid, words = PatchGrid((80, 100), 40, 20), model.embed_texts(["red block"])[0]
    whole = embed_patches(image, grid, model)
    patches = patchify(image, grid)
    alone = [[model.embed_images(patch[None].copy())[0] for patch in row] for row in patches]
    assert torch.allclose(whole.values, torch.stack([torch.stack(row) for row in alone]), atol=1e-4)
    wanted = np.zeros((80, 100), bool)
    wanted[30:45, 20:60] = True
    some = embed_patches(image, grid, model, wanted).score(words)
    assert np.allclose(whole.score(words)[wanted], some[wanted], atol=1e-5)


def test_the_maps_point_at_the_named_things(scene_and_truth, model):
    scene, task, action, _ = scene_and_truth
    block, bowl = task.named_colors
    crop = crop_memory.cut(scene.heightmap, action.place, LITE.top_patch)
    memory = CropMemory([CropEntry(f"{bowl} bowl", crop, "t", 0)], model)
    single = semantic_map.single_view_map(scene, f"{bowl} bowl", model)
    for made, pose in (
        (semantic_map.text_conditioned_map(scene, f"{block} blocks", model), action.pick),
        (semantic_map.text_conditioned_map(scene, f"{bowl} bowl", model), action.place),
        (semantic_map.image_conditioned_map(scene, f"{bowl} bowl", model, memory), action.place),
        (single, action.place),
    ):
        assert made.shape == LITE.workspace.shape
        assert made[LITE.workspace.nearest_cell(pose.x, pose.y)] > 0.5
        assert np.median(made) < 0.3
    assert semantic_map.image_conditioned_map(scene, "red block", model, None) is None, "no memory"
    # Two float32 products of the same numbers may differ in their last bits, and the scale enlarges the difference.
    words = model.embed_texts([f"{bowl} bowl"])[0]
    assert np.allclose(single, model.calibration.scale_text(scene.top.score(words)), atol=1e-4)
    # What is not there gives a dark map: no per-image min-max.
    absent = semantic_map.text_conditioned_map(scene, "black bowl", model)
    assert absent.max() < semantic_map.text_conditioned_map(scene, "green bowl", model).max() - 0.15


@pytest.mark.parametrize("kind", ["as it is", "one camera, stride 7"])
def test_one_matrix_gives_the_map_that_spreads_and_fuses_pixel_by_pixel(scene_and_truth, model, kind):
    scene = scene_and_truth[0]
    if kind != "as it is":  # Behind things, one camera leaves cells unseen.
        view = scene_and_truth[3].views[1]
        view = dataclasses.replace(view, depth=np.where(view.depth > 1.2, 0, view.depth))
        scene = semantic_map.embed_scene([view], model, dataclasses.replace(LITE, stride=7))
    for phrase in ("red block", "banana"):
        words = model.embed_texts([phrase])[0]
        straight = model.calibration.scale_text(scene.fuse([side.score(words) for side in scene.sides]))
        made = semantic_map.text_conditioned_map(scene, phrase, model)
        assert made.dtype == np.float32 and np.abs(made - straight).max() < 1e-5


def test_patches_of_a_wide_picture_show_as_much_of_the_table(scene_and_truth, model):
    scene, task, action, observation = scene_and_truth
    large = []
    for view in observation.views:
        camera = view.camera
        finer = tuple(tuple(2 * x for x in row) for row in camera.intrinsics[:2])
        camera = dataclasses.replace(camera, size=(960, 1280), intrinsics=(*finer, camera.intrinsics[2]))
        large.append(View(camera, *(np.repeat(np.repeat(p, 2, axis=0), 2, axis=1) for p in (view.rgb, view.depth))))
    found = semantic_map.embed_scene(large, model, LITE)
    assert {side.grid.patch for side in found.sides} == {40} and {side.grid.patch for side in scene.sides} == {20}
    assert [side.values.shape for side in found.sides] == [side.values.shape for side in scene.sides]
    block, bowl = task.named_colors
    for phrase, pose in ((f"{block} blocks", action.pick), (f"{bowl} bowl", action.place)):
        text = semantic_map.text_conditioned_map(found, phrase, model)
        assert text[scene.heightmap.workspace.nearest_cell(pose.x, pose.y)] > 0.5
        assert np.abs(text - semantic_map.text_conditioned_map(scene, phrase, model)).mean() < 0.05


def test_patches_of_a_wide_field_of_view_are_no_larger():
    assert [side_grid(camera, LITE).patch for camera in (*CAMERAS, *AZURE_AND_D455)] == [20] * 6


def test_what_lies_outside_the_workspace_changes_no_map(scene_and_truth, model):
    scene, _, _, observation = scene_and_truth
    noise = np.random.default_rng(0).integers(0, 255, observation.views[0].rgb.shape, np.uint8)
    pairs = zip(observation.views, scene.points.kept, strict=True)
    views = [dataclasses.replace(view, rgb=np.where(kept[..., None], view.rgb, noise)) for view, kept in pairs]
    other = semantic_map.embed_scene(views, model, LITE)
    before, after = (semantic_map.text_conditioned_map(s, "red block", model) for s in (scene, other))
    # Not to the last bit: torch rounds attention differently at other places in memory.
    assert np.allclose(before, after, atol=1e-5)
    assert np.array_equal(paint_outside(views[0].rgb, np.zeros(views[0].rgb.shape[:2], bool)), views[0].rgb)


def test_plateau_centre_is_the_middle_of_the_brightest_region():
    semantic = np.zeros((20, 30), np.float32)
    semantic[4:9, 10:15] = 1.0
    semantic[9:12, 10:15] = 0.7  # connected, but no part of the plateau
    semantic[16, 2] = 0.95
    assert plateau_centre(semantic, LITE) == pytest.approx((6.0, 12.0))
    semantic[4:9, 13:15] = 0.9  # half as high above the plateau's foot: counts half
    assert plateau_centre(semantic, LITE)[1] == pytest.approx((3 * 11 + 0.5 * 2 * 13.5) / 4)
    # Two discs of 10 cells' radius, their plateaus joined by a bridge: the middle of all would lie on the bridge.
    rows, cols = np.mgrid[:80, :80]
    joined = (np.minimum(np.hypot(rows - 40, cols - 25), np.hypot(rows - 40, cols - 53)) <= 9).astype(np.float32)
    joined[38:43, 25:53] = 1.0
    row, col = plateau_centre(joined, LITE)
    assert row == pytest.approx(40, abs=0.5)
    assert min(abs(col - 25), abs(col - 53)) < 4


@pytest.mark.parametrize("rotations", [4, 8])
def test_frame_average_commutes_with_quarter_turns(scene_and_truth, model, rotations):
    # Stride 9 does not divide 60: the patch grid itself is not symmetric, so the plain map's error is real.
    grid, words = PatchGrid((80, 80), 20, 9), model.embed_texts(["red block"])[0]

    def score(picture):
        return embed_patches(picture, grid, model).score(words)

    image = scene_and_truth[0].heightmap.rgb[40:120]
    quarter = np.rot90(image).copy()
    averaged, inside = frame_averaged(score, image, rotations)
    assert np.allclose(frame_averaged(score, quarter, rotations)[0], np.rot90(averaged), atol=1e-5)
    assert np.abs(score(quarter) - np.rot90(score(image))).max() > 1e-3
    assert inside.all() == (rotations == 4)


def test_frame_average_leaves_out_what_leaves_the_picture():
    image = np.full((41, 41, 3), 50, np.uint8)
    averaged, inside = frame_averaged(lambda picture: np.full(picture.shape[:2], 3.0), image, 8)
    assert np.allclose(averaged, 3.0, atol=1e-4)
    offset = np.hypot(*np.mgrid[-20:21, -20:21])
    assert inside[offset < 19.9].all()
    assert not inside[offset > 24].any()
    # The corners that turning opens show the picture's median colour, not black.
    darkest = []
    frame_averaged(lambda picture: darkest.append(picture.min()) or picture[..., 0] * 1.0, image, 8)
    assert min(darkest) == 50
    # A score of single pixels is kept, and not one of places.
    image = np.random.default_rng(3).integers(0, 255, (31, 31, 3), np.uint8)
    assert np.allclose(frame_averaged(lambda picture: picture[..., 0] * 1.0, image, 4)[0], image[..., 0], atol=1e-2)
    ramp = np.tile(np.linspace(0, 1, 31), (31, 1))  # deaf to the picture
    assert np.allclose(frame_averaged(lambda picture: ramp, image, 4)[0], 0.5, atol=1e-5)


@pytest.mark.parametrize(
    ("shape", "kind", "rotations", "name"),
    [((40, 60, 3), np.uint8, 4, "image"), ((40, 40, 3), np.float32, 4, "image"), ((40, 40, 3), np.uint8, 0, "rota")],
)
def test_bad_frames_are_named(shape, kind, rotations, name):
    with pytest.raises(ValueError, match=name):
        frame_averaged(lambda picture: picture[..., 0], np.zeros(shape, kind), rotations)


@pytest.mark.release
def test_of_several_exposures_each_map_is_that_of_the_surest(scene_and_truth, model):
    scene, task, _, observation = scene_and_truth
    dark = [dataclasses.replace(view, rgb=exposed(view.rgb, 0.4)) for view in observation.views]
    config = dataclasses.replace(LITE, more_exposures=(1.2, 2.5))
    phrase = f"{task.named_colors[1]} bowl"
    embed = semantic_map.embed_scene
    as_it_is, bracketed = (
        semantic_map.text_conditioned_map(embed(dark, model, wanted), phrase, model) for wanted in (LITE, config)
    )
    brighter = [dataclasses.replace(view, rgb=exposed(view.rgb, 2.5)) for view in dark]
    bright = semantic_map.text_conditioned_map(embed(brighter, model, LITE), phrase, model)
    # The dark pictures, brightened, are nearly the pictures of before; CLIP is surer of them.
    assert bright.max() > as_it_is.max() + semantic_map.EXPOSURE_LEAD
    # A patch may have been embedded in another batch, which changes its last digits.
    assert np.allclose(bracketed, bright, atol=1e-4)
    right = semantic_map.text_conditioned_map(embed(observation.views, model, config), phrase, model)
    assert np.allclose(right, semantic_map.text_conditioned_map(scene, phrase, model), atol=1e-4)


def test_an_exposure_scales_a_picture_and_cuts_what_is_too_bright():
    picture = np.array([[[0, 10, 200]]], np.uint8)
    assert exposed(picture, 1.5).tolist() == [[[0, 15, 255]]]
    assert exposed(picture, 1.0).tolist() == picture.tolist()
    for wrong in ((0.0,), (1.0, -2.0), (1.0,) * 5, (11.0,)):
        with pytest.raises(ValueError, match="more_exposures must be up to 4 values"):
            dataclasses.replace(LITE, more_exposures=wrong)
