"""Gripper, world, tasks and colours."""

import itertools
import math
from functools import partial

import numpy as np
import pybullet as p
import pytest

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.effectors import planar
from gem_lite.simulation.rendering import render
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

HERE, THERE = Pose2(0.4, 0.2, 0.5), Pose2(0.6, -0.2, 0.5)
MOVE = PickPlace(HERE, THERE)
SEEN_TASK, UNSEEN_TASK = "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors"


def block(pose=HERE, color="red"):
    return partial(shapes.add_block, color=colors.rgba(color), pose=pose)


def bowl(pose, movable=False):
    return partial(shapes.add_bowl, color=colors.rgba("green"), pose=pose, movable=movable)


def distance(a, b):
    return math.hypot(a.x - b.x, a.y - b.y)


@pytest.mark.parametrize("name", ["home", "bright-light", "shadows"])
def test_pictures_with_a_stored_floor_are_those_with_a_rendered_floor(name):
    with World(style=looks.style(name)) as world:
        for task in (SEEN_TASK, "packing-shapes-seen"):
            (observation,) = world.reset(tasks.make(task, "val"), seed=1)
            for view in observation.views:
                whole, _ = render(world.client, view.camera, world.style.light)
                assert (view.rgb == whole.rgb).all()
                assert (view.depth == whole.depth).all()


# Colours -------------------------------------------------------------------------------------------------


def test_colour_sets_are_cliports():
    assert set(colors.SEEN) & set(colors.UNSEEN) == {"blue", "red", "green"}
    assert set(colors.NEW) == {"orange", "purple", "pink", "white"}
    assert set(colors.SEEN) | set(colors.UNSEEN) == set(colors.RGB)
    assert colors.rgba("red") == pytest.approx((1.0, 87 / 255, 89 / 255, 1.0))


# Gripper -------------------------------------------------------------------------------------------------


def test_a_block_is_carried_by_the_tool(world, stage):
    (body,), _ = stage(block())
    seen = {}

    def watch(moment):
        seen[moment] = (*world.pose(body), world.effector.held)

    step = world.step(MOVE, watch)
    pose, z, held = seen["picked"]
    assert z > 0.1 and held == body.id  # in the air, still above where it lay
    assert distance(pose, HERE) < 0.005
    pose, z, held = seen["placed"]
    assert z == pytest.approx(body.rest_height, abs=0.001) and held is None
    assert distance(pose, THERE) < 0.003
    assert step.grasped


def test_a_carried_block_never_jumps(world, stage, monkeypatch):
    (body,), _ = stage(block())
    path, simulate = [], p.stepSimulation

    def recorded(**kwargs):
        simulate(**kwargs)
        path.append(p.getBasePositionAndOrientation(body.id, physicsClientId=world.client)[0])

    monkeypatch.setattr(p, "stepSimulation", recorded)
    world.step(MOVE)
    strides = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert strides.sum() > distance(HERE, THERE)  # it went all the way,
    assert strides.max() < 0.01  # and no simulation step took it far


def test_what_is_held_collides(world, stage):
    # Lowered onto another block, it comes to rest on top of it.
    (moved, support), _ = stage(block(), block(THERE, "blue"))
    world.step(MOVE)
    assert world.pose(moved)[1] == pytest.approx(0.06, abs=0.002)
    assert world.pose(support)[1] == pytest.approx(0.02, abs=0.002)


def test_the_block_keeps_its_yaw_to_the_tool(world, stage):
    (body,), _ = stage(block())
    world.step(PickPlace(Pose2(HERE.x, HERE.y, -1.0), Pose2(THERE.x, THERE.y, -0.3)))
    assert world.pose(body)[0].yaw == pytest.approx(HERE.yaw + 0.7, abs=0.02)


def test_the_tool_turns_the_short_way(world, stage, monkeypatch):
    stage(block())
    yaws, simulate = [], p.stepSimulation

    def recorded(**kwargs):
        simulate(**kwargs)
        yaws.append(planar(world.client, world.effector.id).yaw)

    world.effector.pick(Pose2(HERE.x, HERE.y, 3.0), set())
    monkeypatch.setattr(p, "stepSimulation", recorded)
    world.effector.pick(Pose2(HERE.x, HERE.y, -3.0), set())
    assert min(abs(yaw) for yaw in yaws) > 2.9


def test_picking_the_empty_table_grasps_nothing_and_ends_the_action(world, stage):
    (body,), _ = stage(block())
    before, moments = world.pose(body)[0], []
    step = world.step(PickPlace(THERE, HERE), watch=lambda moment: moments.append((moment, world.effector.held)))
    assert not step.grasped
    assert step.reward == 0.0
    assert moments == [("picked", None), ("placed", None)]
    assert distance(world.pose(body)[0], before) < 0.001
    assert world.steps_taken == 1


RIM = PickPlace(Pose2(HERE.x + 0.053, HERE.y), Pose2(THERE.x + 0.053, THERE.y))
"""Grasps a bowl at HERE by its rim and takes it to THERE."""


@pytest.mark.parametrize(("movable", "end", "near"), [(False, HERE, 1e-6), (True, THERE, 0.01)])
def test_a_bowl_is_picked_if_it_can_move(blind, stage, movable, end, near):
    (body,), _ = stage(bowl(HERE, movable))
    assert blind.step(RIM).grasped is movable
    assert distance(blind.pose(body)[0], end) < near


def test_a_block_stays_on_the_floor_of_a_bowl(blind, stage):
    (moved, _), _ = stage(block(), bowl(THERE))
    blind.step(MOVE)
    pose, z = blind.pose(moved)
    assert distance(pose, THERE) < 0.03
    assert z == pytest.approx(0.01 + shapes.BLOCK_SIZE / 2, abs=0.003)


def test_the_parked_tool_is_out_of_every_picture(world, stage):
    _, before = stage()
    world.effector.pick(HERE, set())
    (in_sight,) = world.observe()
    world.effector.park()
    (after,) = world.observe()
    for empty, busy, parked in zip(before.views, in_sight.views, after.views, strict=True):
        assert not np.array_equal(busy.rgb, empty.rgb)
        np.testing.assert_array_equal(parked.rgb, empty.rgb)


# World ---------------------------------------------------------------------------------------------------


def test_every_world_has_a_client_of_its_own():
    with World() as first, World() as second:
        assert first.client != second.client
        first.clear()
        second.clear()
        count = p.getNumBodies(physicsClientId=second.client)
        first.add(block()(first.client))
        assert p.getNumBodies(physicsClientId=first.client) == count + 1
        assert p.getNumBodies(physicsClientId=second.client) == count
        first.close()
        assert p.isConnected(second.client)


def test_close_twice_is_safe():
    world = World()
    client = world.client
    world.close()
    world.close()
    assert world.client == -1
    assert not p.isConnected(client)


def test_no_task_before_reset():
    with World() as fresh:
        with pytest.raises(RuntimeError, match="reset"):
            _ = fresh.task
        with pytest.raises(RuntimeError, match="reset"):
            fresh.step(MOVE)


@pytest.mark.parametrize("name", ["pick", "place"])
@pytest.mark.parametrize("pose", [Pose2(0.2, 0.0), Pose2(0.5, 0.51), Pose2(0.76, 0.0), Pose2(math.nan, 0.0)])
def test_action_outside_the_workspace_raises_and_moves_nothing(world, stage, name, pose):
    (body,), _ = stage(block())
    poses = {"pick": HERE, "place": THERE, name: pose}
    with pytest.raises(ValueError, match=rf"action\.{name}.*outside the workspace"):
        world.step(PickPlace(**poses))
    poses[name] = Pose2(HERE.x, HERE.y, math.nan)
    with pytest.raises(ValueError, match=rf"action\.{name}.*not a finite number"):
        world.step(PickPlace(**poses))
    assert world.steps_taken == 0
    assert distance(world.pose(body)[0], HERE) < 0.001


def test_reward_is_the_change_of_the_score(world, stage):
    def right_half(poses):
        return sum(pose.y < 0 for pose, _ in poses) / len(poses)

    other = Pose2(0.4, 0.05, 0.0)
    stage(block(), max_steps=2)
    assert [world.step(MOVE).done, world.step(PickPlace(THERE, HERE)).done] == [False, True]  # without success
    stage(block(), block(other, "blue"), score=right_half)
    first = world.step(MOVE)
    assert (first.reward, first.done) == (0.5, False)
    back = world.step(PickPlace(THERE, HERE))
    assert (back.reward, back.done) == (-0.5, False)
    world.step(MOVE)
    last = world.step(PickPlace(other, Pose2(0.4, -0.1, 0.0)))
    assert (last.reward, last.done) == (0.5, True)
    assert world.steps_taken == 4


def test_reset_clears_what_was_there(world, stage):
    stage(block(), block(THERE, "blue"))
    world.step(MOVE)
    (body,), observation = stage(block())
    assert [b.id for b in world.bodies] == [body.id]
    assert world.steps_taken == 0
    assert len(observation.views) == 3


def test_a_tipped_scene_settles(world, stage):
    def dropped(client):
        body = block()(client)
        p.resetBasePositionAndOrientation(body.id, (0.5, 0, 0.15), (0, 0, 0, 1), physicsClientId=client)
        return body

    (body,), _ = stage(dropped)
    assert world.settle()
    assert world.pose(body)[1] == pytest.approx(0.02, abs=0.001)


@pytest.mark.parametrize("seed", [7, 2_000_003])
def test_one_seed_is_one_picture_in_any_world(world, seed):
    # The shared world has a history, the fresh one has none.
    with World() as fresh:
        pair = [w.reset(tasks.make(UNSEEN_TASK, "test"), seed)[0] for w in (world, fresh)]
    for a, b in zip(pair[0].views, pair[1].views, strict=True):
        assert np.array_equal(a.rgb, b.rgb)
        assert np.array_equal(a.depth, b.depth)


def test_another_seed_is_another_picture(world):
    one, two = (world.reset(tasks.make(SEEN_TASK), seed)[0] for seed in (1, 2))
    assert not np.array_equal(one.views[0].rgb, two.views[0].rgb)


# Tasks ---------------------------------------------------------------------------------------------------


def test_unknown_task_names_the_nearest():
    with pytest.raises(ValueError, match=f"'put-block-in-bowl-unseen-color'.*{UNSEEN_TASK}"):
        tasks.make("put-block-in-bowl-unseen-color")
    with pytest.raises(ValueError, match=SEEN_TASK):
        tasks.make("")


@pytest.mark.parametrize("call", [partial(tasks.make, SEEN_TASK, "tset"), partial(tasks.episode_seed, "tset", 0)])
def test_unknown_split_names_the_splits(call):
    with pytest.raises(ValueError, match="train, val, test"):
        call()


def test_seed_ranges_of_the_splits_are_disjoint():
    ranges = [(tasks.episode_seed(split, 0), tasks.episode_seed(split, 999_999)) for split in ("train", "val", "test")]
    assert ranges == sorted(ranges)
    assert all(last < first for (_, last), (first, _) in itertools.pairwise(ranges))


@pytest.mark.parametrize("index", [-1, 1_000_000])
def test_an_index_that_would_leave_its_range_raises(index):
    with pytest.raises(ValueError, match="index"):
        tasks.episode_seed("train", index)


def test_free_space_says_when_it_is_full():
    free = FreeSpace(Workspace(), np.random.default_rng(0))
    found = [free.sample(0.12) for _ in range(15)]
    placed = [pose for pose in found if pose]
    assert 1 < len(placed) < 15 and found[-1] is None
    assert min(distance(a, b) for i, a in enumerate(placed) for b in placed[:i]) >= 0.24 + 0.015
