"""A parser of other people's words: the grammar, then a language model that chooses among a sentence's own spans.

The grammar reads what it is sure of (A.1.6: a noun parser). What it refuses goes to the model, see `readings`. If no
reading is likely enough, the parser asks instead of acting. It also asks about amounts, such as "all toys", which the
grammar reads as a group: they are a plan (`planning`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NoReturn

from gem_lite.language import models, readings
from gem_lite.language.grammar import EXAMPLE, parse, parse_thing
from gem_lite.language.models import ModelError, Scorer
from gem_lite.language.phrases import TOKEN, conjuncts, split_relation, with_relation, without_determiner
from gem_lite.language.queries import PARSERS, Queries
from gem_lite.language.spans import ARTICLES, Sentence, Span
from gem_lite.language.word_lists import PUSHES, RELATIONS

LOWEST_PROBABILITY = 0.7
"""A reading with a lower probability is asked about. Of the sentences for development, each read by weights that were
fitted without it, 1.8 % are then misread (experiments/other_words)."""
NAMELESS = frozenset(("something", "anything", "thing", "things", "stuff", "object", "objects", "other", "one", "ones"))
"""Words that alone name nothing."""
MOST_WORDS = 40
"""Longer texts are no requests."""


class ModelParser:
    """Reads with the grammar, then with a language model.

    Args:
        model: scores spans as answers.
        lowest_probability: a higher one asks more often.
    """

    def __init__(self, model: Scorer, lowest_probability: float = LOWEST_PROBABILITY) -> None:
        self.model = model
        self.lowest_probability = lowest_probability

    def __call__(self, instruction: str) -> Queries:
        """The queries of an instruction.

        Raises:
            ValueError: neither reads it, or no reading is likely enough; the text is a question to ask back.
        """
        if not isinstance(instruction, str) or not instruction.strip():
            return parse(instruction)  # It says what an empty text lacks.
        sentence = Sentence.read(instruction)
        if len(sentence.words) > MOST_WORDS:
            _ask(instruction, f"has more than {MOST_WORDS} words")
        reason = readings.reason_to_ask(sentence)
        if reason:
            _ask(instruction, reason)
        try:
            queries = parse(instruction)
        except ValueError:
            queries = self._read(instruction, sentence)
        return named(instruction, queries)

    def _read(self, instruction: str, sentence: Sentence) -> Queries:
        """The queries that the model reads. Raises ValueError if no reading is likely enough."""
        reading, probability = readings.likeliest(self.model, sentence)
        if reading is None:
            _ask(instruction, "names no pick and place that I can find in it")
        try:
            place = place_phrase(sentence, reading.place)
            push = asks_for_push(sentence, (reading.thing, reading.place))
            queries = Queries(readable(sentence.said(reading.thing)), place, push)
        except ValueError as error:  # "between" and one thing
            _ask(instruction, f"is not clear to me: {error}")
        if probability < self.lowest_probability:
            _ask(instruction, f"is not clear to me; shall I {queries}?")
        return queries


def _ask(instruction: str, reason: str) -> NoReturn:
    raise ValueError(f"the instruction {instruction!r} {reason}; say one pick and one place, {EXAMPLE}")


def named(instruction: str, queries: Queries) -> Queries:
    """The queries, if both name something. Raises ValueError for "something" alone, which could be anything."""
    for query in (queries.pick, queries.place):
        if set(str(query).split()) <= NAMELESS:
            _ask(instruction, f"names nothing by {str(query)!r}")
    return queries


def asks_for_push(sentence: Sentence, phrases: Sequence[Span]) -> bool:
    """Whether a word outside the phrases says "push": a push pin may be picked."""
    inside = {index for start, end in phrases for index in range(start, end)}
    return any(word in PUSHES and index not in inside for index, word in enumerate(sentence.words))


def readable(text: str) -> str:
    """A thing's words as a query: as the grammar reads them, or in small letters without a determiner."""
    try:
        return parse_thing(text)
    except ValueError:
        return " ".join(without_determiner(TOKEN.findall(text.lower())))


def place_phrase(sentence: Sentence, span: Span) -> str:
    """The place as a query, with the relation that the words before it say: "left of green bowl".

    Raises:
        ValueError: the relation has another number of things.
    """
    start = span[0]
    side = re.match(r"(left|right)([ -]hand)? side of (the )?", " ".join(sentence.words[slice(*span)]))
    if side:  # "left side of the bowl"
        start += len(side.group().split())
        span = (start, span[1])
    while sentence.word(start - 1) in ARTICLES:
        start -= 1
    before = " ".join(sentence.words[:start])
    wordings = [wording for wording in RELATIONS if f" {before}".endswith(f" {wording}")]
    place = readable(sentence.said(span))
    if not wordings:
        return place
    things = tuple(readable(thing) for thing in conjuncts(place))
    phrase = with_relation(RELATIONS[max(wordings, key=len)], things)
    split_relation(phrase)
    return phrase


@lru_cache(maxsize=1)
def _small_parser() -> ModelParser:
    return ModelParser(models.load())


def read_words(instruction: str) -> Queries:
    """As `ModelParser` with the small language model; as the grammar, where that model cannot be had.

    Raises:
        ValueError: see `ModelParser`; without the model, its reason is in the text.
    """
    try:
        parser = _small_parser()
    except ModelError as error:
        try:
            return parse(instruction)
        except ValueError as refused:
            raise ValueError(f"{refused}; and {error}") from error
    return parser(instruction)


PARSERS.register("words")(read_words)  # not as a decorator, so that its type stays: one goal for an instruction
