"""Words that an experimental CLIP never reads, so that only a demonstration's crop can tell what they mean.

The lists are fixed by rules, before any measurement. What is withheld is still in the pictures. A part is then
captioned by its object at most ("red mug"), and a tile by its colour alone ("red thing").
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.clip_tabletop import vocabulary
from experiments.clip_tabletop.bodies import NOUN_NAMES
from experiments.clip_tabletop.crops import NO_NAME, NO_PART, PART_KEYS, Crops
from gem_lite.simulation.bodies import objects
from gem_lite.tasks import arrange_letter_to_word, pick_object_part

OBJECTS = pick_object_part.SEEN + pick_object_part.UNSEEN
"""Each has two named parts, and each list withholds one of them."""
LETTERS = arrange_letter_to_word.SEEN_LETTERS[::3]
"""Every third seen letter from the first on: A, H, O, T. The next third has the L, which "L-block" would tell."""


@dataclass(frozen=True)
class Withheld:
    """What no caption names.

    Attributes:
        name: of this list.
        nouns: names of `vocabulary.NOUNS`.
        parts: keys of `vocabulary.PARTS`.
    """

    name: str
    nouns: frozenset[str] = frozenset()
    parts: frozenset[tuple[str, str]] = frozenset()

    @property
    def phrases(self) -> list[str]:
        """The nouns and "mug brim" and so on, sorted."""
        return sorted([*self.nouns, *(f"{noun} {part}" for noun, part in self.parts)])

    def names(self, noun: str, part: str | None = None) -> bool:
        """Whether a noun, or a part of it, is withheld."""
        return noun in self.nouns or (noun, part) in self.parts

    def hide(self, crops: Crops) -> Crops:
        """The same pictures without the labels that name what is withheld."""
        nouns = [NOUN_NAMES.index(noun) for noun in self.nouns]
        parts = [PART_KEYS.index(key) for key in self.parts]
        shape = np.where(np.isin(crops.shape, nouns), NO_NAME, crops.shape)
        return replace(crops, shape=shape, part=np.where(np.isin(crops.part, parts), NO_PART, crops.part))

    def words(self) -> dict[str, Any]:
        """`vocabulary.lists` without what is withheld, which is a list of its own if there is any."""
        lists = vocabulary.lists()
        hidden = set(self.phrases)
        for key in ("nouns", "parts"):
            lists[key] = {name: names for name, names in lists[key].items() if name not in hidden}
        return lists | {"withheld": self.phrases} if hidden else lists


def _of_letters(letters: Iterable[str]) -> frozenset[str]:
    """The tiles, the pieces and the holes of some letters."""
    starts = [["letter", letter] for letter in letters]
    return frozenset(name for name in vocabulary.NOUNS if name.split()[:2] in starts)


def _alternating() -> frozenset[tuple[str, str]]:
    """By turns, the first and the second of an object's two parts by the alphabet."""
    return frozenset((name, sorted(objects.part_names(name))[number % 2]) for number, name in enumerate(OBJECTS))


def _whole_words() -> frozenset[tuple[str, str]]:
    """Of each object, the part that is no handle, or the first by the alphabet; and all parts with the same words."""
    words = set()
    for name in OBJECTS:
        parts = sorted(objects.part_names(name))
        others = [part for part in parts if not part.startswith("handle")]
        words.add(others[0])
    return frozenset((name, part) for name, part in PART_KEYS if _has_any(part, words))


def _has_any(part: str, words: set[str]) -> bool:
    # "lens" is in "lenses", too.
    return any(word.startswith(start) for word in part.split() for start in words)


NOTHING = Withheld("nothing")
PAIRS = Withheld("pairs", _of_letters(LETTERS), _alternating())
"""Half of the parts, handles among those withheld and among those kept. A withheld word is read with other objects:
"hammer head" is withheld and "spoon head" is not. A CLIP may put the two words together."""
WORDS = Withheld("words", _of_letters(LETTERS), _whole_words())
"""Half of the parts, and none of their words is read with any object, except "bowl", which is a noun, too."""
LISTS = {withheld.name: withheld for withheld in (NOTHING, PAIRS, WORDS)}
