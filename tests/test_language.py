import pytest

from gem_lite import colors
from gem_lite.language import VERBS, Phrases, parse


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
        ("push the pile of blocks into the green square", "pile of blocks", "green square"),
        # A preposition inside a word is none, and the first real one divides.
        ("put the tonic into box", "tonic", "box"),
        ("put the red block in the bowl on the left", "red block", "bowl on the left"),
    ],
)
def test_instructions(instruction, pick, place):
    assert parse(instruction) == Phrases(pick, place)


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
    assert parse(written) == Phrases("red block", "green bowl")


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_begins_an_instruction(verb):
    assert parse(f"{verb} the red block on the box") == Phrases("red block", "box")


@pytest.mark.parametrize("color", colors.RGB)
def test_every_colour_survives(color):
    assert parse(f"put the {color} blocks in a {color} bowl") == Phrases(f"{color} blocks", f"{color} bowl")


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
    assert parse(instruction) == Phrases("red block", "box")


def test_please_with_a_comma():
    assert parse("Please, put the red block in the box") == Phrases("red block", "box")
