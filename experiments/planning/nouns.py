"""How well a language model's scores tell kinds apart: on nouns for development, and on the names of the objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.planning.scenes import KINDS, MEMBERS
from gem_lite.language.models import Scorer
from gem_lite.planning import belonging
from gem_lite.planning.belonging import Belonging

DEVELOPMENT = {
    "animals": (
        "cat", "horse", "cow", "sheep", "goat", "lion", "bear", "wolf", "fox", "monkey", "zebra", "giraffe", "frog",
        "snake", "lizard", "eagle", "owl", "parrot", "chicken", "goose", "shark", "octopus", "bee", "ant", "spider",
        "mouse", "squirrel", "hedgehog",
    ),
    "food": (
        "rice", "potato", "tomato", "cucumber", "lettuce", "orange", "grape", "strawberry", "peach", "mango", "melon",
        "egg", "chocolate", "cookie", "cake", "sandwich", "sausage", "bacon", "pasta", "soup", "pancake", "muffin",
        "pretzel", "popcorn", "candy", "broccoli", "avocado", "hot dog",
    ),
    "toys": (
        "kite", "yo-yo", "puzzle", "spinning top", "marble", "rattle", "toy soldier", "rocking horse", "dollhouse",
        "toy plane", "toy truck", "stuffed animal", "jigsaw", "building block", "hula hoop", "puppet", "slingshot",
        "frisbee", "jump rope", "water gun", "playing card", "plush bunny", "toy dinosaur", "bouncy ball",
    ),
    "tools": (
        "chisel", "file", "level", "mallet", "tape measure", "ratchet", "sander", "plane", "vise", "rake", "hoe",
        "pickaxe", "soldering iron", "wire cutter", "utility knife", "wheelbarrow", "hatchet", "bolt cutter", "caliper",
        "nail gun", "paintbrush", "awl", "pitchfork", "spade",
    ),
    "kitchen utensils": (
        "bowl", "cup", "saucer", "kettle", "tongs", "grater", "sieve", "peeler", "corkscrew", "cutting board",
        "measuring cup", "measuring spoon", "cleaver", "baking tray", "wok", "garlic press", "pitcher", "jar",
        "skillet", "saucepan", "ice cream scoop", "bread knife", "pizza cutter", "funnel", "mortar",
    ),
}  # fmt: skip
"""Nouns that no object of the simulator and not `belonging.NOUNS` has.
`belonging.LOWEST_MARGIN` was chosen here."""


def yes_no_score(model: Scorer, name: str, kind: str) -> float:
    """The answer to a question: log p("yes") - log p("no") after "Is a train a toy?", in nats."""
    asked = belonging.with_article(belonging.singular(kind))
    yes, no = model.scores(f"Question: Is {belonging.with_article(name)} {asked}? Answer:", [" yes", " no"])
    return float(yes - no)


def table(model: Scorer) -> str:
    """The area under the ROC curve of each score, mean over the kinds; and what passes `belonging.LOWEST_MARGIN`."""
    lines = ["| score | nouns for development | names of the objects |", "|---|---|---|"]
    found = [scores_of(model, members) for members in (DEVELOPMENT, MEMBERS)]
    for name in found[0]:
        areas = [
            mean_area(of_name[name], members) for of_name, members in zip(found, (DEVELOPMENT, MEMBERS), strict=True)
        ]
        lines.append(f"| {name} | {areas[0]:.3f} | {areas[1]:.3f} |")
    for right in (True, False):
        shares = []
        for of_name, members in zip(found, (DEVELOPMENT, MEMBERS), strict=True):
            passes = of_name["margin"] >= belonging.LOWEST_MARGIN
            shares.append(100 * passes[truth(members) == right].mean())
        lines.append(f"| {'right' if right else 'wrong'} pairs that pass | {shares[0]:.0f} % | {shares[1]:.0f} % |")
    return "\n".join(lines)


def scores_of(model: Scorer, members: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
    """(N, kinds) of each score: of all members for all kinds."""
    names = [name for kind in KINDS for name in members[kind]]
    belongs = Belonging(model)
    from_lists = belonging.list_scores(model, names, KINDS)
    from_sentences = belonging.kind_scores(model, names, KINDS)
    return {
        "yes or no": np.array([[yes_no_score(model, name, kind) for kind in KINDS] for name in names]),
        "list": from_lists,
        "word for the kind": from_sentences,
        "list + word": from_lists + from_sentences,
        "margin": np.stack([belongs.margins(names, kind) for kind in KINDS], axis=1),
    }


def truth(members: Mapping[str, Sequence[str]]) -> np.ndarray:
    """(N, kinds) bool: which member belongs to which kind."""
    return np.array([[kind == own for kind in KINDS] for own in KINDS for _ in members[own]])


def mean_area(scores: np.ndarray, members: Mapping[str, Sequence[str]]) -> float:
    """The area under the ROC curve, the mean over the kinds: the share of (right, wrong) pairs in the right order."""
    areas = []
    for found, right in zip(scores.T, truth(members).T, strict=True):
        differences = found[right][:, None] - found[~right]
        areas.append(((differences > 0) + 0.5 * (differences == 0)).mean())
    return float(np.mean(areas))
