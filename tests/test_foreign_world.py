"""The foreign world that acts (notebooks/foreign_world): physics decides, and the pictures are right."""

import math
from pathlib import Path

import foreign_world
import numpy as np
import pytest
from foreign_world import tables
from foreign_world import world as acting
from foreign_world.tables import Scene, Thing, random_scene

from gem_lite.rgbd import camera_check
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.observation import Observation, read_raw
from gem_lite.se2 import Workspace, wrap

BLOCK, BOWL = (0.40, -0.25), (0.50, 0.20)
PLAIN = Scene((0.36, 0.30, 0.24), (0.2, 0.5, 1.6), (
    Thing("red", "block", *BLOCK, 20), Thing("blue", "bowl", *BOWL), Thing("green", "block", 0.62, -0.35, 50),
    Thing("yellow", "bowl", 0.64, -0.08), Thing("orange", "mug", 0.36, 0.0, 140),
))  # fmt: skip
SEED = foreign_world.TEST_SEEDS[0]
MIDDLE = np.array([0, 0, 0.024, 1.0])
CORNERS = np.array([[x, y, z, 1.0] for x in (-0.024, 0.024) for y in (-0.024, 0.024) for z in (0, 0.048)])


@pytest.fixture
def world():
    with foreign_world.ForeignWorld() as made:
        yield made


@pytest.fixture(scope="module")
def looked():
    """A table and what its cameras see; no test may change it."""
    with foreign_world.ForeignWorld() as made:
        yield made, made.reset(SEED)


def observe(look):
    return Observation.from_arrays(look.colors, look.depths, look.intrinsics, look.poses, look.names)


def poses(world):
    return [world.pose(number) for number in range(len(world.scene.things))]


def play(world, pick, place):
    return world.pick_place(world.on_surface(*pick), world.on_surface(*place))


def put(world, number, x, y, z):
    """Set a thing somewhere by hand, at rest."""
    world._data.qpos[7 * number : 7 * number + 7] = x, y, z, 1, 0, 0, 0
    world._data.qvel[:] = 0
    acting.mujoco.mj_forward(world._model, world._data)


def test_the_world_uses_nothing_of_gem_lite():
    files = list(Path(foreign_world.__file__).parent.glob("*.py"))
    lines = [line.strip() for file in files for line in file.read_text().splitlines()]
    assert len(files) == 3
    assert not [line for line in lines if line.startswith(("import ", "from ")) and "gem_lite" in line]


def test_tables_are_as_described():
    assert not set(foreign_world.TRAIN_SEEDS) & set(foreign_world.TEST_SEEDS)
    counts = set()
    for seed in [*foreign_world.TRAIN_SEEDS[:100], *foreign_world.TEST_SEEDS[:100]]:
        things = random_scene(seed).things
        colors = {kind: [t.color for t in things if t.kind == kind] for kind in ("block", "bowl")}
        assert all(len(set(found)) == len(found) for found in colors.values())
        others = len(things) - len(colors["block"]) - len(colors["bowl"])
        counts.add((len(colors["block"]), len(colors["bowl"]), others))
        for number, one in enumerate(things):
            radius, border, _ = tables.KINDS[one.kind]
            assert 0.25 + border <= one.x <= 0.75 - border and abs(one.y) <= 0.5 - border
            for other in things[:number]:
                distance = math.hypot(one.x - other.x, one.y - other.y)
                assert distance > radius + tables.KINDS[other.kind][0]
    assert counts == {(blocks, bowls, others) for blocks in (2, 3, 4) for bowls in (2, 3) for others in (0, 1, 2)}


def test_the_same_seed_gives_the_same_pictures_and_looking_changes_nothing(looked, world):
    other_world, first = looked
    assert np.array_equal(other_world.look().colors[1], first.colors[1])
    again, other = world.reset(SEED), world.reset(SEED + 1)
    for before, after in ((first.colors, again.colors), (first.depths, again.depths)):
        assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert not np.array_equal(first.colors[0], other.colors[0])
    assert [image.shape for image in first.colors] == [(480, 640, 3), (360, 640, 3), (480, 640, 3)]
    assert all(depth.shape == rgb.shape[:2] for depth, rgb in zip(first.depths, first.colors, strict=True))
    assert {image.dtype for image in first.colors} == {np.dtype(np.uint8)}
    assert {image.dtype for image in first.depths} == {np.dtype(np.float32)}


@pytest.mark.parametrize("seed", [SEED, SEED + 1, foreign_world.TRAIN_SEEDS[0]])
def test_pictures_keep_the_conventions_of_an_observation(seed, world, tmp_path):
    observation = observe(world.reset(seed))
    workspace = Workspace()
    heightmap = fuse_views(observation.views, workspace)
    rows, cols = np.indices(workspace.shape)
    x, y = workspace.to_world(rows, cols)
    for number, thing in enumerate(world.scene.things):
        if thing.kind == "block":
            true = world.pose(number)[:3, 3]
            near = np.hypot(x - true[0], y - true[1]) < 0.03
            assert abs(heightmap.height[near].max() - 0.048) < 0.004
    observation.save(tmp_path / "scene")
    assert camera_check.check(read_raw(tmp_path / "scene"), workspace) == []


@pytest.mark.release
def test_the_expert_solves_by_physics(world):
    solved = 0
    for seed in foreign_world.TEST_SEEDS[:12]:
        world.lay(random_scene(seed))
        assert not world.solved()
        solved += play(world, *world.expert()) and world.solved()
    assert solved >= 11


def test_only_the_picked_thing_moves_and_a_bowl_is_carried_with_what_lies_in_it(world):
    world.lay(PLAIN)
    before = poses(world)
    assert play(world, *world.expert()) and world.solved()
    moved = [np.linalg.norm(new[:3, 3] - old[:3, 3]) > 0.1 for old, new in zip(before, poses(world), strict=True)]
    assert moved == [True, False, False, False, False]
    x, y = BOWL
    assert play(world, (x + 0.07, y, 0.0), (0.42, -0.20, 1.0))
    assert math.dist(world.pose(1)[:2, 3], BOWL) > 0.3 and world.solved()


def test_an_empty_pick_and_one_that_stays_too_high_hold_nothing(world):
    world.lay(PLAIN)
    before = poses(world)
    for x, y, height in ((0.5, -0.15, 0.0), (0.5, -0.15, -0.02), (0.5, -0.15, 0.03), (*BLOCK, 0.062)):
        assert not world.pick_place(acting.tool_pose(x, y, 0, height), world.on_surface(*BOWL, 0))
        assert np.allclose(before, poses(world), atol=1e-3) and world.held is None and not world.solved()
    low = acting.tool_pose(*BLOCK, 0, 0.055)
    assert world.pick_place(low, world.on_surface(*BOWL, 0)) and world.solved()


def test_the_cup_takes_what_is_on_top(world):
    world.lay(PLAIN)
    put(world, 2, *BLOCK, 0.048)
    world.settle()
    assert play(world, (*BLOCK, 0.0), (0.40, 0.38, 0.0))
    assert math.dist(world.pose(2)[:2, 3], (0.40, 0.38)) < 0.01, "the upper block"
    assert math.dist(world.pose(0)[:2, 3], BLOCK) < 0.01, "not the lower one"


@pytest.mark.parametrize("turn", [-2.5, 0.4, 3.0])
def test_the_place_turns_the_block(turn, world):
    world.lay(PLAIN)
    old = world.pose(0)
    assert play(world, (*BLOCK, 0.3), (0.40, 0.38, 0.3 + turn))
    new = world.pose(0)
    turned = math.atan2(new[1, 0], new[0, 0]) - math.atan2(old[1, 0], old[0, 0])
    assert abs(wrap(turned - turn)) < math.radians(5)
    assert math.dist(new[:2, 3], (0.40, 0.38)) < 0.005 and abs(new[2, 3]) < 0.002 and new[2, 2] > 0.999


@pytest.mark.parametrize(
    ("pick", "place"), [((0.62, -0.35, 0.0), None), (None, (0.64, -0.08, 0.0)), (None, (BOWL[0], BOWL[1] + 0.13, 0.0))]
)
def test_the_wrong_block_the_wrong_bowl_and_beside_the_bowl_do_not_count(pick, place, world):
    world.lay(PLAIN)
    right_pick, right_place = world.expert()
    assert play(world, pick or right_pick, place or right_place) and not world.solved()
    lies_beside = abs((world.pose(0) @ MIDDLE)[2] - 0.024) < 0.002
    assert lies_beside or place == (0.64, -0.08, 0.0)


def test_a_block_on_the_rim_counts_only_when_it_has_fallen_in(world):
    outcomes = []
    for offset in (0.06, 0.075, 0.08, 0.085, 0.09):
        world.lay(PLAIN)
        assert play(world, world.expert()[0], (BOWL[0] + offset, BOWL[1], 0.0))
        corners = (np.linalg.inv(world.pose(1)) @ world.pose(0) @ CORNERS.T)[:3]
        inside = np.hypot(*corners[:2]).max() < 0.09 and corners[2].min() < 0.03
        assert world.solved() == inside
        outcomes.append(inside)
    assert set(outcomes) == {True, False}


def test_at_the_height_of_the_rim_is_not_inside(world):
    world.lay(PLAIN)
    put(world, 0, BOWL[0] + 0.05, BOWL[1], 0.052)
    assert not world.solved()
    put(world, 0, *BOWL, 0.007)
    assert world.solved()
    world._data.qvel[2] = 0.5
    assert not world.solved(), "it moves"
    world._data.qvel[:] = 0
    world.held = 0
    assert not world.solved(), "a tool holds it"


@pytest.mark.parametrize("pose", [np.eye(3), np.full((4, 4), np.nan)])
def test_what_is_no_pose_is_refused(pose, world):
    world.lay(PLAIN)
    with pytest.raises(ValueError, match=r"place must be a \(4, 4\) pose"):
        world.pick_place(np.eye(4), pose)
