"""Queries: what to pick and where to place it. A parser is any function from an instruction to queries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gem_lite.foundations.registry import Registry
from gem_lite.language import phrases


@dataclass(frozen=True, eq=False)
class ImageQuery:
    """A picture of the thing that is meant, in the place of a phrase. Two are equal if picture and name are.

    Attributes:
        picture: (H, W, 3) uint8.
        name: its name in figures and messages.

    Raises:
        ValueError: another kind of picture.
    """

    picture: np.ndarray
    name: str = "a picture"

    def __post_init__(self) -> None:
        shape = self.picture.shape
        if len(shape) != 3 or shape[-1] != 3 or 0 in shape or self.picture.dtype != np.uint8:
            raise ValueError(f"picture must be (H, W, 3) uint8, got {shape} {self.picture.dtype}")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ImageQuery):
            return NotImplemented
        return self.name == other.name and np.array_equal(self.picture, other.picture)

    def __hash__(self) -> int:
        return hash((self.name, self.picture.tobytes()))

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Spot:
    """A place on a table, by its numbers. No sentence names it; plans do (`planning`).

    Attributes:
        x, y: metres, in the table's frame.
        table: the table's number.
    """

    x: float
    y: float
    table: int = 0

    def __str__(self) -> str:
        return f"({self.x:.2f}, {self.y:.2f}) m" + (f" of table {self.table}" if self.table else "")


ThingQuery = str | ImageQuery
"""The thing that is meant: a phrase without its article, or a picture."""
Query = ThingQuery | Spot
"""What is meant: a thing or, for a place, a spot. The phrase of a place may be a relation to things, too, such as "left
of green bowl" (`phrases.split_relation`)."""


def is_relation(query: Query) -> bool:
    """Whether a query is a place beside things, such as "left of green bowl"."""
    return isinstance(query, str) and phrases.split_relation(query)[0] is not None


@dataclass(frozen=True)
class Queries:
    """What to pick, and where to place it.

    Attributes:
        push: whether the sentence asks for a push, from what is to be pushed to the place.

    Raises:
        ValueError: one of them is neither a text with words, an `ImageQuery` nor a `Spot`; the pick is a relation or a
            spot, or the place is a relation to a wrong number of things.
    """

    pick: Query
    place: Query
    push: bool = False

    def __post_init__(self) -> None:
        for name, query in (("pick", self.pick), ("place", self.place)):
            if not isinstance(query, ImageQuery | Spot) and not (isinstance(query, str) and query.strip()):
                raise ValueError(f"{name} must be a phrase, an ImageQuery or a Spot, got {query!r}")
            is_place = isinstance(query, Spot) or is_relation(query)  # It refuses a wrong number of things.
            if is_place and name == "pick":
                raise ValueError(f"pick must name a thing, not a place, got {query!r}")

    def __str__(self) -> str:
        return f"push {self.pick} to {self.place}" if self.push else f"pick {self.pick}, place {self.place}"


Parser = Callable[[str], Queries | tuple[Queries, ...]]
"""An instruction to the queries of its goal, or of several goals in the order in which to reach them. It raises
ValueError for an instruction that it refuses."""
PARSERS: Registry[Parser] = Registry("parser")
"""Parsers by the names that configurations hold."""


@dataclass(frozen=True)
class Question:
    """What a robot should ask back, since it did not understand a sentence.

    Attributes:
        text: for the person who said the sentence.
    """

    text: str


def understand(sentence: str, parser: Parser) -> tuple[Queries, ...] | Question:
    """The queries of a sentence's goals, or a question: a value for a robot's program, which need not read texts."""
    try:
        parsed = parser(sentence)
    except ValueError as reason:
        return Question(str(reason))
    return (parsed,) if isinstance(parsed, Queries) else parsed
