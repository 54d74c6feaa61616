"""The paper's real tables: their size and cameras, the parallel jaw, and the parts of objects."""

import math

import numpy as np
import pytest
from tabletop import lay_out

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.policies.cliport import ClipPortConfig
from gem_lite.policies.gem_config import LITE, PAPER
from gem_lite.se2 import Pose2
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import objects, shapes
from gem_lite.simulation.grips import Surfaces
from gem_lite.simulation.rendering import cameras_around
from gem_lite.tasks import pick_object_part, real_table

SEEN, UNSEEN = "pick-object-part-in-brown-box-seen", "pick-object-part-in-brown-box-unseen"
TABLE = real_table.WORKSPACE
LIMITS = TABLE.limits
MIDDLE = Pose2(0.5, 0.0)
GRAY = (0.5, 0.5, 0.5, 1.0)


def held(world, pose, *bodies):
    """The number of the body that a jaw holds at a pose, and its part; None if it holds nothing."""
    grip = Surfaces.of(world.client, bodies).grip(pose)
    return grip and ([body.id for body in bodies].index(grip.body), grip.part)


def box(world, size, pose=MIDDLE, movable=True):
    return shapes.add_box(world.client, size, GRAY, pose, movable=movable)


def lying(world, name, variant=1000):
    """An object at rest in the middle of the table."""
    world.clear("parallel-jaw")
    body = world.add(objects.add_object(world.client, name, GRAY, MIDDLE, variant, scale=real_table.SCALE))
    world.wait(0.5)
    return body


@pytest.mark.parametrize("degrees", range(0, 180, 5))
def test_the_yaw_of_a_jaw_decides(blind, degrees):
    blind.clear("parallel-jaw")
    off = abs((degrees + 45) % 90 - 45)  # from the nearest side of a square
    block = box(blind, (0.022, 0.022, 0.022))
    yaw = math.radians(degrees)
    if abs(off - 25) > 2:
        assert held(blind, Pose2(0.5, 0.0, yaw), block) == ((0, "") if off < 25 else None)
    bar = box(blind, (0.055, 0.01, 0.01))
    off = min(degrees, 180 - degrees)  # from the bar's own direction
    if abs(off - 25) > 2:
        assert held(blind, Pose2(0.5, 0.0, yaw), bar) == ((0, "") if off < 25 else None)


def test_a_jaw_needs_room_for_its_fingers_and_one_body_between_them(blind):
    blind.clear("parallel-jaw")
    assert held(blind, MIDDLE, box(blind, (0.04, 0.04, 0.02))) is None, "wider than the jaw"
    block = box(blind, (0.02, 0.02, 0.02))
    assert held(blind, Pose2(0.5, 0.03), block) is None, "beside it"
    assert held(blind, MIDDLE, box(blind, (0.02, 0.02, 0.02), movable=False)) is None
    for gap, holds in ((0.004, None), (0.0, None), (0.006, (0, ""))):
        beside = [box(blind, (0.02, 0.02, 0.02), Pose2(0.5, side * (0.02 + gap))) for side in (-1, 1)]
        assert held(blind, MIDDLE, block, *beside) == holds, gap
    # What is lower than the fingers' ends is not in their way.
    tall = box(blind, (0.02, 0.02, 0.03))
    low = box(blind, (0.06, 0.06, 0.005), movable=False)
    assert held(blind, MIDDLE, tall, low) == (0, "")


def test_a_mug_is_held_by_its_brim_with_one_finger_inside(blind):
    mug = lying(blind, "mug")
    surfaces = Surfaces.of(blind.client, [mug])
    pose, _ = blind.pose(mug)
    brim = surfaces.points[surfaces.owners == [name for _, name in surfaces.parts].index("brim"), :2]
    middle, radius = brim.mean(axis=0), np.ptp(brim, axis=0).max() / 2 - 0.001
    for angle in np.radians([60, 90, 200]):
        x, y = middle + radius * np.array([math.cos(pose.yaw + angle), math.sin(pose.yaw + angle)])
        outward = pose.yaw + angle - math.pi / 2  # The jaw's y axis then points away from the mug's middle.
        assert held(blind, Pose2(x, y, outward), mug) == (0, "brim")
        assert held(blind, Pose2(x, y, outward + math.pi / 2), mug) is None


@pytest.mark.parametrize("name", [*pick_object_part.SEEN, *pick_object_part.UNSEEN])
def test_both_parts_of_every_object_can_be_held(blind, name):
    body = lying(blind, name)
    surfaces = Surfaces.of(blind.client, [body])
    one, other = objects.part_names(name)
    for part in (one, other):
        pose = pick_object_part.central_grasp(surfaces, body, part)
        assert held(blind, pose, body) == held(blind, pose @ Pose2(0, 0, math.pi), body) == (0, part)


def test_the_objects_of_both_sets_differ_and_have_two_parts_each():
    assert len(set(pick_object_part.SEEN)) == 10 and len(set(pick_object_part.UNSEEN)) == 5
    assert not set(pick_object_part.SEEN) & set(pick_object_part.UNSEEN)
    assert all(objects.extents(name, 0, real_table.SCALE)[0] < 0.06 for name in pick_object_part.SEEN)
    with pytest.raises(ValueError, match="scale must be above 0, got 0"):
        objects.parts("mug", 0, 0)


def test_another_part_of_the_right_object_is_wrong_and_is_not_asked_for_again(blind):
    task = lay_out(blind, UNSEEN, 0, "test")
    sentences = [task.instruction]
    (goal,) = task.goals
    (body,) = goal.bodies
    expert = task.expert(blind)
    assert expert.pick_symmetry == pytest.approx(math.pi) and task.max_steps == 10
    name = next(name for name in pick_object_part.UNSEEN if name in sentences[0])
    (other,) = set(objects.part_names(name)) - {goal.metric.part}
    surfaces = Surfaces.of(blind.client, blind.bodies)
    wrong = pick_object_part.central_grasp(surfaces, body, other)
    step = blind.step(PickPlace(wrong, expert.action.place))
    assert (step.held, step.reward, blind.effector.grip.part) == (body.id, 0.0, other)
    sentences.append(task.instruction)
    right = task.expert(blind).action
    assert blind.step(right).reward == pytest.approx(0.1)
    assert blind.effector.held is None and blind.effector.grip.part == sentences[1].split(" and ")[0].split()[-1]
    sentences.append(task.instruction)
    missed = task.expert(blind).action
    assert blind.step(PickPlace(missed.pick, missed.pick)).reward == 0.0, "held, but not in the box"
    assert len(set(sentences)) == 3 and task.score(blind) == pytest.approx(0.1)
    assert set(task.names) == {body.id for body in blind.bodies}


@pytest.mark.parametrize("world", ["real-table", "real-table-kinect"])
def test_cameras_stand_where_real_ones_can(world):
    top, *sides = cameras_around(TABLE, looks.style(world).cameras)
    assert np.allclose(top.rotation[:, 2], (0, 0, -1)) and len(sides) == 2
    for camera in (top, *sides):
        assert 0.5 < np.linalg.norm(camera.position - (0.5, 0.0, 0.0)) < 0.61
        along = camera.position - camera.position[2] / camera.rotation[2, 2] * camera.rotation[:, 2]
        assert TABLE.contains(along[0], along[1])  # It looks at the table.


def test_a_configuration_follows_the_table_and_the_size_of_its_things():
    lite, paper = LITE.for_table(LIMITS, 0.5), PAPER.for_table(LIMITS, 0.5)
    assert (lite.workspace.shape, paper.workspace.shape) == ((160, 128), (320, 256))
    assert paper.pixel == pytest.approx(0.29 / 320)
    for config in (lite, paper):
        assert config.workspace.limits == pytest.approx(LIMITS)
    assert (lite.top_patch, lite.peak_radius) == (LITE.top_patch / 2, LITE.peak_radius / 2)
    # A crop shows as much of a thing as on CLIPort's table.
    assert lite.crop * lite.pixel == pytest.approx(0.5 * LITE.crop * LITE.pixel, abs=lite.pixel)
    assert ClipPortConfig().for_table(LIMITS, 0.5).query == 31
    assert LITE.for_table((0.25, 0.75, -0.5, 0.5)) == LITE
    single = LITE.ablated("with-matched-single-view").for_table(LIMITS, 0.5)
    assert single.top_patch == 0.0875, "an ablation's values stay"


@pytest.mark.parametrize(
    ("flags", "run"), [("110011", (4, 4)), ("0110", (1, 2)), ("000", (0, 0)), ("111", (0, 3)), ("1011", (2, 3))]
)
def test_the_longest_run_on_a_circle(flags, run):
    assert pick_object_part.longest_run([flag == "1" for flag in flags]) == run


def test_seen_and_unseen_variants_show_their_objects():
    assert tasks.make(UNSEEN, "train").object_names == tasks.make(SEEN, "test").object_names == pick_object_part.SEEN
    assert tasks.make(UNSEEN, "val").object_names == pick_object_part.UNSEEN
