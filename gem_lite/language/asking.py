"""A parser that asks a language model for both phrases, as the paper does (A.1.6), and believes only what was said.

A server cannot score given spans. So the model is asked for JSON. Its answer counts only if both phrases are words of
the sentence, in their order: so it cannot bring in a thing that nobody named.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

from gem_lite.language.grammar import EXAMPLE, parse
from gem_lite.language.models import Answerer, ModelError
from gem_lite.language.phrases import without_determiner
from gem_lite.language.queries import Queries
from gem_lite.language.reader import asks_for_push, place_phrase
from gem_lite.language.spans import Sentence, Span

PROMPT = """A robot picks one thing and puts it at one place. Read the request and answer with one line of JSON:
{{"pick": "...", "place": "..."}}
Both values are copied from the request, word by word, without articles and prepositions.
If the request forbids something, is no request, or names no thing, no place, several goals or a choice, answer:
{{"pick": null, "place": null}}

Request: Would you mind putting my red mug in the sink?
{{"pick": "red mug", "place": "sink"}}
Request: Do not touch the plate on the stove.
{{"pick": null, "place": null}}
Request: {sentence}
"""


@dataclass(frozen=True)
class AskingParser:
    """The grammar reads what it is sure of; a model that answers freely is asked for the rest.

    Attributes:
        model: for instance `models.Server`.
    """

    model: Answerer

    def __call__(self, instruction: str) -> Queries:
        """The queries of an instruction.

        Raises:
            ValueError: neither the grammar nor the model reads it, or the model gives no answer. The reason is in it.
        """
        try:
            return parse(instruction)
        except ValueError as refused:
            reason = str(refused)
        try:
            answer = self.model.answer(PROMPT.format(sentence=instruction))
        except ModelError as error:
            raise ValueError(f"{reason}; and {error}") from error
        phrases = [spoken(phrase, instruction) for phrase in pick_and_place(answer)]
        if None in phrases or phrases[0] == phrases[1]:
            raise ValueError(f"{instruction!r} names no pick and place that I can find in it; {EXAMPLE}")
        pick, place = (str(phrase) for phrase in phrases)
        return _with_relation(Sentence.read(instruction), pick, place)


def _with_relation(sentence: Sentence, pick: str, place: str) -> Queries:
    """The queries, with the relation that the words before the place say. Raises ValueError if it is not clear."""
    places = _spans_of(place.split(), sentence)
    try:
        said = {place_phrase(sentence, span) for span in places}
    except ValueError as error:  # "between" and one thing
        raise ValueError(f"{sentence.text!r} is not clear to me: {error}; {EXAMPLE}") from error
    if len(said) > 1:
        raise ValueError(f"{sentence.text!r} names more than one place: {', '.join(sorted(said))}; {EXAMPLE}")
    return Queries(pick, said.pop(), asks_for_push(sentence, [*places, *_spans_of(pick.split(), sentence)]))


def pick_and_place(answer: str) -> tuple[object, object]:
    """The two values of the first JSON object in a text; None for what is missing."""
    for text in re.findall(r"\{[^{}]*\}", answer):
        try:
            values = json.loads(text)
        except ValueError:
            continue
        return values.get("pick"), values.get("place")
    return None, None


def _spans_of(words: Sequence[str], sentence: Sentence) -> list[Span]:
    """Where words stand in a sentence, one after the other."""
    ends = range(len(words), len(sentence.words) + 1)
    return [(end - len(words), end) for end in ends if sentence.words[end - len(words) : end] == tuple(words)]


def spoken(phrase: object, sentence: str) -> str | None:
    """A phrase in small letters and without determiners, if it is a run of words of the sentence; else None."""
    if not isinstance(phrase, str):
        return None
    words = without_determiner(Sentence.read(phrase).words)
    if not words or not _spans_of(words, Sentence.read(sentence)):
        return None
    return " ".join(words)
