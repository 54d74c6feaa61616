"""The Panda: what it reaches, holds by friction, drops and puts back; and an expert that uses it."""

import dataclasses
from functools import partial

import numpy as np
import pybullet as p
import pytest
from tabletop import HERE, THERE, block, distance, lay_out, play

from gem_lite.actions import Outcome
from gem_lite.foundations import colors
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2, Workspace, angle_off
from gem_lite.simulation import looks, panda
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.grips import Surfaces
from gem_lite.simulation.mobile_world import MobileWorld
from gem_lite.simulation.world import World
from gem_lite.tasks import pick_object_part

CORNER = Pose2(0.745, 0.495)


@pytest.fixture
def cell():
    """A world with the arm, and a block at `HERE`."""
    with World(style=looks.style("panda")) as world:
        world.clear(world.style.tool("suction"))
        body = world.add(block()(world.client))
        world.settle()
        yield world, world.effector, body


def test_a_block_is_held_by_friction_carried_and_put_down(cell):
    world, arm, body = cell
    assert arm.pick(HERE, world.bodies) and arm.held == body.id and arm.outcome is Outcome.HELD
    assert world.pose(body)[1] > 0.1, "it is in the air, and no constraint holds it"
    assert p.getNumConstraints(physicsClientId=world.client) == 1, "the one that couples the fingers"
    arm.place(dataclasses.replace(THERE, yaw=HERE.yaw + 0.7))
    pose, height = world.pose(body)
    assert arm.outcome is Outcome.PLACED and arm.held is None
    assert distance(pose, THERE) < 0.003 and height == pytest.approx(0.02, abs=0.001)
    assert angle_off(pose.yaw - HERE.yaw - 0.7, np.pi / 2) < np.radians(3)
    holding = [state.holding for state in world.trace]
    assert holding.count(True) > 10 and not holding[0] and not holding[-1]
    first_held = world.trace[holding.index(True)]
    assert distance(first_held, HERE) < 0.005 and angle_off(first_held.yaw - HERE.yaw, np.pi) < np.radians(3)


def test_beside_a_block_nothing_is_held(cell):
    world, arm, body = cell
    before = world.pose(body)[0]
    assert not arm.pick(Pose2(HERE.x + 0.08, HERE.y), world.bodies)
    assert arm.outcome is Outcome.NOTHING_HELD and distance(world.pose(body)[0], before) < 0.001


def test_what_is_out_of_reach_is_said_and_nothing_moves(cell):
    world, arm, _ = cell
    joints = [p.getJointState(arm.id, joint, physicsClientId=world.client)[0] for joint in panda.ARM]
    assert not arm.pick(CORNER, world.bodies) and arm.outcome is Outcome.OUT_OF_REACH
    after = [p.getJointState(arm.id, joint, physicsClientId=world.client)[0] for joint in panda.ARM]
    assert joints == after


def test_what_cannot_be_placed_is_put_back(cell):
    world, arm, body = cell
    assert arm.pick(HERE, world.bodies)
    arm.place(CORNER)
    assert arm.outcome is Outcome.OUT_OF_REACH and arm.held is None
    pose, height = world.pose(body)
    assert distance(pose, HERE) < 0.005 and height == pytest.approx(0.02, abs=0.001)


def test_what_is_lost_on_the_way_is_noticed(cell):
    world, arm, body = cell
    assert arm.pick(HERE, world.bodies)
    p.resetBasePositionAndOrientation(body.id, (0.3, -0.3, 0.02), (0, 0, 0, 1), physicsClientId=world.client)
    arm.place(THERE)
    assert (
        arm.outcome is Outcome.DROPPED and arm.held is None and distance(world.pose(body)[0], Pose2(0.3, -0.3)) < 0.01
    )


def test_fingers_end_just_above_the_table(cell):
    world, arm, _ = cell
    assert not arm.pick(Pose2(0.5, 0.0), world.bodies)
    arm._go_down(Pose2(0.5, 0.0), lambda: False)
    closest = partial(p.getClosestPoints, arm.id, distance=0.02, physicsClientId=world.client)
    gaps = [
        point[panda.DISTANCE]
        for finger in panda.FINGERS
        for body in range(p.getNumBodies(physicsClientId=world.client))
        if body != arm.id
        for point in closest(body, linkIndexA=finger)
    ]
    assert min(gaps) == pytest.approx(panda.ABOVE_TABLE, abs=0.0005)


@pytest.mark.parametrize("gap", [0.03, 0.008])
def test_the_gripper_opens_as_wide_as_it_has_room(cell, gap):
    world, arm, body = cell
    for side in (-1, 1):
        world.add(block(HERE @ Pose2(0.0, side * (0.04 + gap)))(world.client))
    world.settle()
    others = [world.pose(other)[0] for other in world.bodies[1:]]
    assert arm.pick(HERE, world.bodies) and arm.held == body.id
    assert all(distance(world.pose(b)[0], pose) < 0.001 for b, pose in zip(world.bodies[1:], others, strict=True))


def test_an_arm_that_cannot_turn_on_grasps_again(cell):
    world, arm, body = cell
    places = [dataclasses.replace(THERE, yaw=yaw) for yaw in np.radians(range(0, 360, 20))]
    assert arm.pick(HERE, world.bodies)
    beyond = [pose for pose in places if arm._reach(pose, (arm._half_turn,)) is None]
    assert 0 < len(beyond) < len(places) / 4, "one half turn reaches most yaws, and not all"
    arm.place(beyond[0])
    assert arm.outcome is Outcome.PLACED
    pose, _ = world.pose(body)
    assert distance(pose, THERE) < 0.003 and angle_off(pose.yaw - beyond[0].yaw, np.pi / 2) < np.radians(3)


def test_a_handle_is_held_by_the_handle():
    with World(style=looks.style("real-table-panda")) as world:
        world.clear("panda")
        color = colors.rgba("red")
        mug = world.add(objects.add_object(world.client, "mug", color, HERE, scale=0.5, by_part=True))
        world.settle()
        for part in ("handle", "brim"):
            grasp = pick_object_part.central_grasp(Surfaces.of(world.client, [mug]), mug, part)
            held = world.effector.pick(grasp, world.bodies)
            assert part == "brim" or (held and world.effector.grip.part == "handle")
            world.effector.park()
            world.settle()


def test_an_expert_leaves_what_fell_off_the_table(no_pictures):
    with World() as world:
        task = lay_out(world, "put-block-in-bowl-seen-colors")
        body = task.goals[0].bodies[0]
        p.resetBasePositionAndOrientation(body.id, (1.5, 0.0, 0.02), (0, 0, 0, 1), physicsClientId=world.client)
        assert task.expert(world) is None


def test_a_parked_arm_is_in_no_height_map(cell):
    world, arm, _ = cell
    arm.park()
    heightmap = fuse_views(world.observe()[0].views, Workspace())
    height = heightmap.height.copy()
    row, col = Workspace().nearest_cell(HERE.x, HERE.y)
    height[row - 6 : row + 7, col - 6 : col + 7] = 0
    assert np.abs(height).max() < 0.002 and heightmap.seen.mean() > 0.97


def test_the_arm_is_no_robots_tool():
    with pytest.raises(ValueError, match="in 'panda' it stands at one table"):
        MobileWorld(style=looks.style("panda"))


@pytest.mark.parametrize(
    ("style", "name"),
    [
        ("panda", "put-block-in-bowl-seen-colors"),
        ("panda", "bars-in-box"),
        pytest.param("real-table-panda", "block-stacking-pyramid-seen", marks=pytest.mark.release),
    ],
)
def test_an_expert_plays_an_episode_with_the_arm(no_pictures, style, name):
    with World(style=looks.style(style)) as world:
        steps = play(world, lay_out(world, name)).steps
        assert sum(step.reward for step in steps) == pytest.approx(1.0)
        assert isinstance(world.effector, panda.Panda)
        assert {step.outcome for step in steps} == {Outcome.PLACED}
