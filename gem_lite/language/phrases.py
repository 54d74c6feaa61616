"""Phrases: the words of a thing, where it lies, and what "and" joins.

A location word stands in front of a thing: "left red block". Other wordings mean the same: "leftmost red block", "red
block on the left". In a name ("left shoe", "top hat") the same word says nothing about where the thing lies.

Such a word acts on the whole map (`maps.query_maps.located`). Others belong to a thing: "front left tip to back left
corner" of a square. The embedded CLIP hardly tells these apart. So networks get the words, too (`location_code`).

A relation stands in front of one thing or two, its anchors: "left of green bowl", "between mug and box". It names a
place on the table and no thing (`maps.relations`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import torch

from gem_lite.language import word_lists
from gem_lite.language.word_lists import (
    ADJECTIVES,
    BETWEEN,
    COLORS,
    DETERMINERS,
    LEADING,
    RELATIONS,
    RESERVED,
    SHADES,
    SIDES,
    VERBS,
)

TOKEN = re.compile(r"[^\W_]+(?:['’\u02bc&-][^\W_]+)*|\S")
_CONTRACTION = re.compile(r".+(n't|'re|'ve|'ll|'d|'m)")
_COUNTED = re.compile(r"[0-9]+(mm|cm|m|km|in|ft|deg|s|sec|min|h|x|st|nd|rd|th)")
_BEHIND_A_NOUN = ("of", "with", "on", "in")
CODED = ("left", "right", "top", "bottom", "front", "back", "middle", "tip", "corner")
"""The words that `location_code` counts."""
LOCATION_CODE_LENGTH = 2 * len(CODED)


def split_location(phrase: str) -> tuple[str | None, str]:
    """The location word that a phrase means, and the thing without it, in small letters.

    "the left star hole", "leftmost star hole" and "star hole on the left" give ("left", "star hole"). A phrase without
    a location word gives (None, phrase), and so do names: "middle of the stand", "left shoe", "top hat".
    """
    words = without_determiner(phrase.lower().split())
    for wording, word in word_lists.LOCATIONS.items():
        if " ".join(words).endswith(f" {wording}"):
            return word, " ".join(words).removesuffix(f" {wording}")
    if len(words) < 2 or words[0] not in LEADING or words[1] == "of" or names_by_side(words):
        return None, phrase
    return LEADING[words[0]], " ".join(words[1:])


def with_location(word: str, thing: str) -> str:
    """The phrase for a thing with a location word: "left block", or "leftmost shoe", since "left shoe" is a name."""
    phrase = f"{word} {thing}"
    return phrase if split_location(phrase) == (word, thing) else f"{word}most {thing}"


def location_in_front(phrase: str) -> str:
    """A phrase with its location word in front, however it was said: "left star hole" of "star hole on the left".

    CLIP gets this wording, since it is the one of the demonstrations. It may be a name by itself ("left shoe").
    """
    word, thing = split_location(phrase)
    return phrase if word is None else f"{word} {thing}"


def location_code(phrase: str) -> torch.Tensor:
    """The location words of a phrase as a vector (`LOCATION_CODE_LENGTH`,): how often each of `CODED` is there.

    The first half counts the words of "A" in "A to B", the second half those of "B"; a phrase without "to" is an "A".
    If both have such words, they are the ends of a line, and "B to A" has the same code: the end with more of the
    first words of `CODED` is "A". Words of names are not counted ("left shoe", "top hat"), and "leftmost" counts as
    "left". The vector has unit length, as CLIP's embeddings have; it is 0 if there is no location word.
    """
    start, _, end = phrase.lower().partition(" to ")
    counts = [_counts(start), _counts(end)]
    if any(counts[0]) and any(counts[1]):
        counts.sort(reverse=True)
    return torch.nn.functional.normalize(torch.tensor(counts, dtype=torch.float32).flatten(), dim=0)


def split_relation(phrase: str) -> tuple[str | None, tuple[str, ...]]:
    """The relation in front of a phrase, and the things after it.

    "left of green bowl" gives ("left of", ("green bowl",)), and "between mug and box" gives ("between", ("mug",
    "box")). A phrase without a relation gives (None, (phrase,)).

    Raises:
        ValueError: there are not two things after "between", or not one after another relation.
    """
    words = " ".join(phrase.lower().split())
    relation = next((name for name in RELATIONS.values() if words.startswith(f"{name} ")), None)
    if relation is None:
        return None, (phrase,)
    anchors = conjuncts(" ".join(without_determiner(words.removeprefix(relation).split())))
    count = anchor_count(relation)
    if len(anchors) != count:
        raise ValueError(f"phrase must name {count} after {relation!r}, things joined by 'and', got {phrase!r}")
    return relation, anchors


def anchor_count(relation: str) -> int:
    """How many things a relation is to."""
    return 2 if relation == BETWEEN else 1


def with_relation(relation: str, anchors: Sequence[str]) -> str:
    """The phrase for a place: the inverse of `split_relation`."""
    return f"{relation} {' and '.join(anchors)}"


def without_relation(phrase: str) -> str:
    """What a phrase names, without a relation in front: "mug and box" of "between mug and box".

    Networks get these words. The map alone says what the relation is, since training turns the pictures.
    """
    return " and ".join(split_relation(phrase)[1])


def _counts(phrase: str) -> list[int]:
    """How often each of `CODED` is in a phrase, apart from names."""
    words = phrase.split()
    read = [LEADING.get(word, word) for i, word in enumerate(words) if not names_by_side(words[i:])]
    return [read.count(word) for word in CODED]


def names_by_side(words: Sequence[str]) -> bool:
    """Whether words begin with a name that has a location word, such as "top hat" or "left shoes with red laces"."""
    if len(words) < 2 or words[0] not in word_lists.NAMES:
        return False
    return words[1] in word_lists.NAMES[words[0]] or words[1].removesuffix("s") in word_lists.NAMES[words[0]]


def stray_location(words: Sequence[str]) -> str | None:
    """The first word that may say where a thing lies and is not read so: "left" in "red left block", "left shoe box".

    As the last word it is a noun ("mug middle"), and before "of" ("middle of the stand").
    """
    for number, word in enumerate(words[:-1]):
        if word not in (*LEADING, "front", "back") or (word in word_lists.BEFORE_OF and words[number + 1] == "of"):
            continue
        behind = words[number + 2] if number + 2 < len(words) else "of"
        if not names_by_side(words[number:]) or behind not in (*_BEHIND_A_NOUN, *word_lists.PARTS, "objects"):
            return word
    return None


def conjuncts(phrase: str) -> tuple[str, ...]:
    """The things that a phrase joins by "and", each in full and without its article.

    "green and blue blocks" gives "green blocks" and "blue blocks"; "red block and the blue mug" gives "red block"
    and "blue mug". Members that are adjectives alone (`ADJECTIVES`) share the noun that follows. A phrase without
    "and" is its own only member, and so is a relation ("between mug and box"). A name such as "salt and
    pepper" counts as two things.

    Colours joined before a plural are several things. They are one thing of several colours before

    * a singular ("red and white flashlight"), but not before "block" (`ONE_COLORED`) or with an article between them;
    * a plural that names one thing ("black and blue sneakers", `PAIRS`);
    * a word for a pattern ("green and white striped towels", `PATTERNS`);
    * the noun after "with" or "of" ("mug with red and blue stripes", "pile of red and blue blocks").

    Raises:
        ValueError: the phrase is empty, or "and" or a comma joins nothing.
    """
    words = TOKEN.findall(phrase.lower())
    if words and ("and" not in words or split_relation(phrase)[0] is not None):
        return (phrase,)
    parts = _members(words)
    if not all(without_determiner(part) for part in parts):
        raise ValueError(f"phrase must name a thing on both sides of 'and', got {phrase!r}")
    things: list[str] = []
    run: list[list[str]] = []  # adjectives that wait for their noun
    for number, part in enumerate(parts):
        if run and _described(run[-1]) and without_determiner(part)[0] in ADJECTIVES:
            run[-1] = [*run[-1], "and", *part]
        else:
            run.append(part)
        if number + 1 < len(parts) and (adjectives_alone(without_determiner(part)) or _described(run[-1])):
            continue
        things += _things(run)
        run = []
    return tuple(things)


def shares_noun(phrase: str) -> bool:
    """Whether a phrase names one thing, or joins adjectives before one noun: "green and blue blocks"."""
    *members, _ = _members(TOKEN.findall(phrase.lower()))
    return len(conjuncts(phrase)) == 1 or all(adjectives_alone(without_determiner(member)) for member in members)


def _members(words: Sequence[str]) -> list[list[str]]:
    """The words between "and" and commas."""
    text = f" {' '.join(words)} ".replace(" , and ", " and ")
    return [part.split() for part in re.split(r" and | , ", text)]


def _described(words: Sequence[str]) -> bool:
    """Whether words end in "with" or "of" and adjectives: the noun comes after "and", as in "mug with red and ..."."""
    starts = [number for number, word in enumerate(words) if word in ("with", "of")]
    behind = without_determiner(words[starts[-1] + 1 :]) if starts else []
    return bool(behind) and bool(without_determiner(words[: starts[-1]])) and adjectives_alone(behind)


def _things(run: Sequence[Sequence[str]]) -> list[str]:
    """The things of members of which only the last may have a noun."""
    *members, last = [without_determiner(member) for member in run]
    noun = list(last)
    while noun and noun[0] in ADJECTIVES:
        noun = noun[1:]
    if not members or noun == last:
        return [" ".join(member) for member in (*members, last)]
    first = next((number for number, word in enumerate(members[0]) if word in COLORS), len(members[0]))
    colored = [members[0][first:], *members[1:]]  # "small red and white ball"
    colors_alone = last[0] in COLORS and all(member and set(member) <= COLORS for member in colored)
    articles = any(member[0] in DETERMINERS for member in run[1:])
    if colors_alone and not articles and _is_one(noun, last):
        return [", ".join(" ".join(member) for member in members) + f" and {' '.join(last)}"]
    shaded = last[1:] if last[0] in SHADES else noun  # "light and dark brown blocks"
    return [" ".join(member + (shaded if set(member) <= SHADES else noun)) for member in members] + [" ".join(last)]


def _is_one(noun: Sequence[str], last: Sequence[str]) -> bool:
    """Whether colours before a noun are one thing's: see `conjuncts`."""
    head = list(noun)
    for word in _BEHIND_A_NOUN:
        head = head[: head.index(word)] if word in head else head
    if len(head) > 1 and head[-1] == "objects":  # "black and blue sneakers objects"
        head = head[:-1]
    if not head or any(word in word_lists.PATTERNS for word in last):
        return bool(head)
    plural = head[-1] in word_lists.PLURALS or (head[-1].endswith("s") and not head[-1].endswith(("ss", "us", "is")))
    return head[-1] in word_lists.PAIRS or not (plural or head[-1] in word_lists.ONE_COLORED)


def plain_apostrophes(text: str) -> str:
    """A text with the keyboard's apostrophe in the place of printed ones."""
    return re.sub("[’\u02bc]", "'", text)


def plural(phrase: str) -> str:
    """As "brushes" of "brush"; "scissors" stays."""
    if phrase.endswith("s"):
        return phrase
    return phrase + ("es" if phrase.endswith(("x", "sh", "ch")) else "s")


def is_reserved(word: str) -> bool:
    """Whether a word is never part of a phrase, whatever stands around it."""
    plain = plain_apostrophes(word)
    stem, _, ending = plain.rpartition("'")
    parts = word.split("-")
    return (
        not word[0].isalnum()
        or word in RESERVED
        or bool(_COUNTED.fullmatch(word))  # "10cm", "2nd"
        or bool(_CONTRACTION.fullmatch(plain))  # "don't"
        or (ending == "s" and stem in RESERVED)  # "that's"; but "bull's eye"
        or (len(parts) > 1 and _is_joined_reserved(parts))
        or (word.endswith("ly") and word not in word_lists.NAMES_IN_LY)
    )


def _is_joined_reserved(parts: Sequence[str]) -> bool:
    """The same of words joined by hyphens: "non-red", "top-left", "upside-down"; but "left-most", "pick-up"."""
    if "-".join(parts) in LEADING:
        return False
    negated = parts[0] in ("non", "not") and parts[-1] in ADJECTIVES
    two_sides = parts[-1] in ("left", "right") or all(part in SIDES for part in parts)
    return negated or two_sides or (all(part in RESERVED for part in parts) and parts[0] not in VERBS)


def without_determiner(words: Sequence[str]) -> list[str]:
    """The words of a thing without determiners and "of" at the beginning."""
    start = 0
    while start < len(words) and (words[start] in DETERMINERS or (start and words[start] == "of")):
        start += 1
    return list(words[start:])


def adjectives_alone(words: Sequence[str]) -> bool:
    """Whether words name no thing."""
    return all(word in ADJECTIVES for word in words)
