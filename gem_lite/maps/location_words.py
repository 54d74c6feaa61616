"""Location words, which are ours: "left star hole" is the leftmost of the places that look like a star hole.

A patch does not show where on the table it lies, so CLIP gives all star holes the same score; and training turns the
pictures, so a network cannot learn what "left" is. Here the word acts on the semantic map of the unturned table: it
chooses one of the map's strongest responses and lowers the others. Training then turns the map with the picture.

Other location words belong to a thing, not to the table: "front left tip to back left corner" of a square. The
embedded CLIP gives such phrases nearly the same embedding. So the networks of every method get the words themselves,
too: `code`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy import ndimage

from gem_lite.language import phrases
from gem_lite.language.word_lists import LEADING
from gem_lite.se2 import Workspace

WITHIN = 0.1
"""A response is a local maximum of a map that is at most this far below the highest value."""
SPACING = 0.03
"""Two responses are at least this far (m) apart."""
LOWERED = 0.3
"""Afterwards, the other responses are at least this far below the chosen one."""

WORDS = ("left", "right", "top", "bottom", "front", "back", "middle", "tip", "corner")
"""The words that `code` counts."""
CODE_LENGTH = 2 * len(WORDS)

_Keys = Callable[[np.ndarray, np.ndarray], np.ndarray]
_SMALLEST: dict[str, _Keys] = {
    "left": lambda x, y: x,
    "right": lambda x, y: -x,
    "top": lambda x, y: -y,
    "bottom": lambda x, y: y,
    "middle": lambda x, y: np.hypot(x - x.mean(), y - y.mean()),
}
"""For each word, what is smallest at the response that the word means; x and y in the world."""


def location_word(phrase: str) -> str | None:
    """The location word of a phrase, if there is one: "left" of "left star hole" and of "star hole on the left".

    "middle of the stand", "left shoe" and "top hat" have none: they name things.
    """
    return phrases.split_location(phrase)[0]


def without_location(phrase: str) -> str:
    """A phrase without its location word: "star hole" of "left star hole"."""
    return phrases.split_location(phrase)[1]


def canonical(phrase: str) -> str:
    """A phrase with its location word in front, however it was said: "left star hole" of "star hole on the left".

    CLIP gets this wording, since it is the one of the demonstrations. It may be a name by itself ("left shoe").
    """
    word, thing = phrases.split_location(phrase)
    return phrase if word is None else f"{word} {thing}"


def code(phrase: str) -> torch.Tensor:
    """The location words of a phrase as a vector (`CODE_LENGTH`,): how often each of `WORDS` is there.

    The first half counts the words of "A" in "A to B", the second half those of "B"; a phrase without "to" is an "A".
    If both have such words, they are the ends of a line, and "B to A" has the same code: the end with more of the
    first words of `WORDS` is "A". Words of names are not counted ("left shoe", "top hat"), and "leftmost" counts as
    "left". The vector has unit length, as CLIP's embeddings have; it is 0 if there is no location word.
    """
    start, _, end = phrase.lower().partition(" to ")
    counts = [_counts(start), _counts(end)]
    if any(counts[0]) and any(counts[1]):
        counts.sort(reverse=True)
    return torch.nn.functional.normalize(torch.tensor(counts, dtype=torch.float32).flatten(), dim=0)


def _counts(phrase: str) -> list[int]:
    """How often each of `WORDS` is in a phrase, apart from names."""
    words = phrase.split()
    read = [LEADING.get(word, word) for i, word in enumerate(words) if not phrases.names_by_side(words[i:])]
    return [read.count(word) for word in WORDS]


def responses(semantic: np.ndarray, workspace: Workspace) -> tuple[np.ndarray, int]:
    """A map's strongest responses: its local maxima at most `WITHIN` below the highest value.

    Maxima nearer than `SPACING` to each other, such as the cells of a flat peak, are one response. A map that hardly
    rises above its median, which is the bare table's value, has no response.

    Args:
        semantic: (H, W).

    Returns:
        (H, W) int, the number of the response to which each maximum belongs, from 1 on, and 0 elsewhere; and how many
        there are.
    """
    if semantic.max() - np.median(semantic) <= WITHIN:
        return np.zeros(semantic.shape, int), 0
    reach = round(SPACING / workspace.pixel)
    highest_around = ndimage.maximum_filter(semantic, size=2 * reach + 1, mode="nearest")
    maxima = (semantic == highest_around) & (semantic >= semantic.max() - WITHIN)
    # Two cells are in one region if each lies within half the reach of the region's cells.
    regions, count = ndimage.label(ndimage.binary_dilation(maxima, np.ones((reach, reach))), np.ones((3, 3)))
    return np.where(maxima, regions, 0), count


def located(semantic: np.ndarray, word: str, workspace: Workspace) -> np.ndarray:
    """A map with all responses lowered but the one that a location word means.

    Args:
        semantic: (H, W) float32.
        word: "left" (smaller x), "right", "top" (larger y), "bottom" or "middle" (nearest to all responses' mean).

    Returns:
        (H, W) float32. Cells nearer to another response are cut off at the chosen one minus `LOWERED`. A map without
        responses stays as it is.

    Raises:
        ValueError: an unknown word.
    """
    if word not in _SMALLEST:
        raise ValueError(f"word must be one of {', '.join(_SMALLEST)}, got {word!r}")
    regions, count = responses(semantic, workspace)
    if count < 2:
        return semantic
    numbers = np.arange(1, count + 1)
    middles = np.array(ndimage.center_of_mass(regions > 0, regions, numbers))  # (N, 2) cells
    x, y = workspace.to_world(middles[:, 0], middles[:, 1])
    chosen = numbers[int(np.argmin(_SMALLEST[word](x, y)))]
    # For every cell the nearest maximum of any response.
    rows, cols = ndimage.distance_transform_edt(regions == 0, return_distances=False, return_indices=True)
    of_another = regions[rows, cols] != chosen
    ceiling = np.float32(semantic[regions == chosen].max() - LOWERED)
    return np.where(of_another, np.minimum(semantic, ceiling), semantic)
