"""The task families: layouts, sentences, scores, experts."""

import math
from dataclasses import replace
from functools import partial

import gallery
import numpy as np
import pybullet as p
import pytest
from drawings import plot_benchmark
from pointing import bodies_from_above
from shapely import affinity
from shapely.geometry import Point
from tabletop import block, distance, lay_out, layout, play, teleport
from tiers import for_a_release

from gem_lite import language, tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.evaluation import collecting
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import effectors
from gem_lite.simulation.bodies import objects, shapes, trays
from gem_lite.simulation.bodies.parts import BROWNS
from gem_lite.tasks.goals import VolumeMetric

PYRAMID, INSERTION, BARS = "stack-block-pyramid-seq-seen-colors", "block-insertion", "bars-in-box"
PACKING, PACKING_UNSEEN = "packing-shapes-seen", "packing-shapes-unseen"
BOWL, BOWL_UNSEEN = "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors"
FAMILIES = [PYRAMID, PACKING, INSERTION, BARS, BOWL]
ROPE, KITS, PAIRS = "align-rope", "assembling-kits-seq-seen-colors", "packing-box-pairs-seen-colors"
SEQUENCE, GROUP = "packing-google-objects-seq-seen", "packing-google-objects-group-unseen"
PILES, HANOI = "separating-piles-seen-colors", "towers-of-hanoi-seq-unseen-colors"
ONE_TABLE = [name for name in tasks.names() if tasks.family(name) != "object-sorting"]
RED = colors.rgba("red")


def gap(world, a, b):
    """The distance (m) between two bodies, at most 50 mm."""
    return min((c[8] for c in p.getClosestPoints(a.id, b.id, 0.05, physicsClientId=world.client)), default=0.05)


@pytest.mark.parametrize("name", FAMILIES)
def test_layouts_keep_bodies_apart_and_in_the_workspace(blind, name):
    around = Workspace(x_min=0.2, x_max=0.8, y_min=-0.55, y_max=0.55)
    x, y = around.to_world(*np.indices(around.shape))
    w = blind.workspace
    outside = (x < w.x_min) | (x > w.x_max) | (y < w.y_min) | (y > w.y_max)
    for index in range(4):
        layout(blind, name, "val", index)
        above = bodies_from_above(blind.client, around)
        ids = {body.id for body in blind.bodies}
        assert ids <= set(above[~outside].tolist()) and not ids & set(above[outside].tolist())
        movable = [body for body in blind.bodies if body.movable]
        assert movable and all(gap(blind, a, b) > 0.01 for a in movable for b in blind.bodies if a is not b)
        before = [blind.pose(body)[0] for body in blind.bodies]
        assert blind.settle()
        assert all(distance(blind.pose(body)[0], pose) < 0.001 for body, pose in zip(blind.bodies, before, strict=True))


def check_the_rope(task, played):
    """It keeps its length."""
    beads = np.array([(pose.x, pose.y) for pose, _ in played.movable])
    assert len(beads) == tasks.align_rope.BEADS
    assert np.linalg.norm(np.diff(beads, axis=0), axis=1).mean() == pytest.approx(tasks.align_rope.SPACING, rel=0.15)


def check_the_tower(task, played):
    """It moves ring by ring from light to dark."""
    small, middle, large = task.named_colors
    light, between, dark = tasks.towers_of_hanoi.PLATES
    rings, places = (
        (small, middle, small, large, small, middle, small), (dark, between, between, dark, light, dark, dark)
    )  # fmt: skip
    assert played.sentences == [f"move the {ring} ring to the {at}" for ring, at in zip(rings, places, strict=True)]
    assert all(action.delta == pytest.approx(0.0, abs=1e-6) for action in played.actions)
    expected = [
        tasks.towers_of_hanoi.THICKNESS + (layer + 0.5) * tasks.towers_of_hanoi.RING_HEIGHT for layer in range(3)
    ]
    assert sorted(z for _, z in played.movable) == pytest.approx(expected, abs=0.002)


def check_the_pyramid(task, played):
    """It has six sentences and three layers."""
    a, b, c, d, e, f = task.named_colors
    heard = [language.parse(sentence) for sentence in played.sentences]
    pairs = [f"{a} and {b} blocks", f"{b} and {c} blocks", f"{d} and {e} blocks"]
    assert [phrases.pick for phrases in heard] == [f"{color} block" for color in (a, b, c, d, e, f)]
    assert [phrases.place for phrases in heard] == [*tasks.stack_block_pyramid.PLATES, *pairs]
    expected = [0.025] * 3 + [0.065] * 2 + [0.105]
    assert sorted(z for _, z in played.movable) == pytest.approx(expected, abs=0.002)


SPECIAL = {ROPE: check_the_rope, HANOI: check_the_tower, PYRAMID: check_the_pyramid}
TWINS = (
    "separating-piles-unseen-colors", "towers-of-hanoi-seq-seen-colors", "stack-block-pyramid-seq-unseen-colors",
    "pick-object-part-in-brown-box-seen", "arrange-letter-to-word-seen", "block-stacking-pyramid-unseen",
)  # fmt: skip
"""They differ from a task that is played in their colours or objects alone."""


@pytest.mark.parametrize("name", for_a_release(ONE_TABLE, lambda name: name == "separating-piles-seen-colors"))
def test_the_expert_solves_an_episode_and_the_grammar_reads_every_sentence(blind, name):
    # In this episode of the piles, a cube lies in the square from the beginning. The first action is paid for it, too.
    pushes = name.startswith("separating")
    episode = (1, "test") if pushes else (0, "val")

    def described(index, split):
        task = lay_out(blind, name, index, split)
        assert set(task.names) == {body.id for body in blind.bodies}
        return task.instruction, list(task.names.values()), [blind.pose(body) for body in blind.bodies]

    once = described(*episode)
    assert described(9, episode[1])[2] != once[2] and described(*episode) == once, "one seed is one layout"
    task = blind.task
    if name in TWINS:
        assert all(language.parse(goal.sentence).push == pushes for goal in task.goals)
        return
    first_score = task.score(blind)
    assert 0 < first_score < 0.1 if pushes else first_score < 0.3
    played = play(blind, task)
    rewards = [step.reward for step in played.steps]
    assert sum(rewards) == pytest.approx(task.score(blind)) == pytest.approx(1.0, abs=1e-6 if pushes else 0.01)
    assert len(rewards) <= task.max_steps
    for sentence, action in zip(played.sentences, played.actions, strict=True):
        queries = language.parse(sentence)
        assert queries.push == isinstance(action, Push) == pushes
        assert queries.pick and queries.place
    if tasks.family(name) in {tasks.family(family) for family in FAMILIES}:  # One action for each body, worth the same.
        assert first_score == 0.0 and task.score(blind) == 1.0
        assert rewards == pytest.approx([1 / len(rewards)] * len(rewards)) and all(s.grasped for s in played.steps)
        assert task.expert(blind) is None
    SPECIAL.get(name, lambda task, played: None)(task, played)


IN_COLORS = [name.removesuffix("-seen-colors") for name in tasks.names() if name.endswith("-seen-colors")]


@pytest.mark.parametrize(
    ("name", "split", "palette"),
    [
        *((f"{family}-unseen-colors", "train", colors.SEEN) for family in IN_COLORS),
        *((f"{family}-unseen-colors", "test", colors.UNSEEN) for family in IN_COLORS),
        *((f"{family}-seen-colors", "test", colors.SEEN) for family in IN_COLORS),
        (BOWL_UNSEEN, "val", colors.UNSEEN),
        (INSERTION, "test", colors.SEEN),
        (BARS, "test", [name for name in colors.SEEN if name != "brown"]),
    ],
)
def test_named_colours_come_from_the_palette(blind, name, split, palette):
    named = [layout(blind, name, split, index).named_colors for index in range(30)]
    assert {color for group in named for color in group} == set(palette)
    assert all(len(set(group)) == len(group) for group in named)


def test_the_expert_knows_which_turns_of_a_block_and_of_a_bowl_are_alike(blind):
    expert = lay_out(blind, BOWL).expert(blind)
    assert (expert.pick_symmetry, expert.place_symmetry) == pytest.approx((math.pi / 2, 0.0))


def test_a_block_is_placed_in_position_height_and_yaw_on_plates_from_light_to_dark(blind):
    task = lay_out(blind, PYRAMID)
    assert [task.names[body.id] for body in blind.bodies[:3]] == list(tasks.stack_block_pyramid.PLATES)
    light, middle, dark = (blind.pose(body)[0] for body in blind.bodies if not body.movable)
    assert ((light.inverse() @ middle).y, (light.inverse() @ dark).y) == pytest.approx((0.05, 0.1))
    brightness = [sum(rgba) for rgba in BROWNS]
    assert brightness == sorted(brightness, reverse=True)
    first = next(body for body in blind.bodies if body.movable)
    for dx, dz, degrees, placed in (
        (0, 0, 0, True), (0.008, 0, 0, True), (0.012, 0, 0, False), (0, 0.04, 0, False), (0, 0, 90, True),
        (0, 0, -12, True), (0, 0, 18, False), (0, 0, 45, False),
    ):  # fmt: skip
        teleport(blind, first, light @ Pose2(dx, 0, math.radians(degrees)), 0.025 + dz)
        assert task.score(blind) == pytest.approx(1 / 6 if placed else 0), (dx, dz, degrees)


def test_a_demonstration_keeps_the_sentence_that_each_step_obeyed(world):
    demonstration = collecting.roll_out(world, PYRAMID, "train", 0)
    picks = [step.phrases.pick for step in demonstration.steps]
    assert picks == [f"{color} block" for color in world.task.named_colors]
    assert len({step.instruction for step in demonstration.steps}) == 6


@pytest.mark.parametrize(
    ("name", "split", "names", "palette"),
    [
        (PACKING, "val", shapes.SEEN_SHAPES, colors.SEEN),
        (PACKING_UNSEEN, "train", shapes.SEEN_SHAPES, colors.SEEN),
        (PACKING_UNSEEN, "test", shapes.UNSEEN_SHAPES, colors.UNSEEN),
    ],
)
def test_shapes_and_colours_of_the_splits(blind, name, split, names, palette):
    seen, asked = set(), set()
    for index in range(25):
        task = layout(blind, name, split, index)
        pieces = [what.split(" ", 1) for what in task.names.values() if what != "brown box"]
        assert len({color for color, _ in pieces}) == len({shape for _, shape in pieces}) == tasks.packing_shapes.PIECES
        phrases = language.parse(task.instruction)
        assert phrases.place == "brown box" and phrases.pick in [shape.lower() for _, shape in pieces]
        seen |= {(color, shape) for color, shape in pieces}
        asked.add(phrases.pick)
    assert {color for color, _ in seen} == set(palette) and {shape for _, shape in seen} == set(names)
    assert len(asked) > 4 and not set(shapes.SEEN_SHAPES) & set(shapes.UNSEEN_SHAPES)


def test_another_piece_in_the_box_earns_nothing(blind):
    expert = lay_out(blind, PACKING).expert(blind).action
    others = [blind.pose(body)[0] for body in blind.bodies if body.movable]
    step = blind.step(PickPlace(max(others, key=lambda pose: distance(pose, expert.pick)), expert.place))
    assert step.grasped and step.reward == 0.0


def test_the_walls_of_a_box_are_real(blind, stage):
    centre = Pose2(0.5, 0.0, 0.7)
    box = partial(trays.add_container, size=(0.12, 0.1), color=colors.rgba("brown"), pose=centre)
    (_, dropped), _ = stage(box, block(Pose2(0.4, 0.3)))
    teleport(blind, dropped, centre, 0.1)
    blind.settle()
    assert blind.pose(dropped)[1] == pytest.approx(trays.WALL + 0.02, abs=0.001)


@pytest.mark.parametrize("shape", shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES)
def test_a_pieces_symmetry_and_grasp_point(shape):
    outline = shapes.outline(shape)

    def misfit(turn):
        return outline.symmetric_difference(affinity.rotate(outline, turn, origin=(0, 0))).area / outline.area

    assert outline.buffer(-0.0039).contains(Point(tasks.packing_shapes.grasp_point(shape)))
    assert math.hypot(*tasks.packing_shapes.grasp_point(shape)) < 0.02
    if shape in tasks.packing_shapes.ROUND:
        assert max(misfit(turn) for turn in (11, 45, 100)) < 0.03
        return
    copies = tasks.packing_shapes.TURNS.get(shape, 1)
    assert misfit(360 / copies) < 0.01
    assert all(misfit(360 / more) > 0.03 for more in range(copies + 1, 9))


def test_insertion_names_two_bodies_and_an_l_above_its_fixture_is_not_in_it(blind):
    task = lay_out(blind, INSERTION)
    of_block, of_fixture = task.named_colors
    assert language.parse(task.instruction) == language.Queries(f"{of_block} l-block", f"{of_fixture} box")
    assert of_block != of_fixture
    assert task.expert(blind).place_symmetry == pytest.approx(2 * math.pi)
    fixture, l_block = blind.bodies
    for z, expected in [(0.022, 1.0), (0.04, 0.0)]:
        teleport(blind, l_block, blind.pose(fixture)[0], z)
        assert task.score(blind) == expected


def test_a_fixture_leaves_its_clearance_all_round(blind, stage):
    pose = Pose2(0.5, 0.1, 2.0)
    (fixture, l_block), _ = stage(
        partial(trays.add_l_fixture, color=colors.rgba("blue"), pose=pose),
        partial(shapes.add_l_block, color=RED, pose=Pose2(0.4, -0.2)),
    )
    for direction in range(8):  # the walls on all sides are equally far
        angle = direction * math.pi / 4
        reach = trays.FIXTURE_CLEARANCE / max(abs(math.cos(angle)), abs(math.sin(angle)))
        for share, free in [(0.9, True), (1.1, False)]:
            offset = Pose2(share * reach * math.cos(angle), share * reach * math.sin(angle))
            teleport(blind, l_block, pose @ offset, trays.WALL + l_block.rest_height + 0.001)
            assert (gap(blind, fixture, l_block) > 0) == free


@pytest.mark.parametrize(
    ("x", "degrees", "reward"),
    [(0, -90, 0), (0, -20, 0), (0, 20, 0), (0, 90, 0), (0, 180, 0), (0.014, 0, 0), (0.003, 4, 1)],
)
def test_an_l_goes_in_only_if_it_is_nearly_right(blind, x, degrees, reward):
    expert = lay_out(blind, INSERTION).expert(blind).action
    place = expert.place @ Pose2(x, 0, math.radians(degrees))
    assert blind.step(PickPlace(expert.pick, place)).reward == reward


@pytest.mark.parametrize(
    ("degrees", "along", "holds"),
    [
        (180, 0.0, True), (15, 0.0, True), (-15, 0.0, True), (165, 0.0, True), (0, 0.012, True), (0, -0.012, True),
        (25, 0.0, False), (-25, 0.0, False), (90, 0.0, False), (0, 0.025, False), (0, -0.025, False),
    ],
)  # fmt: skip
def test_a_jaw_holds_a_bar_only_across_and_near_its_middle(blind, degrees, along, holds):
    task = lay_out(blind, BARS)
    assert isinstance(blind.effector, effectors.Jaw)
    (color,) = task.named_colors
    assert language.parse(task.instruction) == language.Queries(f"{color} bar", "brown box")
    assert list(task.names.values()).count(f"{color} bar") == 1
    assert sum(name.endswith("bar") for name in task.names.values()) == tasks.bars_in_box.BARS
    expert = task.expert(blind)
    assert expert.pick_symmetry == pytest.approx(math.pi)
    pick = expert.action.pick @ Pose2(along, 0, math.radians(degrees))
    # Any turn of the bar fits the box.
    step = blind.step(PickPlace(pick, expert.action.place @ Pose2(0, 0, math.radians(2 * degrees + 45))))
    assert (step.grasped, step.reward) == (holds, float(holds))


@pytest.mark.parametrize(("start", "end"), tasks.align_rope.DIRECTIONS)
def test_the_targets_of_a_rope_lie_evenly_between_two_corners(start, end):
    rope = tasks.align_rope
    places = rope.targets(Pose2(0.5, 0.1, 0.0), start, end)
    points = np.array([(place.x - 0.5, place.y - 0.1) for place in places]) / (rope.LENGTH / 2)
    assert len(points) == rope.BEADS
    step = (np.array(rope.CORNERS[end]) - rope.CORNERS[start]) / rope.BEADS
    assert np.allclose(np.diff(points, axis=0), step) and np.allclose(points[0], rope.CORNERS[start] + step / 2)


def test_a_rope_that_lies_the_other_way_round_is_aligned_too(blind):
    task = lay_out(blind, ROPE)
    (goal,) = task.goals
    for bead, target in zip(goal.bodies, reversed(goal.targets), strict=True):
        teleport(blind, bead, Pose2(target.x, target.y), bead.rest_height)
    assert task.score(blind) == 1.0 and task.expert(blind) is None


@pytest.mark.parametrize(
    ("hole", "twins", "word"),
    [
        (0, (), ""), (0, (2,), "left"), (2, (0, 1), "right"), (1, (0, 2), "middle"), (1, (3, 4), "top"),
        (3, (1,), "bottom"), (3, (4,), "left"),
    ],
)  # fmt: skip
def test_a_word_tells_a_hole_from_its_twins(hole, twins, word):
    spots = tasks.assembling_kits.SPOTS
    assert tasks.assembling_kits.location(spots[hole], [spots[twin] for twin in twins]) == word


def test_the_sentences_say_which_of_two_equal_holes(blind):
    for index in range(20):
        task = layout(blind, KITS, "val", index)
        names = [goal.sentence.split(" in the ")[1] for goal in task.goals]
        nouns = [task.names[goal.targets[0].id] for goal in task.goals]
        assert all((name == noun) == (nouns.count(noun) == 1) for name, noun in zip(names, nouns, strict=True))
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
    whole = 2 * math.pi
    index = next(i for i in range(20) if layout(blind, KITS, "val", i).goals[0].metric.symmetry == whole)
    goal = lay_out(blind, KITS, index).goals[0]
    hole = blind.pose(goal.targets[0])[0]
    for turn, share in ((0.0, 1.0), (math.radians(10), 1.0), (math.radians(20), 0.0), (math.pi, 0.0)):
        teleport(blind, goal.bodies[0], Pose2(hole.x, hole.y, hole.yaw + turn), 0.016)
        assert goal.done(blind) == share


def test_the_cells_of_a_floor_fit_into_it_and_do_not_overlap():
    rng = np.random.default_rng(0)
    for _ in range(50):
        sides = tuple(rng.uniform(0.05, 0.3, 2))
        cells = tasks.spawn.split_floor(rng, sides, tasks.packing_box_pairs.SHORTEST)
        boxes = np.array([[[m - s / 2, m + s / 2] for m, s in zip((c.x, c.y), size, strict=True)] for c, size in cells])
        assert (np.abs(boxes) <= np.array(sides)[None, :, None] / 2 - tasks.spawn.MARGIN + 1e-9).all()
        assert (boxes[..., 1] - boxes[..., 0] <= 2 * tasks.packing_box_pairs.SHORTEST + 1e-9).all()
        for i, a in enumerate(boxes):
            apart = [np.maximum(a[:, 0] - b[:, 1], b[:, 0] - a[:, 1]).max() for b in boxes[:i]]
            assert min(apart, default=1) >= tasks.spawn.MARGIN - 1e-9


def test_every_block_of_the_named_colours_must_be_packed(blind):
    task = lay_out(blind, PAIRS)
    (goal,) = task.goals
    named = {f"{color} block" for color in task.named_colors}
    assert {body.id for body in goal.bodies} == {body for body, name in task.names.items() if name in named}
    assert 0 < blind.step(task.expert(blind).action).reward < 1
    assert task.instruction == goal.sentence


@pytest.fixture
def packing(blind):
    """(task, its first goal, the named object, another one, the box's pose, half of its sides)."""
    task = lay_out(blind, SEQUENCE)
    goal = task.goals[0]
    (body,), (box,) = goal.bodies, goal.targets
    other = next(other for other in blind.bodies if other.id not in (body.id, box.id))
    return task, goal, body, other, blind.pose(box)[0], np.array(goal.metric.size) / 2


def test_an_object_that_leans_out_of_the_box_is_moved_to_the_freest_pose_in_it(blind, packing):
    task, goal, body, other, middle, (x_max, y_max) = packing
    first = task.expert(blind).action
    assert (first.place.x, first.place.y) == pytest.approx((middle.x, middle.y), abs=1e-6)
    # Half of it lies over the wall, and another body lies in the left half.
    teleport(blind, body, middle @ Pose2(x_max, 0.0), 0.05)
    teleport(blind, other, middle @ Pose2(-x_max / 2, 0.0), 0.05)
    assert 0 < goal.metric.share(blind, body, goal.targets[0]) < 1
    again = task.expert(blind).action
    offset = middle.inverse() @ again.place
    assert again.pick != first.pick and 0.01 < offset.x < x_max and abs(offset.y) < y_max


def test_the_freest_pose_is_clear_of_other_objects(blind, packing):
    _, goal, body, other, middle, (x_max, y_max) = packing
    metric = replace(goal.metric, extents={body.id: (0.12, 0.02, 0.02), other.id: (x_max, 2 * y_max, 0.02)})
    # The other object fills the right half; a long one has the most space along the left half.
    teleport(blind, other, middle @ Pose2(x_max / 2, 0.0), 0.05)
    offset = middle.inverse() @ tasks.packing_objects.freest_pose(blind, metric, body, tasks.packing_objects.SPOTS)
    assert -0.75 * x_max < offset.x < -0.25 * x_max and abs(math.cos(offset.yaw)) < 0.6
    # In the middle, only the yaw is free.
    offset = middle.inverse() @ tasks.packing_objects.freest_pose(blind, metric, body, 1)
    assert (offset.x, offset.y) == pytest.approx((0.0, 0.0), abs=1e-6) and abs(math.cos(offset.yaw)) < 0.6


def test_the_volume_metric_gives_the_share_inside(blind, stage):
    sides = (0.08, 0.04, 0.04)
    box = partial(shapes.add_box, color=RED, pose=Pose2(0.5, 0.0))
    (body, middle), _ = stage(partial(box, size=sides), partial(box, size=(0.02, 0.02, 0.001), movable=False))
    metric = VolumeMetric(middle, (0.12, 0.12), 0.05, {body.id: sides})
    for offset, share in [(0.0, 1.0), (0.065, 0.5), (0.2, 0.0)]:
        teleport(blind, body, Pose2(0.5 + offset, 0.0))
        assert metric.share(blind, body, middle) == pytest.approx(share, abs=0.01)


def test_unseen_objects_share_no_name_with_those_of_the_demonstrations(blind):
    assert not set(tasks.packing_objects.SEEN) & set(tasks.packing_objects.UNSEEN)
    assert set(tasks.packing_objects.SEEN) | set(tasks.packing_objects.UNSEEN) == set(objects.NAMES)
    assert len(tasks.packing_objects.SEEN) >= 24 and len(tasks.packing_objects.UNSEEN) >= 12
    for split, names in (("train", tasks.packing_objects.SEEN), ("test", tasks.packing_objects.UNSEEN)):
        task = layout(blind, GROUP, split, 2)
        assert {name.split(" ", 1)[1] for name in task.names.values() if name != "brown box"} <= set(names)


def test_a_group_has_objects_of_one_name_and_a_sequence_names_one_after_the_other(blind):
    counts = set()
    for index in range(4):
        task = layout(blind, GROUP, "val", index)
        (goal,) = task.goals
        nouns = [task.names[body.id].split(" ", 1)[1] for body in goal.bodies]
        assert len(nouns) >= 2 and len(set(nouns)) == 1
        assert goal.sentence == f"pack all the {nouns[0]} objects in the brown box"
        task = layout(blind, SEQUENCE, "val", index)
        assert len({goal.bodies[0].id for goal in task.goals}) == len(task.goals) == task.max_steps - 1
        counts.add(len(task.goals))
    assert len(counts) > 1


def test_a_pile_earns_its_share_in_the_square(blind):
    task = lay_out(blind, PILES)
    (goal,) = task.goals
    assert len(goal.bodies) == tasks.separating_piles.CUBES
    square, start = blind.pose(goal.targets[0])[0], task.score(blind)
    for cube in goal.bodies[:10]:
        teleport(blind, cube, Pose2(square.x, square.y), 0.005)
    assert task.score(blind) == pytest.approx(start + 0.2)


def test_a_ring_really_hangs_round_its_peg(blind):
    ring = lay_out(blind, HANOI).goals[0].bodies[0]
    pose = blind.pose(ring)[0]
    for _ in range(60):
        p.resetBaseVelocity(ring.id, (0.3, 0.0, 0.0), physicsClientId=blind.client)
        p.stepSimulation(physicsClientId=blind.client)
    assert distance(blind.pose(ring)[0], pose) < 0.02


def test_the_gallery_shows_a_task_before_and_after(world):
    story = gallery.play(world, BOWL, split="val")
    assert story.score == 1.0 and story.actions >= 1
    assert len(story.sentences) == 1 and story.sentences[0].startswith("put the")
    changed = np.abs(story.first.astype(int) - story.last).max(axis=-1) > 30
    assert 0.0001 < changed.mean() < 0.2  # the blocks moved, the rest of the picture did not
    assert len(plot_benchmark.show_gallery([story, story], columns=2).axes) == 4


@pytest.mark.parametrize("name", ["align-rope", "assembling-kits-seq-seen-colors"])
def test_sentences_are_the_same_where_no_time_passes(blind, name):
    for index, sentences in enumerate(gallery.sentences(name, episodes=2)):
        task = tasks.make(name, "test")
        blind.begin(task, tasks.episode_seed("test", index))
        assert sentences == [goal.sentence for goal in task.goals]
