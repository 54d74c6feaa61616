"""CLIPort's families beside those of test_tasks.py: layouts, sentences, scores and experts."""

import math
from dataclasses import replace
from functools import partial

import gallery
import numpy as np
import pybullet as p
import pytest
from drawings import plot_benchmark
from test_tasks import lay_out, layout, play, teleport

from gem_lite import tasks
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import kits, objects, piles, ropes, shapes, stands
from gem_lite.tasks import assembling_kits, packing_box_pairs, packing_objects, spawn
from gem_lite.tasks.goals import VolumeMetric

ROPE, KITS, PAIRS = "align-rope", "assembling-kits-seq-seen-colors", "packing-box-pairs-seen-colors"
SEQUENCE, GROUP = "packing-google-objects-seq-seen", "packing-google-objects-group-unseen"
PILES, HANOI = "separating-piles-seen-colors", "towers-of-hanoi-seq-unseen-colors"


def put(world, body, pose):
    """Put a body at a pose, just above the table."""
    teleport(world, body, pose, 0.05)


# All families --------------------------------------------------------------------------------------------


def test_all_eighteen_tasks_of_the_paper_are_registered():
    assert len(set(tasks.PAPER)) == 18
    assert set(tasks.PAPER) <= set(tasks.names())


# align-rope ----------------------------------------------------------------------------------------------


def test_the_rope_keeps_its_length(blind):
    task = lay_out(blind, ROPE)
    play(blind, task)
    beads = np.array([(blind.pose(body)[0].x, blind.pose(body)[0].y) for body in blind.bodies if body.movable])
    assert len(beads) == ropes.BEADS
    gaps = np.linalg.norm(np.diff(beads, axis=0), axis=1)
    assert gaps.mean() == pytest.approx(ropes.SPACING, rel=0.15)


@pytest.mark.parametrize(("start", "end"), ropes.DIRECTIONS)
def test_the_targets_of_a_rope_lie_evenly_between_two_corners(start, end):
    places = ropes.targets(Pose2(0.5, 0.1, 0.0), start, end)
    points = np.array([(place.x - 0.5, place.y - 0.1) for place in places]) / (ropes.LENGTH / 2)
    assert len(points) == ropes.BEADS
    step = (np.array(ropes.CORNERS[end]) - ropes.CORNERS[start]) / ropes.BEADS
    assert np.allclose(np.diff(points, axis=0), step)
    assert np.allclose(points[0], ropes.CORNERS[start] + step / 2)


def test_a_rope_that_lies_the_other_way_round_is_aligned_too(blind):
    task = lay_out(blind, ROPE)
    (goal,) = task.goals
    for bead, target in zip(goal.bodies, reversed(goal.targets), strict=True):
        teleport(blind, bead, Pose2(target.x, target.y), bead.rest_height)
    assert task.score(blind) == 1.0
    assert task.expert(blind) is None


# assembling-kits-seq -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hole", "twins", "word"),
    [
        (0, (), ""), (0, (2,), "left"), (2, (0, 1), "right"), (1, (0, 2), "middle"), (1, (3, 4), "top"),
        (3, (1,), "bottom"), (3, (4,), "left"),
    ],
)  # fmt: skip
def test_a_word_tells_a_hole_from_its_twins(hole, twins, word):
    spots = kits.SPOTS
    assert assembling_kits.location(spots[hole], [spots[twin] for twin in twins]) == word


def test_the_sentences_say_which_of_two_equal_holes(blind):
    for index in range(20):
        task = layout(blind, KITS, "val", index)
        names = [goal.sentence.split(" in the ")[1] for goal in task.goals]
        nouns = [task.names[goal.targets[0].id] for goal in task.goals]
        for name, noun in zip(names, nouns, strict=True):
            assert (name == noun) == (nouns.count(noun) == 1)
        if len(set(nouns)) < len(nouns):
            assert len(set(names)) == len(names)
            return
    raise AssertionError("no kit had two equal holes")


def test_tests_of_both_kit_variants_have_unseen_shapes(blind):
    for variant in ("seen-colors", "unseen-colors"):
        for split, allowed in (("test", shapes.UNSEEN_SHAPES), ("train", shapes.SEEN_SHAPES)):
            names = layout(blind, f"assembling-kits-seq-{variant}", split, 1).names.values()
            assert {name.removesuffix(" hole") for name in names if name.endswith(" hole")} <= set(allowed)


def test_a_piece_in_the_wrong_yaw_is_not_in_its_hole(blind):
    for index in range(20):
        task = lay_out(blind, KITS, index)
        goal = task.goals[0]
        if goal.metric.symmetry == 2 * math.pi:
            break
    hole = blind.pose(goal.targets[0])[0]
    for turn, share in ((0.0, 1.0), (math.radians(10), 1.0), (math.radians(20), 0.0), (math.pi, 0.0)):
        teleport(blind, goal.bodies[0], Pose2(hole.x, hole.y, hole.yaw + turn), 0.016)
        assert goal.done(blind) == share


# packing -------------------------------------------------------------------------------------------------


def test_the_cells_of_a_floor_fit_into_it_and_do_not_overlap():
    rng = np.random.default_rng(0)
    for _ in range(50):
        sides = tuple(rng.uniform(0.05, 0.3, 2))
        cells = spawn.split_floor(rng, sides, packing_box_pairs.SHORTEST)
        boxes = np.array([[[m - s / 2, m + s / 2] for m, s in zip((c.x, c.y), size, strict=True)] for c, size in cells])
        assert (np.abs(boxes) <= np.array(sides)[None, :, None] / 2 - spawn.MARGIN + 1e-9).all()
        assert (boxes[..., 1] - boxes[..., 0] <= 2 * packing_box_pairs.SHORTEST + 1e-9).all()
        for i, a in enumerate(boxes):
            for b in boxes[:i]:
                apart = np.maximum(a[:, 0] - b[:, 1], b[:, 0] - a[:, 1]).max()
                assert apart >= spawn.MARGIN - 1e-9


def test_every_block_of_the_named_colours_must_be_packed(blind):
    task = lay_out(blind, PAIRS)
    (goal,) = task.goals
    named = {f"{color} block" for color in task.named_colors}
    assert {body.id for body in goal.bodies} == {body for body, name in task.names.items() if name in named}
    world_step = blind.step(task.expert(blind).action)
    assert 0 < world_step.reward < 1
    assert task.instruction == goal.sentence


def test_an_object_that_leans_out_of_the_box_is_moved_to_the_freest_pose_in_it(blind):
    task = lay_out(blind, SEQUENCE)
    goal = task.goals[0]
    (body,), (box,) = goal.bodies, goal.targets
    middle = blind.pose(box)[0]
    first = task.expert(blind).action
    assert (first.place.x, first.place.y) == pytest.approx((middle.x, middle.y), abs=1e-6)
    # Half of it lies over the wall, and another body lies in the left half.
    x_max, y_max = np.array(goal.metric.size) / 2
    other = next(other for other in blind.bodies if other.id not in (body.id, box.id))
    put(blind, body, middle @ Pose2(x_max, 0.0))
    put(blind, other, middle @ Pose2(-x_max / 2, 0.0))
    assert 0 < goal.metric.share(blind, body, box) < 1
    again = task.expert(blind).action
    offset = middle.inverse() @ again.place
    assert again.pick != first.pick
    assert 0.01 < offset.x < x_max and abs(offset.y) < y_max


def test_the_freest_pose_is_clear_of_other_objects(blind):
    task = lay_out(blind, SEQUENCE)
    goal = task.goals[0]
    (body,), (box,) = goal.bodies, goal.targets
    middle = blind.pose(box)[0]
    x_max, y_max = np.array(goal.metric.size) / 2
    other = next(other for other in blind.bodies if other.id not in (body.id, box.id))
    extents = {body.id: (0.12, 0.02, 0.02), other.id: (x_max, 2 * y_max, 0.02)}
    metric = replace(goal.metric, extents=extents)
    # The other object fills the right half; a long one has the most space along the left half.
    put(blind, other, middle @ Pose2(x_max / 2, 0.0))
    offset = middle.inverse() @ packing_objects.freest_pose(blind, metric, body, packing_objects.SPOTS)
    assert -0.75 * x_max < offset.x < -0.25 * x_max
    assert abs(math.cos(offset.yaw)) < 0.6
    # In the middle, only the yaw is free.
    offset = middle.inverse() @ packing_objects.freest_pose(blind, metric, body, 1)
    assert (offset.x, offset.y) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert abs(math.cos(offset.yaw)) < 0.6


@pytest.mark.parametrize(("offset", "share"), [(0.0, 1.0), (0.065, 0.5), (0.2, 0.0)])
def test_the_volume_metric_gives_the_share_inside(blind, stage, offset, share):
    def build(client):
        return shapes.add_box(client, (0.08, 0.04, 0.04), colors.rgba("red"), Pose2(0.5 + offset, 0.0))

    zone = partial(shapes.add_box, size=(0.02, 0.02, 0.001), color=colors.rgba("blue"), pose=Pose2(0.5, 0.0, 0.0))
    (body, middle), _ = stage(build, lambda client: zone(client, movable=False))
    metric = VolumeMetric(middle, (0.12, 0.12), 0.05, {body.id: (0.08, 0.04, 0.04)})
    assert metric.share(blind, body, middle) == pytest.approx(share, abs=0.01)


def test_unseen_objects_share_no_name_with_those_of_the_demonstrations(blind):
    assert not set(packing_objects.SEEN) & set(packing_objects.UNSEEN)
    assert set(packing_objects.SEEN) | set(packing_objects.UNSEEN) == set(objects.NAMES)
    assert len(packing_objects.SEEN) >= 24 and len(packing_objects.UNSEEN) >= 12
    for split, names in (("train", packing_objects.SEEN), ("test", packing_objects.UNSEEN)):
        task = lay_out(blind, GROUP, 2, split)
        shown = {name.split(" ", 1)[1] for name in task.names.values() if name != "brown box"}
        assert shown <= set(names)


def test_a_group_has_two_named_objects_and_two_of_another_name(blind):
    for index in range(5):
        task = lay_out(blind, GROUP, index)
        (goal,) = task.goals
        nouns = [task.names[body.id].split(" ", 1)[1] for body in goal.bodies]
        assert len(nouns) >= 2 and len(set(nouns)) == 1
        assert goal.sentence == f"pack all the {nouns[0]} objects in the brown box"


def test_a_sequence_names_one_object_after_the_other(blind):
    counts = set()
    for index in range(6):
        task = layout(blind, SEQUENCE, "val", index)
        assert len({goal.bodies[0].id for goal in task.goals}) == len(task.goals) == task.max_steps - 1
        counts.add(len(task.goals))
    assert len(counts) > 1


# separating-piles ----------------------------------------------------------------------------------------


def test_a_pile_earns_its_share_in_the_square(blind):
    task = lay_out(blind, PILES)
    (goal,) = task.goals
    assert len(goal.bodies) == piles.CUBES
    square = blind.pose(goal.targets[0])[0]
    start = task.score(blind)
    for cube in goal.bodies[:10]:
        teleport(blind, cube, Pose2(square.x, square.y), 0.005)
    assert task.score(blind) == pytest.approx(start + 0.2)


# towers-of-hanoi-seq -------------------------------------------------------------------------------------


def test_the_tower_moves_ring_by_ring_from_light_to_dark(blind):
    task = lay_out(blind, HANOI)
    sentences, actions, _ = play(blind, task)
    small, middle, large = task.named_colors
    light, between, dark = stands.PLATES
    assert sentences == [
        f"move the {ring} ring to the {place}"
        for ring, place in zip(
            (small, middle, small, large, small, middle, small),
            (dark, between, between, dark, light, dark, dark),
            strict=True,
        )
    ]
    assert all(action.delta == pytest.approx(0.0, abs=1e-6) for action in actions)
    heights = sorted(blind.pose(body)[1] for body in blind.bodies if body.movable)
    expected = [stands.PLATE[2] + (layer + 0.5) * stands.RING_HEIGHT for layer in range(3)]
    assert heights == pytest.approx(expected, abs=0.002)


def test_a_ring_really_hangs_round_its_peg(blind):
    task = lay_out(blind, HANOI)
    ring = task.goals[0].bodies[0]
    pose = blind.pose(ring)[0]
    velocity = (0.3, 0.0, 0.0)
    for _ in range(60):
        p.resetBaseVelocity(ring.id, velocity, physicsClientId=blind.client)
        p.stepSimulation(physicsClientId=blind.client)
    moved = blind.pose(ring)[0]
    assert math.hypot(moved.x - pose.x, moved.y - pose.y) < 0.02


# The gallery ---------------------------------------------------------------------------------------------


def test_the_gallery_shows_a_task_before_and_after(world):
    story = gallery.play(world, "put-block-in-bowl-seen-colors", split="val")
    assert story.score == 1.0 and story.actions >= 1
    assert len(story.sentences) == 1 and story.sentences[0].startswith("put the")
    changed = np.abs(story.first.astype(int) - story.last).max(axis=-1) > 30
    assert 0.0001 < changed.mean() < 0.2  # the blocks moved, the rest of the picture did not
    fig = plot_benchmark.show_gallery([story, story], columns=2)
    assert len(fig.axes) == 4
