"""A parser that asks a language model for both phrases, as the paper does (A.1.6), and believes only what was said.

A server cannot score given spans. So the model is asked for JSON. Its answer counts only if both phrases are words of
the sentence, in their order: so it cannot bring in a thing that nobody named.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

from gem_lite.language.grammar import EXAMPLE, parse
from gem_lite.language.models import Answerer, ModelError
from gem_lite.language.phrases import TOKEN, without_determiner
from gem_lite.language.queries import Queries
from gem_lite.language.reader import place_phrase
from gem_lite.language.spans import Sentence, Span
from gem_lite.language.word_lists import PUSHING

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
        sentence = Sentence.read(instruction)
        return Queries(pick, place_phrase(sentence, _last_span(place, instruction)), PUSHING in sentence.words)


def pick_and_place(answer: str) -> tuple[object, object]:
    """The two values of the first JSON object in a text; None for what is missing."""
    for text in re.findall(r"\{[^{}]*\}", answer):
        try:
            values = json.loads(text)
        except ValueError:
            continue
        return values.get("pick"), values.get("place")
    return None, None


def _last_span(phrase: str, instruction: str) -> Span:
    """Where the words of a `spoken` phrase stand in an instruction, for the last time."""
    words, said = phrase.split(), TOKEN.findall(instruction.lower())
    starts = [start for start in range(len(said)) if said[start : start + len(words)] == words]
    return starts[-1], starts[-1] + len(words)


def spoken(phrase: object, sentence: str) -> str | None:
    """A phrase in small letters and without determiners, if it is a run of words of the sentence; else None."""
    if not isinstance(phrase, str):
        return None
    words = without_determiner(TOKEN.findall(phrase.lower()))
    if not words or f" {' '.join(words)} " not in f" {' '.join(TOKEN.findall(sentence.lower()))} ":
        return None
    return " ".join(words)
