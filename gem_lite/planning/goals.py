"""What an instruction asks for: goals such as "all toys into the brown box", one after the other.

``all``, ``every``, ``each`` and ``both`` ask for everything of a kind; so does the name of a known kind alone ("the
toys"). Any other instruction is a goal of one sentence. Two goals may stand in one instruction: "put all toys in the
brown box and the mug in the bowl".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from gem_lite import language
from gem_lite.language import Parser, Queries
from gem_lite.language.word_lists import OF_SEVERAL
from gem_lite.planning.belonging import KINDS
from gem_lite.planning.swaps import Swap, read_swap

_JOINT = re.compile(r"\s*(?:,|;|\band then\b|\band\b|\bthen\b)\s*")
_BULLET = re.compile(r"\s*(?:[-*•]|\d+[.):])?\s*")


@dataclass(frozen=True)
class Goal:
    """One goal of an instruction.

    Attributes:
        sentence: its part of the instruction, which a policy could get as it is.
        thing: what is to be moved: a phrase, or a kind in the plural if ``every``.
        place: where to.
        every: whether everything that belongs to the kind ``thing`` is meant.
    """

    sentence: str
    thing: str
    place: str
    every: bool

    def line(self, phrase: str) -> str:
        """The sentence that moves the thing that a phrase names to the goal's place."""
        return f"put the {phrase} in the {self.place}"


def read(
    instruction: str, kinds: Sequence[str] = KINDS, parser: Parser = language.parse
) -> tuple[Goal | Swap, ...]:  # fmt: skip
    """The goals of an instruction, in their order.

    Raises:
        ValueError: the parser refuses it, and each way to cut it in two.
    """
    try:
        return (_goal(instruction, kinds, parser),)
    except ValueError as error:
        refused = error
    for joint in _JOINT.finditer(instruction):
        first, rest = instruction[: joint.start()], instruction[joint.end() :]
        try:
            before = _goal(first, kinds, parser)
            verb = next((word for word in first.lower().split() if word in language.VERBS), "")
            begins = rest.lower().split()[:1]
            whole = read_swap(rest) is not None or (begins and begins[0] in language.VERBS)
            rest = rest if whole else f"{verb} {rest}"
            return (before, *read(rest, kinds, parser))
        except ValueError:
            continue
    raise refused


def read_lines(
    text: str, kinds: Sequence[str] = KINDS, parser: Parser = language.parse
) -> tuple[tuple[Goal | Swap, ...], tuple[str, ...]]:
    """The goals of a plan that a language model wrote, a sentence a line. The text is data: nothing in it is run.

    Returns:
        The goals of the lines that can be read, and for each other line why it cannot.
    """
    goals: list[Goal | Swap] = []
    refused: list[str] = []
    for line in text.splitlines():
        sentence = _BULLET.sub("", line, count=1).strip()
        if not sentence:
            continue
        try:
            goals.extend(read(sentence, kinds, parser))
        except ValueError as error:
            refused.append(str(error))
    return tuple(goals), tuple(refused)


def _goal(sentence: str, kinds: Sequence[str], parser: Parser) -> Goal | Swap:
    swap = read_swap(sentence)
    if swap is not None:
        return swap
    parsed = parser(sentence)
    if not isinstance(parsed, Queries) or not isinstance(parsed.pick, str) or not isinstance(parsed.place, str):
        raise ValueError(f"a goal must be one pick and one place in words, got {sentence!r}")
    if parsed.push:
        raise ValueError(f"a goal must be to pick and place, got the push {sentence!r}")
    words = sentence.lower().split()
    known = parsed.pick.split()[-1] in {kind.split()[-1] for kind in kinds}
    every = known or any(word in words for word in OF_SEVERAL)
    in_singular = "every" in words or "each" in words
    return Goal(sentence.strip(), language.plural(parsed.pick) if in_singular else parsed.pick, parsed.place, every)
