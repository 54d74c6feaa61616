"""Does a name belong to a kind? Is a train one of the "toys"? A language model's probabilities tell.

A small model answers "Is a train a toy?" almost by chance (lesson 13). But it has read many lists: after "Examples
of toys:" a train is likelier than after "Examples of things:" (`list_score`), and after "A train is a kind of" the word
"toy" is likelier than "tool" (`kind_scores`). `Belonging` adds both scores and compares the kinds with each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gem_lite import language
from gem_lite.language import models
from gem_lite.language.models import Scorer

KINDS = ("animals", "food", "toys", "tools", "kitchen utensils")
"""What things on a table may be. Give others for a table with other things."""
NOUNS = (
    "dog", "pig", "tiger", "deer", "camel", "crocodile", "penguin", "dolphin",
    "bread", "onion", "lemon", "pineapple", "butter", "pie", "steak", "waffle",
    "doll", "lego brick", "toy boat", "action figure", "rubber ball", "board game", "pinwheel", "music box",
    "drill", "crowbar", "hacksaw", "trowel", "sledgehammer", "ladder", "allen key", "scraper",
    "plate", "pot", "colander", "can opener", "chopsticks", "pepper mill", "strainer", "potato masher",
)  # fmt: skip
"""Common nouns of all `KINDS`. A kind's mean score over them is its zero: some kinds are likelier words than others."""
ZEROS: Mapping[str, Mapping[str, float]] = {
    models.SMALL: {
        "animals": -9.7310, "food": -7.8871, "toys": -7.6465, "tools": -9.4204, "kitchen utensils": -12.4765,
    }
}  # fmt: skip
"""By a model's name: the zeros of kinds, which would take half a minute to compute. `scores` gave them, to 0.0001."""
LISTS = ("Examples of {}:", "I like {} such as", "There are many {}, for example")
SENTENCES = ("{} is a kind of", "{} is a type of", "A good example: {} is a")
ANYTHING = "things"
"""The kind to which every noun belongs."""
LOWEST_MARGIN = -0.5
"""A name belongs to a kind if no other kind scores higher by more than this (nats). It was chosen on nouns that no
object of the simulator has, so that about 5 of 100 wrong pairs pass (python -m experiments.planning nouns)."""


def with_article(name: str) -> str:
    """As in "an apple" and "a pear"."""
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def singular(kind: str) -> str:
    """As "toy" of "toys" and "box" of "boxes"; "food" stays."""
    return kind.removesuffix("es" if kind.endswith(("xes", "shes", "ches", "sses")) else "s")


def list_scores(model: Scorer, names: Sequence[str], kinds: Sequence[str]) -> np.ndarray:
    """How much likelier each name becomes in a list of a kind than in a list of things.

    Returns:
        (N, K) nats: log p(name | "Examples of toys:") - log p(name | "Examples of things:"), the mean over `LISTS`.
    """
    words = [f" {with_article(name)}" for name in names]
    total = np.zeros((len(names), len(kinds)))
    for text in LISTS:
        among_things = model.scores(_sentence(text, ANYTHING), words)
        for number, kind in enumerate(kinds):
            total[:, number] += model.scores(_sentence(text, kind), words) - among_things
    return total / len(LISTS)


def kind_scores(model: Scorer, names: Sequence[str], kinds: Sequence[str]) -> np.ndarray:
    """How likely each kind's word is in a sentence about a name.

    Returns:
        (N, K) nats: log p("toy" | "A train is a kind of"), the mean over `SENTENCES`.
    """
    words = [f" {singular(kind)}" for kind in kinds]
    prompts = [[_sentence(text, with_article(name)) for text in SENTENCES] for name in names]
    return np.array([np.mean([model.scores(prompt, words) for prompt in of_name], axis=0) for of_name in prompts])


def _sentence(form: str, words: str) -> str:
    text = form.format(words)
    return text[0].upper() + text[1:]


def scores(model: Scorer, names: Sequence[str], kinds: Sequence[str]) -> np.ndarray:
    """`list_scores` plus `kind_scores`, (N, K) nats."""
    return list_scores(model, names, kinds) + kind_scores(model, names, kinds)


@dataclass(eq=False)
class Belonging:
    """Says which names belong to a kind. What it once found is kept.

    Attributes:
        model: the language model.
        kinds: what things on the table may be; a kind that is asked for is compared with them.
        lowest_margin: a higher one accepts less, see `LOWEST_MARGIN`.
    """

    model: Scorer
    kinds: Sequence[str] = KINDS
    lowest_margin: float = LOWEST_MARGIN
    _zeros: dict[str, float] = field(init=False, repr=False)
    _scores: dict[tuple[str, tuple[str, ...]], np.ndarray] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self._zeros = dict(ZEROS.get(getattr(self.model, "name", ""), {}))

    def __call__(self, names: Sequence[str], kind: str) -> list[bool]:
        """Whether each name belongs to a kind. "mug" belongs to "mug" and to "mugs", whatever the model says."""
        asked = [name for name in names if kind not in (name, language.plural(name))]
        margins = dict(zip(asked, self.margins(asked, kind), strict=True))
        return [name not in margins or bool(margins[name] >= self.lowest_margin) for name in names]

    def margins(self, names: Sequence[str], kind: str) -> np.ndarray:
        """By how much (nats) a kind scores higher than the best other one, for each name, (N,).

        It is infinite if there is no other. A kind's scores are counted from their mean over `NOUNS`. A name for the
        same kind, such as "utensils" to "kitchen utensils", is no other one.
        """
        if not names:
            return np.zeros(0)
        others = {other for other in self.kinds if other.split()[-1] != kind.split()[-1]}
        compared = tuple(sorted({kind} | others))
        unknown = tuple(other for other in compared if other not in self._zeros)
        if unknown:
            self._zeros.update(zip(unknown, scores(self.model, NOUNS, unknown).mean(axis=0), strict=True))
        new = [name for name in dict.fromkeys(names) if (name, compared) not in self._scores]
        if new:
            found = scores(self.model, new, compared) - [self._zeros[other] for other in compared]
            self._scores.update({(name, compared): row for name, row in zip(new, found, strict=True)})
        rows = np.array([self._scores[name, compared] for name in names])  # (N, kinds)
        asked = compared.index(kind)
        return rows[:, asked] - np.delete(rows, asked, axis=1).max(axis=1, initial=-np.inf)
