"""The words of the embedded CLIP: its colours, shapes, objects and parts, and their captions."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.clip_tabletop import basic_solids, printed
from gem_lite.foundations import colors
from gem_lite.simulation.bodies import objects, shapes, tiles
from gem_lite.tasks import align_rope, object_sorting

COLORS: dict[str, tuple[str, ...]] = {
    "blue": ("blue", "azure"),
    "red": ("red", "scarlet", "crimson"),
    "green": ("green", "emerald"),
    "orange": ("orange", "tangerine"),
    "yellow": ("yellow", "golden"),
    "purple": ("purple", "violet"),
    "pink": ("pink", "rose"),
    "cyan": ("cyan", "teal", "turquoise"),
    "brown": ("brown", "chestnut", "middle brown"),
    "white": ("white", "snowy"),
    "gray": ("gray", "grey"),
    "black": ("black", "jet black"),
    "lime": ("lime", "lime green"),
    "magenta": ("magenta", "fuchsia"),
    "light brown": ("light brown", "lighter brown", "lightest brown"),
    "dark brown": ("dark brown", "darker brown", "darkest brown"),
}
"""Each colour's names, the plain one first."""

RGB: dict[str, tuple[int, int, int]] = {
    **colors.RGB,
    "black": (18, 18, 18),
    **colors.OTHERS,
    "dark brown": (78, 58, 47),
}

LETTERS = ("H", "K", "X", "S")
DIGITS = ("2", "3", "4", "7", "8")
GLYPHS = tuple(f"letter {c} shape" for c in LETTERS) + tuple(f"digit {c} shape" for c in DIGITS)
"""Pieces like the kitting letters, without those that look like a turned or mirrored other piece."""

_SYNONYMS: dict[str, tuple[str, ...]] = {
    "block": ("cube",),
    "bowl": ("dish",),
    "circle": ("disc", "round piece"),
    "star": ("five-pointed star",),
    "plus": ("cross",),
    "diamond": ("rhombus",),
    "L-block": ("L-shaped block",),
    "box": ("container", "open box"),
    "plate": ("saucer",),
    "ball": ("sphere",),
    "cylinder": ("can",),
    "cone": ("traffic cone",),
    "mug": ("coffee mug", "cup"),
    "pan": ("frying pan", "skillet"),
    "flashlight": ("torch",),
    "wrench": ("spanner",),
    "airplane": ("plane", "aeroplane"),
    "toy car": ("car", "toy automobile"),
    "glasses": ("eyeglasses", "spectacles"),
    "hat": ("fedora",),
    "headphones": ("headset",),
    "teapot": ("kettle",),
    "brush": ("scrubbing brush",),
    "magnifying glass": ("magnifier",),
    "duck": ("rubber duck", "duckling"),
    "dumbbell": ("barbell",),
    "sailboat": ("boat", "toy boat"),
    "lamp": ("table lamp",),
    "chair": ("toy chair",),
    "lollipop": ("sucker",),
    "mushroom": ("toadstool",),
    "wine glass": ("goblet",),
    "bottle": ("flask",),
    "spatula": ("turner",),
    "pencil": ("crayon",),
    "hammer": ("mallet",),
    "spoon": ("teaspoon",),
    "knife": ("table knife",),
    "pizza slice": ("slice of pizza",),
    "cherries": ("pair of cherries",),
    "hamburger": ("burger",),
    "donut": ("doughnut",),
    "corn": ("ear of corn", "corn cob"),
    "ice cream": ("ice cream cone",),
    "rabbit": ("bunny",),
    "turtle": ("tortoise",),
    "toy train": ("train", "locomotive"),
    "rocket": ("spaceship",),
    "robot": ("toy robot",),
    "truck": ("lorry",),
    "axe": ("hatchet",),
    "shovel": ("spade",),
    "tape roll": ("roll of tape",),
    "salt shaker": ("shaker",),
    "teddy bear": ("teddy",),
    "striped block": ("block with stripes",),
    "dotted block": ("spotted block", "block with dots"),
    "checkered block": ("checked block", "chequered block"),
    "striped towel": ("towel with stripes",),
    "dotted towel": ("spotted towel", "towel with dots"),
    "checkered towel": ("checked towel", "chequered towel"),
    "rope": ("string", "cord"),
    "kit": ("kitting board", "board"),
    "side": ("side of the stand", "end of the stand"),
}

TEXTURED = tuple(f"{texture} {thing}" for thing in ("block", "towel") for texture in printed.TEXTURES)
PIECES = shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES
SHAPES: dict[str, tuple[str, ...]] = {
    name: (name, *_SYNONYMS.get(name, ()))
    for name in ("block", "bowl", "L-block", *basic_solids.BASIC, *PIECES, *GLYPHS, *objects.NAMES, *TEXTURED)
}
"""The names of each shape and object that can have any colour, the plain one first."""

TILES = {name: (name, f"{name} tile", f"{name} block") for name in tiles.TILES}
"""The names of the tiles with a letter or a digit."""

HOLES = {f"{name} hole": (f"{name} hole",) for name in PIECES}
"""The names of the holes of a kit."""
LOCATIONS = ("left", "right", "top", "bottom", "middle")
"""Words before the name of a hole. A picture of one hole does not show them, so they should not change its score."""

STRUCTURES = {
    "kit": ("kit", *_SYNONYMS["kit"]),
    "side": ("side", *_SYNONYMS["side"]),
    "middle of the stand": ("middle of the stand",),
    "rope": ("rope", *_SYNONYMS["rope"]),
    "square guide": ("square guide", *(f"{start} to {end}" for start, end in align_rope.DIRECTIONS)),
    "pile of {} blocks": ("pile of {} blocks", "heap of {} blocks"),
}
"""The names of what the tasks build on the table. In a pile's names, the colour stands at ``{}``."""

_SYMBOL_SYNONYMS = {"recycle": "recycling", "gear": "cogwheel", "smiley": "smile face", "moon": "crescent"}

BOXES: dict[str, tuple[str, ...]] = {
    f"{symbol} box": tuple(f"{word} box" for word in (symbol, _SYMBOL_SYNONYMS.get(symbol, f"{symbol} symbol")))
    for symbol in object_sorting.SYMBOLS
}
"""The names of the boxes with symbols."""

NOUNS: dict[str, tuple[str, ...]] = SHAPES | TILES | HOLES | STRUCTURES | BOXES
"""The names of everything that pictures show, the plain one first."""

_PART_SYNONYMS = {"handle": "grip", "brim": "rim", "body": "middle", "head": "tip", "blade": "edge"}

PARTS: dict[tuple[str, str], tuple[str, ...]] = {
    (name, part): (part, _PART_SYNONYMS[part]) if part in _PART_SYNONYMS else (part,)
    for name in objects.NAMES
    for part in objects.part_names(name)
}
"""The parts of each object and their names: captions call ("mug", "handle") "mug handle" or "mug grip"."""

TABLE = ("table", "empty table", "the table", "dark table", "bare table top", "floor", "background", "nothing")

NOUNS_WITHOUT_PICTURES: tuple[str, ...] = (
    "sofa", "bicycle", "window", "tree", "cat", "mountain", "violin", "bread", "sandwich", "river", "pillow",
    "blanket", "shirt", "trousers", "sock", "glove", "camera", "telephone", "computer", "keyboard", "book",
    "newspaper", "envelope", "stamp", "coin", "wallet", "belt", "necklace", "candle", "vase", "flower pot", "tomato",
    "boot", "potato", "onion", "cabbage", "grape", "melon", "umbrella", "cactus", "clock", "helmet", "anchor",
    "cookie", "cake", "ladder", "bucket", "rake", "drill", "nail", "screw", "chain", "tent", "backpack", "piano",
    "whistle", "horse", "tiger", "bird", "spider", "frog", "tractor", "ship",
)  # fmt: skip
"""Nouns in captions without pictures. They teach the text tower that an unknown object is not one of the known."""

HELD_OUT: frozenset[tuple[str, str]] = frozenset(
    {
        ("cyan", "star"), ("red", "hexagon"), ("yellow", "heart"), ("purple", "plus"), ("green", "ring"),
        ("blue", "triangle"), ("pink", "letter R shape"), ("orange", "flower"), ("white", "pentagon"),
        ("brown", "letter T shape"), ("gray", "diamond"), ("red", "letter E shape"), ("blue", "mug"),
        ("yellow", "hammer"), ("green", "teapot"), ("purple", "toy car"), ("pink", "airplane"), ("orange", "key"),
        ("white", "duck"), ("cyan", "scissors"),
    }
)  # fmt: skip
"""Colour-shape pairs that are in no picture and no caption of the training. They test new combinations."""

UNREAD_COLORS: dict[str, tuple[str, ...]] = {
    "blue": ("navy", "cobalt", "indigo"),
    "red": ("maroon", "ruby"),
    "green": ("olive", "jade", "mint"),
    "orange": ("apricot", "pumpkin"),
    "yellow": ("mustard", "lemon", "amber"),
    "purple": ("lilac", "lavender", "plum"),
    "pink": ("salmon", "blush"),
    "cyan": ("aqua",),
    "brown": ("tan",),
    "white": ("ivory",),
    "gray": ("charcoal", "slate"),
    "black": ("onyx", "inky"),
}
"""Words for colours that are in no caption, by the plain name with their meaning."""
UNREAD_NOUNS: dict[str, tuple[str, ...]] = {
    "block": ("brick", "chunk", "lump"),
    "bowl": ("basin", "tureen"),
    "mug": ("beaker", "tumbler", "chalice"),
    "bottle": ("carafe",),
    "spoon": ("scoop",),
    "hat": ("bonnet",),
    "toy car": ("vehicle",),
    "chair": ("stool",),
}
"""Words for shapes and objects that are in no caption."""

_FULL = ("{}", "a {}", "the {}", "one {}", "a photo of a {}", "a picture of the {}", "this is a {}")
_THING = ("{}", "something {}", "a {} thing", "the {} object", "{} objects")


_NO_PLURAL = ("glasses", "scissors", "headphones", "spectacles", "cherries", "pliers", "stripes", "dots")


def plural(noun: str) -> str:
    """The plural of a shape's name: blocks, letter R shapes, crosses. Names of several words with "of" keep theirs."""
    if noun.endswith(_NO_PLURAL) or " of " in noun or " to " in noun:
        return noun
    return noun + ("es" if noun.endswith(("s", "x", "sh", "ch")) else "s")


def nearest_color(rgb: np.ndarray) -> str:
    """The named colour nearest to an RGB value (0-255)."""
    return min(RGB, key=lambda name: float(np.square(np.array(RGB[name]) - rgb).sum()))


def named(word: str, noun: str) -> str:
    """A noun with a word for its colour, which may be empty: "red block", "pile of red blocks"."""
    phrase = noun.format(word) if "{}" in noun else f"{word} {noun}"
    return " ".join(phrase.split())


def caption(color: str | None, shape: str | None, rng: np.random.Generator, part: str | None = None) -> str:
    """A random caption of a colour, a shape, both, or (neither) the bare table.

    ``part`` names a part of the shape: "blue mug handle". A shape that is not in `NOUNS` has no synonyms.
    """
    if color is None and shape is None:
        return str(rng.choice(TABLE))
    word = str(rng.choice(COLORS[color])) if color else ""
    if shape is None:
        return str(rng.choice(_THING)).format(word)
    noun = str(rng.choice(NOUNS.get(shape, (shape,))))
    if part:
        noun = f"{noun} {rng.choice(PARTS[shape, part])}"
    if shape in HOLES and rng.random() < 0.5:
        noun = f"{rng.choice(LOCATIONS)} {noun}"
    chance = rng.random()
    if chance < 0.05:
        return f"{named(word, noun)} objects"
    if chance < 0.3:
        determiner = str(rng.choice(("", "the ", "some ")))
        return determiner + named(word, plural(noun))
    return str(rng.choice(_FULL)).format(named(word, noun))


def lists() -> dict[str, Any]:
    """The words as JSON has them: the file words.json beside the weights, for those who use the CLIP."""
    return {
        "colors": COLORS,
        "nouns": NOUNS,
        "parts": {f"{noun} {part}": names for (noun, part), names in PARTS.items()},
        "nouns_without_pictures": NOUNS_WITHOUT_PICTURES,
        "held_out_pairs": sorted(HELD_OUT),
        "unread_colors": UNREAD_COLORS,
        "unread_nouns": UNREAD_NOUNS,
    }
