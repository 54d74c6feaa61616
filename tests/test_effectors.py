"""End effectors: which actions they can do, and the push; picks and places are tested with the world."""

import math
from functools import partial

import numpy as np
import pytest

from gem_lite.actions import PickPlace, Push
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation import effectors
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.world import World

START, END = Pose2(0.45, 0.1), Pose2(0.45, -0.15)


@pytest.fixture
def pushing(world, stage, no_pictures, monkeypatch):
    """``pushing(build, ...)`` lays bodies out for the spatula."""

    def lay_out(*builders):
        stage()
        monkeypatch.setattr(type(world.task), "effector", "spatula")
        return stage(*builders)[0]

    return lay_out


def cube(pose, side=0.02):
    return partial(shapes.add_box, size=(side,) * 3, color=colors.rgba("red"), pose=pose)


def test_effectors_are_found_by_name():
    assert effectors.EFFECTORS.names() == ("suction", "low-suction", "jaw", "spatula")
    with pytest.raises(ValueError, match="no end effector is named 'spoon'; the nearest names: "):
        effectors.EFFECTORS.find("spoon")
    with World() as fresh, pytest.raises(ValueError, match="no end effector is named 'hand'"):
        fresh.clear("hand")


@pytest.mark.parametrize(("beside", "holds"), [(0.0045, True), (0.0055, False)])
def test_a_suction_cup_holds_what_its_rim_touches(blind, stage, beside, holds):
    stage(cube(Pose2(0.5, 0.0), 0.04))
    assert blind.step(PickPlace(Pose2(0.52 + beside, 0.0), Pose2(0.6, 0.2))).grasped is holds


def test_a_push_takes_a_body_to_its_end(world, pushing):
    (body,) = pushing(cube(START))
    step = world.step(Push(START, END))
    pose, z = world.pose(body)
    assert (step.grasped, world.effector.held) == (False, None)
    assert step.trace and not any(state.holding for state in step.trace)
    assert abs(pose.x - END.x) < 0.01
    assert 0 < END.y - pose.y < 0.03  # its near face is at the end, and it hardly slides on
    assert z == pytest.approx(0.01, abs=0.002)


def test_the_blade_stands_square_to_the_way(world, pushing):
    pushing()
    for degrees in (0, 60, -135):
        way = Pose2(0.5, 0.0, math.radians(degrees)) @ Pose2(0.1, 0.0)
        step = world.step(Push(Pose2(0.5, 0.0), Pose2(way.x, way.y)))
        sweeping = [state for state in step.trace if math.hypot(state.x - 0.5, state.y) < 0.05]
        assert np.median([math.degrees(state.yaw) for state in sweeping]) == pytest.approx(degrees, abs=2)


def test_a_blade_sweeps_several_bodies_at_once(world, pushing):
    bodies = pushing(*(cube(Pose2(0.45 + dx, 0.05), 0.012) for dx in (-0.015, 0.0, 0.015)))
    world.step(Push(Pose2(0.45, 0.05), END))
    assert all(world.pose(body)[0].y < END.y + 0.01 for body in bodies)


def test_the_parked_spatula_is_out_of_every_picture(world, stage):
    _, before = stage()
    world.clear("spatula")
    (after,) = world.observe()
    for one, other in zip(before.views, after.views, strict=True):
        np.testing.assert_array_equal(one.rgb, other.rgb)


def test_a_tool_refuses_what_it_cannot_do(world, stage, pushing):
    (body,), _ = stage(cube(START))
    with pytest.raises(ValueError, match="action must be a PickPlace for the tool Suction, got a Push"):
        world.step(Push(START, END))
    assert (world.steps_taken, world.pose(body)[0].y) == (0, pytest.approx(START.y, abs=1e-3))
    pushing(cube(START))
    with pytest.raises(ValueError, match="action must be a Push for the tool Spatula, got a PickPlace"):
        world.step(PickPlace(START, END))


@pytest.mark.parametrize(
    ("push", "said"),
    [
        (Push(Pose2(0.2, 0.0), END), r"action\.start = .* lies outside the workspace"),
        (Push(START, Pose2(0.5, 0.6)), r"action\.end = .* lies outside the workspace"),
        (Push(START, START), "must be different places"),
        (Push(START, Pose2(0.5, 0.0, math.inf)), r"action\.end = .* not a finite number"),
        (Push(START, END, table=1), r"action\.table must be in \[0, 1\), got 1"),
    ],
)
def test_a_push_that_cannot_be_is_refused(world, pushing, push, said):
    pushing()
    with pytest.raises(ValueError, match=said):
        world.step(push)
    assert world.steps_taken == 0
