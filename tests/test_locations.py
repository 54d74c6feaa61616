import numpy as np
import pytest
import torch

from gem_lite import clip
from gem_lite.language import LOCATION_CODE_LENGTH, Queries, location_code, split_location, word_lists
from gem_lite.maps import query_maps
from gem_lite.policies import methods
from gem_lite.se2 import Workspace
from gem_lite.simulation.bodies import ropes

WORKSPACE = Workspace()


def table(*places):
    """A map that is 0 but for squares around (row, col, value), whose middles are their highest cells."""
    semantic = np.zeros(WORKSPACE.shape, np.float32)
    for row, col, value in places:
        semantic[row - 3 : row + 4, col - 3 : col + 4] = value - 0.05
        semantic[row, col] = value
    return semantic


@pytest.mark.parametrize(
    ("phrase", "word"),
    [
        ("left star hole", "left"), ("the top letter T shape hole", "top"), ("Middle ring hole", "middle"),
        ("block on the left", "left"), ("the block in the middle", "middle"), ("leftmost block", "left"),
        ("right-most block", "right"), ("middle brown block", "middle"), ("left top hat", "left"),
        ("leftmost shoe", "left"), ("shoe on the right", "right"), ("top black hat", "top"),
        ("star hole", None), ("middle of the stand", None), ("left", None), ("top hat", None), ("right shoe", None),
        ("left shoes with red laces", None), ("black top hat", None), ("bottom drawer", None), ("", None),
        ("on the left", None),
    ],
)  # fmt: skip
def test_the_location_word_of_a_phrase(phrase, word):
    assert split_location(phrase)[0] == word


def cells_of(semantic):
    """The cells of each response, as lists of (row, col)."""
    regions, count = query_maps.responses(semantic, WORKSPACE)
    return [np.argwhere(regions == number).tolist() for number in range(1, count + 1)]


@pytest.mark.parametrize(
    ("phrase", "thing"),
    [
        ("left star hole", "star hole"), ("the left star hole", "star hole"), ("star hole on the left", "star hole"),
        ("leftmost shoe", "shoe"), ("middle brown block", "brown block"), ("top hat", "top hat"),
        ("middle of the stand", "middle of the stand"), ("red block", "red block"), ("left", "left"),
    ],
)  # fmt: skip
def test_a_phrase_without_its_location_word(phrase, thing):
    assert split_location(phrase)[1] == thing


@pytest.mark.parametrize("word", word_lists.LOCATION_WORDS)
def test_every_word_that_is_read_chooses_a_response(word):
    semantic = table((50, 20, 1.0), (90, 40, 1.0))
    for wording in (f"{word} block", f"{word}most block"):
        read = split_location(wording)[0]
        assert (query_maps.located(semantic, read, WORKSPACE) == 1).sum() == 1


def test_responses_are_the_strongest_maxima():
    assert cells_of(table((50, 20, 1.0), (50, 50, 0.95), (90, 40, 0.85))) == [[[50, 20]], [[50, 50]]]


def test_two_maxima_of_one_place_are_one_response():
    semantic = table((50, 20, 1.0))
    semantic[52, 22] = 0.99
    assert cells_of(semantic) == [[[50, 20]]]
    semantic[52, 22] = 1.0
    assert cells_of(semantic) == [[[50, 20], [52, 22]]]


def flat_things():
    """Two flat things of 20 x 20 equal cells, as a detector fills its boxes."""
    semantic = np.zeros(WORKSPACE.shape, np.float32)
    semantic[40:60, 10:30] = semantic[90:110, 45:65] = 1.0
    return semantic


def test_a_flat_thing_is_one_response_and_stays_whole():
    semantic = flat_things()
    assert [len(cells) for cells in cells_of(semantic)] == [400, 400]
    for word, kept, lowered in (
        ("left", np.s_[40:60, 10:30], np.s_[90:110, 45:65]),
        ("bottom", np.s_[90:110, 45:65], np.s_[40:60, 10:30]),
    ):
        located = query_maps.located(semantic, word, WORKSPACE)
        assert (located[kept] == 1).all()
        assert np.allclose(located[lowered], 1 - query_maps.LOWERED)


def test_a_long_thing_beside_another_stays_whole():
    # By the distance to the middles, the ends of the long thing would belong to the other.
    semantic = np.zeros(WORKSPACE.shape, np.float32)
    semantic[10:150, 20] = 1.0
    semantic[20, 32] = 1.0
    located = query_maps.located(semantic, "left", WORKSPACE)
    assert (located[10:150, 20] == 1).all()
    assert located[20, 32] == np.float32(1 - query_maps.LOWERED)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_constant_map_has_no_response_and_stays_as_it_is(value):
    semantic = np.full(WORKSPACE.shape, value, np.float32)
    assert cells_of(semantic) == []
    for word in ("left", "right", "top", "bottom", "middle"):
        assert np.array_equal(query_maps.located(semantic, word, WORKSPACE), semantic)


def test_a_map_that_hardly_rises_above_the_table_has_no_response():
    semantic = table((50, 20, 0.09), (50, 50, 0.08))
    assert cells_of(semantic) == []
    assert np.array_equal(query_maps.located(semantic, "right", WORKSPACE), semantic)


@pytest.mark.parametrize(
    ("word", "place"),
    [("left", (70, 15)), ("right", (80, 60)), ("top", (30, 40)), ("bottom", (120, 40)), ("middle", (72, 40))],
)
def test_a_word_chooses_one_response_and_lowers_the_others(word, place):
    places = [(70, 15), (80, 60), (30, 40), (120, 40), (72, 40)]
    semantic = table(*[(row, col, 1.0 - 0.01 * i) for i, (row, col) in enumerate(places)])
    located = query_maps.located(semantic, word, WORKSPACE)
    assert located.dtype == np.float32
    assert np.unravel_index(located.argmax(), located.shape) == place
    own = np.s_[place[0] - 3 : place[0] + 4, place[1] - 3 : place[1] + 4]
    assert np.array_equal(located[own], semantic[own])
    for row, col in set(places) - {place}:
        assert located[row, col] == pytest.approx(semantic[place] - query_maps.LOWERED)
    assert (located <= semantic).all()


def test_the_directions_are_those_of_the_world():
    # Left is smaller x, top is larger y: as the task's words (tasks/assembling_kits.py).
    left, top = table((60, 15, 1.0), (60, 60, 1.0)), table((20, 40, 1.0), (120, 40, 1.0))
    row, col = np.unravel_index(query_maps.located(left, "left", WORKSPACE).argmax(), WORKSPACE.shape)
    assert WORKSPACE.to_world(row, col)[0] < WORKSPACE.to_world(60, 60)[0]
    row, col = np.unravel_index(query_maps.located(top, "top", WORKSPACE).argmax(), WORKSPACE.shape)
    assert WORKSPACE.to_world(row, col)[1] > WORKSPACE.to_world(120, 40)[1]


def test_one_response_stays_as_it_is():
    semantic = table((50, 20, 1.0))
    assert np.array_equal(query_maps.located(semantic, "right", WORKSPACE), semantic)


def test_an_unknown_word_is_named():
    with pytest.raises(ValueError, match="word must be one of left, right, top, bottom, middle, got 'north'"):
        query_maps.located(table((50, 20, 1.0)), "north", WORKSPACE)


def test_the_code_tells_directions_apart_that_the_embedded_clip_does_not():
    phrases = [f"{start} to {end}" for start, end in ropes.DIRECTIONS]
    codes = torch.stack([location_code(phrase) for phrase in phrases])
    embeddings = clip.load().embed_texts(phrases)
    apart = ~torch.eye(len(phrases), dtype=torch.bool)
    assert (embeddings @ embeddings.T)[apart].min() > 0.99
    assert (codes @ codes.T)[apart].max() < 0.9


@pytest.mark.parametrize(
    ("phrase", "words"),
    [
        ("red block", {}),
        ("left star hole", {0: 1}),
        ("Front left tip to back left corner", {4: 1, 0: 1, 7: 1, 9 + 5: 1, 9 + 0: 1, 9 + 8: 1}),
        ("tip tip", {7: 2}),
        ("leftmost red block", {0: 1}),
        ("red block on the left", {0: 1}),
        ("middle of the stand", {6: 1}),
        ("", {}),
        # Names have no location words.
        ("top hat", {}),
        ("left shoe", {}),
        ("leftmost shoe", {0: 1}),
        ("right left shoe", {1: 1}),
    ],
)
def test_the_code_counts_words_before_and_after_to(phrase, words):
    expected = torch.zeros(LOCATION_CODE_LENGTH)
    for number, count in words.items():
        expected[number] = count
    code = location_code(phrase)
    assert torch.allclose(code, torch.nn.functional.normalize(expected, dim=0))
    assert code.norm() == pytest.approx(1 if words else 0)


def test_a_word_after_to_is_another_than_one_before():
    before, after = location_code("left block"), location_code("block to the left")
    assert any(before) and any(after) and not torch.equal(before, after)


def test_a_line_has_one_code_in_both_directions():
    # CLIPort says "from back right corner to back left corner" where our task names the corners the other way round.
    for start, end in ropes.DIRECTIONS:
        assert torch.equal(location_code(f"{end} to {start}"), location_code(f"{start} to {end}"))


@pytest.mark.parametrize("method", methods.METHODS.names())
def test_the_networks_of_every_method_get_the_code_of_both_phrases(method):
    kind, config = methods.find(method)
    policy = kind(config, clip.load())
    words = policy.words(Queries("left red block", "front left tip to back left corner"))
    for name, phrase in (("pick", "left red block"), ("place", "front left tip to back left corner")):
        assert words[name].shape == (policy.language_dim,)
        assert torch.equal(words[name][-LOCATION_CODE_LENGTH:], location_code(phrase))
        assert words[name][-LOCATION_CODE_LENGTH:].any()
