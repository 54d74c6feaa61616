"""Map sources of the library, and one from outside."""

import dataclasses

import numpy as np
import pytest

from gem_lite import tasks
from gem_lite.language import ImageQuery, Queries
from gem_lite.maps import crop_memory, semantic_map, sources
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE


@pytest.fixture(scope="module")
def observed(world):
    """The views of a scene, and the expert's action in it."""
    task = tasks.make("put-block-in-bowl-seen-colors", "val")
    views = world.reset(task, tasks.episode_seed("val", 3))[0].views
    return views, task.expert(world).action


def test_a_source_from_outside_makes_a_policys_maps(model, observed):
    import toys  # noqa: F401 (registers the map source "redness")

    views, _ = observed
    policy = Gem(dataclasses.replace(LITE, semantic_map="redness", image_weight=0.0), model)
    scene = policy.embed(views)
    maps = policy.maps(scene, "red block")
    assert maps.text.shape == LITE.workspace.shape and maps.text.max() > 0.3
    red = scene.heightmap.rgb.astype(int)
    shown = red[..., 0] - np.maximum(red[..., 1], red[..., 2]) > 60
    assert maps.text[shown].mean() > 5 * maps.text[~shown].mean(), "the map is bright where the picture is red"


def test_the_registered_sources_are_the_functions_of_the_lessons(model, observed):
    views, _ = observed
    scene = semantic_map.embed_scene(views, model, LITE)
    expected = {
        "multi-view": semantic_map.text_conditioned_map(scene, "red block", model),
        "single-view": semantic_map.single_view_map(scene, "red block", model),
        "none": np.ones(LITE.workspace.shape),
    }
    for name, semantic in expected.items():
        source = sources.SOURCES.find(name)(model, LITE)
        assert np.allclose(source.map(source.embed(views), "red block"), semantic, atol=1e-5)


def test_a_picture_of_a_thing_points_at_the_thing(model, observed):
    views, action = observed
    scene = semantic_map.embed_scene(views, model, LITE)
    crop = crop_memory.cut(scene.heightmap, action.place, LITE.top_patch)
    query = ImageQuery(crop, "this bowl")
    row, col = LITE.workspace.nearest_cell(action.place.x, action.place.y)
    by_picture = semantic_map.image_conditioned_map(scene, query, model, None)
    assert by_picture[row, col] > 0.5 and np.median(by_picture) < 0.3
    memory = CropMemory([CropEntry("bowl", crop, "t", 0)], model)
    by_phrase = semantic_map.image_conditioned_map(scene, "bowl", model, memory)
    assert np.allclose(by_phrase, by_picture, atol=1e-6)
    fused = semantic_map.text_conditioned_map(scene, query, model)
    assert fused.shape == LITE.workspace.shape and fused[row, col] > np.median(fused) + 0.2


def test_a_policy_is_asked_with_pictures(model, observed, world):
    views, action = observed
    policy = Gem(LITE, model)
    scene = policy.embed(views)
    pick = ImageQuery(crop_memory.cut(scene.heightmap, action.pick, LITE.top_patch), "this block")
    place = ImageQuery(crop_memory.cut(scene.heightmap, action.place, LITE.top_patch), "this bowl")
    decision = policy.decide(world.observe()[0], Queries(pick, place))
    assert decision.queries.pick is pick and decision.instruction == "pick this block, place this bowl"
    assert decision.pick_image is not None, "a picture needs no memory"
    words = policy.words(decision.queries)
    assert not np.allclose(words["pick"], words["place"])


def test_the_same_pictures_are_embedded_once_and_others_anew(model, observed):
    views, _ = observed
    source = sources.SOURCES.find("multi-view")(model, LITE)
    own = [dataclasses.replace(view, rgb=view.rgb.copy(), depth=view.depth.copy()) for view in views]
    scene = source.embed(views)
    assert source.embed(own) is scene, "equal pictures in other arrays"
    before = source.map(scene, "red block")
    for view in own:
        view.rgb[:] = 255 - view.rgb  # a driver that writes into the arrays that it gave before
    changed = source.embed(own)
    assert changed is not scene and np.abs(source.map(changed, "red block") - before).max() > 0.3
    for view in own:
        view.rgb[:] = 255 - view.rgb
        view.depth[:] += 0.01
    assert np.abs(source.embed(own).heightmap.height - scene.heightmap.height).max() > 0.005
    moved = [dataclasses.replace(v, camera=dataclasses.replace(v.camera, name=v.camera.name + "!")) for v in views]
    assert source.embed(moved) is not scene
