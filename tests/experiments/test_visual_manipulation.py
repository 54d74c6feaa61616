"""The task visual-manipulation: its things and textures, its levels, and how an episode is won and lost."""

import importlib
import math

import numpy as np
import pytest
from small import SMALL
from tabletop import distance, lay_out, play, teleport

from experiments.picture_prompts import patterned, textures, visual_manipulation
from experiments.picture_prompts.visual_manipulation import LISTS, Thing
from gem_lite import demonstrations, tasks
from gem_lite.actions import PickPlace
from gem_lite.evaluation import collecting
from gem_lite.foundations import colors
from gem_lite.language import PictureSentence
from gem_lite.policies.gem import Gem
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2
from gem_lite.simulation.world import World

pytestmark = pytest.mark.release

PLACEMENT, COMBINATIONS, OBJECTS = LEVELS = tuple(f"visual-manipulation-{level}" for level in LISTS)


@pytest.fixture(autouse=True, scope="module")
def registered(registries_as_they_were):
    importlib.import_module("experiments.picture_prompts.register_tasks")


TABLE_GRAY = np.array(colors.TABLE)
NEVER_IN_TRAINING = tuple(name for name in textures.NAMES if name not in textures.W + textures.C)


def test_textures_are_there_and_differ():
    assert (len(textures.NAMES), len(textures.W), len(textures.C), len(NEVER_IN_TRAINING)) == (49, 19, 20, 10)
    assert set(textures.W) | set(textures.C) | set(NEVER_IN_TRAINING) == set(textures.NAMES)
    assert len({*textures.W, *textures.C, *NEVER_IN_TRAINING}) == 49, "the sets are disjoint"
    assert {"brick", "magma", "orange", "pink"} < set(NEVER_IN_TRAINING)
    pictures = {name: textures.picture(name).astype(int) for name in textures.NAMES}
    for name, picture in pictures.items():
        plain = len(np.unique(picture.reshape(-1, 3), axis=0)) == 1
        assert plain == (name in textures.PLAIN)
        nearest = min(np.abs(picture - other).mean() for other_name, other in pictures.items() if other_name != name)
        assert nearest > 4, name
    for first, second in (("red", "yellow"), ("blue", "purple")):
        shown = {tuple(row) for row in pictures[f"{first} and {second} stripe"].reshape(-1, 3).tolist()}
        assert shown == {colors.RGB[first], colors.RGB[second]}
    with pytest.raises(ValueError, match="no texture is named 'plaid'; the names are blue, red"):
        textures.picture("plaid")


def test_things_have_their_sizes():
    assert (len(patterned.DRAGGED), len(patterned.CONTAINERS)) == (19, 6)
    sizes = {
        "block": (0.07, 0.07, 0.07), "letter E": (0.058, 0.1, 0.033), "letter M": (0.092, 0.096, 0.031),
        "diamond": (0.12, 0.096, 0.029), "bowl": (0.2, 0.2, 0.069), "frame": (0.18, 0.18, 0.0015),
        "square": (0.24, 0.24, 0.001), "pallet": (0.21, 0.175, 0.026), "pan": (0.294, 0.169, 0.041),
    }  # fmt: skip
    for name, size in sizes.items():
        assert patterned.mesh(name).extents == pytest.approx(size, abs=1e-3), name
    assert patterned.mesh("container", (0.15, 0.16)).extents == pytest.approx((0.152, 0.162, 0.0455))
    for name in patterned.DRAGGED:
        x, y, side = patterned.square(name)
        assert (x, y) == pytest.approx((0, 0), abs=1e-6) and 0.06 < side <= 0.12
    with pytest.raises(ValueError, match="no thing is named 'letter Q'"):
        patterned.mesh("letter Q")


def test_every_thing_stands_and_wears_its_texture(blind):
    for name in (*patterned.DRAGGED, *patterned.CONTAINERS):
        thing = Thing(name, "red and blue stripe", (0.15, 0.17))
        blind.clear()
        body = blind.add(thing.add(blind.client, Pose2(0.5, 0.0)))
        assert body.movable == (name in patterned.DRAGGED)
        assert blind.settle() and distance(blind.pose(body)[0], Pose2(0.5, 0.0)) < 0.003
        rgb = thing.portrait().astype(int)
        shown = rgb[np.abs(rgb - TABLE_GRAY).max(axis=-1) > 30]
        red, blue = shown[:, 0] - shown[:, 2] > 60, shown[:, 2] - shown[:, 0] > 40
        assert len(shown) > 2000 and min(red.mean(), blue.mean()) > 0.2, name


def test_things_of_one_look_differ_in_shape():
    portraits = [Thing(name, "red", (0.15, 0.17)).portrait().astype(int) for name in patterned.DRAGGED]
    for number, picture in enumerate(portraits):
        assert picture.shape == (128, 128, 3)
        others = [np.abs(picture - other).mean() for other in portraits[:number]]
        assert min(others, default=99) > 1.5, patterned.DRAGGED[number]


def test_a_portrait_looks_like_the_thing_in_a_height_map():
    thing = Thing("letter T", "red and yellow stripe", (0.15, 0.17))
    with World() as world:
        world.clear()
        thing.add(world.client, Pose2(0.5, 0.0))
        heightmap = fuse_views(world.observe()[0].views, world.workspace)
    x, y = heightmap.workspace.to_world(*np.indices(heightmap.workspace.shape))
    half = visual_manipulation.SMALLEST_PORTRAIT / 2
    portrait = thing.portrait()
    inside = (np.abs(x - 0.5) < 0.9 * half) & (np.abs(y) < 0.9 * half)
    rows = np.floor((half - y[inside]) / (2 * half) * 128).astype(int)
    columns = np.floor((x[inside] - 0.5 + half) / (2 * half) * 128).astype(int)
    off = np.abs(heightmap.rgb[inside].astype(int) - portrait[rows, columns]).max(axis=-1)
    assert np.mean(off < 40) > 0.75, "but for cells at edges"
    assert np.abs(portrait[-1, 0].astype(int) - heightmap.rgb[0, 0]).max() <= 1, "the same gray behind it"


@pytest.mark.parametrize(("name", "level"), zip(LEVELS, LISTS, strict=True))
def test_levels_draw_from_their_lists(name, level):
    for split in ("train", "test"):
        lists = LISTS["placement" if split == "train" else level]
        task = tasks.make(name, split)
        rng = np.random.default_rng(5)
        drawn = [task._draw_things(rng) for _ in range(2000)]
        for number, (names, of_textures) in enumerate(
            ((lists.dragged, lists.dragged_textures), (lists.containers, lists.container_textures))
        ):
            assert {things[number].name for things in drawn} == set(names)
            assert {things[number].texture for things in drawn} == set(of_textures)
        assert {things[2].name for things in drawn} == {*lists.dragged, *lists.containers}
        assert {things[2].texture for things in drawn} == {*lists.dragged_textures, *lists.container_textures}
        assert all(len({str(thing) for thing in things}) == 3 for things in drawn)


def test_the_lists_of_levels():
    placement, combinations, objects = LISTS.values()
    assert (len(placement.dragged), len(placement.containers)) == (14, 4)
    assert (placement.dragged_textures, placement.container_textures) == (textures.W, textures.C)
    assert (combinations.dragged_textures, combinations.container_textures) == (textures.C, textures.W)
    assert (combinations.dragged, combinations.containers) == (placement.dragged, placement.containers)
    assert not {*objects.dragged, *objects.containers} & {*placement.dragged, *placement.containers}
    assert (len(objects.dragged), len(objects.containers)) == (5, 2)
    assert (len(objects.dragged_textures), len(objects.container_textures)) == (24, 25)
    for new in (objects.dragged_textures, objects.container_textures):
        assert len(set(new) & set(NEVER_IN_TRAINING)) >= 4


@pytest.mark.parametrize("name", LEVELS)
def test_the_expert_wins(blind, name):
    for index in range(5):
        task = lay_out(blind, name, index, "test")
        bodies = blind.bodies
        assert [body.movable for body in bodies[:2]] == [True, False] and not task.lost(blind)
        played = play(blind, task)
        assert sum(step.reward for step in played.steps) == 1.0 and len(played.steps) == 1
        assert distance(*(blind.pose(body)[0] for body in bodies[:2])) < 0.1


def test_one_seed_is_one_sentence(blind):
    first, other, again = (lay_out(blind, PLACEMENT, index).instruction for index in (0, 1, 0))
    assert isinstance(first, PictureSentence) and str(first) == "put [picture-0] into [picture-1]"
    assert first == again and first != other, "the names tell a policy nothing"


@pytest.fixture
def scene(blind):
    """The task, the world, and its dragged thing, container and distractor, far from one another."""
    task = lay_out(blind, PLACEMENT, 3)  # A block, a square, and a cross: all three stay where a test puts them.
    dragged, container, distractor = blind.bodies
    middle = blind.pose(container)[0]
    return task, blind, middle, dragged, distractor


def beside(middle, by):
    """A pose so much (m) nearer to the table's middle along y."""
    return Pose2(middle.x, middle.y - math.copysign(by, middle.y))


def test_it_is_won_within_ten_centimetres_whatever_the_yaw(scene):
    task, world, middle, dragged, distractor = scene
    teleport(world, distractor, beside(middle, 0.4))
    for by, yaw, score in ((0.0, 0.0, 1.0), (0.095, 1.0, 1.0), (0.105, 1.0, 0.0), (0.2, 0.0, 0.0)):
        place = beside(middle, by)
        teleport(world, dragged, Pose2(place.x, place.y, yaw), 0.035)
        assert task.score(world) == score and not task.lost(world)


def test_it_is_lost_near_the_distractor(scene):
    task, world, middle, dragged, distractor = scene
    teleport(world, dragged, middle, 0.035)
    for by, lost in ((0.15, False), (0.095, True)):  # Of container and thing at once: it is tested before success.
        teleport(world, distractor, beside(middle, by))
        assert task.lost(world) == lost and task.score(world) == (0.0 if lost else 1.0)
    teleport(world, distractor, beside(middle, 0.3))
    teleport(world, dragged, beside(middle, 0.21), 0.035)
    assert task.lost(world) and task.score(world) == 0.0, "the thing is near the distractor"


def test_it_is_lost_outside_the_table(scene):
    task, world, middle, dragged, distractor = scene
    teleport(world, distractor, beside(middle, 0.4))
    teleport(world, dragged, Pose2(0.5, 0.6), 0.035)
    assert task.lost(world)


def test_a_loss_ends_the_episode_and_a_miss_does_not(scene):
    task, world, middle, dragged, distractor = scene
    free = world.pose(dragged)[0]
    missed = world.step(PickPlace(free, Pose2(free.x, free.y, free.yaw + 1.0)))
    assert (missed.reward, missed.done) == (0.0, False) and task.max_steps == 5
    lost = world.step(PickPlace(world.pose(distractor)[0], beside(middle, 0.05)))
    assert (lost.reward, lost.done) == (0.0, True) and task.lost(world)
    assert lay_out(world, PLACEMENT, 3).max_steps == 5


def test_a_layout_that_is_lost_is_drawn_again(blind):
    with pytest.MonkeyPatch.context() as patch:
        given = iter([Pose2(0.4, 0.0), Pose2(0.6, 0.0), Pose2(0.45, 0.0), *(Pose2(0.5, y) for y in (0.3, 0.0, -0.3))])
        patch.setattr(visual_manipulation.FreeSpace, "sample", lambda *_: next(given))
        lay_out(blind, PLACEMENT)
        assert next(given, None) is None
    assert [round(blind.pose(body)[0].y, 2) for body in blind.bodies] == [0.0, 0.3, -0.3]


def test_demonstrations_bring_their_pictures_to_a_policy(tmp_path, model):
    folder = tmp_path / "demos"
    collected = collecting.collect(OBJECTS, 1, folder)
    (demo,) = demonstrations.load(folder)
    with World() as world:
        fresh = collecting.roll_out(world, OBJECTS, "train", demo.seed)
    (step,), (made,) = demo.steps, fresh.steps
    assert step.instruction == made.instruction and len(collected) == 1
    for loaded, said in zip(step.instruction.pictures, made.instruction.pictures, strict=True):
        assert np.array_equal(loaded.picture, said.picture)
    policy = Gem(SMALL, model)
    assert policy.act(step.observation, step.instruction) == policy.act(made.observation, made.instruction)
