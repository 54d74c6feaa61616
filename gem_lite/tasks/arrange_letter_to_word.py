"""arrange-letter-to-word: "pick the blue letter E and place on green plate", of the paper's real tables (A.11)."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import trimesh
from shapely import Polygon, affinity, box
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import tiles
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import FULL_TURN, Goal, PoseMetric
from gem_lite.tasks.real_table import AREA, GAP, SCALE, WORKSPACE
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

WORDS = (
    "ACE", "ART", "CAN", "CAR", "CAT", "COT", "EAR", "EAT", "HAT", "HEN", "HER", "HOT", "LET", "LOT", "NET", "OAR",
    "ONE", "ORE", "RAN", "SEA", "SHE", "SON", "TEA", "TEN", "TOE",
)  # fmt: skip
"""Words of three different letters, for training and for tests with seen letters."""
UNSEEN_WORDS = (
    "BIG", "BUD", "DIG", "DIM", "DIP", "FIG", "FIX", "GUM", "GYM", "JIB", "JUG", "KID", "MIX", "MUD", "MUG", "PIG",
    "PUB", "VIM", "WIG", "ZIP",
)  # fmt: skip
"""Words without any letter of `WORDS`."""
SEEN_LETTERS = tuple(sorted(set("".join(WORDS))))
UNSEEN_LETTERS = tuple(sorted(set("".join(UNSEEN_WORDS))))
DIGITS = tuple("0123456789")
NUMBERS = 0.5
"""The share of unseen episodes whose word is a number of three different digits."""

TILE = (0.0275, 0.0275, 0.006)
"""Sides (m) of a tile. Its glyph is half as large as on CLIPort's table."""
PLATE = (0.04, 0.04, 0.002)
LINE = 0.0022
"""Width (m) of the lines on tiles and plates: a black one along the left edge, a white one along the right edge."""
TILE_MARGIN, PLATE_MARGIN = 0.0008, 0.0015
"""Distance (m) from an edge to its line. On a plate, the lines lie outside a tile that is in its middle."""
ON_PLATE = PoseMetric(
    PLATE[0] / 2, FULL_TURN, math.radians(15), height=PLATE[2] + TILE[2] / 2, height_distance=0.003, wrong_yaw=0.5
)
"""The middle of a tile lies over the plate, flat. A wrong yaw earns half (A.11); its limit is our other tasks'."""
QUARTER = math.pi / 2


@cache
def _lines(side: float, margin: float) -> tuple[Polygon, Polygon]:
    """The black and the white line on a square of this side (m)."""
    inner, outer = side / 2 - margin - LINE, side / 2 - margin
    return box(-outer, -outer, -inner, outer), box(inner, -outer, outer, outer)


def _square(side: float) -> Polygon:
    return box(-side / 2, -side / 2, side / 2, side / 2)


@cache
def _tile_meshes(name: str) -> list[trimesh.Trimesh]:
    """A tile's own colour, its glyph, its black line and its white line."""
    glyph = affinity.scale(tiles.tile_ink(name), SCALE, SCALE, origin=(0, 0))
    return tiles.printed_plate(_square(TILE[0]), [glyph, *_lines(TILE[0], TILE_MARGIN)], TILE[2])


@cache
def _plate_meshes() -> list[trimesh.Trimesh]:
    """A plate's own colour, its black line and its white line."""
    return tiles.printed_plate(_square(PLATE[0]), _lines(PLATE[0], PLATE_MARGIN), PLATE[2])


def add_lined_tile(client: int, name: str, color: RGBA, pose: Pose2) -> Body:
    """A tile as the embedded CLIP knows it, at half of its size, with the two lines that show its yaw.

    Args:
        name: one of `tiles.TILES`.

    Raises:
        ValueError: the name is unknown.
    """
    inks = (color, tiles.ink_on(color), tiles.DARK_INK, tiles.WHITE_INK)
    return tiles.add_printed(client, _tile_meshes(name), inks, TILE, pose, mass=0.01)


def add_lined_plate(client: int, color: RGBA, pose: Pose2) -> Body:
    """A fixed flat square plate, with the two lines that show its yaw."""
    inks = (color, tiles.DARK_INK, tiles.WHITE_INK)
    return tiles.add_printed(client, _plate_meshes(), inks, PLATE, pose, mass=0.0, movable=False)


@register("arrange-letter-to-word", {"seen": {}, "unseen": {"unseen": True}})
class ArrangeLetterToWord(Task):
    """Five movable tiles and three fixed plates; the sentences follow the word, one for each of its three letters.

    Two tiles are distractors. One has the colour of a tile of the word and another letter, so that the letter must be
    read; the other has the letter of a tile of the word and another colour. The plates have colours that no tile of the
    word has.

    In validation and test, the unseen variant has other letters, or digits; the colours are the same. Each sentence is
    said once: after each action the next one follows. What it missed is lost, and what it achieved stays earned. So a
    tile with a wrong yaw stays as it is, and earns half.
    """

    workspace = WORKSPACE
    scale = SCALE
    effector = "parallel-jaw"
    max_steps = 3
    _lost = 0.0
    """The sum of the shares that were missed."""

    @override
    def reset(self, environment: Environment, rng: np.random.Generator, seed: int) -> None:
        self._lost = 0.0
        super().reset(environment, rng, seed)

    @override
    def score(self, environment: Environment) -> float:
        return super().score(environment) - self._lost / sum(goal.share for goal in self.goals)

    @override
    def advance(self, environment: Environment) -> None:
        if self._reached < len(self.goals):
            goal = self.goals[self._reached]
            self._lost += goal.share * (1.0 - goal.done(environment))
            self._reached += 1
        super().advance(environment)

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        word, others = self._word(rng)
        *of_tiles, spare, plate_1, plate_2, plate_3 = draw(rng, colors.SEEN, 7)
        of_plates = (plate_1, plate_2, plate_3)
        self.named_colors = (*of_tiles, *of_plates)
        free = FreeSpace(AREA, rng, environment.style, GAP)
        plates = []
        for color in of_plates:
            plate = add_lined_plate(environment.client, colors.rgba(color), free.take(_radius(PLATE)))
            plates.append(self.put(environment, plate, f"{color} plate"))
        asked = list(zip(of_tiles, word, strict=True))
        distractors = [(str(rng.choice(of_tiles)), draw(rng, others, 1)[0]), (spare, str(rng.choice(word)))]
        bodies = []
        for color, name in (*asked, *distractors):
            tile = add_lined_tile(environment.client, name, colors.rgba(color), free.take(_radius(TILE)))
            bodies.append(self.put(environment, tile, f"{color} {name}"))
        return [
            Goal(
                f"pick the {color} {name} and place on {of_plate} plate", (tile,), (plate,), ON_PLATE,
                grasp_symmetry=QUARTER,
            )
            for (color, name), of_plate, tile, plate in zip(asked, of_plates, bodies, plates, strict=False)
        ]  # fmt: skip

    def _word(self, rng: np.random.Generator) -> tuple[list[str], list[str]]:
        """The names of a word's three tiles, and those of the other tiles of the same kind."""
        kind, glyphs = "letter", UNSEEN_LETTERS if self.unseen else SEEN_LETTERS
        word = list(str(rng.choice(UNSEEN_WORDS if self.unseen else WORDS)))
        if self.unseen and rng.random() < NUMBERS:
            kind, glyphs = "digit", DIGITS
            word = draw(rng, DIGITS, len(word))
        return [f"{kind} {glyph}" for glyph in word], [f"{kind} {glyph}" for glyph in glyphs if glyph not in word]


def _radius(size: tuple[float, float, float]) -> float:
    return math.hypot(*size[:2]) / 2
