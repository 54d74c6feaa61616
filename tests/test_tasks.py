"""The task families: layouts, sentences, scores, experts. More of those of CLIPort: test_benchmark_tasks.py."""

import math
from functools import partial

import numpy as np
import pybullet as p
import pytest
from pointing import bodies_from_above
from shapely import affinity
from shapely.geometry import Point

from gem_lite import language, tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.evaluation import collecting
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import effectors
from gem_lite.simulation.bodies import shapes, trays
from gem_lite.tasks import bars_in_box, packing_shapes, stack_block_pyramid
from gem_lite.tasks.goals import ZoneMetric

PYRAMID = "stack-block-pyramid-seq-seen-colors"
PYRAMID_UNSEEN = "stack-block-pyramid-seq-unseen-colors"
INSERTION, BARS = "block-insertion", "bars-in-box"
PACKING, PACKING_UNSEEN = "packing-shapes-seen", "packing-shapes-unseen"
BOWL, BOWL_UNSEEN = "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors"
FAMILIES = [PYRAMID, PYRAMID_UNSEEN, PACKING, PACKING_UNSEEN, INSERTION, BARS, BOWL, BOWL_UNSEEN]
ONE_TABLE = [name for name in tasks.names() if tasks.family(name) != "object-sorting"]


def lay_out(world, name, index=0, split="val"):
    task = tasks.make(name, split)
    world.reset(task, tasks.episode_seed(split, index))
    return task


def teleport(world, body, pose, z):
    p.resetBasePositionAndOrientation(
        body.id, (pose.x, pose.y, z), p.getQuaternionFromEuler((0, 0, pose.yaw)), physicsClientId=world.client
    )


def gap(world, a, b):
    """The distance (m) between two bodies, at most 50 mm."""
    return min((c[8] for c in p.getClosestPoints(a.id, b.id, 0.05, physicsClientId=world.client)), default=0.05)


def layout(world, name, split, index):
    """The task after laying out an episode that nothing has simulated since."""
    task = tasks.make(name, split)
    world.clear()
    seed = tasks.episode_seed(split, index)
    task.reset(world, np.random.default_rng(seed), seed)
    return task


def play(world, task):
    """Let the expert play to the end. Returns the sentences, the actions and the results."""
    sentences, actions, steps = [], [], []
    while not (steps and steps[-1].done):
        sentences.append(task.instruction)
        actions.append(task.expert(world).action)
        steps.append(world.step(actions[-1]))
    return sentences, actions, steps


# All families --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FAMILIES)
def test_layouts_keep_bodies_apart_and_in_the_workspace(blind, name):
    around = Workspace(x_min=0.2, x_max=0.8, y_min=-0.55, y_max=0.55)
    rows, cols = np.indices(around.shape)
    x, y = around.to_world(rows, cols)
    w = blind.workspace
    outside = (x < w.x_min) | (x > w.x_max) | (y < w.y_min) | (y > w.y_max)
    for index in range(5):
        layout(blind, name, "val", index)
        above = bodies_from_above(blind.client, around)
        ids = [body.id for body in blind.bodies]
        assert set(ids) <= set(above[~outside].tolist()) and not set(ids) & set(above[outside].tolist())
        movable = [body for body in blind.bodies if body.movable]
        assert movable and all(gap(blind, a, b) > 0.01 for a in movable for b in blind.bodies if a is not b)
        before = [blind.pose(body)[0] for body in blind.bodies]
        assert blind.settle()
        for body, pose in zip(blind.bodies, before, strict=True):
            assert math.hypot(blind.pose(body)[0].x - pose.x, blind.pose(body)[0].y - pose.y) < 0.001


@pytest.mark.parametrize("name", ONE_TABLE)
def test_every_body_has_a_name_and_one_seed_is_one_layout(blind, name):
    def described(index):
        task = lay_out(blind, name, index)
        assert set(task.names) == {body.id for body in blind.bodies}
        return task.instruction, list(task.names.values()), [blind.pose(body) for body in blind.bodies]

    assert described(5) == described(5)
    assert described(5)[2] != described(6)[2]


@pytest.mark.parametrize("name", ONE_TABLE)
def test_the_expert_solves_an_episode_and_the_grammar_reads_every_sentence(blind, name):
    # In this episode of the piles, a cube lies in the square from the beginning. The first action is paid for it, too.
    pushes = name.startswith("separating")
    task = lay_out(blind, name, 1, "test") if pushes else lay_out(blind, name)
    first_score = task.score(blind)
    assert 0 < first_score < 0.1 if pushes else first_score < 0.3
    sentences, actions, steps = play(blind, task)
    rewards = [step.reward for step in steps]
    assert sum(rewards) == pytest.approx(task.score(blind)) == pytest.approx(1.0, abs=1e-6 if pushes else 0.01)
    assert len(actions) <= task.max_steps
    for sentence, action in zip(sentences, actions, strict=True):
        queries = language.parse(sentence)
        assert queries.push == isinstance(action, Push) == pushes
        assert queries.pick and queries.place
    if name in FAMILIES:  # One action for each body, each worth the same.
        assert first_score == 0.0 and task.score(blind) == 1.0
        assert rewards == pytest.approx([1 / len(steps)] * len(steps)) and all(step.grasped for step in steps)
        assert task.expert(blind) is None


@pytest.mark.parametrize("name", FAMILIES)
def test_doing_nothing_earns_nothing(blind, name):
    task = lay_out(blind, name)
    instruction = task.instruction
    pick = task.expert(blind).action.pick
    step = blind.step(PickPlace(pick, pick))
    assert step.grasped and step.reward == 0.0
    assert task.instruction == instruction
    assert step.done == (task.max_steps == 1)


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


# stack-block-pyramid-seq ---------------------------------------------------------------------------------


def test_a_pyramid_has_six_sentences_and_three_layers(blind):
    task = lay_out(blind, PYRAMID)
    a, b, c, d, e, f = task.named_colors
    heard = [language.parse(sentence) for sentence in play(blind, task)[0]]
    places = [
        *stack_block_pyramid.PLATES, f"{a} and {b} blocks", f"{b} and {c} blocks", f"{d} and {e} blocks"
    ]  # fmt: skip
    assert [phrases.pick for phrases in heard] == [f"{color} block" for color in (a, b, c, d, e, f)]
    assert [phrases.place for phrases in heard] == places
    heights = sorted(blind.pose(body)[1] for body in blind.bodies if body.movable)
    assert heights == pytest.approx([0.025] * 3 + [0.065] * 2 + [0.105], abs=0.002)


def test_the_plates_lie_from_light_to_dark_along_the_base(blind):
    task = lay_out(blind, PYRAMID)
    light, middle, dark = (blind.pose(body)[0] for body in blind.bodies if not body.movable)
    assert [task.names[body.id] for body in blind.bodies[:3]] == list(stack_block_pyramid.PLATES)
    assert (light.inverse() @ middle).y == pytest.approx(0.05)
    assert (light.inverse() @ dark).y == pytest.approx(0.1)
    brightness = [sum(rgba) for rgba in stack_block_pyramid.PLATES.values()]
    assert brightness == sorted(brightness, reverse=True)


@pytest.mark.parametrize(
    ("dx", "dz", "degrees", "placed"),
    [
        (0, 0, 0, True), (0.008, 0, 0, True), (0.012, 0, 0, False), (0, 0.04, 0, False), (0, 0, 90, True),
        (0, 0, -12, True), (0, 0, 18, False), (0, 0, 45, False),
    ],
)  # fmt: skip
def test_a_block_is_placed_in_position_height_and_yaw(blind, dx, dz, degrees, placed):
    task = lay_out(blind, PYRAMID)
    block = next(body for body in blind.bodies if body.movable)
    spot = blind.pose(blind.bodies[0])[0] @ Pose2(dx, 0, math.radians(degrees))
    teleport(blind, block, spot, 0.025 + dz)
    assert task.score(blind) == pytest.approx(1 / 6 if placed else 0)


def test_a_pyramid_counts_a_done_sentence_for_good_and_repeats_an_open_one(blind):
    task = lay_out(blind, PYRAMID)
    first, home = next(body for body in blind.bodies if body.movable), Pose2(0.5, 0.0)
    blind.step(task.expert(blind).action)
    second = task.instruction
    teleport(blind, first, home, 0.02)
    assert task.score(blind) == pytest.approx(1 / 6)
    expert = task.expert(blind).action
    wrong = Pose2(expert.place.x, expert.place.y, expert.place.yaw + math.radians(45))
    step = blind.step(PickPlace(expert.pick, wrong))
    assert (step.reward, step.done, task.instruction) == (0.0, False, second)
    step = blind.step(task.expert(blind).action)  # a second try
    assert step.reward == pytest.approx(1 / 6) and task.instruction != second


def test_a_demonstration_keeps_the_sentence_that_each_step_obeyed(world):
    demonstration = collecting.roll_out(world, PYRAMID, "train", 0)
    task = tasks.make(PYRAMID, "train")
    world.reset(task, tasks.episode_seed("train", 0))
    picks = [step.phrases.pick for step in demonstration.steps]
    assert picks == [f"{color} block" for color in task.named_colors]
    assert len({step.instruction for step in demonstration.steps}) == 6


# packing-shapes ------------------------------------------------------------------------------------------


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
        assert len({color for color, _ in pieces}) == len({shape for _, shape in pieces}) == packing_shapes.PIECES
        phrases = language.parse(task.instruction)
        assert phrases.place == "brown box"
        assert phrases.pick in [shape.lower() for _, shape in pieces]
        seen |= {(color, shape) for color, shape in pieces}
        asked.add(phrases.pick)
    assert {color for color, _ in seen} == set(palette)
    assert {shape for _, shape in seen} == set(names)
    assert len(asked) > 4
    assert not set(shapes.SEEN_SHAPES) & set(shapes.UNSEEN_SHAPES)


def test_another_piece_in_the_box_earns_nothing(blind):
    task = lay_out(blind, PACKING)
    asked, box = task.expert(blind).action.pick, task.expert(blind).action.place
    others = [blind.pose(body)[0] for body in blind.bodies if body.movable]
    other = max(others, key=lambda pose: math.hypot(pose.x - asked.x, pose.y - asked.y))
    step = blind.step(PickPlace(other, box))
    assert step.grasped and step.reward == 0.0


def test_in_a_zone_is_between_its_walls_and_below_the_rim(blind, stage):
    size, centre = (0.12, 0.1), Pose2(0.5, 0.0, 0.7)
    (box, block), _ = stage(
        partial(trays.add_container, size=size, color=colors.rgba("brown"), pose=centre),
        partial(shapes.add_block, color=colors.rgba("red"), pose=Pose2(0.4, 0.3)),
    )
    inside = partial(ZoneMetric(size, trays.CONTAINER_HEIGHT).share, blind, block, box)
    assert not inside()
    for offset, z, expected in [
        (Pose2(0, 0), 0.022, True),
        (Pose2(0.055, 0.045), 0.022, True),
        (Pose2(0.065, 0), 0.022, False),
        (Pose2(0, 0.055), 0.022, False),
        (Pose2(0, 0), 0.07, False),
    ]:
        teleport(blind, block, centre @ offset, z)
        assert inside() == expected
    # Its walls are real: a block dropped in comes to rest on its floor.
    teleport(blind, block, centre, 0.1)
    blind.settle()
    assert blind.pose(block)[1] == pytest.approx(trays.WALL + 0.02, abs=0.001)


@pytest.mark.parametrize("shape", shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES)
def test_a_pieces_symmetry_and_grasp_point(shape):
    outline = shapes.outline(shape)

    def misfit(turn):
        return outline.symmetric_difference(affinity.rotate(outline, turn, origin=(0, 0))).area / outline.area

    assert outline.buffer(-0.0039).contains(Point(packing_shapes.grasp_point(shape)))
    assert math.hypot(*packing_shapes.grasp_point(shape)) < 0.02
    if shape in packing_shapes.ROUND:
        assert max(misfit(turn) for turn in (11, 45, 100)) < 0.03
        return
    copies = packing_shapes.TURNS.get(shape, 1)
    assert misfit(360 / copies) < 0.01
    assert all(misfit(360 / more) > 0.03 for more in range(copies + 1, 9))


# block-insertion -----------------------------------------------------------------------------------------


def test_insertion_names_two_bodies(blind):
    task = lay_out(blind, INSERTION)
    block, fixture = task.named_colors
    assert language.parse(task.instruction) == language.Queries(f"{block} l-block", f"{fixture} box")
    assert block != fixture and len(blind.bodies) == 2
    assert task.expert(blind).place_symmetry == pytest.approx(2 * math.pi)


def test_a_fixture_leaves_its_clearance_all_round(blind, stage):
    pose = Pose2(0.5, 0.1, 2.0)
    (fixture, block), _ = stage(
        partial(trays.add_l_fixture, color=colors.rgba("blue"), pose=pose),
        partial(shapes.add_l_block, color=colors.rgba("red"), pose=Pose2(0.4, -0.2)),
    )
    c, seated = trays.FIXTURE_CLEARANCE, trays.WALL + block.rest_height
    for direction in range(8):  # the walls on all sides are equally far
        angle = direction * math.pi / 4
        reach = c / max(abs(math.cos(angle)), abs(math.sin(angle)))
        for share, free in [(0.9, True), (1.1, False)]:
            offset = Pose2(share * reach * math.cos(angle), share * reach * math.sin(angle))
            teleport(blind, block, pose @ offset, seated + 0.001)
            assert (gap(blind, fixture, block) > 0) == free


@pytest.mark.parametrize(
    ("x", "degrees", "reward"),
    [(0, -90, 0), (0, -20, 0), (0, 20, 0), (0, 90, 0), (0, 180, 0), (0.014, 0, 0), (0.003, 4, 1)],
)
def test_an_l_goes_in_only_if_it_is_nearly_right(blind, x, degrees, reward):
    for index in range(3):
        expert = lay_out(blind, INSERTION, index).expert(blind).action
        place = expert.place @ Pose2(x, 0, math.radians(degrees))
        assert blind.step(PickPlace(expert.pick, place)).reward == reward


def test_an_l_above_the_fixture_is_not_in_it(blind):
    task = lay_out(blind, INSERTION)
    fixture, block = blind.bodies
    pose = blind.pose(fixture)[0]
    for z, expected in [(0.022, 1.0), (0.04, 0.0)]:
        teleport(blind, block, pose, z)
        assert task.score(blind) == expected


# bars-in-box ---------------------------------------------------------------------------------------------


def test_a_bar_is_named_among_others(blind):
    task = lay_out(blind, BARS)
    (color,) = task.named_colors
    assert language.parse(task.instruction) == language.Queries(f"{color} bar", "brown box")
    assert sorted(task.names.values()).count(f"{color} bar") == 1
    assert sum(name.endswith("bar") for name in task.names.values()) == bars_in_box.BARS
    assert task.expert(blind).pick_symmetry == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("degrees", "along", "holds"),
    [
        (180, 0.0, True), (15, 0.0, True), (-15, 0.0, True), (165, 0.0, True), (0, 0.012, True), (0, -0.012, True),
        (25, 0.0, False), (-25, 0.0, False), (90, 0.0, False), (0, 0.025, False), (0, -0.025, False),
    ],
)  # fmt: skip
def test_a_jaw_holds_a_bar_only_across_and_near_its_middle(blind, degrees, along, holds):
    task = lay_out(blind, BARS)
    expert = task.expert(blind).action
    step = blind.step(PickPlace(expert.pick @ Pose2(along, 0, math.radians(degrees)), expert.place))
    assert step.grasped == holds
    assert step.reward == float(holds)


def test_any_turn_of_the_bar_fits_the_box(blind):
    for index, degrees in enumerate([45, 90, 135]):
        task = lay_out(blind, BARS, index)
        expert = task.expert(blind).action
        assert blind.step(PickPlace(expert.pick, expert.place @ Pose2(0, 0, math.radians(degrees)))).reward == 1.0


def test_suction_holds_a_bar_at_any_yaw(blind, stage):
    lay_out(blind, BARS)
    assert isinstance(blind.effector, effectors.Jaw)
    pose = Pose2(0.5, 0.0, 0.3)
    stage(partial(shapes.add_box, size=bars_in_box.BAR_SIZE, color=colors.rgba("red"), pose=pose))
    assert type(blind.effector) is effectors.Suction
    assert blind.step(PickPlace(pose @ Pose2(0, 0, math.pi / 2), Pose2(0.5, 0.2))).grasped


def test_what_is_placed_is_known(blind):
    index = next(i for i in range(20) if len(layout(blind, BOWL, "val", i).goals[0].bodies) > 1)
    task = lay_out(blind, BOWL, index)
    assert task.placed(blind) == set()
    expert = task.expert(blind)
    assert expert.action.delta == pytest.approx(0)
    assert (expert.pick_symmetry, expert.place_symmetry) == pytest.approx((math.pi / 2, 0.0))
    blind.step(expert.action)
    (placed,) = task.placed(blind)
    assert task.names[placed] == f"{task.named_colors[0]} block"
    task = lay_out(blind, PYRAMID)
    for count in range(3):
        assert {task.names[body] for body in task.placed(blind)} == {f"{c} block" for c in task.named_colors[:count]}
        blind.step(task.expert(blind).action)
