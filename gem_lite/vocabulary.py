"""The words of the embedded CLIP: what it was shown, and how captions name it."""

from __future__ import annotations

import numpy as np

from gem_lite import colors
from gem_lite.tabletop import shapes

COLORS: dict[str, tuple[str, ...]] = {
    "blue": ("blue", "azure"),
    "red": ("red", "scarlet", "crimson"),
    "green": ("green", "emerald"),
    "orange": ("orange", "tangerine"),
    "yellow": ("yellow", "golden"),
    "purple": ("purple", "violet"),
    "pink": ("pink", "rose"),
    "cyan": ("cyan", "teal", "turquoise"),
    "brown": ("brown", "chestnut"),
    "white": ("white", "snowy"),
    "gray": ("gray", "grey"),
    "black": ("black",),
}
"""Each colour's names, the plain one first."""

RGB: dict[str, tuple[int, int, int]] = {**colors.RGB, "black": (18, 18, 18)}

SHAPES: dict[str, tuple[str, ...]] = {
    "block": ("block", "cube"),
    "bowl": ("bowl", "dish"),
    **{name: (name,) for name in shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES},
    "circle": ("circle", "disc"),
    "star": ("star", "five-pointed star"),
    "plus": ("plus", "cross"),
    "diamond": ("diamond", "rhombus"),
    "L-block": ("L-block", "L-shaped block"),
}
"""Each shape's names, the plain one first."""

TABLE = ("table", "empty table", "the table", "dark table", "bare table top", "floor", "background", "nothing")

HELD_OUT: frozenset[tuple[str, str]] = frozenset(
    {
        ("cyan", "star"), ("red", "hexagon"), ("yellow", "heart"), ("purple", "plus"), ("green", "ring"),
        ("blue", "triangle"), ("pink", "letter R shape"), ("orange", "flower"), ("white", "pentagon"),
        ("brown", "letter T shape"), ("gray", "diamond"), ("red", "letter E shape"),
    }
)  # fmt: skip
"""Colour-shape pairs that training never shows and never says: they measure how CLIP composes."""

_FULL = ("{}", "a {}", "the {}", "one {}", "a photo of a {}", "a picture of the {}", "this is a {}")
_THING = ("{}", "something {}", "a {} thing", "the {} object", "{} objects")


def plural(noun: str) -> str:
    """The plural of a shape's name: blocks, letter R shapes, crosses."""
    return noun + ("es" if noun.endswith(("s", "x", "sh", "ch")) else "s")


def caption(color: str | None, shape: str | None, rng: np.random.Generator) -> str:
    """A random caption of a colour, a shape, both, or (neither) the bare table."""
    if color is None and shape is None:
        return str(rng.choice(TABLE))
    word = rng.choice(COLORS[color]) if color else ""
    if shape is None:
        return str(rng.choice(_THING)).format(word)
    noun = str(rng.choice(SHAPES[shape]))
    if rng.random() < 0.3:
        return f"{rng.choice(('', 'the ', 'some '))}{word} {plural(noun)}".replace("  ", " ").strip()
    return str(rng.choice(_FULL)).format(f"{word} {noun}".strip())
