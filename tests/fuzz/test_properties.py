"""Laws that hold for every input: SE(2), the patch grid, stitch and split, and the grammar of sentences."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from gem_lite import language
from gem_lite.language import Queries, conjuncts, parse, word_lists
from gem_lite.maps.patches import PatchGrid, patchify, unpatchify
from gem_lite.policies.choosing import split, stitch
from gem_lite.se2 import ImageMotion, Pose2, Workspace, angle_off, rotation_matrix, wrap

ANGLES = st.floats(-20, 20)
METRES = st.floats(-2, 2)
POSES = st.builds(Pose2, METRES, METRES, ANGLES)
IDENTITY = Pose2(0.0, 0.0, 0.0)


def assert_same_pose(a, b):
    assert (a.x, a.y, wrap(a.yaw - b.yaw)) == pytest.approx((b.x, b.y, 0.0), abs=1e-9)


# SE(2)


@given(POSES, POSES, POSES)
def test_poses_are_a_group(a, b, c):
    assert_same_pose((a @ b) @ c, a @ (b @ c))
    assert_same_pose(a @ IDENTITY, a)
    assert_same_pose(IDENTITY @ a, a)
    assert_same_pose(a @ a.inverse(), IDENTITY)
    assert_same_pose(a.inverse() @ a, IDENTITY)
    assert_same_pose((a @ b).inverse(), b.inverse() @ a.inverse())


@given(POSES, POSES, POSES)
def test_a_motion_keeps_relative_poses(motion, a, b):
    assert_same_pose((motion @ a).inverse() @ (motion @ b), a.inverse() @ b)


@given(st.floats(-1e6, 1e6), st.integers(-1000, 1000))
def test_wrap_keeps_the_direction_and_forgets_whole_turns(angle, turns):
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1, abs=1e-9)
    assert math.cos(wrap(angle + 2 * math.pi * turns) - wrapped) == pytest.approx(1, abs=1e-9)


@given(ANGLES, st.integers(1, 12), st.integers(-20, 20))
def test_an_angle_is_as_far_off_as_every_equivalent_angle(angle, fold, turns):
    symmetry = 2 * math.pi / fold
    off = angle_off(angle, symmetry)
    assert 0 <= off <= symmetry / 2 + 1e-9
    assert angle_off(angle + turns * symmetry, symmetry) == pytest.approx(off, abs=1e-9)
    assert angle_off(-angle, symmetry) == pytest.approx(off, abs=1e-9)


# World and pixels


@st.composite
def workspaces(draw):
    """Any table: a corner anywhere, 1 to 60 cells a side, cells of 1 to 20 mm."""
    pixel = draw(st.floats(0.001, 0.02))
    x_min, y_min = draw(METRES), draw(METRES)
    rows, cols = draw(st.integers(1, 60)), draw(st.integers(1, 60))
    return Workspace(x_min, x_min + cols * pixel, y_min, y_min + rows * pixel, pixel=pixel)


FRACTIONS = st.floats(0.001, 0.999)


@given(workspaces(), METRES, METRES)
def test_world_and_pixels_undo_each_other(workspace, x, y):
    assert workspace.to_world(*workspace.to_pixel(x, y)) == pytest.approx((x, y), abs=1e-9)


@given(workspaces(), FRACTIONS, FRACTIONS)
def test_every_point_of_the_table_has_a_cell_at_most_half_a_pixel_away(workspace, across, along):
    x = workspace.x_min + across * (workspace.x_max - workspace.x_min)
    y = workspace.y_min + along * (workspace.y_max - workspace.y_min)
    row, col = workspace.nearest_cell(x, y)
    assert 0 <= row < workspace.shape[0] and 0 <= col < workspace.shape[1]
    centre = workspace.to_world(row, col)
    assert max(abs(centre[0] - x), abs(centre[1] - y)) <= workspace.pixel / 2 + 1e-9


@given(workspaces(), METRES, METRES, ANGLES, METRES, METRES)
def test_counter_clockwise_in_the_world_is_counter_clockwise_in_the_picture(workspace, x, y, angle, dx, dy):
    # The same vector, turned in the world by a pose and in the picture by a matrix.
    turned = Pose2(x, y, angle) @ Pose2(dx, dy)
    here, there = np.array(workspace.to_pixel(x, y)), np.array(workspace.to_pixel(x + dx, y + dy))
    assert workspace.to_pixel(turned.x, turned.y) == pytest.approx(
        here + rotation_matrix(angle) @ (there - here), abs=1e-6
    )


SIDES = st.integers(2, 24)
SHIFTS = st.tuples(st.integers(-5, 5), st.integers(-5, 5))


@given(SIDES, SIDES, ANGLES, SHIFTS, st.floats(0, 30), st.floats(0, 30), ANGLES)
def test_a_motion_of_pixels_keeps_distances_and_turns_directions(height, width, angle, shift, row, col, direction):
    motion = ImageMotion(angle, shift)
    start, ahead = (row, col), (row - math.sin(direction), col + math.cos(direction))  # rows point down
    here, there = (np.array(motion.move(pixel, (height, width))) for pixel in (start, ahead))
    turned = direction + angle
    assert there - here == pytest.approx((-math.sin(turned), math.cos(turned)), abs=1e-9)


# The patch grid


@st.composite
def grids(draw):
    shape = draw(st.tuples(st.integers(1, 40), st.integers(1, 40)))
    patch = draw(st.integers(1, min(shape)))
    return PatchGrid(shape, patch, draw(st.integers(1, patch)))


def summed(grid, scores):
    """(H, W): the sum of the scores of the patches that hold each pixel, one patch at a time."""
    total = np.zeros(grid.shape)
    rows, cols = grid.starts()
    for i, row in enumerate(rows):
        for j, col in enumerate(cols):
            total[row : row + grid.patch, col : col + grid.patch] += scores[i, j]
    return total


def counts(grid):
    """(H, W): how many patches hold each pixel."""
    return summed(grid, np.ones(size(grid)))


def size(grid):
    """(m, n): the number of rows and columns of patches."""
    rows, cols = grid.starts()
    return len(rows), len(cols)


@given(grids())
def test_every_pixel_is_covered_and_no_patch_leaves_the_image(grid):
    for starts, length in zip(grid.starts(), grid.shape, strict=True):
        assert starts[0] == 0 and starts[-1] == length - grid.patch
        assert ((np.diff(starts) >= 1) & (np.diff(starts) <= grid.stride)).all()
    assert counts(grid).min() >= 1
    rows, cols = grid.coverage()
    assert np.array_equal(np.outer(rows.sum(axis=1), cols.sum(axis=1)), counts(grid))


@given(grids(), st.integers(0, 2**32 - 1))
def test_unpatchify_is_the_mean_of_the_patches_that_hold_a_pixel(grid, seed):
    scores = np.random.default_rng(seed).normal(size=size(grid))
    spread = unpatchify(scores, grid)
    np.testing.assert_allclose(spread, summed(grid, scores) / counts(grid), atol=1e-4)
    assert scores.min() - 1e-5 <= spread.min() and spread.max() <= scores.max() + 1e-5


@given(grids(), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_patches_are_slices_and_wanted_ones_are_those(grid, channels, seed):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 255, (*grid.shape, channels), np.uint8)
    patches = patchify(image, grid)
    rows, cols = grid.starts()
    assert patches.shape == (len(rows), len(cols), grid.patch, grid.patch, channels)
    i, j = rng.integers(len(rows)), rng.integers(len(cols))
    assert np.array_equal(patches[i, j], image[rows[i] : rows[i] + grid.patch, cols[j] : cols[j] + grid.patch])
    wanted = rng.random(size(grid)) < 0.3
    assert np.array_equal(patchify(image, grid, wanted), patches[wanted])


@given(grids(), st.data())
def test_a_pixel_meets_the_patches_that_hold_it(grid, data):
    pixel = tuple(data.draw(st.integers(0, length - 1)) for length in grid.shape)
    pixels = np.zeros(grid.shape, bool)
    pixels[pixel] = True
    met = grid.meets(pixels)
    assert met.sum() == counts(grid)[pixel]
    marked = pixels[..., None].astype(np.uint8)
    assert np.array_equal(patchify(marked, grid).any(axis=(2, 3, 4)), met)


SMALL = st.integers(1, 6)


@given(SMALL, SMALL, SMALL, SMALL, st.data())
def test_a_cell_of_the_stitched_map_is_the_cell_of_one_table(tables, turns, height, width, data):
    maps = torch.arange(tables * turns * height * width).reshape(tables, turns, height, width)
    stitched = stitch(maps)
    assert stitched.shape == (turns, height, tables * width)
    cell = tuple(data.draw(st.integers(0, length - 1)) for length in stitched.shape)
    table, own = split(cell, width)
    assert 0 <= table < tables
    assert maps[table][own] == stitched[cell]
    assert (own[0], own[1], table * width + own[2]) == cell


# The parser


@dataclasses.dataclass(frozen=True)
class Named:
    """How a sentence names something, and the phrase that a parser must find."""

    written: str
    phrase: str


def maybe(strategy):
    return st.one_of(st.just(""), strategy)


def spaced(*words):
    return " ".join(word for word in words if word)


NOUNS = ("block", "bowl", "brown box", "coffee mug", "letter E block", "pile of blocks", "mug with orange stripes")
COLORS = ("red", "light brown", "scarlet", "grey")
KINDS = st.builds(spaced, maybe(st.sampled_from(COLORS)), st.sampled_from(NOUNS))
DETERMINERS = maybe(st.sampled_from(("the", "a", "all of the", "one of the")))
THINGS = st.builds(lambda determiner, kind: Named(spaced(determiner, kind), kind.lower()), DETERMINERS, KINDS)
PLACED = st.builds(
    lambda thing, where: Named(
        spaced(thing.written, where), spaced(word_lists.LOCATIONS.get(where, ""), thing.phrase)
    ),
    THINGS, maybe(st.sampled_from(tuple(word_lists.LOCATIONS))),
)  # fmt: skip
"""Anything, and perhaps which one of several equal ones."""
LED = st.builds(
    lambda word, kind: Named(f"the {word} {kind}", f"{word_lists.LEADING[word]} {kind.lower()}"),
    st.sampled_from(tuple(word_lists.LEADING)), KINDS,
)  # fmt: skip
JOINED = st.builds(
    lambda first, second, kind: Named(f"the {first} and {second} {kind}", f"{first} and {second} {kind}"),
    st.sampled_from(COLORS), st.sampled_from(COLORS), st.sampled_from(("blocks", "mugs")),
)  # fmt: skip
HELD = st.builds(
    lambda thing, part: Named(f"{thing.written} by its {part}", f"{thing.phrase} {part}"),
    THINGS, st.sampled_from(word_lists.PARTS),
)  # fmt: skip
PICKS = st.one_of(PLACED, LED, JOINED, HELD)
PLACES = st.one_of(PLACED, LED, JOINED).filter(lambda place: not place.written.startswith("all"))
"""A place is one: "in all of the bowls" is refused."""
JOINTS = st.builds(
    spaced,
    st.sampled_from(("and", "then", "and then", ", and")), st.sampled_from(language.VERBS),
    maybe(st.sampled_from(("it", "them"))),
)  # fmt: skip
PREPOSITIONS = st.sampled_from(language.PLACING)
OPENINGS = maybe(st.sampled_from(("please", "could you", "now")))
CLOSINGS = maybe(st.sampled_from((".", "please", "for me , thank you !")))


FIRST_VERBS = st.sampled_from([verb for verb in language.VERBS if verb != word_lists.ALIGNING])


@given(OPENINGS, FIRST_VERBS, PICKS, maybe(JOINTS), PREPOSITIONS, PLACES, CLOSINGS)
def test_every_sentence_of_the_grammar_is_read_right(opening, verb, pick, joint, preposition, place, closing):
    sentence = spaced(opening, verb, pick.written, joint, preposition, place.written, closing)
    assert parse(sentence) == Queries(pick.phrase, place.phrase, push=verb == word_lists.PUSHING)


@given(st.lists(st.sampled_from(COLORS), min_size=2, max_size=4, unique=True), st.sampled_from(("blocks", "mugs")))
def test_a_shared_noun_is_given_to_every_member(colors, noun):
    phrase = f"{', '.join(colors[:-1])} and {colors[-1]} {noun}"
    assert conjuncts(phrase) == tuple(f"{color} {noun}" for color in colors)
    assert parse(f"put the {phrase} in the bowl") == Queries(phrase, "bowl")
