"""Sentences with pictures in the places of phrases: "put {0} into {1}"."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from gem_lite.language.queries import ImageQuery, Parser, Queries, Query
from gem_lite.rgbd import png

_SLOT = re.compile(r"\{(\d+)\}")


@dataclass(frozen=True)
class PictureSentence:
    """A sentence with pictures: "put {0} into {1}" and two pictures, or "put {0} in the brown box" and one.

    Attributes:
        text: the sentence. ``{0}`` stands for the first picture, ``{1}`` for the second.
        pictures: the pictures. Each stands in the text once.

    Raises:
        ValueError: there is no picture, or the text does not hold each picture once.
    """

    text: str
    pictures: tuple[ImageQuery, ...]

    def __post_init__(self) -> None:
        slots = sorted(int(slot) for slot in _SLOT.findall(self.text))
        if not slots or slots != list(range(len(self.pictures))):
            wanted = ", ".join(f"{{{number}}}" for number in range(max(1, len(self.pictures))))
            raise ValueError(
                f"text must hold each of {len(self.pictures)} pictures once, as {wanted}, got {self.text!r}"
            )

    def __str__(self) -> str:
        return _SLOT.sub(lambda slot: f"[{self.pictures[int(slot[1])]}]", self.text)

    def queries(self, parser: Parser) -> tuple[Queries, ...]:
        """The queries of the sentence's goals: each picture is a thing.

        Args:
            parser: reads the sentence with a made-up noun in the place of each picture.

        Raises:
            ValueError: the parser refuses the sentence, or a picture is only a part of a phrase, as in "left of {0}".
        """
        nouns = {_noun(number): picture for number, picture in enumerate(self.pictures)}
        try:
            parsed = parser(_SLOT.sub(lambda slot: _noun(int(slot[1])), self.text))
        except ValueError as error:
            said = str(error)
            for number in reversed(range(len(self.pictures))):  # A later noun begins with each earlier one.
                said = said.replace(_noun(number), f"{{{number}}}")
            raise ValueError(said) from None
        goals = (parsed,) if isinstance(parsed, Queries) else parsed

        def pictured(query: Query) -> Query:
            return nouns.get(query, query) if isinstance(query, str) else query

        read = tuple(Queries(pictured(goal.pick), pictured(goal.place), goal.push) for goal in goals)
        found = [query for goal in read for query in (goal.pick, goal.place)]
        if not all(any(query is picture for query in found) for picture in self.pictures):
            raise ValueError(f"a picture must stand in the place of a whole phrase, got {self.text!r}")
        return read


def _noun(number: int) -> str:
    """A word that no language has, so that no parser knows anything about it."""
    return "picturex" + "i" * (number + 1)


Instruction = str | PictureSentence
"""What a person says: a sentence, or one with pictures."""


def read_goals(instruction: Instruction, parser: Parser) -> tuple[Queries, ...]:
    """The queries of an instruction's goals, in the order in which to reach them.

    Raises:
        ValueError: the parser refuses it, or see `PictureSentence.queries`.
    """
    if isinstance(instruction, PictureSentence):
        return instruction.queries(parser)
    parsed = parser(instruction)
    return (parsed,) if isinstance(parsed, Queries) else parsed


def read_picture(path: Path | str) -> ImageQuery:
    """The picture of a thing in a PNG file, named by its path: see `png.decode_any`.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is no picture, or too large.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no picture {path}")
    return ImageQuery(png.decode_any(path.read_bytes(), path), str(path))
