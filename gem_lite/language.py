"""From an instruction to a pick phrase and a place phrase (the noun parser of A.1.6)."""

from __future__ import annotations

import re
from dataclasses import dataclass

VERBS = ("pick up", "pick", "put", "place", "pack", "move", "grasp", "grab", "take", "set", "drop", "stack", "push")
PREPOSITIONS = ("on top of", "into", "in", "inside", "onto", "on", "to")
EXAMPLE = 'for example "put the red block in the green bowl"'

_ARTICLE = re.compile(r"^(?:all )?(?:the |a |an |some |one )?(?:of the )?")
_VERB = rf"(?:{'|'.join(VERBS)})\b"
_SECOND_VERB = rf"(?:(?:\s*,|\s+and|\s+then|\s+and then)+\s+{_VERB}(?:\s+(?:it|them))?)?"
_PATTERN = re.compile(
    rf"^(?:please,?\s+)?{_VERB}(?P<pick>.*?){_SECOND_VERB}"
    rf"(?:\s+(?:{'|'.join(PREPOSITIONS)})\b\s*(?P<place>.*))?$"
)
_PART = re.compile(r"^(?P<whole>.+?) by (?:its|the|their) (?P<part>.+)$")


@dataclass(frozen=True)
class Phrases:
    """The two noun phrases of an instruction, without articles."""

    pick: str
    place: str


def parse(instruction: str) -> Phrases:
    """Split an instruction into what to pick and where to place it.

    "put the red blocks in a green bowl" gives "red blocks" and "green bowl"; "grasp the scissors by
    its handle and place into the brown box" gives "scissors handle" and "brown box".

    Raises:
        ValueError: the instruction is empty, starts with no known verb, or names no pick or no place.
    """
    if not isinstance(instruction, str) or not instruction.strip():
        raise ValueError(f"the instruction is empty; say what to pick and where to place it, {EXAMPLE}")
    text = re.sub(r"\s+", " ", instruction.strip().lower()).rstrip(".!? ")
    match = _PATTERN.match(text)
    if match is None:
        raise ValueError(
            f"the instruction {instruction!r} does not begin with a known verb ({', '.join(VERBS)}); {EXAMPLE}"
        )
    pick, place = _noun(match["pick"]), _noun(match["place"] or "")
    if not pick:
        raise ValueError(f"the instruction {instruction!r} names nothing to pick; {EXAMPLE}")
    if not place:
        raise ValueError(f"the instruction {instruction!r} names no place; {EXAMPLE}")
    return Phrases(pick, place)


def _noun(text: str) -> str:
    text = _ARTICLE.sub("", f"{text.strip(' ,')} ").strip()
    part = _PART.match(text)
    return f"{part['whole']} {part['part']}" if part else text
