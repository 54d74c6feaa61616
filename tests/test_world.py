"""The world of one table: end effectors, actions and their refusals, pictures, and the tasks by name."""

import dataclasses
import itertools
import math
from functools import partial

import numpy as np
import pybullet as p
import pytest
from tabletop import HERE, MOVE, THERE, block, bowl, distance

from gem_lite import tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace, angle_off
from gem_lite.simulation import effectors, looks
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.rendering import render
from gem_lite.simulation.world import World
from gem_lite.tasks.spawn import FreeSpace

SEEN_TASK, UNSEEN_TASK = "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors"
START, END = Pose2(0.45, 0.1), Pose2(0.45, -0.15)


def cube(pose, side=0.02):
    return partial(shapes.add_box, size=(side,) * 3, color=colors.rgba("red"), pose=pose)


@pytest.mark.parametrize(
    ("name", "task"), [("home", SEEN_TASK), ("bright-light", "packing-shapes-seen"), ("shadows", SEEN_TASK)]
)
def test_pictures_with_a_stored_floor_are_those_with_a_rendered_floor(name, task):
    with World(style=looks.style(name)) as world:
        (observation,) = world.reset(tasks.make(task, "val"), seed=1)
        for view in observation.views:
            whole, _ = render(world.client, view.camera, world.style.light)
            assert (view.rgb == whole.rgb).all() and (view.depth == whole.depth).all()


def test_colour_sets_are_cliports():
    assert set(colors.SEEN) & set(colors.UNSEEN) == {"blue", "red", "green"}
    assert set(colors.NEW) == {"orange", "purple", "pink", "white"}
    assert set(colors.SEEN) | set(colors.UNSEEN) == set(colors.RGB)
    assert colors.rgba("red") == pytest.approx((1.0, 87 / 255, 89 / 255, 1.0))


def test_a_block_is_carried_by_the_tool_and_never_jumps(blind, stage, monkeypatch):
    (body,), _ = stage(block())
    seen, path, simulate = {}, [], p.stepSimulation

    def recorded(**kwargs):
        simulate(**kwargs)
        path.append(p.getBasePositionAndOrientation(body.id, physicsClientId=blind.client)[0])

    def watch(moment):
        seen[moment] = (*blind.pose(body), blind.effector.held)

    monkeypatch.setattr(p, "stepSimulation", recorded)
    assert blind.step(PickPlace(Pose2(HERE.x, HERE.y, -1.0), Pose2(THERE.x, THERE.y, -0.3)), watch).grasped
    pose, z, held = seen["picked"]
    assert z > 0.1 and held == body.id and distance(pose, HERE) < 0.005  # in the air, still above where it lay
    pose, z, held = seen["placed"]
    assert z == pytest.approx(body.rest_height, abs=0.001) and held is None
    assert distance(pose, THERE) < 0.003
    assert pose.yaw == pytest.approx(HERE.yaw + 0.7, abs=0.02)  # it keeps its yaw to the tool
    strides = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert strides.sum() > distance(HERE, THERE)  # it went all the way,
    assert strides.max() < 0.01  # and no simulation step took it far


@pytest.mark.parametrize(("below", "height", "near"), [(block(THERE, "blue"), 0.06, 0.003), (bowl(THERE), 0.03, 0.03)])
def test_what_is_held_comes_to_rest_on_what_is_below(blind, stage, below, height, near):
    (moved, support), _ = stage(block(), below)
    blind.step(MOVE)
    pose, z = blind.pose(moved)
    assert z == pytest.approx(height, abs=0.003) and distance(pose, THERE) < near
    assert blind.pose(support)[1] == pytest.approx(support.rest_height, abs=0.002)


def test_the_tool_turns_the_short_way(blind, stage, monkeypatch):
    stage(block())
    yaws, simulate = [], p.stepSimulation

    def recorded(**kwargs):
        simulate(**kwargs)
        yaws.append(effectors.planar(blind.client, blind.effector.id).yaw)

    blind.effector.pick(Pose2(HERE.x, HERE.y, 3.0), set())
    monkeypatch.setattr(p, "stepSimulation", recorded)
    blind.effector.pick(Pose2(HERE.x, HERE.y, -3.0), set())
    assert min(abs(yaw) for yaw in yaws) > 2.9


def test_picking_the_empty_table_grasps_nothing_and_ends_the_action(blind, stage):
    (body,), _ = stage(block())
    before, moments = blind.pose(body)[0], []
    step = blind.step(PickPlace(THERE, HERE), watch=lambda moment: moments.append((moment, blind.effector.held)))
    assert (step.grasped, step.reward, blind.steps_taken) == (False, 0.0, 1)
    assert moments == [("picked", None), ("placed", None)]
    assert distance(blind.pose(body)[0], before) < 0.001


@pytest.mark.parametrize(("movable", "end", "near"), [(False, HERE, 1e-6), (True, THERE, 0.01)])
def test_a_bowl_is_picked_by_its_rim_if_it_can_move(blind, stage, movable, end, near):
    (body,), _ = stage(bowl(HERE, movable))
    step = blind.step(PickPlace(Pose2(HERE.x + 0.053, HERE.y), Pose2(THERE.x + 0.053, THERE.y)))
    assert step.grasped is movable and distance(blind.pose(body)[0], end) < near


@pytest.mark.parametrize(("beside", "holds"), [(0.0045, True), (0.0055, False)])
def test_a_suction_cup_holds_what_its_rim_touches(blind, stage, beside, holds):
    stage(cube(Pose2(0.5, 0.0), 0.04))
    assert blind.step(PickPlace(Pose2(0.52 + beside, 0.0), Pose2(0.6, 0.2))).grasped is holds


def test_parked_tools_are_out_of_every_picture(world, stage):
    _, empty = stage()
    world.effector.pick(HERE, set())
    (busy,) = world.observe()
    world.effector.park()
    (parked,) = world.observe()
    world.clear("spatula")
    (spatula,) = world.observe()
    for at, view in enumerate(empty.views):
        assert not np.array_equal(busy.views[at].rgb, view.rgb)
        assert np.array_equal(parked.views[at].rgb, view.rgb) and np.array_equal(spatula.views[at].rgb, view.rgb)


@pytest.fixture
def pushing(blind, stage, monkeypatch):
    """``pushing(build, ...)`` lays bodies out for the spatula."""

    def lay_out(*builders):
        stage()
        monkeypatch.setattr(type(blind.task), "effector", "spatula")
        return stage(*builders)[0]

    return lay_out


def test_effectors_are_found_by_name():
    assert effectors.EFFECTORS.names() == (
        "suction", "narrow-suction", "low-suction", "jaw", "parallel-jaw", "spatula", "panda",
    )  # fmt: skip
    with World() as fresh, pytest.raises(ValueError, match="no end effector is named 'spoon'; the nearest names: "):
        fresh.clear("spoon")


def test_a_push_takes_a_body_to_its_end(blind, pushing):
    (body,) = pushing(cube(START))
    step = blind.step(Push(START, END))
    pose, z = blind.pose(body)
    assert (step.grasped, blind.effector.held) == (False, None)
    assert step.trace and not any(state.holding for state in step.trace)
    assert abs(pose.x - END.x) < 0.01
    assert 0 < END.y - pose.y < 0.03  # its near face is at the end, and it hardly slides on
    assert z == pytest.approx(0.01, abs=0.002)


def test_the_blade_stands_square_to_the_way_and_sweeps_several_bodies_at_once(blind, pushing):
    bodies = pushing(*(cube(Pose2(0.45 + dx, 0.05), 0.012) for dx in (-0.015, 0.0, 0.015)))
    blind.step(Push(Pose2(0.45, 0.05), END))
    assert all(blind.pose(body)[0].y < END.y + 0.01 for body in bodies)
    for degrees in (0, 60, -135):
        way = Pose2(0.5, 0.1, math.radians(degrees)) @ Pose2(0.1, 0.0)
        step = blind.step(Push(Pose2(0.5, 0.1), Pose2(way.x, way.y)))
        sweeping = [state for state in step.trace if math.hypot(state.x - 0.5, state.y - 0.1) < 0.05]
        assert np.median([math.degrees(state.yaw) for state in sweeping]) == pytest.approx(degrees, abs=2)


OUTSIDE, NO_YAW = "lies outside the workspace", "not a finite number"
BEYOND = [Pose2(0.2, 0.0), Pose2(0.5, 0.51), Pose2(0.76, 0.0), Pose2(math.nan, 0.0)]


@pytest.mark.parametrize(
    ("action", "said"),
    [
        *((PickPlace(pose, THERE), rf"action\.pick = .* {OUTSIDE}") for pose in BEYOND),
        *((PickPlace(HERE, pose), rf"action\.place = .* {OUTSIDE}") for pose in BEYOND),
        (PickPlace(Pose2(HERE.x, HERE.y, math.nan), THERE), rf"action\.pick = .*{NO_YAW}"),
        (PickPlace(HERE, Pose2(HERE.x, HERE.y, math.nan)), rf"action\.place = .*{NO_YAW}"),
        (Push(Pose2(0.2, 0.0), END), rf"action\.start = .* {OUTSIDE}"),
        (Push(START, Pose2(0.5, 0.6)), rf"action\.end = .* {OUTSIDE}"),
        (Push(START, START), "must be different places"),
        (Push(START, Pose2(0.5, 0.0, math.inf)), rf"action\.end = .* {NO_YAW}"),
        (Push(START, END, table=1), r"action\.table must be in \[0, 1\), got 1"),
    ],
)
def test_what_cannot_be_done_is_refused_and_nothing_moves(blind, stage, pushing, action, said):
    (body,) = pushing(block()) if isinstance(action, Push) else stage(block())[0]
    with pytest.raises(ValueError, match=said):
        blind.step(action)
    own, other = ("Spatula", MOVE) if isinstance(action, Push) else ("Suction", Push(START, END))
    with pytest.raises(ValueError, match=rf"action must be a .* for the tool {own}, got a {type(other).__name__}"):
        blind.step(other)
    assert blind.steps_taken == 0 and distance(blind.pose(body)[0], HERE) < 0.001


def test_every_world_has_a_client_of_its_own_and_may_be_closed_twice():
    with World() as first, World() as second:
        assert first.client != second.client
        first.clear()
        second.clear()
        count = p.getNumBodies(physicsClientId=second.client)
        first.add(block()(first.client))
        assert p.getNumBodies(physicsClientId=first.client) == count + 1
        assert p.getNumBodies(physicsClientId=second.client) == count
        client = first.client
        first.close()
        first.close()
        assert not p.isConnected(client) and p.isConnected(second.client)
        with pytest.raises(RuntimeError, match="reset"):
            _ = second.task
        with pytest.raises(RuntimeError, match="reset"):
            second.step(MOVE)


@pytest.mark.parametrize(("beside", "holds"), [(0.0, True), (0.0005, True), (0.0045, False)])
def test_a_narrow_suction_holds_no_cube_beside_its_tip(beside, holds):
    with World(style=looks.style("narrow-suction")) as world:
        world.clear(world.style.tool("suction"))
        world.add(cube(Pose2(0.5, 0.0), 0.04)(world.client))
        assert world.effector.pick(Pose2(0.52 + beside, 0.0), world.bodies) is holds
        if holds:
            world.effector.place(THERE)
    assert looks.style("narrow-suction").tool("spatula") == "spatula"


@pytest.mark.parametrize("tool", ["suction", "narrow-suction"])
def test_what_a_cup_holds_turns_along(tool):
    with World() as world:
        world.clear(tool)
        body = world.add(shapes.add_l_block(world.client, colors.rgba("red"), HERE))
        world.settle()
        corner = HERE @ Pose2(-0.03, -0.03)
        assert world.effector.pick(corner, world.bodies)
        goal = dataclasses.replace(THERE, yaw=HERE.yaw + 2.5)
        world.effector.carry(goal)
        pose, expected = world.pose(body)[0], goal @ (corner.inverse() @ HERE)
        assert distance(pose, expected) < 0.004 and angle_off(pose.yaw - expected.yaw, math.tau) < np.radians(1)


def test_of_two_touched_bodies_a_narrow_suction_tries_the_nearer_one_first():
    with World() as world:
        world.clear("narrow-suction")
        far, near = (world.add(cube(Pose2(0.5, y), 0.04)(world.client)) for y in (0.0219, -0.0212))
        world.effector._move(np.array([0.5, 0.0, 0.03]), 0.0)
        assert world.effector.in_order({far.id, near.id}) == [near.id, far.id]


def test_a_closed_world_says_that_it_is_closed():
    world, task = World(), tasks.make("put-block-in-bowl-seen-colors")
    world.reset(task, 0)
    world.close()
    with pytest.raises(RuntimeError, match="the world is closed: make a new one"):
        world.reset(task, 0)
    with pytest.raises(RuntimeError, match="no task"):
        world.step(MOVE)
    for call in (world.observe, world.clear, world.settle, lambda: world.client):
        with pytest.raises(RuntimeError, match="the world is closed: make a new one"):
            call()


def test_reward_is_the_change_of_the_score(blind, stage):
    def right_half(poses):
        return sum(pose.y < 0 for pose, _ in poses) / len(poses)

    other = Pose2(0.4, 0.05, 0.0)
    stage(block(), max_steps=2)
    assert [blind.step(MOVE).done, blind.step(PickPlace(THERE, HERE)).done] == [False, True]  # without success
    bodies, _ = stage(block(), block(other, "blue"), score=right_half)
    assert blind.bodies == bodies and blind.steps_taken == 0
    moves = (MOVE, PickPlace(THERE, HERE), MOVE, PickPlace(other, Pose2(0.4, -0.1, 0.0)))
    steps = [blind.step(move) for move in moves]
    assert [(step.reward, step.done) for step in steps] == [(0.5, False), (-0.5, False), (0.5, False), (0.5, True)]
    assert blind.steps_taken == 4


@pytest.mark.parametrize("seed", [7, 2_000_003])
def test_one_seed_is_one_picture_in_any_world(world, seed):
    # The shared world has a history, the fresh one has none.
    with World() as fresh:
        pair = [w.reset(tasks.make(UNSEEN_TASK, "test"), seed)[0] for w in (world, fresh)]
    for a, b in zip(pair[0].views, pair[1].views, strict=True):
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (partial(tasks.make, "put-block-in-bowl-unseen-color"), f"'put-block-in-bowl-unseen-color'.*{UNSEEN_TASK}"),
        (partial(tasks.make, ""), SEEN_TASK),
        (partial(tasks.make, SEEN_TASK, "tset"), "train, val, test"),
        (partial(tasks.episode_seed, "tset", 0), "train, val, test"),
        (partial(tasks.episode_seed, "train", -1), "index"),
        (partial(tasks.episode_seed, "train", 1_000_000), "index"),
    ],
)
def test_unknown_tasks_and_splits_and_indices_out_of_range_are_named(call, said):
    with pytest.raises(ValueError, match=said):
        call()


def test_seed_ranges_of_the_splits_are_disjoint():
    ranges = [(tasks.episode_seed(split, 0), tasks.episode_seed(split, 999_999)) for split in ("train", "val", "test")]
    assert ranges == sorted(ranges)
    assert all(last < first for (_, last), (first, _) in itertools.pairwise(ranges))


def test_free_space_says_when_it_is_full():
    free = FreeSpace(Workspace(), np.random.default_rng(0))
    found = [free.sample(0.12) for _ in range(15)]
    placed = [pose for pose in found if pose]
    assert 1 < len(placed) < 15 and found[-1] is None
    assert min(distance(a, b) for i, a in enumerate(placed) for b in placed[:i]) >= 0.24 + 0.015
