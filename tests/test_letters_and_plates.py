"""Three tasks of the real tables: letters on plates, a pyramid on coloured plates, shapes in bowls."""

import math
from functools import partial

import numpy as np
import pytest
from tabletop import lay_out, layout, play

from gem_lite import language, tasks
from gem_lite.actions import PickPlace
from gem_lite.foundations import colors
from gem_lite.rgbd.camera import Camera
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.grips import Surfaces
from gem_lite.simulation.rendering import render
from gem_lite.tasks import arrange_letter_to_word, pick_shapes_in_bowl

LETTERS, PYRAMID, SHAPES = "arrange-letter-to-word-seen", "block-stacking-pyramid-seen", "pick-shapes-in-bowl-seen"
MIDDLE = Pose2(0.5, 0.0)
ABOVE = Camera.pinhole("above", (0.5, 0, 5), (1.0, 0.0, 0.0, 0.0), (96, 96), 10000, 4, 6)
"""Looks straight down at (0.5, 0): 0.5 mm to a pixel, world +y up in the picture."""


def turned(action, degrees):
    """The action with another yaw of the place."""
    return PickPlace(action.pick, action.place @ Pose2(0, 0, math.radians(degrees)))


@pytest.mark.parametrize("degrees", [10, 25, 180])
def test_a_letter_with_a_wrong_yaw_earns_half_and_is_not_put_again(blind, degrees):
    task = lay_out(blind, LETTERS)
    sentences = [goal.sentence for goal in task.goals]
    first = blind.step(turned(task.expert(blind).action, degrees))
    earned = 1.0 if degrees == 10 else 0.5
    assert first.reward == pytest.approx(earned / 3) and task.instruction == sentences[1]
    # The right plate of the third letter is a wrong one for the second, which is then lost.
    second, third = task.goals[1:]
    wrong = PickPlace(blind.pose(second.bodies[0])[0], blind.pose(third.targets[0])[0] @ Pose2(0.0, 0.012))
    assert blind.step(wrong).reward == 0.0 and task.instruction == sentences[2]
    last = blind.step(PickPlace(blind.pose(third.bodies[0])[0], blind.pose(second.targets[0])[0]))
    assert last.done and task.score(blind) == pytest.approx(earned / 3)
    task.advance(blind)
    assert task.expert(blind) is None and task.instruction == sentences[2]


@pytest.mark.parametrize(
    ("variant", "split", "letters", "digits"),
    [
        ("seen", "test", arrange_letter_to_word.SEEN_LETTERS, ()),
        ("unseen", "train", arrange_letter_to_word.SEEN_LETTERS, ()),
        ("unseen", "test", arrange_letter_to_word.UNSEEN_LETTERS, arrange_letter_to_word.DIGITS),
    ],
)
def test_the_tiles_of_a_word(blind, variant, split, letters, digits):
    assert not set(arrange_letter_to_word.SEEN_LETTERS) & set(arrange_letter_to_word.UNSEEN_LETTERS)
    found, words = set(), set()
    for index in range(40):
        task = layout(blind, f"arrange-letter-to-word-{variant}", split, index)
        names = [tuple(name.split(" ", 1)) for name in task.names.values()]
        plates = [color for color, what in names if what == "plate"]
        *asked, same_color, same_letter = (name for name in names if name[1] != "plate")
        sentences = [
            f"pick the {c} {what} and place on {at} plate" for (c, what), at in zip(asked, plates, strict=True)
        ]
        assert [goal.sentence for goal in task.goals] == sentences
        assert len({*plates, *(color for color, _ in asked)}) == 6 and set(task.named_colors) <= set(colors.SEEN)
        assert same_color[0] in dict(asked) and same_color[1] not in dict(asked).values()
        assert same_letter[1] in dict(asked).values() and same_letter[0] not in (*dict(asked), *plates)
        found |= {what for _, what in names if what != "plate"}
        words.add("".join(what[-1] for _, what in asked))
    of_letters = {what[-1] for what in found if what.startswith("letter ")}
    assert of_letters <= set(letters) and len(of_letters) > 0.8 * len(letters)
    assert {what[-1] for what in found if what.startswith("digit ")} == set(digits)
    assert words & set(arrange_letter_to_word.UNSEEN_WORDS if digits else arrange_letter_to_word.WORDS)


@pytest.mark.parametrize("yaw", [0.0, math.pi])
def test_a_black_line_and_a_white_one_show_the_yaw(world, stage, yaw):
    for add, side in (
        (partial(arrange_letter_to_word.add_lined_tile, name="letter I"), arrange_letter_to_word.TILE[0]),
        (arrange_letter_to_word.add_lined_plate, arrange_letter_to_word.PLATE[0]),
    ):
        stage(partial(add, color=colors.rgba("red"), pose=Pose2(0.5, 0.0, yaw)))
        view, _ = render(world.client, ABOVE)
        reach = round((side / 2 - 0.0024) / 0.0005)
        left, right = (int(view.rgb[40, 48 + sign * reach].max()) for sign in (-1, 1))
        assert (left < 40 and right > 200) if yaw == 0 else (left > 200 and right < 40)


def test_the_plates_of_a_pyramid_touch_and_no_block_has_their_colours(blind):
    task = lay_out(blind, PYRAMID)
    plates = [blind.pose(body)[0] for body in blind.bodies if not body.movable]
    assert [(plates[0].inverse() @ plate).y for plate in plates] == pytest.approx([0, 0.025, 0.05])
    of_plates = [name.removesuffix(" plate") for name in task.names.values() if name.endswith(" plate")]
    assert set(of_plates) == set(colors.OTHERS) and not set(of_plates) & set(colors.RGB)
    a, b, c, d, e, _ = task.named_colors
    joined = [language.conjuncts(language.parse(goal.sentence).place) for goal in task.goals]
    assert joined[:3] == [(f"{color} plate",) for color in of_plates]
    assert joined[3:] == [tuple(f"{color} block" for color in pair) for pair in ((a, b), (b, c), (d, e))]
    played = play(blind, task)
    assert sorted(z for _, z in played.movable) == pytest.approx([0.0125] * 3 + [0.0325] * 2 + [0.0525], abs=0.001)


def test_both_colour_and_shape_decide(blind):
    for split, variant, allowed in (("test", "unseen", "UNSEEN_SHAPES"), ("train", "unseen", "SHAPES")):
        for index in range(20):
            task = layout(blind, f"pick-shapes-in-bowl-{variant}", split, index)
            pieces = [tuple(name.split(" ", 1)) for name in task.names.values() if not name.endswith(" bowl")]
            (color, shape), same_color, same_shape, other = pieces
            assert language.parse(task.instruction).pick == f"{color} {shape}"
            assert same_color[0] == color and same_color[1] != shape
            assert same_shape[1] == shape and same_shape[0] != color
            assert other[0] != color and other[1] != shape
            assert {what for _, what in pieces} <= set(getattr(pick_shapes_in_bowl, allowed))
    task = lay_out(blind, SHAPES)
    expert = task.expert(blind).action
    other = next(body for body in blind.bodies if task.names[body.id] not in task.instruction and body.movable)
    grasp = pick_shapes_in_bowl.GRASPS.get(task.names[other.id].split(" ", 1)[1], Pose2(0, 0))
    step = blind.step(PickPlace(blind.pose(other)[0] @ grasp, expert.place))
    assert step.held == other.id and step.reward == 0.0


@pytest.mark.parametrize("shape", pick_shapes_in_bowl.SHAPES + pick_shapes_in_bowl.UNSEEN_SHAPES)
def test_a_jaw_holds_every_piece_where_the_expert_grasps_it_and_a_little_beside(blind, stage, shape):
    mesh = pick_shapes_in_bowl.piece_mesh(shape)
    (piece,), _ = stage(partial(shapes.add_mesh, mesh=mesh, color=colors.rgba("red"), pose=MIDDLE))
    surfaces = Surfaces.of(blind.client, [piece])
    grasp = MIDDLE @ pick_shapes_in_bowl.GRASPS.get(shape, Pose2(0, 0))
    symmetry = pick_shapes_in_bowl.grasp_symmetry(shape) or math.radians(50)
    for turn in np.arange(0, 2 * math.pi, symmetry):
        for dx, dy, degrees in ((0, 0, 0), (0.001, 0, 5), (-0.001, 0.001, -5), (0, -0.001, 5)):
            pose = grasp @ Pose2(dx, dy, turn + math.radians(degrees))
            assert surfaces.grip(pose) is not None, (turn, dx, dy, degrees)
    if shape in ("square", "rectangle"):
        assert surfaces.grip(MIDDLE @ Pose2(0, 0, math.radians(45))) is None


def test_the_real_tables_tasks_are_registered():
    assert set(tasks.REAL_TABLE) <= set(tasks.names()) and not set(tasks.REAL_TABLE) & set(tasks.PAPER)
    for name in tasks.REAL_TABLE:
        task = tasks.make(name)
        assert (task.effector, task.scale) == ("parallel-jaw", 0.5) and task.workspace.shape == (160, 128)
