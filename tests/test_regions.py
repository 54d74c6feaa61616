"""The map source "regions": each thing on the table, filled with one score."""

import dataclasses

import numpy as np
import pytest
import torch
from small import SMALL, weights
from tabletop import block, bowl

from gem_lite.clip import Clip
from gem_lite.language import ImageQuery
from gem_lite.maps import crop_memory, regions, semantic_map
from gem_lite.maps.sources import SOURCES
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.se2 import Pose2
from gem_lite.training import train

REGIONS = dataclasses.replace(LITE, semantic_map="regions")
APART = {"red": Pose2(0.4, 0.2, 0.5), "blue": Pose2(0.6, 0.25, 0.0), "yellow": Pose2(0.45, -0.25, 1.0)}
"""Blocks, each alone."""
BOWL = Pose2(0.6, -0.1)
BESIDE = {"red": Pose2(0.4, 0.1, 0.0), "green": Pose2(0.441, 0.1, 0.0)}
"""Two blocks of 40 mm that touch."""


@pytest.fixture(scope="module")
def source(model):
    return SOURCES.find("regions")(model, REGIONS)


@pytest.fixture(scope="module")
def scene(stage, source):
    _, observation = stage(*(block(pose, color) for color, pose in APART.items()), bowl(BOWL))
    return source.embed(observation.views)


def cell(pose):
    return LITE.workspace.nearest_cell(pose.x, pose.y)


def region_at(scene, pose):
    (region,) = [region for region in scene.regions if region[cell(pose)]]
    return region


@pytest.mark.parametrize("color", APART)
def test_the_named_blocks_region_is_the_highest(color, scene, source):
    semantic = source.map(scene, f"{color} block")
    assert semantic.shape == LITE.workspace.shape and semantic.dtype == np.float32
    region = region_at(scene, APART[color])
    assert len(np.unique(semantic[region])) == 1 and semantic[region][0] > 0.6
    assert semantic[~region].max() < semantic[region][0] - 0.2


def test_each_region_has_one_score_and_the_table_has_none(scene, source):
    assert len(scene.regions) == 4
    semantic = source.map(scene, "green bowl")
    covered = np.any(scene.regions, axis=0)
    assert not semantic[~covered].any() and semantic.min() == 0
    assert all(len(np.unique(semantic[region])) == 1 for region in scene.regions)
    assert semantic.max() == semantic[cell(BOWL)] > 0.6, "the inside of a bowl belongs to it"
    assert source.uses_views


def test_a_flat_thing_of_another_colour_is_a_region(scene, source):
    painted = scene.heightmap.rgb.copy()
    painted[120:130, 10:20] = (200, 30, 30)
    proposed = source.propose(dataclasses.replace(scene.heightmap, rgb=painted))
    assert len(proposed) == len(scene.regions) + 1
    assert any(mask[120:130, 10:20].all() and mask.sum() == 100 for mask in proposed)


def test_a_picture_of_a_thing_fills_its_region(scene, source):
    crop = crop_memory.cut(scene.heightmap, APART["blue"], 0.05)
    semantic = source.map(scene, ImageQuery(crop, "this block"))
    region = region_at(scene, APART["blue"])
    assert semantic[region][0] == semantic.max() > semantic[~region].max() + 0.2


def test_two_blocks_that_touch_are_one_region(stage, source, model):
    """A detector's bias (A.6) and a failure: no patch of such a map shows one of the two blocks. Patches do."""
    _, observation = stage(*(block(pose, color) for color, pose in BESIDE.items()))
    scene = source.embed(observation.views)
    assert len(scene.regions) == 1
    for color in BESIDE:
        semantic = source.map(scene, f"{color} block")
        red, green = (semantic[cell(pose)] for pose in BESIDE.values())
        assert red == green > 0
    patches = semantic_map.embed_scene(observation.views, model, LITE)
    for color, pose in BESIDE.items():
        semantic = semantic_map.text_conditioned_map(patches, f"{color} block", model)
        other = next(place for name, place in BESIDE.items() if name != color)
        assert semantic[cell(pose)] > semantic[cell(other)] + 0.1


def test_a_block_in_a_bowl_keeps_its_own_score_where_it_is_found(source, scene):
    outer = region_at(scene, BOWL)
    inner = np.zeros_like(outer)
    row, col = cell(BOWL)
    inner[row - 2 : row + 3, col - 2 : col + 3] = True
    pictures = torch.stack([source.clip.embed_texts([name])[0] for name in ("green bowl", "red block")])
    both = dataclasses.replace(scene, regions=(outer, inner), pictures=pictures)
    semantic = source.map(both, "red block")
    assert semantic[inner].min() > semantic[outer & ~inner].max()


def test_an_empty_table_has_an_empty_map(stage, source):
    _, observation = stage()
    scene = source.embed(observation.views)
    assert scene.regions == () and scene.pictures.shape == (0, source.clip.dim)
    for query in ("red block", ImageQuery(np.zeros((8, 8, 3), np.uint8))):
        assert not source.map(scene, query).any()


def test_the_crops_are_embedded_once_for_all_queries(stage, source, monkeypatch):
    _, observation = stage(*(block(pose, color) for color, pose in APART.items()))
    seen = []
    honest = Clip.embed_known_images
    monkeypatch.setattr(
        Clip, "embed_known_images", lambda self, images: seen.append(images.shape) or honest(self, images)
    )
    scene = source.embed(observation.views)
    assert len(seen) == 3 and all(count == 1 and height == width for count, height, width, _ in seen)
    for phrase in ("red block", "blue block", "banana"):
        source.map(scene, phrase)
    assert len(seen) == 3


def test_a_scene_of_another_source_is_refused(scene, source, model):
    other = semantic_map.SceneEmbedding(scene.heightmap, scene.points, (), scene.embed_top)
    with pytest.raises(TypeError, match="what embed of the source 'regions' returns, got SceneEmbedding"):
        source.map(other, "red block")


def test_a_crop_is_a_square_around_the_region_inside_the_picture():
    picture = np.arange(20 * 12).reshape(20, 12, 1).repeat(3, axis=2).astype(np.uint8)

    def crop(rows, cols):
        region = np.zeros((20, 12), bool)
        region[rows, cols] = True
        return regions.square(picture, region)

    # 5 cells are longer than 3; a tenth of them is one cell on each side.
    assert np.array_equal(crop(slice(6, 9), slice(4, 9)), picture[4:11, 3:10])
    assert np.array_equal(crop(slice(0, 2), slice(10, 12)), picture[0:4, 8:12]), "moved inside at a corner"
    assert np.array_equal(crop(slice(0, 20), slice(3, 5)), picture[4:16, 0:12]), "as wide as the picture"


def test_a_policy_trains_on_regions_acts_and_comes_back(model, demos, tmp_path):
    policy = Gem(dataclasses.replace(SMALL, semantic_map="regions", steps=2), model)
    policy.remember(demos)
    prepared = list(policy.prepare(demos))
    first = prepared[0][0].maps["pick"]
    assert float(first.max()) > 0 and float((first == 0).float().mean()) > 0.8
    before = weights(policy)
    learner = train.Learner(policy, train.Accelerator(cpu=True))
    rng = np.random.default_rng(0)
    for _ in range(policy.config.steps):
        learner.step(train.make_batch(policy, prepared, rng), 1e-3)
    assert not torch.equal(weights(policy), before)
    save_policy(policy, tmp_path / "policy.safetensors", {})
    loaded = load_policy(tmp_path / "policy.safetensors", model)
    assert loaded.config.semantic_map == "regions" and torch.equal(weights(loaded), weights(policy))
    step = demos[0].steps[0]
    decision = policy.decide(step.observation, step.phrases)
    assert decision.pick_map.shape == SMALL.workspace.shape
    assert loaded.act(step.observation, step.instruction) == policy.act(step.observation, step.instruction)
