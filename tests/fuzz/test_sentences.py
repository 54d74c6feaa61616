"""Any text is parsed or refused with a ValueError, and what is parsed is clean."""

import re
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from experiments.clip_tabletop import vocabulary
from gem_lite.language import PLACING, VERBS, Queries, conjuncts, parse, parse_thing, split_location, word_lists

NOUNS = tuple(
    name
    for names in (vocabulary.SHAPES | vocabulary.TILES | vocabulary.HOLES | vocabulary.BOXES).values()
    for name in names
)
WORDS = (
    *VERBS, *PLACING, *word_lists.DETERMINERS, *sorted(word_lists.ADJECTIVES), *sorted(word_lists.RESERVED),
    *word_lists.LOCATIONS, *word_lists.OPENINGS, *word_lists.CLOSINGS, *NOUNS,
    *word_lists.LEADING, *word_lists.SIDES, *word_lists.PARTS, *word_lists.FEATURES, "hat", "shoe", "drawer", "corner",
    "and", "and then", ",", "with", "of", "by its", "by the", "letter A", "gently", "", "\t", ";", "'", "\ud800", "É",
    "that's", "it’s", "isn't", "don\u02bct", "you'd", "we've", "dont", "bull's", "non-red", "top-left", "upside-down",
    "10", "10cm", "2nd", "pepsi next box", "one", "ones", "objects",
)  # fmt: skip
NEAR = st.lists(st.sampled_from(WORDS), max_size=12).map(" ".join)
"""Words of the grammar in any order."""
THINGS = st.builds(
    " ".join,
    st.tuples(st.sampled_from(("", "the", "a")), st.sampled_from(sorted(vocabulary.COLORS)), st.sampled_from(NOUNS)),
)
SPOILT = st.builds(
    lambda verb, pick, placing, place, rest: f"{verb} {pick} {placing} {place} {rest}",
    st.sampled_from(VERBS), THINGS, st.sampled_from(PLACING), THINGS, NEAR,
)  # fmt: skip
"""A good sentence, and more words behind it."""
SENTENCES = st.lists(st.one_of(st.text(max_size=60), NEAR, SPOILT), min_size=10, max_size=10)
"""Ten sentences are one example: a profile's 200 examples are 2,000 sentences."""
CONTRACTION = re.compile(r"(n.t|.(re|ve|ll|d|m))$")


def assert_clean(phrase: str) -> None:
    words = phrase.replace("pepsi next box", "pepsi box").split()
    assert words and phrase == phrase.strip()
    for before, word in zip(["", *words], words, strict=False):
        name = word.removesuffix(",")
        stem, *endings = re.split("['’\u02bc]", name)
        assert re.sub("['’\u02bc&-]", "", name).isalnum(), phrase
        assert name not in word_lists.RESERVED or before == "letter", phrase
        assert not endings or (stem not in word_lists.RESERVED and not CONTRACTION.search(name)), phrase
    assert words[0] not in word_lists.DETERMINERS and words[0] not in ("and", "of", "with")
    assert (
        words[-1] not in ("and", "of", "with", *word_lists.DETERMINERS)
        or words[-1] == "one"
        or words[-2:-1] == ["letter"]
    ), phrase


def assert_own_words(queries: Queries, sentence: str) -> None:
    """What is read stands in the sentence, in this order, and a location word is said."""
    left = iter(words_of(sentence))
    for phrase in (queries.pick, queries.place):
        location, thing = split_location(phrase)
        for word in words_of(thing):
            assert word in left, f"{word!r} of {queries} is not said, or not in this order"
        said = {word_lists.LEADING.get(word, word) for word in sentence.lower().split()}
        assert location is None or location in said


def words_of(text: str) -> list[str]:
    return re.findall(r"[^\W_]+|[^\w\s]", text.lower())


def assert_location_is_read(thing: str) -> None:
    """No word that says where the thing lies is left over where `split_location` ignores it."""
    rest = split_location(thing)[1].split()
    for word, after in zip(rest, [*rest[1:], ""], strict=True):
        of_a_name = word in word_lists.NAMES and after.removesuffix("s") in word_lists.NAMES[word]
        assert word not in word_lists.LEADING or of_a_name or after in ("", "of"), thing


@given(SENTENCES)
def test_any_sentence_is_parsed_cleanly_or_refused(sentences):
    for sentence in sentences:
        try:
            phrases = parse(sentence)
        except ValueError as error:
            assert "put the red block in the green bowl" in str(error)
            continue
        assert isinstance(phrases, Queries)
        ends = phrases.place.split(" to ")  # of an alignment
        for phrase in (phrases.pick, *ends):
            assert_clean(phrase)
            assert all(conjuncts(phrase)), "what parse returns has members"
        if len(ends) == 1:
            assert_own_words(phrases, sentence)
            again = parse(f"put the {phrases.pick} on the {phrases.place}")
            assert again == replace(phrases, push=False)
            assert phrases.pick == parse_thing(phrases.pick)
            for thing in (*conjuncts(phrases.pick), *conjuncts(phrases.place)):
                assert_location_is_read(thing)


@given(SENTENCES)
def test_conjuncts_of_any_text_are_phrases_or_refused(texts):
    for text in texts:
        try:
            members = conjuncts(text)
        except ValueError as error:
            assert "phrase must name a thing" in str(error)
            continue
        assert members and all(member.strip() for member in members)
        assert len(members) == 1 or not any(" and " in f" {member} " for member in members)
