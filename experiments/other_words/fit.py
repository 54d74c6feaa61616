"""The weights of readings, fitted on the sentences for development."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from tqdm import tqdm

from experiments.other_words.sentences import AnnotatedSentence, same
from gem_lite.foundations.files import write_atomically
from gem_lite.language import Queries, parse
from gem_lite.language.models import Scorer
from gem_lite.language.reader import place_phrase, readable
from gem_lite.language.readings import (
    Reading,
    Scores,
    all_readings,
    features,
    probabilities,
    reason_to_ask,
    score_spans,
)
from gem_lite.language.spans import Sentence, spans

PENALTY = 0.003
"""Of the squared weights, against a fit to single sentences."""
FOLDS = 10


@dataclass(frozen=True)
class Table:
    """The readings of a sentence.

    Attributes:
        rows: the features of each reading.
        right: the indices of the readings that a person has; empty if no spans are right.
    """

    item: AnnotatedSentence
    rows: list[dict[str, float]]
    right: list[int]


def tables(items: Sequence[AnnotatedSentence], model: Scorer, kept: Path) -> list[Table]:
    """The readings of the sentences that reach the model: the grammar refuses them, and nothing else decides.

    Args:
        kept: a file for the model's scores, so that a second run need not compute them.
    """
    known = json.loads(kept.read_text()) if kept.exists() else {}
    found = []
    for item in tqdm(items, unit="sentence"):
        sentence = Sentence.read(item.sentence)
        candidates = spans(sentence)
        if reason_to_ask(sentence) or reads_alone(item.sentence) or len(candidates) < 2:
            continue
        if item.sentence not in known:
            scores = score_spans(model, sentence, candidates)
            known[item.sentence] = [scores.thing.tolist(), scores.place.tolist()]
            write_atomically(kept, json.dumps(known).encode())
        scores = Scores(*map(np.array, known[item.sentence]))
        options = all_readings(candidates)
        rows = [features(sentence, candidates, option, scores) for option in options]
        found.append(Table(item, rows, [i for i, option in enumerate(options) if agrees(sentence, option, item)]))
    return found


def reads_alone(text: str) -> bool:
    """Whether the grammar reads a sentence without a model."""
    try:
        parse(text)
    except ValueError:
        return False
    return True


def agrees(sentence: Sentence, reading: Reading | None, item: AnnotatedSentence) -> bool:
    """Whether a reading is what a person understands."""
    if reading is None or item.queries is None:
        return reading is None and item.queries is None
    try:
        return same(Queries(readable(sentence.said(reading.thing)), place_phrase(sentence, reading.place)), item)
    except ValueError:
        return False


def fit(found: Sequence[Table], names: Sequence[str]) -> dict[str, float]:
    """Weights that make right readings likely: the mean log-probability, less `PENALTY` for large weights."""
    used = [table for table in found if table.right]
    matrix = np.array([[row.get(name, 0.0) for name in names] for table in used for row in table.rows], float)
    ends = np.cumsum([len(table.rows) for table in used])
    starts = ends - [len(table.rows) for table in used]
    is_right = np.zeros(len(matrix), bool)
    for start, table in zip(starts, used, strict=True):
        is_right[start + np.array(table.right)] = True
    group = np.repeat(np.arange(len(used)), ends - starts)

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        sums = matrix @ weights
        scaled = np.exp(sums - np.maximum.reduceat(sums, starts)[group])
        chances = scaled / np.add.reduceat(scaled, starts)[group]
        right = np.where(is_right, chances, 0)
        of_group = np.add.reduceat(right, starts)
        slope = matrix.T @ (chances - right / of_group[group]) / len(used)
        value = -np.log(of_group).mean() + PENALTY * (weights**2).sum() / 2
        return value, slope + PENALTY * weights

    best = minimize(loss, np.zeros(len(names)), jac=True, method="L-BFGS-B")
    return dict(zip(names, best.x.round(3).tolist(), strict=True))


def feature_names(found: Sequence[Table]) -> list[str]:
    """The names of all features."""
    return sorted({name for table in found for row in table.rows for name in row})


def held_out(found: Sequence[Table], names: Sequence[str]) -> list[np.ndarray]:
    """The probabilities of each table's readings, by weights that were fitted without it."""
    fold = np.random.default_rng(0).permutation(len(found)) % FOLDS
    chances: list[np.ndarray] = [np.empty(0)] * len(found)
    for number in range(FOLDS):
        weights = fit([table for table, of in zip(found, fold, strict=True) if of != number], names)
        for index in np.flatnonzero(fold == number):
            chances[index] = probabilities(found[index].rows, weights)
    return chances


def counts(found: Sequence[Table], chances: Sequence[np.ndarray], lowest: float) -> Mapping[str, int]:
    """How many tables are read rightly, asked about and misread, if readings below ``lowest`` are asked about."""
    result = {"right": 0, "asked": 0, "misread": 0}
    for table, of_table in zip(found, chances, strict=True):
        best = int(of_table.argmax())
        acts = best > 0 and of_table[best] >= lowest
        if table.item.queries is None:
            result["misread" if acts else "right"] += 1
        else:
            result["asked" if not acts else "right" if best in table.right else "misread"] += 1
    return result
