"""A refusal with a reason when nothing on the table matches the words."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from gem_lite import clip
from gem_lite.language import ImageQuery
from gem_lite.maps import recognition
from gem_lite.policies import checkpoints
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Workspace

FOREIGN = clip.DATA / "foreign-scenes"


@dataclass
class Table:
    """A scene without pictures: a height map alone."""

    heightmap: HeightMap


class Painted:
    """A source whose maps are written down."""

    def __init__(self, maps):
        self.maps = maps

    def map(self, scene, phrase):
        return self.maps.get(phrase, np.zeros(scene.heightmap.height.shape, np.float32))


@pytest.fixture
def table():
    """Two things of 10 x 10 cells, and a speck."""
    workspace = Workspace()
    height = np.zeros(workspace.shape, np.float32)
    height[20:30, 20:30] = 0.04
    height[100:110, 40:50] = 0.04
    height[60, 60] = 0.04
    return Table(HeightMap(workspace, np.zeros((*workspace.shape, 3), np.uint8), height, height >= 0))


def painted(table, **values):
    """A source with constant values on the first and the second thing, by phrase."""
    maps = {}
    for phrase, (first, second) in values.items():
        semantic = np.zeros(table.heightmap.height.shape, np.float32)
        semantic[20:30, 20:30] = first
        semantic[100:110, 40:50] = second
        maps[phrase.replace("_", " ")] = semantic
    return Painted(maps)


def test_alternatives_change_the_colour_or_the_noun():
    others = recognition.alternatives("red block", ("block", "bowl"))
    assert "red bowl" in others and "blue block" in others and "red block" not in others
    assert len(others) == len(recognition.OTHER_COLORS) - 1 + 1
    assert recognition.alternatives("hammer", ("hammer", "spoon")) == ["spoon"]


def test_a_table_that_is_noisy_and_too_high_is_no_thing(table):
    masks = recognition.things(table)
    rng = np.random.default_rng(0)
    table.heightmap.height[:] += 0.01 + np.abs(rng.normal(0, 0.005, table.heightmap.height.shape)).astype(np.float32)
    noisy = recognition.things(table)
    assert len(noisy) == len(masks) == 2
    for before, after in zip(masks, noisy, strict=True):
        assert (before & after).sum() > 0.95 * before.sum() and after.sum() < 1.1 * before.sum()


def test_specks_are_no_things(table):
    assert [int(mask.sum()) for mask in recognition.things(table)] == [100, 100]


def test_a_phrase_fits_the_thing_on_which_no_alternative_is_much_better(table):
    source = painted(table, red_block=(0.7, 0.8), blue_block=(0.2, 1.1), red_bowl=(0.65, 0.1))
    found = recognition.fit(table, "red block", source)
    assert found.margin == pytest.approx(0.05, abs=1e-5), "the first thing, though the second has the higher value"
    assert (found.x, found.y) == pytest.approx(Workspace().to_world(24.5, 24.5))
    assert found.alternative == "red bowl"
    assert recognition.refusal(table, ["red block"], source) is None


def test_what_is_not_there_is_refused_with_a_reason(table):
    source = painted(table, red_block=(0.9, 0.1), red_mug=(0.5, 0.0), red_bowl=(0.1, 0.2))
    reason = recognition.refusal(table, ["red block", "the left red mug"], source)
    x, y = Workspace().to_world(24.5, 24.5)
    # On the second thing, the mug's 0 is as near to the bowl's 0.2, but too low to be a match.
    assert reason == (f'there is no "red mug": the nearest thing, at ({x:.2f}, {y:.2f}) m, looks more like "red block"')
    assert recognition.refusal(table, ["green mug"], source).endswith("nothing on the table looks like it")
    assert recognition.refusal(table, ["red block and red mug"], source, lowest_margin=-0.5) is None
    assert recognition.refusal(table, ["red block and red mug"], source, lowest_margin=-0.1) is not None
    picture = ImageQuery(np.zeros((4, 4, 3), np.uint8))
    assert recognition.refusal(table, [picture], source) is None


def test_an_empty_table_refuses_every_phrase(table):
    table.heightmap.height[:] = 0
    assert recognition.refusal(table, ["red block"], painted(table)) == (
        'there is no "red block": nothing rises above the table'
    )


def test_the_embedded_clip_refuses_on_a_foreign_table():
    policy = checkpoints.load_policy(clip.DATA / "gem-multi.safetensors", clip.load()).eval()
    scene = policy.embed(Observation.load(FOREIGN / "workbench").views)
    entries = json.loads((FOREIGN / "workbench" / "truth.json").read_text())["things"]
    for thing in entries:
        assert recognition.refusal(scene, [f"{thing['color']} {thing['kind']}"], policy.source) is None
    for absent in ("pink block", "white bowl", "banana", "blue block", "cyan star"):
        assert recognition.refusal(scene, [absent], policy.source) is not None, absent
