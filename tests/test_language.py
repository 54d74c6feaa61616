import re

import numpy as np
import pytest

from experiments.clip_tabletop import vocabulary
from gem_lite import language, tasks
from gem_lite.foundations import colors
from gem_lite.language import ImageQuery, Queries, conjuncts, parse, parse_thing, split_location
from gem_lite.policies.transporter import TransporterConfig, TransporterLan
from gem_lite.simulation.bodies import objects, shapes
from gem_lite.tasks import align_rope, stack_block_pyramid


def table(text):
    """The cells of a table with a case in each line: a | b | c."""
    return [line.strip().split(" | ") for line in text.strip().splitlines()]


READ = """
    grasp the mug by the handle and put it on the tray | mug handle | tray
    pick up the red block and put it on top of the green one | red block | green one
    Can you please put the duck into the bowl? | duck | bowl
    put the red block in the bowl now, please. | red block | bowl
    pick the mug up and place it in the box | mug | box
    pick the red block, the mug and the blue block and put them in the box | red block, the mug and the blue block | box
    grasp the mug on the left by its handle and put it in the box | left mug handle | box
    insert the key into the jelly mould | key | jelly mould
    pick the red block, place it in the box | red block | box
    Please, put the red block in the box | red block | box
    Please align the rope from front left tip to back left corner. | rope | front left tip to back left corner
"""
OF_THE_PAPER = """
    pick the blue mug handle and place into brown box | blue mug handle | brown box
    pick blue letter E block and place onto green plate | blue letter e block | green plate
    pick yellow block and place on gray and red block | yellow block | gray and red block
    pick all toys and place into brown box | toys | brown box
    pick letter R shape and place into letter R block hole | letter r shape | letter r block hole
"""
"""Of the paper's tasks."""


@pytest.mark.parametrize(("instruction", "pick", "place"), [*table(READ), *table(OF_THE_PAPER)])
def test_instructions(instruction, pick, place):
    assert parse(instruction) == Queries(pick, place)


WRONG = """
    put in the green bowl | names nothing to pick
    put | nothing to pick
    pick the red block | names no place
    put the red block in | names no place
    pick the red block and place | names no place
    pickle the red block in the bowl | known verb
    don't put the block in the bowl | does not begin with a known verb
    align the rope to the wall | must say what to align
    align the rope from one tip to the other, gently | leftover words 'other, gently'
    grasp the coffee mug by its handle | names no place
    put the block on the left | names no place
    put the red block in the bowl and the blue one | names several places, 'bowl and the blue one'
    put the red block in the green bowl and the blue bowl | names several places
    put the red block in both bowls | says 'both' of a place
    put the red block in each of the bowls | says 'each' of a place
    put the red block in the red and the | names nothing on one side of 'and'
    put the red block in the bowl in 5 minutes | leftover words 'in 5 minutes'
    grasp the mug by its left handle and put it in the box | says 'left' where it is not understood
    grasp by its handle and put it in the box | leftover words 'by its handle
"""


@pytest.mark.parametrize(("instruction", "message"), [("", "is empty"), (" \t\n", "is empty"), *table(WRONG)])
def test_what_is_wrong_is_said(instruction, message):
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        parse(instruction)
    assert language.EXAMPLE in str(error.value)  # Whoever reads it learns what would have worked.


LEFT_OVER = """
    move the mug / from the left box to the right box
    put the mug / near the teapot
    put the red block in the box and the blue block / into the bowl
    pick the block on the tray / and place it in the box
    put the red block in the bowl / and leave
    put the fork / and spoon in the box
    pick the mug / by the teapot and place it in the box
    pick the mug and the cup / by their handles and put them in the box
    put the red block on the bowl / by its handle
    put the mug / with the handle in the box
    put the block in / back of the bowl
    push the block / up to the wall
    put the chair / back in the box
    put the block / right in the bowl
    put the red block / gently in the bowl
    put the block / that is red in the bowl
    put the red block, / not the blue one, in the bowl
    put / it in the bowl
    put the block in / it
    put the chess / set in the box
"""
"""Sentences; what is behind the slash is not understood."""


@pytest.mark.parametrize(
    ("instruction", "leftover"),
    [
        *((sentence.replace(" / ", " "), sentence.partition(" / ")[2]) for (sentence,) in table(LEFT_OVER)),
        ("put the red block in the bowl. put the blue block in the box.", ". put the blue block in the box"),
        ("put the big, red block in the bowl", ", red block in the bowl"),
        ('put the "red block" in the bowl', '" red block " in the bowl'),
    ],
)
def test_what_is_not_understood_is_named(instruction, leftover):
    with pytest.raises(ValueError, match="has leftover words") as error:
        parse(instruction)
    assert f"leftover words {leftover!r} that are not understood" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


TASK_SENTENCE = re.compile(
    r"(align|pack|pick|put|push|move) (all the |the )?(?P<pick>.+?) (and place into|and place on|from|in|into|on|to) "
    r"(the |a )?(?P<place>.+)"
)
"""The words of a task's sentence between its verb, its preposition and their articles."""


def assert_read_as_written(sentence):
    """The shipped policies were trained with these phrases, things and location words."""
    written = TASK_SENTENCE.fullmatch(sentence.lower())
    queries = parse(sentence)
    assert queries == Queries(written["pick"], written["place"], push=sentence.startswith("push"))
    for phrase in (written["pick"], written["place"]):
        both = re.fullmatch(r"(\w+) and (\w+) (blocks?)", phrase)
        assert conjuncts(phrase) == ((f"{both[1]} {both[3]}", f"{both[2]} {both[3]}") if both else (phrase,))
        first, second, *_ = [*phrase.split(), ""]
        located = first in ("left", "right", "top", "bottom", "middle") and second != "of"
        assert split_location(phrase)[0] == (first if located else None)


@pytest.mark.parametrize("name", tasks.names())
def test_every_task_says_what_is_parsed(name, blind):
    for split in tasks.registry.SPLITS:
        task = tasks.make(name, split)
        blind.reset(task, tasks.episode_seed(split, 0))
        for goal in task.goals:
            if tasks.family(name) == "put-beside":  # Its wordings: tests/test_relations.py.
                assert language.split_relation(parse(goal.sentence).place)[0] == goal.metric.relation
            else:
                assert_read_as_written(goal.sentence)


def test_the_words_of_the_tasks_in_every_combination():
    for word in ("", "left ", "right ", "top ", "bottom ", "middle "):
        for shape in (*shapes.SEEN_SHAPES, *shapes.UNSEEN_SHAPES):
            assert_read_as_written(f"put the red {shape} in the {word}{shape} hole")
    for plate in stack_block_pyramid.PLATES:
        assert_read_as_written(f"put the red block on the {plate}")
    for name in objects.NAMES:
        assert_read_as_written(f"pack all the {name} objects in the brown box")
    for start, end in align_rope.DIRECTIONS:
        assert_read_as_written(f"align the rope from {start} to {end}")


KINDS = vocabulary.SHAPES | vocabulary.TILES | vocabulary.HOLES | vocabulary.BOXES
NOUNS = [name for names in KINDS.values() for name in names]


def test_every_colour_and_noun_of_tasks_and_vocabulary_can_be_named():
    for color in colors.RGB:
        assert parse(f"put the {color} blocks in a {color} bowl") == Queries(f"{color} blocks", f"{color} bowl")
    for color in (name for names in vocabulary.COLORS.values() for name in names):
        assert conjuncts(f"{color} and red blocks") == (f"{color} blocks", "red blocks")
    built = ("kit", "rope", "square guide", "middle of the stand", "lighter brown side", "pile of red blocks")
    for noun in (*NOUNS, *built):
        assert parse(f"put the red block on the {noun}") == Queries("red block", noun.lower())
    for noun in NOUNS:
        assert parse(f"put the red {noun} on the box") == Queries(f"red {noun.lower()}", "box")
    parts = [(name, part) for (name, _), parts in vocabulary.PARTS.items() for part in parts]
    for name, part in (*parts, ("bottle", "middle")):
        if part != "back":  # "the chair by its back": could as well be "put back"
            queries = parse(f"grasp the {name} by its {part} and put it on the tray")
            assert queries == Queries(f"{name} {part}", "tray")


JOINED = """
    the green and the blue block | green block + blue block
    red block and the blue mug | red block + blue mug
    red block, the mug and the blue block | red block + mug + blue block
    light brown and darkest brown block | light brown block + darkest brown block
    small red and big striped letter e block | small red letter e block + big striped letter e block
    orange and mug | orange + mug
    salt and pepper | salt + pepper
    red and blue blocks on the left | red blocks on the left + blue blocks on the left
    red and white ball | red and white ball
    red, white and blue ball | red, white and blue ball
    light and dark brown shoe | light and dark brown shoe
    red and white striped towels | red and white striped towels
    mug with red and blue stripes | mug with red and blue stripes
    pile of red and blue blocks | pile of red and blue blocks
    gray and red block | gray block + red block
    the red and a white ball | red ball + white ball
    light and dark brown blocks | light brown blocks + dark brown blocks
    big and small bowl | big bowl + small bowl
    red and blue dice | red dice + blue dice
    red and white objects | red objects + white objects
    red and white ball and the blue mug | red and white ball + blue mug
    blue mug and red and white balls | blue mug + red balls + white balls
    mug with red and blue stripes and green bowl | mug with red and blue stripes + green bowl
    mug with red stripes and the bowl | mug with red stripes + bowl
"""


@pytest.mark.parametrize(("phrase", "members"), table(JOINED))
def test_conjuncts(phrase, members):
    assert conjuncts(phrase) == tuple(members.split(" + "))


@pytest.mark.parametrize("phrase", ["", " ", "and", "red and", "and red", "red block, and"])
def test_conjuncts_of_nothing_are_refused(phrase):
    with pytest.raises(ValueError, match="phrase must name a thing on both sides of 'and'"):
        conjuncts(phrase)


def test_a_query_is_a_phrase_or_a_picture():
    picture = np.zeros((4, 4, 3), np.uint8)
    assert str(Queries(ImageQuery(picture, "this mug"), "bowl")) == "pick this mug, place bowl"
    assert str(parse("push the pile of blocks into the green square")) == "push pile of blocks to green square"
    for pick in ("", " ", None, 3, picture):
        with pytest.raises(ValueError, match="pick must be a phrase, an ImageQuery or a Spot"):
            Queries(pick, "bowl")
    for wrong in (picture[..., 0], np.zeros((4, 4, 4), np.uint8), picture[:0], picture.astype(float)):
        with pytest.raises(ValueError, match=r"picture must be \(H, W, 3\) uint8, got .* (uint8|float64)"):
            ImageQuery(wrong)


LOCATED = """
    the pile of red blocks on the right | right pile of red blocks
    the red and white flashlight on the left | left red and white flashlight
    the top hat | top hat
    the black top hat on the left | left black top hat
    the left shoe | left shoe
    the shoe on the left | leftmost shoe
    the leftmost shoes | leftmost shoes
    the left shoe on the right | right left shoe
    the left and right shoes | left and right shoes
    the middle of the stand | middle of the stand
    the spinning top | spinning top
"""
"""Also names with the same words, and places of things so named."""


@pytest.mark.parametrize(("written", "phrase"), table(LOCATED))
def test_location_words_and_names(written, phrase):
    assert parse(f"put {written} in the bowl") == Queries(phrase, "bowl")
    assert parse(f"put the mug on the {phrase}").place == parse_thing(written) == phrase


@pytest.mark.parametrize(
    "thing",
    [
        "red left block", "top left block", "top-left block", "third-left block", "leftmost block on the right",
        "left middle brown block", "left red and blue blocks", "red and blue blocks on the left",
        "left red block and the blue mug", "left and right blocks", "front block", "rear block", "left one", "left",
        "leftmost of the blocks", "middle one of the blocks", "left corner of the box", "left shoe box",
        "middle of the left bowl", "block leftmost", "far left block", "block on the left side",
    ],
)  # fmt: skip
def test_location_words_that_are_not_understood_are_refused(thing):
    for sentence in (f"put the {thing} in the bowl", f"put the mug on the {thing}"):
        with pytest.raises(ValueError, match="the instruction") as error:
            parse(sentence)
        assert language.EXAMPLE in str(error.value)
    for text in (thing, "", "grab the red block", "red block in the bowl", "3 mugs"):
        with pytest.raises(ValueError, match="the instruction"):
            parse_thing(text)


@pytest.mark.parametrize(
    "words",
    [
        "that's on the plate", "that’s blue", "that\u02bcs blue", "isn't", "isnt", "you'd like", "next door to the mug",
        "10 cm", "10cm", "asap", "now", "with care", "with tongs", "with both hands", "upside-down", "near-by", "flat",
        "deep", "2nd", "5 minutes", "like before", "well",
    ],
)  # fmt: skip
def test_words_that_would_be_swallowed_are_refused(words):
    with pytest.raises(ValueError, match="has leftover words"):
        parse(f"put the red block {words} in the bowl")
    with pytest.raises(ValueError, match="the instruction"):
        parse(f"put the red block in the bowl {words} in the box")


@pytest.mark.parametrize(
    "thing",
    [
        "none of the blocks", "nothing", "no blocks", "two blocks", "2 blocks", "half of the blocks",
        "a couple of blocks", "the nearest block", "the second block", "the 2nd block", "the other block",
        "the non-red block", "the not red block", "its block", "this block",
    ],
)  # fmt: skip
def test_things_that_need_more_than_a_name_are_refused(thing):
    for sentence in (f"put {thing} in the bowl", f"put the mug on {thing}"):
        with pytest.raises(ValueError, match="has leftover words"):
            parse(sentence)


@pytest.mark.parametrize(
    "name",
    [
        # Of CLIPort's scanned objects, those with colours, features, numbers and odd words.
        "black and blue sneakers", "black boot with leopard print", "black shoe with orange stripes", "c clamp",
        "green and white striped towel", "grey soccer shoe with cleats", "hard drive",
        "light brown boot with golden laces", "nintendo 3ds", "office depot box",
        "pepsi gold caffeine free box", "pepsi next box", "porcelain salad plate",
        "red and white flashlight", "red and white striped towel", "spatula with purple head", "toy school bus",
        # Of people.
        "rubik's cube", "bull's eye", "m&m's bag", "jack-in-the-box", "push-pin", "take-away box", "block 2",
        "digit 3 shape", "something red", "leftover pizza", "family photo", "letter m shape",
    ],
)  # fmt: skip
def test_names_are_no_reason_to_refuse(name):
    assert parse(f"pack the {name} in the brown box") == Queries(name, "brown box")
    assert parse(f"pack all the {name} objects in the brown box") == Queries(f"{name} objects", "brown box")
    assert conjuncts(name) == (name,) and conjuncts(f"{name} objects") == (f"{name} objects",)
    assert split_location(name)[0] is None


def test_a_parser_may_give_several_goals(model, demo_set):
    def each(sentence):
        things, places = zip(*(part.split(" in the ") for part in sentence.split(" and ")), strict=True)
        return tuple(map(Queries, things, places))

    policy = TransporterLan(TransporterConfig(), model, parser=each)
    sentence = "red block in the box and blue block in the bowl"
    first, second = Queries("red block", "box"), Queries("blue block", "bowl")
    assert policy.goals(sentence) == (first, second)
    assert (policy.read(sentence), policy.read(sentence, [first])) == (first, second)
    assert policy.decide(demo_set[1][0].steps[0].observation, sentence).queries == first
    with pytest.raises(ValueError, match="reached holds every goal of 'red block"):
        policy.read(sentence, [second, first])
