"""Sentences of other people, their halves, and whether a sentence is read rightly."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from typing import Literal

from gem_lite.foundations.files import DATA
from gem_lite.language import Parser, Queries, Question, split_relation, understand
from gem_lite.language.phrases import conjuncts, with_relation
from gem_lite.language.reader import readable

FOLDER = DATA / "other_words"
Half = Literal["development", "filed"]
Outcome = Literal["right", "asked", "misread"]
POINTING = (" over there", " there", " here")
"""Words at a phrase's end that name nothing."""


@dataclass(frozen=True)
class AnnotatedSentence:
    """A sentence and what a person understands.

    Attributes:
        kind: of the sentence, such as "polite".
        pick, place: words of the sentence; None if a robot must refuse or ask.
        relation: of the place to the things that it names, if any.
    """

    sentence: str
    kind: str
    pick: str | None
    place: str | None
    relation: str | None
    expected: Literal["act", "refuse_or_ask"]

    @property
    def half(self) -> Half:
        """The half of the first writer's sentences, by hash: nobody chose which are filed."""
        return "filed" if hashlib.sha256(self.sentence.encode()).digest()[0] % 2 else "development"

    @property
    def queries(self) -> Queries | None:
        """The queries that a person understands."""
        if self.pick is None or self.place is None:
            return None
        place = readable(self.place)
        if self.relation is not None:
            things = tuple(readable(thing) for thing in conjuncts(place))
            place = with_relation(self.relation, things) if len(things) == 1 + (self.relation == "between") else place
        return Queries(readable(self.pick), place)


def read_file(name: str) -> list[AnnotatedSentence]:
    """The sentences of a file in `FOLDER`."""
    lines = (FOLDER / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
    return [AnnotatedSentence(**json.loads(line)) for line in lines]


def development() -> list[AnnotatedSentence]:
    """All sentences that may be looked at: half of the first writer's, and the second writer's."""
    return [item for item in read_file("first") if item.half == "development"] + read_file("second")


def filed() -> list[AnnotatedSentence]:
    """The sentences that are held back: the other half of the first writer's."""
    return [item for item in read_file("first") if item.half == "filed"]


def outcome(item: AnnotatedSentence, parser: Parser) -> Outcome:
    """Whether a parser does what the annotation says: it acts on both phrases, or asks where it must not act."""
    understood = understand(item.sentence, parser)
    if isinstance(understood, Question):
        return "right" if item.expected == "refuse_or_ask" else "asked"
    return "right" if len(understood) == 1 and same(understood[0], item) else "misread"


def same(found: Queries, item: AnnotatedSentence) -> bool:
    """Whether queries are those of a person, apart from words that point ("over there").

    The writers call "mug" what is to be picked in "grab the mug by its handle". The paper's policies pick it there:
    "mug handle" (A.11) is right, too.
    """
    expected = item.queries
    if expected is None:
        return False
    picks = {plain(str(expected.pick))}
    part = re.search(r" by (?:its|the|their) (\w+)", item.sentence)
    if part:
        picks.add(f"{plain(str(expected.pick))} {part.group(1)}")
    return plain(str(found.pick)) in picks and plain(str(found.place)) == plain(str(expected.place))


def plain(phrase: str) -> str:
    """A phrase without words that point at its end; a relation with its things."""
    relation, things = split_relation(phrase)
    cut = [thing.lower() for thing in things]
    for pointing in POINTING:
        cut = [thing.removesuffix(pointing) for thing in cut]
    return " ".join([relation or "", *cut])
