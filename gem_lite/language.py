"""Queries (what to pick and where to place it) and the parser of instructions (the noun parser of A.1.6).

A `Parser` is any function from an instruction to `Queries`; `parse` is the library's own. Its grammar (``?``: may be
missing, ``*``: any number of times, ``|``: or)::

    instruction = OPENING* verb phrase place CLOSING*
                | OPENING* verb phrase joint verb pronoun? place CLOSING*
                | OPENING* "align" phrase "from" phrase "to" phrase CLOSING*     the place is "... to ..."
    verb        = VERB PARTICLE?
    joint       = PARTICLE? ("," | "and" | "then")*      as in "pick the mug up, and then place it"
    pronoun     = "it" | "them"
    place       = ","? PLACING phrase
    phrase      = list LOCATION? | list part?            a part belongs to what is picked, not to the place
    list        = thing | (thing ",")* thing ","? "and" thing
    thing       = DETERMINER* word word*                 with "of the ..." and "with ..." among the words
    part        = "by its ..." | "by their ..." | "by the" PART

Words in capitals are the tuples below. A word of `RESERVED` is never part of a phrase. What the grammar does not
cover is refused, never guessed: a wrong phrase would send the robot somewhere without a warning.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from gem_lite import colors
from gem_lite.registry import Registry

ALIGNING = "align"
PUSHING = "push"
"""The verb of a sentence that asks for a push and not for a pick and place."""
VERBS = (
    "pick", "put", "place", "pack", "move", "grasp", "grab", "take", "set", "drop", "stack", PUSHING, "lay", "lift",
    "bring", "transfer", "insert", ALIGNING,
)  # fmt: skip
PARTICLES = ("up", "down")
PLACING = (
    "on top of", "on the top of", "on to", "onto", "on", "upon", "atop", "down on", "down onto",
    "inside of", "inside", "in to", "into", "in", "within", "down in", "down into", "over to", "to",
)  # fmt: skip
"""Prepositions that say where to place; the longest one that fits is read."""
EXAMPLE = 'for example "put the red block in the green bowl"'
OPENINGS = (",", "please", "kindly", "now", "could you", "can you", "would you", "will you")
CLOSINGS = (",", ".", "!", "?", "please", "now", "for me", "thanks", "thank you")
LOCATIONS = ("on the left", "on the right", "in the middle")
"""Words that may follow a phrase to tell equal things apart."""
PARTS = (
    "handle", "grip", "brim", "rim", "body", "middle", "head", "tip", "blade", "edge", "base", "shade", "seat", "legs",
    "cap", "stem", "tines", "bristles", "neck", "tail",
)  # fmt: skip
"""Parts that "by the ..." may name; after "by the", another word could be a thing that stands there."""
DETERMINERS = ("the", "a", "an", "all", "both", "each", "every", "some", "any", "one", "my", "your", "our")
ADJECTIVES = frozenset(
    (*colors.RGB, "azure", "scarlet", "crimson", "emerald", "tangerine", "golden", "violet", "rose", "teal",
     "turquoise", "chestnut", "snowy", "grey", "black", "jet", "lime", "magenta", "fuchsia", "silver",
     "light", "lighter", "lightest", "dark", "darker", "darkest", "bright", "left", "right", "top", "bottom", "middle",
     "front", "back", "small", "smaller", "smallest", "big", "bigger", "biggest", "large", "larger", "largest",
     "little", "tiny", "long", "short", "tall", "thin", "thick", "round", "striped")
)  # fmt: skip
"""Words that name no thing without a noun."""
_SIDES = ("left", "right", "front", "back", "side", "top")
"""Before "of", they say that something lies beside another thing."""
_RELATIONS = (
    "about", "above", "across", "adjacent", "after", "against", "ahead", "along", "alongside", "among", "around", "at",
    "before", "behind", "below", "beneath", "beside", "besides", "between", "beyond", "by", "close", "closer", "during",
    "for", "far", "farther", "from", "further", "near", "nearer", "nearby", "next", "off", "onwards", "opposite", "out",
    "outside", "over", "parallel", "past", "perpendicular", "since", "through", "till", "touching", "toward",
    "towards", "under", "underneath", "until", "via", "without",
)  # fmt: skip
_OTHERS = (
    "again", "also", "am", "apart", "are", "as", "aside", "away", "be", "because", "but", "could", "did", "do",
    "does", "else", "except", "first", "has", "have", "here", "how", "i", "if", "instead", "is", "it", "just", "later",
    "let", "may", "me", "must", "neither", "never", "no", "nor", "not", "once", "or", "please", "should", "so", "soon",
    "straight", "than", "thank", "thanks", "that", "them", "then", "there", "these", "they", "this", "those", "though",
    "times", "today", "together", "tomorrow", "tonight", "too", "twice", "unless", "was", "we", "were", "what", "when",
    "where", "whether", "which", "while", "who", "will", "would", "yet", "you",
)  # fmt: skip
RESERVED = frozenset((*VERBS, *PARTICLES, *(word for word in PLACING if " " not in word), *_RELATIONS, *_OTHERS))
_NAMES_IN_LY = ("assembly", "belly", "butterfly", "curly", "doily", "dragonfly", "fly", "holly", "jelly", "lolly")
"""All other words that end in "ly" count as adverbs: "gently", "carefully"."""

_TOKEN = re.compile(r"[^\W_]+(?:['’&-][^\W_]+)*|\S")


@dataclass(frozen=True, eq=False)
class ImageQuery:
    """A picture of the thing that is meant, in the place of a phrase.

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

    def __str__(self) -> str:
        return self.name


Query = str | ImageQuery
"""The thing that is meant: a phrase without its article, or a picture."""


@dataclass(frozen=True)
class Queries:
    """What to pick, and where to place it.

    Attributes:
        push: whether the sentence asks for a push, from what is to be pushed to the place.

    Raises:
        ValueError: one of them is neither a text with words nor an `ImageQuery`.
    """

    pick: Query
    place: Query
    push: bool = False

    def __post_init__(self) -> None:
        for name, query in (("pick", self.pick), ("place", self.place)):
            if not isinstance(query, ImageQuery) and not (isinstance(query, str) and query.strip()):
                raise ValueError(f"{name} must be a phrase or an ImageQuery, got {query!r}")

    def __str__(self) -> str:
        return f"push {self.pick} to {self.place}" if self.push else f"pick {self.pick}, place {self.place}"


Parser = Callable[[str], Queries]
"""An instruction to queries. It raises ValueError for an instruction that it refuses."""
PARSERS: Registry[Parser] = Registry("parser")
"""Parsers by the names that configurations hold."""


@PARSERS.register("grammar")
def parse(instruction: str) -> Queries:
    """Split an instruction into what to pick and where to place it.

    "put the red blocks in a green bowl" gives "red blocks" and "green bowl"; "grasp the scissors by
    its handle and place into the brown box" gives "scissors handle" and "brown box".

    Raises:
        ValueError: the instruction is empty, starts with no known verb, names no pick or no place, or has words
            that the grammar does not cover: a second clause, "from ... to ...", "next to ...", "gently".
    """
    if not isinstance(instruction, str) or not instruction.strip():
        raise ValueError(f"the instruction is empty; say what to pick and where to place it, {EXAMPLE}")
    return _Reader(instruction).queries()


def conjuncts(phrase: str) -> tuple[str, ...]:
    """The things that a phrase joins by "and", each in full and without its article.

    "green and blue blocks" gives "green blocks" and "blue blocks"; "red block and the blue mug" gives "red block"
    and "blue mug". A noun is shared only by members that are adjectives alone (`ADJECTIVES`). A phrase without
    "and" is its own only member. A name such as "salt and pepper" counts as two things.

    Raises:
        ValueError: the phrase is empty, or "and" or a comma joins nothing.
    """
    words = _TOKEN.findall(phrase.lower())
    if words and "and" not in words:
        return (phrase,)
    text = f" {' '.join(words)} ".replace(" , and ", " and ")
    members = [_without_determiner(part.split()) for part in re.split(r" and | , ", text)]
    if not all(members):
        raise ValueError(f"phrase must name a thing on both sides of 'and', got {phrase!r}")
    noun = members[-1]
    while noun and noun[0] in ADJECTIVES:
        noun = noun[1:]
    shared = noun if len(noun) < len(members[-1]) else []
    full = [member + shared if _adjectives_alone(member) else member for member in members[:-1]]
    return tuple(" ".join(member) for member in [*full, members[-1]])


def _without_determiner(words: list[str]) -> list[str]:
    """The words of a thing without determiners and "of" at the beginning."""
    start = 0
    while start < len(words) and (words[start] in DETERMINERS or (start and words[start] == "of")):
        start += 1
    return words[start:]


def _adjectives_alone(words: list[str]) -> bool:
    return all(word in ADJECTIVES for word in words)


class _Reader:
    """Reads an instruction from left to right; ``position`` is the next word's index."""

    def __init__(self, instruction: str) -> None:
        self.instruction = instruction
        self.words = _TOKEN.findall(instruction.lower())
        self.position = 0
        while closing := next((c for c in CLOSINGS if self.words[-len(c.split()) :] == c.split()), None):
            del self.words[-len(closing.split()) :]

    def queries(self) -> Queries:
        """The rule ``instruction``."""
        while self.accept(OPENINGS):
            pass
        verb = self.accept(VERBS)
        if not verb:
            self.refuse(f"does not begin with a known verb ({', '.join(VERBS)})")
        if verb == ALIGNING:
            return self.alignment()
        self.accept(PARTICLES)
        pick = self.phrase() + self.part()
        end_of_joint = self.joint(self.position)
        if not pick:
            if not end_of_joint and not self.fits(PLACING):
                self.refuse_rest()
            self.refuse("names nothing to pick")
        if end_of_joint:
            self.position = end_of_joint
            self.accept(PARTICLES)
            self.accept(("it", "them"))
            self.accept(PARTICLES)
        self.accept((",",))
        if not self.accept(PLACING):
            self.refuse_rest()
            self.refuse("names no place")
        place = self.phrase()
        self.refuse_rest()
        if not place:
            self.refuse("names no place")
        return Queries(" ".join(pick).replace(" ,", ","), " ".join(place).replace(" ,", ","), verb == PUSHING)

    def alignment(self) -> Queries:
        """The rest of the rule with "align": the place has a start and an end."""
        thing = self.phrase()
        start = self.phrase() if self.accept(("from",)) else []
        end = self.phrase() if self.accept(("to",)) else []
        self.refuse_rest()
        if not (thing and start and end):
            self.refuse('must say what to align, and along what, as in "align the rope from left corner to right tip"')
        return Queries(" ".join(thing), f"{' '.join(start)} to {' '.join(end)}")

    def phrase(self) -> list[str]:
        """The rules ``list`` and ``LOCATION``: the words of a phrase, without its determiner."""
        start = self.position
        thing = start  # the start of the current member of the list
        while self.position < len(self.words) and not self.stops(start, thing):
            if self.words[self.position] in ("and", ","):
                thing = self.position + 1
            self.position += 1
        words = _without_determiner(self.words[start : self.position])
        if "," in words and "and" not in words[words.index(",") :]:
            self.position = start + self.words[start:].index(",")
            self.refuse_rest()
        if all(word in _SIDES for word in words):
            return []
        if words[-1] in ("left", "right", "back"):  # "put the chair back in the box" has two meanings.
            self.position -= 1
            self.refuse_rest()
        return words + self.location()

    def stops(self, start: int, thing: int) -> bool:
        """Whether the next word does not belong to a phrase that began at ``start``."""
        word = self.words[self.position]
        before = self.words[self.position - 1] if self.position > start else ""
        after = self.words[self.position + 1] if self.position + 1 < len(self.words) else ""
        if before == "letter" and len(word) == 1:
            return not word.isalnum()
        if word in ("and", ","):
            member = _without_determiner(self.words[thing : self.position])
            # Any other word after "and" could be an unknown verb: "and leave".
            begins = after == "and" or after in (*DETERMINERS, *ADJECTIVES) or _adjectives_alone(member)
            return not (member and begins) or self.joint(self.position) > 0
        if word in DETERMINERS:
            return bool(before) and before not in ("of", "and", ",", *DETERMINERS) and word != "one"
        if word in _SIDES and after == "of":
            return True
        if word == "of":
            return not before or not after
        if word == "with":
            return not before or not after or after in DETERMINERS
        adverb = word.endswith("ly") and word not in _NAMES_IN_LY
        return word in RESERVED or adverb or not word[0].isalnum()

    def location(self) -> list[str]:
        """The rule ``LOCATION``, if the words after it do not continue the same thing."""
        start = self.position
        location = self.accept(LOCATIONS)
        ends = self.position == len(self.words) or self.words[self.position] == "," or self.joint(self.position)
        if ends or self.fits(PLACING):
            return location.split()
        self.position = start
        return []

    def part(self) -> list[str]:
        """The rule ``part``: the words of the part alone."""
        start = self.position
        owner = self.accept(("by its", "by their", "by the"))
        if not owner:
            return []
        words = self.phrase()
        if words and "and" not in self.words[: self.position] and (owner != "by the" or words[-1] in PARTS):
            return words
        self.position = start
        return []

    def joint(self, start: int) -> int:
        """The rules ``joint`` and ``verb`` from ``start``: the index of the word after them, 0 if they do not fit."""
        end = start
        if end < len(self.words) and self.words[end] in PARTICLES:
            end += 1
        conjunction = end
        while end < len(self.words) and self.words[end] in (",", "and", "then"):
            end += 1
        if conjunction < end < len(self.words) and self.words[end] in VERBS:
            return end + 1
        return 0

    def fits(self, options: Iterable[str]) -> str:
        """The longest of ``options`` that the next words are, or ""."""
        fitting = [o for o in options if self.words[self.position : self.position + len(o.split())] == o.split()]
        return max(fitting, key=len, default="")

    def accept(self, options: Iterable[str]) -> str:
        """As `fits`, and move on to the word after it."""
        option = self.fits(options)
        self.position += len(option.split())
        return option

    def refuse_rest(self) -> None:
        """Raises ValueError if words are left."""
        if self.position < len(self.words):
            rest = " ".join(self.words[self.position :]).replace(" ,", ",")
            self.refuse(f"has leftover words {rest!r} that are not understood; say one pick and one place")

    def refuse(self, reason: str) -> NoReturn:
        """Raises ValueError with the instruction, the reason and an example."""
        raise ValueError(f"the instruction {self.instruction!r} {reason}; {EXAMPLE}")
