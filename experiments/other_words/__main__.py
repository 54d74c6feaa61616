"""Sentences of other people: fit the reader's weights, and measure parsers."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from gem_lite.cli import base

KEPT = Path("runs/other_words/scores.json")
LOWEST = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
METHODS = ("grammar", "words")


def fit(*, without_model: bool = False) -> None:
    """Fit the weights of readings on the sentences for development, and print what held-out ones give.

    Writes data/other_words/weights.json, but not without the model.

    Args:
        without_model: fit without the language model's features, to see what they are worth

    Examples:
      python -m experiments.other_words fit
    """
    from experiments.other_words import fit as fitting
    from experiments.other_words.sentences import development, outcome
    from gem_lite.foundations.files import write_atomically
    from gem_lite.language import models
    from gem_lite.language.reader import ModelParser
    from gem_lite.language.readings import WEIGHTS

    items = development()
    model = models.load()
    found = fitting.tables(items, model, KEPT)
    reached = {table.item.sentence for table in found}
    others = Counter(outcome(item, ModelParser(model)) for item in items if item.sentence not in reached)
    print(f"{len(items)} sentences; {len(found)} of them reach the model; of the others {dict(others)}")
    names = [name for name in fitting.feature_names(found) if not (without_model and name.endswith(": model"))]
    chances = fitting.held_out(found, names)
    for lowest in LOWEST:
        counted = fitting.counts(found, chances, lowest)
        shares = {key: f"{100 * (value + others[key]) / len(items):.1f} %" for key, value in counted.items()}
        print(f"asks below {lowest}: {shares}")
    if not without_model:
        weights = fitting.fit(found, names)
        content = {"fitted_on": f"{len(found)} sentences for development", "weights": weights}
        write_atomically(WEIGHTS, (json.dumps(content, indent=1) + "\n").encode())


def measure(
    *,
    half: Annotated[Literal["development", "filed"], Parameter(help="which sentences")] = "development",
    method: Annotated[Literal["grammar", "words"], Parameter(help="grammar alone, or with the small model")] = "words",
    show: Annotated[bool, Parameter(help="print the sentences that are not right; never of the filed half")] = False,
) -> None:
    """Count the sentences that are read rightly, asked about and misread, and file the row.

    Examples:
      python -m experiments.other_words measure --method grammar
    """
    import numpy as np

    from experiments.other_words import sentences
    from gem_lite.evaluation.statistics import bounded_interval
    from gem_lite.foundations.files import write_atomically
    from gem_lite.language import models, parse
    from gem_lite.language.reader import ModelParser

    items = sentences.filed() if half == "filed" else sentences.development()
    parser = parse if method == "grammar" else ModelParser(models.load())
    outcomes, seconds = [], []
    for item in items:
        start = time.perf_counter()
        outcomes.append(sentences.outcome(item, parser))
        seconds.append(time.perf_counter() - start)
        if show and half == "development" and outcomes[-1] != "right":
            print(f"{outcomes[-1]:8s}{item.kind:16s}{item.sentence}")
    row = {
        "half": half,
        "method": method,
        "sentences": len(items),
        "median_seconds": round(float(np.median(seconds)), 2),
    }
    for name in ("right", "asked", "misread"):
        hits = [float(outcome == name) for outcome in outcomes]
        low, high = bounded_interval(hits, 0, 1)
        row[name] = [round(100 * value, 1) for value in (float(np.mean(hits)), low, high)]
        print(f"{name:8s}{row[name][0]:5.1f} % [{row[name][1]}, {row[name][2]}]")
    kinds = {item.kind for item in items}
    row["right_by_kind"] = {
        kind: [sum(o == "right" for o, i in zip(outcomes, items, strict=True) if i.kind == kind),
               sum(i.kind == kind for i in items)]
        for kind in sorted(kinds)
    }  # fmt: skip
    path = sentences.FOLDER / "rows.jsonl"
    old = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    rows = [other for other in old if (other["half"], other["method"]) != (half, method)] + [row]
    write_atomically(path, "".join(json.dumps(other) + "\n" for other in rows).encode())


APP = base.make_app("python -m experiments.other_words", __doc__, fit, measure)

if __name__ == "__main__":
    sys.exit(base.run(APP))
