"""Is the named thing on the table at all? A policy always chooses something; this says when nothing fits the words.

The value of a map alone does not tell: on another table with another lamp, what is there may score lower than what is
not there on ours. So phrases are compared with each other, on one thing at a time. Every thing that rises above the
table is scored by the named phrase and by `alternatives` to it: the same noun with other colours, and the same colour
with other nouns. The phrase fits a thing if it scores at least `LOWEST_SCORE` and no alternative fits much better.

This part is ours; the paper has no refusal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from gem_lite import colors, language
from gem_lite.language import Query
from gem_lite.maps import locations
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource

RISES = 0.008
"""A cell belongs to a thing if it is higher (m) above the table than this, and than the table's own noise."""
NOISE = 3.0
"""A cell is above the table's noise if it is higher by this many standard deviations."""
FEWEST_CELLS = 12
"""A region of fewer cells is no thing."""
BEST_SHARE = 0.3
"""The score of a thing is the mean over this share of its cells, those with the highest values."""
LOWEST_MARGIN = -0.2
"""A phrase fits a thing if the best alternative scores at most this much higher. It was chosen on data/foreign-scenes
and on validation scenes of our simulator."""
LOWEST_SCORE = 0.4
"""A thing with a lower score does not fit: on a thing that no word fits, all margins are near 0."""
OTHER_COLORS = (*colors.RGB, "black")
OTHER_NOUNS = (
    "block", "bowl", "mug", "plate", "ball", "cylinder", "ring", "star", "box", "bottle", "banana", "apple", "hammer",
    "spoon", "scissors", "cup", "pan", "shoe", "cone", "car", "book", "screwdriver", "toy train",
)  # fmt: skip
"""Nouns that a thing on a table may have. Give others for a table with other things."""


@dataclass(frozen=True)
class Fit:
    """How well a phrase fits the thing that it fits best.

    Attributes:
        phrase: what was looked for.
        x, y: the middle of the thing (m).
        score: the phrase's value on the thing, about 1 on a match.
        margin: the phrase's score minus that of the best alternative; above 0 if the phrase fits best of all.
        alternative: the alternative that fits the same thing best.
    """

    phrase: str
    x: float
    y: float
    score: float
    margin: float
    alternative: str


def alternatives(phrase: str, nouns: Sequence[str] = OTHER_NOUNS) -> list[str]:
    """What else a thing could be: the same noun with other colours, the same colour with other ``nouns``.

    A phrase without a known colour gets the nouns alone.
    """
    words = phrase.split()
    color = next((word for word in words if word in OTHER_COLORS), None)
    noun = " ".join(word for word in words if word != color)
    if color is None:
        return [other for other in nouns if other != noun]
    others = [f"{other} {noun}".strip() for other in OTHER_COLORS if other != color]
    return others + [f"{color} {other}" for other in nouns if other != noun]


def things(scene: SceneEmbedding) -> list[np.ndarray]:
    """The things on a table: for each connected region that rises above it, an (H, W) bool mask.

    The table is most of the map, so its level is the median height, and its noise follows from the median deviation.
    """
    height = scene.heightmap.height
    level = np.median(height)
    noise = 1.4826 * np.median(np.abs(height - level))  # the standard deviation, if the noise is normal
    regions, count = ndimage.label(height > level + max(RISES, NOISE * noise))
    masks = [regions == number for number in range(1, count + 1)]
    return [mask for mask in masks if mask.sum() >= FEWEST_CELLS]


def fit(
    scene: SceneEmbedding, phrase: str, source: MapSource, nouns: Sequence[str] = OTHER_NOUNS
) -> Fit | None:  # fmt: skip
    """The thing that a phrase fits best, and how well. None if nothing rises above the table."""
    masks = things(scene)
    if not masks:
        return None
    others = alternatives(phrase, nouns)
    wanted = _scores(source.map(scene, phrase), masks)  # (things,)
    rivals = np.stack([_scores(source.map(scene, other), masks) for other in others])  # (alternatives, things)
    margins = wanted - rivals.max(axis=0)
    enough = wanted >= LOWEST_SCORE
    best = int(np.where(enough, margins, -np.inf).argmax()) if enough.any() else int(wanted.argmax())
    rows, cols = np.nonzero(masks[best])
    x, y = scene.heightmap.workspace.to_world(float(rows.mean()), float(cols.mean()))
    return Fit(phrase, x, y, float(wanted[best]), float(margins[best]), others[int(rivals[:, best].argmax())])


def _scores(semantic: np.ndarray, masks: Sequence[np.ndarray]) -> np.ndarray:
    """The score of each thing on a map."""
    scores = []
    for mask in masks:
        values = np.sort(semantic[mask])
        scores.append(values[-max(1, round(BEST_SHARE * len(values))) :].mean())
    return np.array(scores)


def refusal(
    scene: SceneEmbedding, queries: Sequence[Query], source: MapSource, nouns: Sequence[str] = OTHER_NOUNS,
    lowest_margin: float = LOWEST_MARGIN,
) -> str | None:  # fmt: skip
    """Why an instruction cannot be followed: the first of its queries that fits nothing on the table, in one sentence.

    None if all of them fit something. Of "X and Y", each must fit. A picture is never refused, since it has no
    alternatives.

    Args:
        lowest_margin: a higher one refuses more, see `LOWEST_MARGIN`.
    """
    for query in queries:
        if not isinstance(query, str):
            continue
        for member in language.conjuncts(query):
            word = locations.location_word(member)
            phrase = member if word is None else member.removeprefix("the ").removeprefix(word).strip()
            found = fit(scene, phrase, source, nouns)
            if found is None:
                return f'there is no "{phrase}": nothing rises above the table'
            if found.score < LOWEST_SCORE:
                return f'there is no "{phrase}": nothing on the table looks like it'
            if found.margin < lowest_margin:
                return (
                    f'there is no "{phrase}": the nearest thing, at ({found.x:.2f}, {found.y:.2f}) m, looks more like '
                    f'"{found.alternative}"'
                )
    return None
