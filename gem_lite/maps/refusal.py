"""Is the named thing on the table at all? A policy always chooses something; this says when nothing fits the words.

The value of a map alone does not tell: on another table with another lamp, what is there may score lower than what is
not there on ours. So phrases are compared with each other, on one thing at a time. Every thing on the table is scored
by the named phrase and by `alternatives` to it: the same noun with other colours, and the same colour with other
nouns. The phrase fits a thing if it scores at least `LOWEST_SCORE` and no alternative fits much better.

This part is ours; the paper has no refusal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gem_lite import language
from gem_lite.clip import Clip
from gem_lite.foundations import colors
from gem_lite.language import Query, word_lists
from gem_lite.maps import relations
from gem_lite.maps.query_maps import relation_map
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource
from gem_lite.maps.things import middle, things
from gem_lite.se2 import Workspace

REACH = 0.0625
"""Of a flat thing, the cells within this distance (m) of the phrase's best cell count: a board has many holes."""
BEST_SHARE = 0.3
"""The score of a thing is the mean over this share of its cells, those with the highest values."""
LOWEST_MARGIN = -0.2
"""A phrase fits a thing if the best alternative scores at most this much higher. It was chosen on data/foreign-scenes
and on validation scenes of our simulator."""
LOWEST_COLOR_MARGIN = -0.05
"""The same for a phrase without a noun, such as "something red". Colours alone differ more clearly, but less from the
bare table, so that a score has no lowest value. It was chosen on data/foreign-scenes."""
LOWEST_SCORE = 0.4
"""A thing with a lower score does not fit: on a thing that no word fits, all margins are near 0."""
OTHER_COLORS = (*colors.RGB, "black")
SHADES = word_lists.SHADES | {"middle", "jet", "lime"}
"""Words that belong to the colour after them."""
COLOR_WORDS = word_lists.COLORS - word_lists.SHADES - {"jet"}
"""Words for colours in a phrase."""
VAGUE = frozenset(("thing", "things", "object", "objects", "something", "anything", "one", "ones", "item", "items"))
"""Words that name no thing. "something red" is whatever is red."""
OTHER_NOUNS = (
    "block", "bowl", "mug", "plate", "ball", "cylinder", "ring", "star", "box", "bottle", "banana", "apple", "hammer",
    "spoon", "scissors", "cup", "pan", "shoe", "cone", "car", "book", "screwdriver", "toy train",
)  # fmt: skip
"""Nouns that a thing on a table may have. Give others for a table with other things."""

_STARTS = ("a", "the", "a photo of a", "a picture of the")
"""Words before a phrase that leave its meaning as it is."""


@dataclass(frozen=True)
class PhraseFit:
    """How well a phrase fits the thing that it fits best.

    Attributes:
        phrase: what was looked for.
        x, y: the middle of the thing (m).
        score: the phrase's value on the thing, about 1 on a match.
        margin: the phrase's score minus that of the best alternative; above 0 if the phrase fits best of all, infinite
            if there is no alternative.
        alternative: the alternative that fits the same thing best; empty if there is none.
    """

    phrase: str
    x: float
    y: float
    score: float
    margin: float
    alternative: str


def alternatives(phrase: str, nouns: Sequence[str] = OTHER_NOUNS, clip: Clip | None = None) -> list[str]:
    """What else a thing could be: the same noun with other colours, the same colour with other ``nouns``.

    A phrase without a known colour gets the nouns alone, one without a noun, such as "something red", the colours. What
    is less exact than the phrase is no alternative: "brown block" to "lightest brown block".

    Args:
        clip: if it does not know the phrase's noun (`knows`), nothing is said about nouns, and colours alone remain.
    """
    words = phrase.split()
    color = _color(words)
    others = []
    if color:
        start = words.index(color[0])
        rest = words[start + len(color) :]
        others = [" ".join([*words[:start], other, *rest]) for other in OTHER_COLORS if other not in color]
    if not is_vague(phrase) and (clip is None or knows(clip, phrase)):
        others += [" ".join([*color, other]) for other in nouns]
    return [other for other in others if not set(other.split()) <= set(words)]


def is_vague(phrase: str) -> bool:
    """Whether a phrase names no thing, but a colour at most: "something red", "red object"."""
    words = phrase.split()
    color = _color(words)
    return all(word in VAGUE or word in color for word in words)


def knows(clip: Clip, phrase: str) -> bool:
    """Whether a CLIP has read a phrase's words. If so, they mean the same with an article and in the plural.

    The embedding of a word that it never read changes at random, so that its scores cannot be compared with others.
    Two phrases mean the same if their cosine is at least the CLIP's retrieval threshold.
    """
    try:
        own, *others = clip.embed_texts([phrase, language.plural(phrase), *(f"{start} {phrase}" for start in _STARTS)])
    except ValueError:  # One of these wordings is longer than what the CLIP reads.
        return False
    return all(float(own @ other) >= clip.calibration.retrieval_threshold for other in others)


def _color(words: Sequence[str]) -> list[str]:
    """The words of a phrase that name its first colour, such as "lightest brown"; empty if there is none."""
    for index, word in enumerate(words):
        if word in COLOR_WORDS:
            return list(words[index - 1 : index + 1]) if index and words[index - 1] in SHADES else [word]
    return []


def fit(
    scene: SceneEmbedding, phrase: str, source: MapSource, nouns: Sequence[str] = OTHER_NOUNS
) -> PhraseFit | None:  # fmt: skip
    """The thing that a phrase fits best, and how well. None if there is no thing on the table."""
    rising, flat = things(scene.heightmap)
    if not rising and not flat:
        return None
    others = alternatives(phrase, nouns, source.clip)
    source.clip.embed_texts([phrase, *others])  # All at once is faster than one by one, and the CLIP keeps them.
    semantic = source.map(scene, phrase)
    masks = rising + [_near_best(mask, semantic, scene.heightmap.workspace) for mask in flat]
    wanted = thing_scores(semantic, masks)  # (things,)
    rivals = np.array([thing_scores(source.map(scene, other), masks) for other in others])  # (alternatives, things)
    margins = wanted - rivals.max(axis=0, initial=-np.inf)
    enough = (wanted >= LOWEST_SCORE) | is_vague(phrase)
    best = int(np.where(enough, margins, -np.inf).argmax()) if enough.any() else int(wanted.argmax())
    x, y = middle(masks[best], scene.heightmap.workspace)
    alternative = others[int(rivals[:, best].argmax())] if others else ""
    return PhraseFit(phrase, x, y, float(wanted[best]), float(margins[best]), alternative)


def _near_best(mask: np.ndarray, semantic: np.ndarray, workspace: Workspace) -> np.ndarray:
    """The cells of a mask (H, W) within `REACH` of the one at which a map is highest."""
    row, col = np.unravel_index(np.where(mask, semantic, -np.inf).argmax(), mask.shape)
    rows, cols = np.indices(mask.shape)
    return mask & (np.hypot(rows - row, cols - col) * workspace.pixel <= REACH)


def thing_scores(semantic: np.ndarray, masks: Sequence[np.ndarray]) -> np.ndarray:
    """The score of each thing, a mask (H, W) of `things`, on a map (H, W): the mean over `BEST_SHARE` of its cells."""
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

    None if all of them fit something. Of "X and Y", each must fit; of "red and blue blocks", which is one group, at
    least one. Of a place beside things, such as "left of green bowl", each of these must fit, and a place must be free.
    A picture is never refused, since it has no alternatives.

    Args:
        lowest_margin: a higher one refuses more, see `LOWEST_MARGIN`.
    """
    for query in queries:
        if not isinstance(query, str):
            continue
        relation, anchors = language.split_relation(query)
        members = language.conjuncts(query) if relation is None else anchors
        phrases = [language.split_location(member)[1] for member in members]
        reasons = [reason(phrase, fit(scene, phrase, source, nouns), lowest_margin) for phrase in phrases]
        missing = [said for said in reasons if said is not None]
        if missing and (len(missing) == len(members) or relation or not _one_group(members)):
            return missing[0]
        if relation is not None and not relation_map(scene, query, source).any():
            return relations.no_free_place(query)
    return None


def _one_group(members: Sequence[str]) -> bool:
    """Whether the members of "X and Y" are one group of things with several colours, as in "green and cyan blocks"."""
    nouns = {member.split()[-1] for member in members}
    return len(nouns) == 1 and nouns.pop().endswith("s") and all(_color(member.split()) for member in members)


def reason(phrase: str, found: PhraseFit | None, lowest_margin: float = LOWEST_MARGIN) -> str | None:
    """Why the thing that fits a phrase best is not what it names, in one sentence; None if it is."""
    if found is None:
        return f'there is no "{phrase}": nothing lies on the table'
    if is_vague(phrase):
        lowest_margin = max(lowest_margin, LOWEST_COLOR_MARGIN)
    elif found.score < LOWEST_SCORE:
        return f'there is no "{phrase}": nothing on the table looks like it'
    if found.margin >= lowest_margin:
        return None
    where = f"({found.x:.2f}, {found.y:.2f}) m"
    return f'there is no "{phrase}": the nearest thing, at {where}, looks more like "{found.alternative}"'
