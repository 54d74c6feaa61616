import numpy as np
import pytest
import torch

from gem_lite.language import LOCATION_CODE_LENGTH, Queries, location_code, split_location, word_lists
from gem_lite.maps import query_maps
from gem_lite.policies import methods
from gem_lite.se2 import Workspace
from gem_lite.tasks import align_rope

WORKSPACE = Workspace()


def table(*places):
    """A map that is 0 but for squares around (row, col, value), whose middles are their highest cells."""
    semantic = np.zeros(WORKSPACE.shape, np.float32)
    for row, col, value in places:
        semantic[row - 3 : row + 4, col - 3 : col + 4] = value - 0.05
        semantic[row, col] = value
    return semantic


@pytest.mark.parametrize(
    ("phrase", "word", "thing"),
    [
        ("the top letter T shape hole", "top", "letter t shape hole"), ("Middle ring hole", "middle", "ring hole"),
        ("the block in the middle", "middle", "block"), ("right-most block", "right", "block"),
        ("left top hat", "left", "top hat"), ("shoe on the right", "right", "shoe"),
        ("top black hat", "top", "black hat"),
        *((name, None, name) for name in (
            "star hole", "middle of the stand", "left", "top hat", "right shoe", "left shoes with red laces",
            "black top hat", "bottom drawer", "", "on the left", "red block",
        )),
    ],
)  # fmt: skip
def test_a_phrase_is_a_location_word_and_a_thing(phrase, word, thing):
    assert split_location(phrase) == (word, thing)


def cells_of(semantic):
    """The cells of each response, as lists of (row, col)."""
    regions, count = query_maps.responses(semantic, WORKSPACE)
    return [np.argwhere(regions == number).tolist() for number in range(1, count + 1)]


def test_responses_are_the_strongest_maxima():
    assert cells_of(table((50, 20, 1.0), (50, 50, 0.95), (90, 40, 0.85))) == [[[50, 20]], [[50, 50]]]
    # Two maxima of one place are one response.
    semantic = table((50, 20, 1.0))
    semantic[52, 22] = 0.99
    assert cells_of(semantic) == [[[50, 20]]]
    semantic[52, 22] = 1.0
    assert cells_of(semantic) == [[[50, 20], [52, 22]]]


def test_flat_and_long_things_are_one_response_and_stay_whole():
    # Two flat things of 20 x 20 equal cells, as a detector fills its boxes.
    things = {"left": np.s_[40:60, 10:30], "bottom": np.s_[90:110, 45:65]}
    semantic = np.zeros(WORKSPACE.shape, np.float32)
    for cells in things.values():
        semantic[cells] = 1.0
    assert [len(cells) for cells in cells_of(semantic)] == [400, 400]
    for word, other in (("left", "bottom"), ("bottom", "left")):
        located = query_maps.located(semantic, word, WORKSPACE)
        assert (located[things[word]] == 1).all()
        assert np.allclose(located[things[other]], 1 - query_maps.LOWERED)
    # By the distance to the middles, the ends of the long thing would belong to the other.
    semantic = np.zeros(WORKSPACE.shape, np.float32)
    semantic[10:150, 20] = 1.0
    semantic[20, 32] = 1.0
    located = query_maps.located(semantic, "left", WORKSPACE)
    assert (located[10:150, 20] == 1).all()
    assert located[20, 32] == np.float32(1 - query_maps.LOWERED)


@pytest.mark.parametrize(
    ("semantic", "count"),
    [
        (np.full(WORKSPACE.shape, 0.0, np.float32), 0), (np.full(WORKSPACE.shape, 1.0, np.float32), 0),
        (table((50, 20, 0.09), (50, 50, 0.08)), 0), (table((50, 20, 1.0)), 1),
    ],
    ids=["constant 0", "constant 1", "hardly above the table", "one response"],
)  # fmt: skip
def test_a_map_with_fewer_than_two_responses_stays_as_it_is(semantic, count):
    assert len(cells_of(semantic)) == count
    for word in word_lists.LOCATION_WORDS:
        assert np.array_equal(query_maps.located(semantic, word, WORKSPACE), semantic)
    with pytest.raises(ValueError, match="word must be one of left, right, top, bottom, middle, got 'north'"):
        query_maps.located(semantic, "north", WORKSPACE)


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
    # As the task's words (tasks/assembling_kits.py): left is smaller x, top is larger y.
    (x, y), others = WORKSPACE.to_world(*place), [WORKSPACE.to_world(*one) for one in set(places) - {place}]
    first = {"left": x < min(o[0] for o in others), "right": x > max(o[0] for o in others),
             "top": y > max(o[1] for o in others), "bottom": y < min(o[1] for o in others)}  # fmt: skip
    assert first.get(word, True)


def test_the_code_tells_directions_apart_that_the_embedded_clip_does_not(model):
    phrases = [f"{start} to {end}" for start, end in align_rope.DIRECTIONS]
    codes = torch.stack([location_code(phrase) for phrase in phrases])
    embeddings = model.embed_texts(phrases)
    apart = ~torch.eye(len(phrases), dtype=torch.bool)
    assert (embeddings @ embeddings.T)[apart].min() > 0.99
    assert (codes @ codes.T)[apart].max() < 0.9
    # CLIPort says "from back right corner to back left corner" where our task names the corners the other way round.
    assert torch.equal(torch.stack([location_code(f"{end} to {start}") for start, end in align_rope.DIRECTIONS]), codes)


@pytest.mark.parametrize(
    ("phrase", "words"),
    [
        ("red block", {}), ("left star hole", {0: 1}), ("tip tip", {7: 2}), ("leftmost red block", {0: 1}),
        ("Front left tip to back left corner", {4: 1, 0: 1, 7: 1, 9 + 5: 1, 9 + 0: 1, 9 + 8: 1}), ("", {}),
        ("red block on the left", {0: 1}), ("middle of the stand", {6: 1}),
        # Names have no location words.
        ("top hat", {}), ("left shoe", {}), ("leftmost shoe", {0: 1}), ("right left shoe", {1: 1}),
    ],
)  # fmt: skip
def test_the_code_counts_words_before_and_after_to(phrase, words):
    expected = torch.zeros(LOCATION_CODE_LENGTH)
    for number, count in words.items():
        expected[number] = count
    code = location_code(phrase)
    assert torch.allclose(code, torch.nn.functional.normalize(expected, dim=0))
    assert code.norm() == pytest.approx(1 if words else 0)
    before, after = location_code("left block"), location_code("block to the left")
    assert any(before) and any(after) and not torch.equal(before, after)


@pytest.mark.parametrize("method", methods.METHODS.names())
def test_the_networks_of_every_method_get_the_code_of_both_phrases(method, model):
    kind, config = methods.find(method)
    policy = kind(config, model)
    queries = Queries("left red block", "front left tip to back left corner")
    words = policy.words(queries)
    for name, phrase in (("pick", queries.pick), ("place", queries.place)):
        assert words[name].shape == (policy.language_dim,)
        assert torch.equal(words[name][-LOCATION_CODE_LENGTH:], location_code(phrase))
        assert words[name][-LOCATION_CODE_LENGTH:].any()
