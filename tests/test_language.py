import numpy as np
import pytest

from gem_lite import colors, language, tasks
from gem_lite.clip_training import vocabulary
from gem_lite.language import VERBS, ImageQuery, Queries, conjuncts, parse


@pytest.mark.parametrize(
    ("instruction", "pick", "place"),
    [
        ("put the red blocks in a green bowl", "red blocks", "green bowl"),
        ("pick the red block and place into the brown box", "red block", "brown box"),
        ("pack the star in the brown box", "star", "brown box"),
        ("grasp the scissors by its handle and place into the brown box", "scissors handle", "brown box"),
        ("grasp the mug by the handle and put it on the tray", "mug handle", "tray"),
        ("put the red block on the green and blue blocks", "red block", "green and blue blocks"),
        ("put the red and blue blocks in the bowl", "red and blue blocks", "bowl"),
        ("pick up the red block and put it on top of the green one", "red block", "green one"),
        ("pick the block then drop it in the bowl", "block", "bowl"),
        ("pick the red block, and place it in the box", "red block", "box"),
        ("put all of the red blocks in a box", "red blocks", "box"),
        ("pack the yellow ring inside the brown box", "yellow ring", "brown box"),
        # A preposition inside a word is none, and the first real one divides.
        ("put the tonic into box", "tonic", "box"),
        ("put the red block in the bowl on the left", "red block", "bowl on the left"),
    ],
)
def test_instructions(instruction, pick, place):
    assert parse(instruction) == Queries(pick, place)


@pytest.mark.parametrize(
    "written",
    [
        "Put the RED block in the Green Bowl",
        "put the red block in the green bowl.",
        "put the red block in the green bowl!",
        "  put  the red   block in the green  bowl  ",
        "put\tthe red block\nin the green bowl",
        "please put the red block in the green bowl",
    ],
)
def test_spelling_does_not_matter(written):
    assert parse(written) == Queries("red block", "green bowl")


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb != language.ALIGNING])
def test_every_verb_begins_an_instruction(verb):
    assert parse(f"{verb} the red block on the box") == Queries("red block", "box", push=verb == language.PUSHING)


@pytest.mark.parametrize("color", colors.RGB)
def test_every_colour_survives(color):
    assert parse(f"put the {color} blocks in a {color} bowl") == Queries(f"{color} blocks", f"{color} bowl")


@pytest.mark.parametrize(
    ("instruction", "message"),
    [
        ("", "is empty"),
        (" \t\n", "is empty"),
        ("put in the green bowl", "names no"),
        ("put", "nothing to pick"),
        ("pick the red block", "names no place"),
        ("put the red block in", "names no place"),
        ("put the red block in the", "names no place"),
        ("pick the red block and place", "names no place"),
        ("the red block in the green bowl", "known verb"),
        ("pickle the red block in the bowl", "known verb"),
        ("?", "known verb"),
    ],
)
def test_what_is_wrong_is_said(instruction, message):
    with pytest.raises(ValueError, match=message) as error:
        parse(instruction)
    # Whoever reads it learns what would have worked.
    assert "put the red block in the green bowl" in str(error.value)


def test_no_pick_is_called_no_pick():
    with pytest.raises(ValueError, match="nothing to pick"):
        parse("put in the green bowl")


@pytest.mark.parametrize(
    "instruction", ["pick the red block and then place it in the box", "pick the red block, place it in the box"]
)
def test_other_joints_between_the_verbs(instruction):
    assert parse(instruction) == Queries("red block", "box")


def test_please_with_a_comma():
    assert parse("Please, put the red block in the box") == Queries("red block", "box")


@pytest.mark.parametrize(
    ("instruction", "leftover"),
    [
        ("move the mug from the left box to the right box", "from the left box to the right box"),
        ("put the mug next to the teapot", "next to the teapot"),
        ("put the red block in the box and the blue block into the bowl", "into the bowl"),
        ("put the red block in the box and place the blue block in the bowl", "and place the blue block in the bowl"),
        ("pick the red block and put the blue block in the bowl", "the blue block in the bowl"),
        ("put the red block in the bowl. put the blue block in the box.", ". put the blue block in the box"),
        ("put the red block in the bowl on the green plate", "on the green plate"),
        ("pick the block on the tray and place it in the box", "and place it in the box"),
        ("put the red block in the bowl and leave", "and leave"),
        ("take the block and deposit into the bowl", "and deposit into the bowl"),
        ("put the fork and spoon in the box", "and spoon in the box"),
        ("put the mug by the teapot", "by the teapot"),
        ("pick the mug by the teapot and place it in the box", "by the teapot and place it in the box"),
        (
            "pick the mug and the cup by their handles and put them in the box",
            "by their handles and put them in the box",
        ),
        ("put the red block on the bowl by its handle", "by its handle"),
        ("put the mug with the handle in the box", "with the handle in the box"),
        ("put the block to the left of the bowl", "left of the bowl"),
        ("put the block in front of the bowl", "front of the bowl"),
        ("put the block in between the bowls", "between the bowls"),
        ("put the block close to the bowl", "close to the bowl"),
        ("push the block up to the wall", "up to the wall"),
        ("put the chair back in the box", "back in the box"),
        ("put the block right in the bowl", "right in the bowl"),
        ("put the red block gently in the bowl", "gently in the bowl"),
        ("put the red block in the bowl carefully", "carefully"),
        ("put the block that is red in the bowl", "that is red in the bowl"),
        ("put the red block, not the blue one, in the bowl", "not the blue one, in the bowl"),
        ("put the big, red block in the bowl", ", red block in the bowl"),
        ("put it in the bowl", "it in the bowl"),
        ("put the block in it", "it"),
        ("put the chess set in the box", "set in the box"),
        ('put the "red block" in the bowl', '" red block " in the bowl'),
    ],
)
def test_what_is_not_understood_is_named(instruction, leftover):
    with pytest.raises(ValueError, match="has leftover words") as error:
        parse(instruction)
    assert f"leftover words {leftover!r} that are not understood" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("instruction", "pick", "place"),
    [
        ("could you move the duck over to the bowl", "duck", "bowl"),
        ("Can you please put the duck into the bowl?", "duck", "bowl"),
        ("stack the red block atop the blue block", "red block", "blue block"),
        ("put the red block in the bowl please", "red block", "bowl"),
        ("put the red block in the bowl now, please.", "red block", "bowl"),
        ("put the red block in the bowl for me, thank you!", "red block", "bowl"),
        ("pick the mug up and place it in the box", "mug", "box"),
        ("put the block down on the tray", "block", "tray"),
        (
            "pick the red block, the mug and the blue block and put them in the box",
            "red block, the mug and the blue block",
            "box",
        ),
        ("put the red block on the left in the bowl on the right", "red block on the left", "bowl on the right"),
        ("put one of the blocks in the middle bowl", "blocks", "middle bowl"),
        ("put the mug with orange stripes in the box", "mug with orange stripes", "box"),
        ("insert the key into the jelly mould", "key", "jelly mould"),
    ],
)
def test_other_wordings(instruction, pick, place):
    assert parse(instruction) == Queries(pick, place)


@pytest.mark.parametrize(
    ("instruction", "pick", "place"),
    [
        # The sentences of the benchmark's and the paper's tasks.
        (
            "put the red letter A shape in the left letter A shape hole",
            "red letter a shape",
            "left letter a shape hole",
        ),
        (
            "pick the green letter R shape and place into the green letter R block hole",
            "green letter r shape",
            "green letter r block hole",
        ),
        ("pack all the red and blue blocks into the brown box", "red and blue blocks", "brown box"),
        (
            "pack all the black shoe with orange stripes objects in the brown box",
            "black shoe with orange stripes objects",
            "brown box",
        ),
        ("pack the black and blue sneakers in the brown box", "black and blue sneakers", "brown box"),
        ("pack the can opener in the brown box", "can opener", "brown box"),
        ("put the cyan block on the lightest brown block", "cyan block", "lightest brown block"),
        ("put the cyan block on the middle brown block", "cyan block", "middle brown block"),
        ("move the red ring to the lighter brown side", "red ring", "lighter brown side"),
        ("move the red ring to the middle of the stand", "red ring", "middle of the stand"),
        ("pick the blue mug handle and place into brown box", "blue mug handle", "brown box"),
        ("pick blue letter E block and place onto green plate", "blue letter e block", "green plate"),
        ("pick yellow block and place on gray and red block", "yellow block", "gray and red block"),
        ("pick the yellow block on gray plate", "yellow block", "gray plate"),
        ("pick the yellow pentagon block and place into green bowl", "yellow pentagon block", "green bowl"),
        ("pick black headphone and place into recycle box", "black headphone", "recycle box"),
        ("pick all toys and place into brown box", "toys", "brown box"),
        ("Grasp the mug by its handle and put it in the box", "mug handle", "box"),
    ],
)
def test_sentences_of_the_paper(instruction, pick, place):
    assert parse(instruction) == Queries(pick, place)


@pytest.mark.parametrize(
    ("instruction", "message"),
    [
        ("align the rope to the wall", "must say what to align"),
        ("align the rope from the left corner", "must say what to align"),
        ("align the rope from one tip to the other, gently", "leftover words ', gently'"),
        ("pick up the yellow screwdriver", "names no place"),
        ("grasp the coffee mug by its handle", "names no place"),
        ("pick banana crown", "names no place"),
        ("put the block on the left", "names no place"),
        ("put the block on top", "names no place"),
        ("don't put the block in the bowl", "does not begin with a known verb"),
    ],
)
def test_sentences_that_no_pick_and_place_can_follow(instruction, message):
    with pytest.raises(ValueError, match=message):
        parse(instruction)


@pytest.mark.parametrize("name", tasks.names())
def test_every_task_says_what_is_parsed(name, world):
    task = tasks.make(name, "test")
    world.reset(task, tasks.episode_seed("test", 0))
    phrases = parse(task.instruction)
    assert f" {phrases.pick} " in task.instruction.lower() and task.instruction.lower().endswith(f" {phrases.place}")


def test_an_alignment_has_a_start_and_an_end():
    queries = parse("Please align the rope from front left tip to back left corner.")
    assert queries == Queries("rope", "front left tip to back left corner")


def test_only_the_verb_push_asks_for_a_push():
    queries = parse("push the pile of blocks into the green square")
    assert queries == Queries("pile of blocks", "green square", push=True)
    assert str(queries) == "push pile of blocks to green square"
    assert not parse("put the pile of blocks into the green square").push


PLAIN_NOUNS = [
    name
    for noun in (vocabulary.SHAPES | vocabulary.TILES | vocabulary.HOLES | vocabulary.BOXES).values()
    for name in noun
]


def test_what_the_tasks_build_can_be_named():
    for noun in ("kit", "rope", "square guide", "middle of the stand", "lighter brown side", "pile of red blocks"):
        assert parse(f"put the red block on the {noun}") == Queries("red block", noun)


@pytest.mark.parametrize("noun", PLAIN_NOUNS)
def test_every_noun_of_the_vocabulary_can_be_named(noun):
    assert parse(f"put the red {noun} on the {noun}") == Queries(f"red {noun.lower()}", noun.lower())


@pytest.mark.parametrize("color", [name for names in vocabulary.COLORS.values() for name in names])
def test_every_colour_word_is_an_adjective(color):
    assert conjuncts(f"{color} and red blocks") == (f"{color} blocks", "red blocks")


def test_parts_may_be_grasped():
    for (name, _), parts in vocabulary.PARTS.items():
        for part in parts:
            if part != "back":  # "the chair by its back": could as well be "put back"
                assert parse(f"grasp the {name} by its {part} and put it on the tray") == Queries(
                    f"{name} {part}", "tray"
                )


@pytest.mark.parametrize(
    ("phrase", "members"),
    [
        ("red block", ("red block",)),
        ("green and blue blocks", ("green blocks", "blue blocks")),
        ("the green and the blue block", ("green block", "blue block")),
        ("red block and the blue mug", ("red block", "blue mug")),
        ("red, green and blue blocks", ("red blocks", "green blocks", "blue blocks")),
        ("red, green, and blue blocks", ("red blocks", "green blocks", "blue blocks")),
        ("red block, the mug and the blue block", ("red block", "mug", "blue block")),
        ("light brown and darkest brown block", ("light brown block", "darkest brown block")),
        ("small red and big striped letter e block", ("small red letter e block", "big striped letter e block")),
        ("orange and mug", ("orange", "mug")),
        ("salt and pepper", ("salt", "pepper")),
        ("red and blue blocks on the left", ("red blocks on the left", "blue blocks on the left")),
        ("sand box", ("sand box",)),
    ],
)
def test_conjuncts(phrase, members):
    assert conjuncts(phrase) == members


@pytest.mark.parametrize("phrase", ["", " ", "and", "red and", "and red", "red block, and"])
def test_conjuncts_of_nothing_are_refused(phrase):
    with pytest.raises(ValueError, match="phrase must name a thing on both sides of 'and'"):
        conjuncts(phrase)


@pytest.mark.parametrize("pick", ["", " ", None, 3, np.zeros((2, 2, 3), np.uint8)])
def test_a_query_is_a_phrase_or_a_picture(pick):
    with pytest.raises(ValueError, match="pick must be a phrase or an ImageQuery"):
        Queries(pick, "bowl")


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 4), (0, 4, 3)])
def test_what_is_no_picture_is_no_query(shape):
    with pytest.raises(ValueError, match=r"picture must be \(H, W, 3\) uint8"):
        ImageQuery(np.zeros(shape, np.uint8))
    with pytest.raises(ValueError, match="float64"):
        ImageQuery(np.zeros((4, 4, 3)))


def test_queries_are_named_in_figures():
    assert str(Queries(ImageQuery(np.zeros((4, 4, 3), np.uint8), "this mug"), "bowl")) == "pick this mug, place bowl"
