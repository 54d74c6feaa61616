"""A swap is three moves: the first thing to a free spot, the second to the first one's spot, the first to the second's.

No sentence names a spot of the bare table. So the moves are queries: what to pick is a phrase, and the place is a
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
    """Two things that exchange their places.

    Attributes:
        sentence: its part of the instruction.
        first, second: the phrases of the things.
    """

    sentence: str
    first: str
    second: str


def read_swap(sentence: str) -> Swap | None:
    """The swap that a sentence asks for: "swap the red block and the mug". None if it asks for none."""
    words = " ".join(phrases.TOKEN.findall(sentence.lower()))
    for form in _FORMS:
        match = form.fullmatch(words)
        if match is None:
            continue
        for first, second in _pairs(match["both"]):
            try:
                return Swap(sentence.strip(), language.parse_thing(first), language.parse_thing(second))
            except ValueError:
                continue
    return None


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
    reasons = [refusal.refusal(scene, [phrase], source, nouns) for scene in scenes]
    spots = []
    for table, (scene, reason) in enumerate(zip(scenes, reasons, strict=True)):
        thing = refusal.fit(scene, phrase, source, nouns)
        if reason is None and thing is not None:
            spots.append((thing.margin, Spot(thing.x, thing.y, table)))
    if not spots:
        raise ValueError(reasons[0])
    return max(spots, key=lambda found: found[0])[1]


def near(one: Spot, other: Spot) -> bool:
    """Whether two spots are at most `ARRIVED` from each other on one table."""
    return one.table == other.table and math.hypot(one.x - other.x, one.y - other.y) <= ARRIVED


def moves(
    swap: Swap, scenes: Sequence[SceneEmbedding], source: MapSource, nouns: Sequence[str]
) -> tuple[Queries, ...]:  # fmt: skip
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
    return Queries(swap.first, between), Queries(swap.second, first), Queries(swap.first, second)


def is_done(move: Queries, scenes: Sequence[SceneEmbedding], source: MapSource, nouns: Sequence[str]) -> bool:
    """Whether the thing of a move is at its spot."""
    if not isinstance(move.pick, str) or not isinstance(move.place, Spot):
        raise ValueError(f"move must bring a thing that a phrase names to a Spot, got {move}")
    try:
        return near(find_thing(move.pick, scenes, source, nouns), move.place)
    except ValueError:  # It is on no table.
        return False
