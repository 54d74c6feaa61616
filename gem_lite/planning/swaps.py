"""A swap is three moves: the first thing to a free spot, the second to the first one's spot, the first to the second's.

No sentence names a spot of the bare table. So the policy gets queries: what to pick is a phrase, and the place is a
`language.Spot`. The spots are seen before the first move and remembered.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gem_lite import language
from gem_lite.language import Queries, Spot, phrases, word_lists
from gem_lite.maps import refusal, relations
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource

ARRIVED = 0.05
"""A thing is at a spot if its middle is at most this far (m) from it: its pick may be off its middle."""
_OPENING, _CLOSING = ("|".join(map(re.escape, words)) for words in (word_lists.OPENINGS, word_lists.CLOSINGS))
_EXCHANGE = "swap|exchange|switch|trade"
_PLACES = "places|positions"
_FORMS = tuple(
    re.compile(rf"(?:(?:{_OPENING}) )*{form}(?: (?:{_CLOSING}))*")
    for form in (
        rf"(?:{_EXCHANGE}) (?:the (?:{_PLACES}) of )?(?P<both>.+?)",
        rf"(?:let|make|have|could|can) (?P<both>.+?) (?:{_EXCHANGE}|change) (?:{_PLACES})",
    )
)
"""As in "swap the red mug and the bowl" and "let the red mug and the bowl change places"."""
_JOINTS = (" with ", " and ")


@dataclass(frozen=True)
class Swap:
    """Two things that exchange their places: the phrases that name them."""

    first: str
    second: str


@dataclass(frozen=True)
class Move:
    """One move of a swap: the thing that a phrase names comes to a spot."""

    thing: str
    spot: Spot

    @property
    def queries(self) -> Queries:
        """What the policy gets."""
        return Queries(self.thing, self.spot)


def read_swap(sentence: str) -> Swap | None:
    """The swap that a sentence asks for: "swap the red block and the mug". None if it asks for none.

    Both phrases name single things. A location word, as in "the left mug", is not read: it would mean another thing
    after the first move.
    """
    words = " ".join(phrases.TOKEN.findall(sentence.lower()))
    for form in _FORMS:
        match = form.fullmatch(words)
        if match is None:
            continue
        for pair in _pairs(match["both"]):
            try:
                first, second = map(language.parse_thing, pair)
            except ValueError:
                continue
            if _is_plain(first) and _is_plain(second):
                return Swap(first, second)
    return None


def _is_plain(phrase: str) -> bool:
    """Whether a phrase names one thing without a location word."""
    return len(language.conjuncts(phrase)) == 1 and language.split_location(phrase)[0] is None


def _pairs(both: str) -> Iterator[tuple[str, str]]:
    """The ways to cut "the mug and the red block" in two, those before a determiner first."""
    cuts = [match for joint in _JOINTS for match in re.finditer(joint, both)]
    for cut in sorted(cuts, key=lambda cut: both[cut.end() :].split()[0] not in word_lists.DETERMINERS):
        yield both[: cut.start()], both[cut.end() :]


def find_thing(phrase: str, scenes: Sequence[SceneEmbedding], source: MapSource, nouns: Sequence[str]) -> Spot:
    """Where the thing lies that a phrase names.

    Args:
        scenes: at least one, of each table.
        nouns: what things on the tables may be called.

    Raises:
        ValueError: it is on no table.
    """
    things = [refusal.fit(scene, phrase, source, nouns) for scene in scenes]
    reasons = [refusal.reason(phrase, thing) for thing in things]
    spots = [
        (thing.margin, Spot(thing.x, thing.y, table))
        for table, (thing, reason) in enumerate(zip(things, reasons, strict=True))
        if thing is not None and reason is None
    ]
    if not spots:
        raise ValueError(reasons[0])
    return max(spots, key=lambda found: found[0])[1]


def near(one: Spot, other: Spot) -> bool:
    """Whether two spots are at most `ARRIVED` from each other on one table."""
    return one.table == other.table and math.hypot(one.x - other.x, one.y - other.y) <= ARRIVED


def moves(
    swap: Swap, scenes: Sequence[SceneEmbedding], source: MapSource, nouns: Sequence[str]
) -> tuple[Move, ...]:  # fmt: skip
    """The three moves of a swap.

    Raises:
        ValueError: a thing is on no table, both are the same thing, or no spot is free.
    """
    first, second = (find_thing(phrase, scenes, source, nouns) for phrase in (swap.first, swap.second))
    if near(first, second):
        raise ValueError(f'there are no two things, "{swap.first}" and "{swap.second}": one thing looks like both')
    between = relations.free_spot(scenes[first.table].heightmap, first.table)
    if between is None:
        raise ValueError(f'there is no free spot to put the "{swap.first}" meanwhile')
    return Move(swap.first, between), Move(swap.second, first), Move(swap.first, second)


def is_done(move: Move, scenes: Sequence[SceneEmbedding], source: MapSource, nouns: Sequence[str]) -> bool:
    """Whether the thing of a move is at its spot."""
    try:
        return near(find_thing(move.thing, scenes, source, nouns), move.spot)
    except ValueError:  # It is on no table.
        return False
