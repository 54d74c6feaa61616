"""Which span of a sentence is picked, and which is the place: a table of probabilities.

A reading is two spans, or no request at all. It has features: what stands around its spans (`spans`), and how likely a
language model finds them as answers after a few examples. The probability of a reading is the softmax of its features'
weighted sums over all readings of the sentence (a log-linear model). The weights are fitted on sentences of other
people: ``python -m experiments.other_words fit``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np

from gem_lite.foundations.files import DATA
from gem_lite.language.models import Scorer
from gem_lite.language.spans import (
    ARTICLES,
    PLACING,
    PREPOSITIONS,
    RELATIVES,
    Sentence,
    Span,
    spans,
)

WEIGHTS = DATA / "other_words" / "weights.json"
EXAMPLES = """What should the robot take, and where should it put it?

Request: Put the red mug in the sink.
Thing: red mug
Place: sink

Request: I would like the stapler on the upper shelf.
Thing: stapler
Place: upper shelf

Request: Into the drawer with the spoon that lies there!
Thing: spoon that lies there
Place: drawer

Request: Good evening, how are you?
Thing: nothing
Place: nothing

Request: The wrench is in the way, so take it and hang it on the hook of the door.
Thing: wrench
Place: hook of the door

Request: Grab the teapot by its handle and leave it beside the bread box, please.
Thing: teapot
Place: bread box

Request: Is the pan on the stove?
Thing: nothing
Place: nothing

Request: {sentence}
Thing:"""
"""The prompt. The model computes it once; only the sentence is new."""
NOTHING = "nothing"
LEAST = -12.0
"""Log-probabilities below this count as this."""
UNIT = 3.0
"""A feature of a log-probability is this part of it, so that all features have a similar size."""

COURTESIES = re.compile(
    r"if (you (don't|do not) mind|you (could|can|would|please|have|get)|possible|i may|it's no \w+|it is no \w+)|"
    r"(would be|'d be|'d|would) (\w+ )?(appreciate it|grateful|happy|glad|great|nice|lovely|cool|good|kind|super) if|"
    r"when(ever)? (you|it) \w+|once you \w+|no (rush|hurry|problem|worries)|any chance|(would|do) you mind"
)
"""What is polite, and neither a condition nor a negation."""
NEGATIONS = frozenset(
    ("not", "never", "no", "cannot", "without", "nowhere", "nor", "neither", "nobody", "none", "avoid", "stop",
     "refrain", "dont", "cant", "wont", "shouldnt", "mustnt", "forbidden", "unless")
)  # fmt: skip
CHOICES = frozenset(("or", "either", "whichever", "whether"))
EXCHANGES = frozenset(("swap", "exchange", "switch", "trade", "substitute", "replace"))
AMOUNTS = frozenset(
    ("all", "every", "each", "everything", "everyone", "both", "half", "several", "few", "many", "two", "three", "four",
     "five", "six", "seven", "eight", "nine", "ten", "dozen", "couple", "rest", "whatever")
)  # fmt: skip
"""Words for more than one thing, or for a part of them: one pick cannot do it, but a plan can (`planning`)."""
MORE = frozenset(("any", "lot", "whole", "most", "more", "other", "another", "anything", "only", "enough"))
"""Words that often say an amount, and sometimes do not."""
QUESTION_WORDS = frozenset(
    ("what", "which", "who", "whose", "where", "how", "why", "when", "is", "are", "was", "were", "did", "does", "has",
     "have", "do", "am")
)  # fmt: skip
PAST = frozenset(("yesterday", "ago"))
REFERRING = frozenset(("it", "them", "that"))


@dataclass(frozen=True)
class Reading:
    """What a sentence may ask for: the span of the thing to pick and the span of the place."""

    thing: Span
    place: Span


@dataclass(frozen=True)
class Scores:
    """How likely a language model finds spans as answers: log-probabilities (N + 1,), the last of `NOTHING`.

    Those of ``place`` are after the likeliest thing.
    """

    thing: np.ndarray
    place: np.ndarray


def reason_to_ask(sentence: Sentence) -> str:
    """Why a sentence is asked about before any model reads it; "" if there is no reason.

    Negations, choices, conditions, exchanges, amounts, questions and the past are told by closed classes of words.
    """
    plain = COURTESIES.sub(" ", " ".join(sentence.words))
    words = plain.split()
    if "anywhere but" in plain or re.search(r"\bkeep .* (away|off|out)\b", plain):
        return "says where something must not be"
    for word in words:
        if word in NEGATIONS or word.endswith("n't"):
            return f"says {word!r}"
        if word in CHOICES:
            return f"says {word!r}: a choice"
        if word in EXCHANGES:
            return f"says {word!r}: two goals"
        if word in AMOUNTS:
            return f"says {word!r}: more than one pick"
        if word in PAST:
            return f"says {word!r}: it is over"
    if "if" in words:
        return "has a condition"
    if words and words[0] in QUESTION_WORDS and "?" in words and words.index("?") == len(words) - 1:
        return "is a question"
    return ""


def score_spans(model: Scorer, sentence: Sentence, found: Sequence[Span]) -> Scores:
    """Let a language model score spans as answers."""
    prompt = EXAMPLES.format(sentence=sentence.text)
    answers = [f" {sentence.said(span).lower()}" for span in found] + [f" {NOTHING}"]
    lines = [f"{answer}\n" for answer in answers]
    thing = _normalised(model.scores(prompt, lines))
    likeliest_thing = answers[int(thing[:-1].argmax())]
    place = _normalised(model.scores(f"{prompt}{likeliest_thing}\nPlace:", lines))
    return Scores(thing, place)


def _normalised(logs: np.ndarray) -> np.ndarray:
    """Log-probabilities that sum to 1 over the given answers."""
    return logs - np.logaddexp.reduce(logs)


def all_readings(found: Sequence[Span]) -> list[Reading | None]:
    """All readings of spans that do not overlap, and None: no request."""
    pairs = [(thing, place) for thing, place in permutations(found, 2) if thing[1] <= place[0] or place[1] <= thing[0]]
    return [None, *(Reading(thing, place) for thing, place in pairs)]


def features(sentence: Sentence, found: Sequence[Span], reading: Reading | None, scores: Scores) -> dict[str, float]:
    """The features of a reading by their names; those that are missing are 0."""
    if reading is None:
        return {f"no request: {name}": value for name, value in _of_no_request(sentence).items()}
    order = {span: number for number, span in enumerate(found)}
    thing, place = reading.thing, reading.place
    values = {f"thing: {name}": value for name, value in _of_span(sentence, thing).items()}
    values |= {f"place: {name}": value for name, value in _of_span(sentence, place).items()}
    values |= _of_pair(sentence, reading)
    values["thing: model"] = max(scores.thing[order[thing]], LEAST) / UNIT
    values["place: model"] = max(scores.place[order[place]], LEAST) / UNIT
    return values


def _of_span(sentence: Sentence, span: Span) -> dict[str, float]:
    """What stands before, in and behind a span."""
    start, end = span
    inner = sentence.words[start:end]
    before = start - 1
    while sentence.word(before) in ARTICLES:
        before -= 1
    word = sentence.word(before)
    outer = sentence.word(before - 1)
    behind = sentence.word(end)
    ends_a_preposition = outer in ("inside", "top", "front", "side", "left", "right")  # "on top of"
    return {
        "after a determiner": before < start - 1,
        "after a placing word": word in PLACING and (word != "of" or ends_a_preposition),
        "after of": word == "of",
        "after an open word": sentence.is_open(before),
        "after a sign": sentence.is_sign(before),
        "among the first two words": start < 2,
        "length": min(end - start, 6) / UNIT,
        "has a clause": any(inside in RELATIVES for inside in inner),
        "has a placing word": any(inside in PLACING and inside != "of" for inside in inner),
        "has and": "and" in inner,
        "has with": "with" in inner,
        "before a placing word": behind in PLACING and behind != "of",
        "before a clause": behind in RELATIVES,
        "before a determiner": behind in ARTICLES,
        "before an open word": sentence.is_open(end),
    }


def _of_pair(sentence: Sentence, reading: Reading) -> dict[str, float]:
    """What lies between two spans and around them."""
    first, last = sorted((reading.thing, reading.place))
    between = sentence.words[first[1] : last[0]]
    left_out = [place for place in _determined(sentence) if not _inside(place, first) and not _inside(place, last)]
    explained = PREPOSITIONS - PLACING
    others = [place for place in left_out if sentence.word(place - 1) not in explained]
    return {
        "place first, before a determiner": first == reading.place and sentence.word(first[1]) in ARTICLES,
        "and between": "and" in between,
        "it between": any(word in REFERRING or word == "this" for word in between),
        "things between": sum(first[1] <= place < last[0] for place in others),
        "things behind": sum(place >= last[1] for place in others),
        "open words behind": sum(map(sentence.is_open, range(last[1], len(sentence.words)))) / 2,
        "open words before": sum(map(sentence.is_open, range(first[0]))) / 2,
    }


def _determined(sentence: Sentence) -> list[int]:
    """Where a determiner stands before an open word."""
    indices = range(len(sentence.words))
    return [index for index in indices if sentence.word(index) in ARTICLES and sentence.is_open(index + 1)]


def _inside(index: int, span: Span) -> bool:
    """Whether a determiner belongs to a span: it stands in it or directly before it."""
    return span[0] - 1 <= index < span[1]


def _of_no_request(sentence: Sentence) -> dict[str, float]:
    """What tells that nothing, or too much, is asked for."""
    words = set(sentence.words)
    starts_as_question = sentence.words[0] in QUESTION_WORDS
    return {
        "always": 1.0,
        "perhaps an amount": bool(words & MORE),
        "begins as a question": starts_as_question,
        "more than two things": max(0, len(_determined(sentence)) - 2),
        "no placing word": not words & (PLACING - {"of", "to"}),
        "no to": "to" not in words,
        "it": bool(words & REFERRING),
        "and": "and" in words,
        "foreign letters": any(ord(letter) > 127 and letter.isalpha() for letter in sentence.text),
    }


@lru_cache(maxsize=1)
def fitted_weights() -> Mapping[str, float]:
    """The weights that the library ships."""
    return json.loads(WEIGHTS.read_text())["weights"]


def probabilities(rows: Sequence[Mapping[str, float]], weights: Mapping[str, float]) -> np.ndarray:
    """The probability of each reading, from its features."""
    sums = np.array([sum(weights.get(name, 0.0) * value for name, value in row.items()) for row in rows])
    exponentials = np.exp(sums - sums.max())
    return exponentials / exponentials.sum()


def likeliest(model: Scorer, sentence: Sentence) -> tuple[Reading | None, float]:
    """The likeliest reading of a sentence, None for no request, and its probability by `fitted_weights`."""
    found = spans(sentence)
    if len(found) < 2:
        return None, 1.0
    scores = score_spans(model, sentence, found)
    options = all_readings(found)
    rows = [features(sentence, found, option, scores) for option in options]
    chances = probabilities(rows, fitted_weights())
    best = int(chances.argmax())
    return options[best], float(chances[best])
