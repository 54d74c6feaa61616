"""Pictures as prompts: what both methods see, the rival's tokens, and trainings from demonstrations to rows."""

import dataclasses
import importlib

import numpy as np
import pytest
import torch
from scipy import ndimage

from experiments.picture_prompts import cutouts, rival, segmented_world
from experiments.picture_prompts.rival import Rival, RivalConfig
from experiments.picture_prompts.segmented_world import SegmentedWorld
from gem_lite import demonstrations, tasks
from gem_lite.actions import PickPlace
from gem_lite.evaluation import collecting, results
from gem_lite.foundations import colors
from gem_lite.policies import augment, checkpoints
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2, Workspace

pytestmark = pytest.mark.release

SMALL = RivalConfig(width=16, layers=1, cutout_layers=1, heads=2, dropout=0.0, steps=160, batch=4, learning_rate=3e-3)
GRAY = np.array(colors.TABLE)


@pytest.fixture(autouse=True, scope="module")
def registered(registries_as_they_were):
    importlib.import_module("experiments.picture_prompts.register_tasks")


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    """(folder, demonstrations): four of the training level."""
    folder = tmp_path_factory.mktemp("prompts") / "demos"
    return folder, collecting.collect("visual-manipulation-placement", 4, folder, environment=SegmentedWorld)


def test_the_depth_shows_masks_and_no_form():
    task = tasks.make("visual-manipulation-placement", "val")
    with SegmentedWorld() as world:
        ((view,),) = (observation.views for observation in world.reset(task, tasks.episode_seed("val", 0)))
        poses = [world.pose(body)[0] for body in world.bodies]
        workspace = world.workspace
    depths = np.unique(view.depth)
    assert len(depths) == 2, "every thing has the same height"
    shown = segmented_world.masks(view)
    off = np.abs(view.rgb.astype(int) - GRAY).max(axis=-1)
    assert off[~shown].max() <= 2 and (off[shown] > 10).mean() > 0.95
    heightmap = fuse_views((view,), workspace)
    assert np.unique(heightmap.height.round(3)).tolist() == pytest.approx([0.0, segmented_world.PLATE])
    numbers, count = ndimage.label(heightmap.height > 0.02)
    middles = [workspace.to_world(*cell) for cell in ndimage.center_of_mass(numbers > 0, numbers, range(1, count + 1))]
    assert count == len(poses) == 3
    for pose in poses:
        assert min(np.hypot(x - pose.x, y - pose.y) for x, y in middles) < 0.025


def test_a_cutout_is_padded_and_its_box_is_a_share_of_the_picture():
    picture = np.zeros((100, 50, 3), np.uint8)
    picture[20:40, 10:20] = (200, 100, 50)
    mask = picture[..., 0] > 0
    part, box = cutouts.cut(picture, mask)
    assert part.shape == (32, 32, 3) and box == pytest.approx((0.3, 0.3, 0.2, 0.2))
    assert (part[:, 8:24] == (200, 100, 50)).all() and not part[:, :8].any() and not part[:, 24:].any()
    with pytest.raises(ValueError, match="mask must hold a pixel"):
        cutouts.cut(picture, np.zeros_like(mask))


def test_a_scene_becomes_its_things(demos):
    for demonstration in demos[1]:
        step = demonstration.steps[0]
        scene = cutouts.cutouts(step.observation, step.instruction)
        assert scene.things.shape == (3, 32, 32, 3) and scene.boxes.shape == (3, 4) and len(scene.prompt) == 2
        pick = step.expert.action.pick
        w = Workspace()
        at = np.array([(w.y_max - pick.y) / (w.y_max - w.y_min), (pick.x - w.x_min) / (w.x_max - w.x_min)])
        inside = (np.abs(scene.boxes[:, :2] - at) <= scene.boxes[:, 2:] / 2 + 0.01).all(axis=1)
        (picked,) = np.flatnonzero(inside)
        to_pick, to_place = (np.abs(_colors(scene.things[picked]) - _colors(part)).sum() for part in scene.prompt)
        assert to_pick < to_place, "the first picture of the prompt shows what the expert picks"


def _colors(cutout):
    """The shares of coarse colours in a cutout, without its background."""
    pixels = cutout.reshape(-1, 3)
    shown = pixels[(np.abs(pixels.astype(int) - GRAY).max(axis=1) > 20) & pixels.any(axis=1)]
    return np.histogramdd(shown, bins=4, range=[(0, 256)] * 3)[0] / len(shown)


def test_the_order_and_the_number_of_things_mean_nothing(demos):
    step = demos[1][0].steps[0]
    scene = cutouts.cutouts(step.observation, step.instruction)
    turned = cutouts.Cutouts(scene.things[::-1].copy(), scene.boxes[::-1].copy(), scene.prompt)
    fewer = cutouts.Cutouts(scene.things[:2], scene.boxes[:2], scene.prompt)
    net = Rival(SMALL, Workspace()).eval()
    with torch.no_grad():
        first, second = net(rival.tokens_of([scene])), net(rival.tokens_of([turned]))
        alone, beside = net(rival.tokens_of([fewer])), net(rival.tokens_of([fewer, scene]))
    for one, other in zip(first, second, strict=True):
        assert torch.allclose(one, other, atol=1e-5)
    for one, other in zip(alone, beside, strict=True):
        assert torch.allclose(one[0], other[0], atol=1e-5), "an absent thing changes nothing"
    assert not torch.allclose(first[0], alone[0], atol=1e-5)
    exchanged = cutouts.Cutouts(scene.things, scene.boxes, scene.prompt[::-1].copy())
    with torch.no_grad():
        other_way = net(rival.tokens_of([exchanged]))
    assert all(not torch.allclose(one, other, atol=1e-4) for one, other in zip(first, other_way, strict=True))


def test_the_bins_of_an_action():
    net = Rival(SMALL, Workspace())
    assert net.bins == (50, 100, 50, 100)
    assert net.label(PickPlace(Pose2(0.2501, -0.499), Pose2(0.7499, 0.4999))) == pytest.approx(
        [0.01, 0.1, 49.99, 99.99]
    )
    assert net.label(PickPlace(Pose2(0.5049, 0.0049), Pose2(0.9, -0.9))) == pytest.approx([25.49, 50.49, 65, -40])


def test_labels_are_one_bin_or_soft():
    places = torch.tensor([25.49, 120.0])
    logits = torch.zeros(2, 50)
    one_bin = Rival(dataclasses.replace(SMALL, spread=0.0), Workspace()).soft_labels(places, logits)
    assert one_bin.argmax(dim=1).tolist() == [25, 49] and one_bin.sum() == 2
    soft = Rival(SMALL, Workspace()).soft_labels(places, logits)
    assert soft.argmax(dim=1).tolist() == [25, 49] and torch.allclose(soft.sum(dim=1), torch.ones(2))
    assert soft[0, 24] > soft[0, 26] > soft[0, 27] > 0, "the middle of bin 24 is nearer to 25.49 than that of bin 26"


def test_a_box_has_fourier_features():
    near = rival.fourier_features(torch.tensor([[0.5, 0.5, 0.1, 0.1], [0.51, 0.5, 0.1, 0.1]]))
    assert near.shape == (2, 4 * (1 + 2 * len(rival.FREQUENCIES)))
    assert (near[1] - near[0]).norm() > 20 * 0.01, "one hundredth of the table is seen more than twenty times larger"


def test_the_learning_rate_rises_and_falls():
    rates = [rival.rate(step / 20) for step in range(20)]
    assert 0 < rates[0] < rates[1] == 1.0 and rates[1:] == sorted(rates[1:], reverse=True) and rates[-1] < 0.02


def test_a_small_rival_learns_its_demonstrations(demos, tmp_path):
    first, again = Rival(SMALL, Workspace(), seed=1), Rival(SMALL, Workspace(), seed=1)
    rival.train(first, demos[1], seed=2)
    rival.train(again, demos[1], seed=2)
    for one, other in zip(first.parameters(), again.parameters(), strict=True):
        assert torch.equal(one, other), "the seed decides"
    for demonstration in demos[1]:
        step = demonstration.steps[0]
        act = first.act(cutouts.cutouts(step.observation, step.instruction))
        right = step.expert.action
        assert np.hypot(act.pick.x - right.pick.x, act.pick.y - right.pick.y) < 0.02
        assert np.hypot(act.place.x - right.place.x, act.place.y - right.place.y) < 0.02
    rival.save(first, tmp_path / "rival.safetensors", {"demos": 4, "seed": 2})
    path = tmp_path / "rival.safetensors"
    card = checkpoints.read_card(path)
    loaded = rival.load(path, card, Workspace())
    assert card["demos"] == 4
    scene = cutouts.cutouts(demos[1][0].steps[0].observation, demos[1][0].steps[0].instruction)
    assert loaded.act(scene) == first.act(scene)
    with pytest.raises(ValueError, match="do not fit"):
        rival.load(path, {**card, "config": {**card["config"], "width": 32}}, Workspace())
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ValueError, match="cut off or changed"):
        rival.load(path, card, Workspace())


def test_both_methods_are_trained_and_measured(demos, tmp_path, model, monkeypatch):
    def refuse(*_):
        raise AssertionError("no training is augmented here")

    for name in ("moved", "rescaled", "recolored"):
        monkeypatch.setattr(augment, name, refuse)
    measuring = importlib.import_module("experiments.picture_prompts.measuring")
    folder, _ = demos
    gem_file, rival_file = tmp_path / "gem.safetensors", tmp_path / "rival.safetensors"
    measuring.train_gem(folder, gem_file, 2, measuring.gem_config(1, 1e-3), 0, tmp_path / "run")
    measuring.train_rival(folder, rival_file, 4, SMALL, 0)
    rows = []
    for file in (gem_file, rival_file):
        trained = measuring.load(file, model)
        played = measuring.play(trained.actor, "visual-manipulation-objects", "val", 1)
        rows.append(measuring.row(trained, "visual-manipulation-objects", "val", played))
    path = tmp_path / "rows.jsonl"
    results.file_rows(rows, path)
    assert results.read_rows(path) == rows
    assert [(row["method"], row["demos"], row["steps"]) for row in rows] == [("gem", 2, 1), ("vima-like", 4, 160)]
    assert all(row["parameters"] > 10_000 and row["episodes"] == 1 and row["data_sha256"] for row in rows)
    assert rows[0]["clip_fingerprint"] == model.fingerprint and rows[1]["clip_fingerprint"] is None
    assert rows[0]["config_hash"] != rows[1]["config_hash"]
    with pytest.raises(ValueError, match="episodes must be from 1 to 4"):
        measuring.train_rival(folder, rival_file, 5, SMALL, 0)


def test_gem_has_image_conditioned_maps_alone_and_no_rules_of_ours(demos, model):
    measuring = importlib.import_module("experiments.picture_prompts.measuring")
    policy = measuring.Unaugmented(measuring.PICTURES_ALONE, model)
    step = demonstrations.load(demos[0])[0].steps[0]
    scene = policy.embed(step.observation.views)
    picture = step.instruction.pictures[0]
    maps = policy.maps(scene, picture)
    alone = model.calibration.scale_image(scene.top.score(model.embed_images(picture.picture[None])[0].cpu()))
    assert maps.image is None and np.allclose(maps.fused, alone, atol=1e-6)
    queries = policy.read(step.instruction)
    assert policy.gates(step.observation.views, policy.inputs(scene, queries), queries) == {}


def test_a_peak_counts_if_it_is_nearest_to_its_thing():
    patch_peaks = importlib.import_module("experiments.picture_prompts.patch_peaks")
    poses = [Pose2(0.4, 0.0), Pose2(0.5, 0.0), Pose2(0.6, 0.3)]
    for peak, number, right in (
        (Pose2(0.41, 0.0), 0, True),
        (Pose2(0.46, 0.0), 0, False),
        (Pose2(0.46, 0.0), 1, True),
        (Pose2(0.6, 0.15), 2, False),
    ):
        assert patch_peaks._is_nearest(peak, poses, number) == right
    assert patch_peaks.with_patches(0.1).top_stride == 0.025
