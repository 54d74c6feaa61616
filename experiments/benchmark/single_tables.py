"""Tables of single experiments in docs/results.md, and the cells of which all its tables are made."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import summaries
from summaries import COMPARED, Score, scores

from experiments.benchmark.tables import MARK, MIXED, Row, cell, interval_text, lines_of
from gem_lite.evaluation import results
from gem_lite.evaluation.statistics import Difference
from gem_lite.tasks import PAPER, family

OVERVIEW = {
    "gem": "GEM",
    "cliport": "CLIPort",
    "transporter-lan": "Transporter-Lan",
    "gem-multi": "GEM-multi",
    "cliport-multi": "CLIPort-multi",
    "expert-rounded": "expert, rounded",
}
"""The columns of the first table: methods, and their titles."""
ANGLE = {
    "gem": "GEM: one kernel, steered",
    "gem-with-free-kernels": "36 free kernels (ours)",
    "gem-without-steerable-kernel": "one unrotated kernel",
    "cliport": "CLIPort",
    "transporter-lan": "Transporter-Lan",
    "expert-rounded": "expert, rounded",
}
"""The methods where the place angle decides, and their titles."""
WORLDS = {
    "home": "home",
    "other-containers": "other-containers: bowls, boxes and plates that no demonstration had",
    "white-floor": "white-floor",
    "shadows": "shadows: a low lamp that casts them",
    "bright-light": "bright-light",
    "touching": "touching: bodies that touch each other",
}
"""Worlds, and their titles."""
KINECTS = {
    "home": "home",
    "kinect": "kinect: three depth cameras that err, a lamp that was put up anew",
    "kinect-hard": "kinect-hard: the same with larger errors",
}
"""The worlds of a real cell's cameras, and their titles."""
MOVED = ("put-block-in-bowl-seen-colors", "stack-block-pyramid-seq-seen-colors", "packing-shapes-seen")
"""The tasks that are measured in other worlds."""
ERRORS = {
    "all": "all together",
    "disparity": "disparity",
    "holes": "holes",
    "edges": "edges",
    "rotation": "rotation of the poses",
    "position": "position of the poses",
    "color": "colour",
    "quantisation": "rounding",
}
"""Kinds of errors of depth cameras, and their titles."""
SIZES = {
    "nominal": ("nominal", "1 x nominal"),
    "hard": ("hard", "4 x nominal"),
    "twice hard": ("2 x hard", "8 x nominal"),
}
"""Sizes of these errors, and their names in rows."""
RULES = (
    ("GEM-multi", "location words", "gem-multi", "gem-without-locations-multi"),
    ("GEM-multi", "near the peak", "gem-multi", "gem-without-peak-multi"),
    ("GEM-multi", '"and"', "gem-multi", "gem-without-conjuncts-multi"),
    ("CLIPort-multi", "all three", "cliport-with-map-rules-multi", "cliport-multi"),
)
"""A policy, rules of acting, and the methods as which it acts with and without them."""
ENCODERS = {
    "gem": "the paper's",
    "gem-with-modulated-encoder": "words at every level",
    "gem-with-steerable-encoder": "steerable",
}
"""GEM with three encoders, and their titles."""
ENCODED = ("block-insertion", "align-rope", "assembling-kits-seq-seen-colors")
"""The tasks on which they are compared."""
COUNTS = (1, 3, 5, 10, 20, 50, 100)
"""The numbers of demonstrations with which they are compared."""
SOURCES = {
    "gem": "patches of all views",
    "gem-with-single-view": "patches from above",
    "gem-with-dense-map": "one pass for each view",
    "gem-with-region-map": "regions",
}
"""GEM with four map sources, and their titles."""
SOURCES_ON = (
    ("put-block-in-bowl-seen-colors", 10, "home"),
    ("put-block-in-bowl-unseen-colors", 10, "home"),
    ("put-block-in-bowl-seen-colors", 10, "touching"),
    ("packing-shapes-seen", 10, "home"),
    ("packing-shapes-unseen", 10, "home"),
    ("pick-object-part-in-brown-box-seen", 5, "real-table"),
    ("pick-object-part-in-brown-box-unseen", 5, "real-table"),
)
"""The tasks on which they are compared, with the number of demonstrations and the world."""
Rows = Sequence[Row]
"""Rows of results."""


def found(rows: Rows, **wanted: object) -> Row | None:
    """The row with these entries, or None. Raises ValueError if there are several."""
    matches = [row for row in rows if wanted.items() <= row.items()]
    if len(matches) > 1:
        raise ValueError(f"there are {len(matches)} rows with {wanted}")
    return matches[0] if matches else None


def at_home(rows: Rows, method: str, task: str, demos: int | None = 10, world: str = "home") -> str:
    """The cell of a policy with training seed 0, or of a scripted method, on the test episodes; empty without a row."""
    seed = None if demos is None else 0
    facts = {"split": "test", "subset": "all", "config": "lite", "world": world, "seed": seed}
    row = found(rows, method=method, task=task, demos=demos, **facts)
    return cell(row) if row else ""


def score_cell(score: Score) -> str:
    """A score in a cell, with the mark if a row of it is outdated."""
    return f"{score}{MARK if score.outdated else ''}"


def lead(first: Score | None, second: Score | None) -> str:
    """The paired difference of two scores; empty if one is missing."""
    if first is None or second is None:
        return ""
    return signed(summaries.paired_difference(first, second), (first, second))


def signed(difference: Difference, measured: Sequence[Score]) -> str:
    """A difference in a cell, with `MARK` if one of its scores is outdated, and `MIXED` if their rules differ."""
    mark = MARK if any(score.outdated for score in measured) else ""
    if len(frozenset().union(*(score.rules for score in measured))) > 1:
        mark += MIXED
    return interval_text(difference.mean, difference.interval, "+") + mark


def named(task: str) -> str:
    """The name of a task in a table, with a star if it is not the paper's."""
    return task if task in PAPER else f"{task}*"


def place_angle(rows: Rows) -> str:
    """Methods on block-insertion, where the place angle decides."""
    task = "block-insertion"
    lines = [[title, at_home(rows, name, task, None if "expert" in name else 10)] for name, title in ANGLE.items()]
    return lines_of(["method", named(task)], lines)


def worlds(rows: Rows) -> str:
    """GEM in other worlds."""
    lines = [[title, *(at_home(rows, "gem", task, world=world) for task in MOVED)] for world, title in WORLDS.items()]
    return lines_of(["world", *map(named, MOVED)], lines)


def kinects(rows: Rows) -> str:
    """Two policies, measured before real cameras' errors: a line for each world that has a row."""
    pair = (MOVED[0], MOVED[2])
    lines = [[title, *(at_home(rows, "gem", task, world=world) for task in pair)] for world, title in KINECTS.items()]
    return lines_of(["world", *map(named, pair)], [line for line in lines if any(line[1:])])


def _played(row: Row) -> tuple:
    """What the rows of one policy on the same episodes share."""
    return (row["method"], row["checkpoint_sha256"], row["task"], row["world"], *row["rewards"])


def heights(rows: Rows) -> str:
    """Shipped policies measured again: by family of tasks, the benchmark's rows of the same weights beside ``rows``."""
    benchmark = {_played(row): row for row in results.stored_rows()}
    pairs: dict[tuple[str, str], list[tuple[Row, Row]]] = {}
    for row in (row for row in rows if (row["subset"], row["world"]) == ("all", "home")):
        if earlier_row := benchmark.get(_played(row)):
            pairs.setdefault((row["method"], family(row["task"])), []).append((earlier_row, row))
    lines = []
    for (method, name), of_family in sorted(pairs.items(), key=lambda item: item[0]):
        earlier, now = ({row["task"]: summaries.pool([row]) for row in side} for side in zip(*of_family, strict=True))
        difference = summaries.mean_difference(now, earlier)
        means = [interval_text(*summaries.mean_over_tasks(side)) for side in (earlier, now)]
        changed = sum(int(np.not_equal(now[task].rewards, earlier[task].rewards).sum()) for task in now)
        cells = [*means, interval_text(difference.mean, difference.interval, "+"), str(changed)]
        lines.append([OVERVIEW[method], name, str(sum(score.rewards.size for score in now.values())), *cells])
    return lines_of(["policy", "family", "episodes", "earlier", "now", "now minus earlier", "other rewards"], lines)


def sources(rows: Rows) -> str:
    """GEM with four map sources (Figure A7), and what two of them lead over patches of all views.

    ``rows`` are of shipped policies; they take the place of the benchmark's of the same weights.
    """
    newest = list({_played(row): row for row in (*results.stored_rows(), *rows)}.values())
    others = ("gem-with-dense-map", "gem-with-region-map")
    lines = []
    for task, demos, world in SOURCES_ON:
        cells = [at_home(newest, method, task, demos, world) for method in SOURCES]
        measured = {method: scores(newest, method, demos, world=world).get(task) for method in SOURCES}
        leads = [lead(measured[method], measured["gem"]) for method in others]
        lines.append([named(task), world, str(demos), *cells, *leads])
    titles = [*SOURCES.values(), *(f"{SOURCES[method]} minus patches" for method in others)]
    return lines_of(["task", "world", "demonstrations", *titles], lines)


def search(rows: Rows) -> str:
    """Every trial of the search, on validation episodes: the bowls / the pyramid."""
    facts = {"split": "val", "subset": "all"}
    trials = [row for row in rows if facts.items() <= row.items() and row["task"] in MOVED[:2]]
    trials = [row for row in trials if row["method"] in COMPARED]
    lines = []
    for steps, rate in sorted({(row["steps"], row["learning_rate"]) for row in trials}):
        cells = []
        for method in COMPARED:
            facts = {"method": method, "steps": steps, "learning_rate": rate}
            both = [found(trials, task=task, **facts) for task in MOVED[:2]]
            cells.append(" / ".join(cell(row) if row else "" for row in both))
        lines.append([f"{steps}, {rate}", *cells])
    return lines_of(["steps, rate", *(OVERVIEW[name] for name in COMPARED)], lines)


def _validated(rows: Rows, method: str, seeds: Sequence[int]) -> str:
    """The mean on validation episodes of the policies whose test rows have these seeds; a dash if one has none."""
    means = []
    for seed in seeds:
        test = found(rows, method=method, split="test", seed=seed)
        training = {entry: test[entry] for entry in ("steps", "learning_rate")} if test else {}
        row = found(rows, method=method, split="val", seed=seed, **training)
        if row is None:
            return "-"
        means.append(row["mean"])
    return f"{sum(means) / len(means):.1f}"


def encoders(rows: Rows) -> str:
    """GEM with three encoders: a line for each task and number of demonstrations with which two of them were tested.

    A cell has the score on the test episodes, and in brackets the mean on validation episodes. Both are over the
    training seeds that all tested encoders have.
    """
    lines = []
    home = {"world": "home", "subset": "all", "config": "lite"}
    for task, demos in itertools.product(ENCODED, COUNTS):
        alike = [row for row in rows if (home | {"task": task, "demos": demos}).items() <= row.items()]
        tests = [row for row in alike if row["split"] == "test"]
        tested = {name: {row["seed"] for row in tests if row["method"] == name} for name in ENCODERS}
        tested = {name: seeds for name, seeds in tested.items() if seeds}
        common = sorted(set.intersection(*tested.values())) if len(tested) > 1 else []
        if common:
            pooled = {name: scores(alike, name, demos, common)[task] for name in tested}
            texts = {name: f"{score_cell(score)} ({_validated(alike, name, common)})" for name, score in pooled.items()}
            difference = lead(pooled.get("gem-with-steerable-encoder"), pooled.get("gem"))
            cells = [*(texts.get(name, "") for name in ENCODERS), difference]
            lines.append([named(task), str(demos), ", ".join(map(str, common)), *cells])
    return lines_of(["task", "demonstrations", "seeds", *ENCODERS.values(), "steerable minus the paper's"], lines)


def rules(rows: Rows) -> str:
    """What rules of acting are worth: one policy with and without them, on the tasks on which both were measured.

    The last column is GEM's lead when the rule makes no difference between the two: GEM-multi without it minus
    CLIPort-multi, which has no rule; or GEM-multi minus CLIPort-multi with all three.
    """
    lines = []
    gem, rival = (scores(rows, f"{name}-multi", 10) for name in ("gem", "cliport"))
    for policy, rule, *methods in RULES:
        with_rule, without = (scores(rows, method, 10) for method in methods)
        for task in PAPER:
            if task in with_rule and task in without:
                both = (with_rule[task], without[task])
                compared = (gem.get(task), both[0]) if policy == "CLIPort-multi" else (both[1], rival.get(task))
                lines.append([policy, rule, task, *map(score_cell, both), lead(*both), lead(*compared)])
    titles = ["policy", "rule", "task", "with it", "without it", "difference", "GEM's lead then"]
    return lines_of(titles, lines)


def two_tables(rows: Rows) -> str:
    """GEM over two tables, by how the robot knows where they are."""
    lines = []
    for task in ("object-sorting-seen", "object-sorting-unseen"):
        facts = {"task": task, "world": "home", "shift": 0.0, "turn": 0.0}
        both = [found(rows, poses=poses, **facts) for poses in ("tags", "truth")]
        lines.append([task, *(cell(row) if row else "" for row in both)])
    return lines_of(["object-sorting", "poses from tags", "true poses"], lines)


def own_table(rows: Rows) -> str:
    """Two policies on a table of another simulator, and their difference."""
    trained, shipped = (found(rows, method=name, task="foreign-block-in-bowl") for name in ("gem", "gem-multi"))
    lines = []
    if trained and shipped:
        lines.append([f"GEM, {trained['steps']} steps", f"{trained['demos']}, recorded there", cell(trained)])
        lines.append(["GEM-multi as it is shipped", "none of these tables", cell(shipped)])
        lines.append(["the first minus the second", "", lead(summaries.pool([trained]), summaries.pool([shipped]))])
    return lines_of(["policy", "demonstrations", "solved"], lines)


LIT = "104f6f9724c3"
"""The hash of the configuration of experiments/foreign_tasks/gem-multi-lit.safetensors."""
UNEVEN_LIGHT = {"uneven light from the first step": "f3609218344d", "uneven light in the last 5,000 steps": LIT}
"""Two policies that learned in two worlds: what the table calls them, and the hash of their configuration."""


def foreign_tasks(rows: Rows) -> str:
    """Three policies on four families of tasks in another simulator, and paired differences to the first one."""
    lines = []
    there = [row for row in rows if row["world"] == "MuJoCo"]
    for task in dict.fromkeys(row["task"] for row in there):
        shipped = found(there, method="gem-multi", task=task, split="test", demonstrations_world="varied")
        cells = [cell(shipped) if shipped else ""]
        for digest in UNEVEN_LIGHT.values():
            other = found(there, method="gem-multi", task=task, split="test", config_hash=digest)
            scores = (summaries.pool([row]) if row else None for row in (other, shipped))
            cells += [cell(other) if other else "", lead(*scores)]
        lines.append([task.removeprefix("foreign-"), *cells])
    head = ["family", "GEM-multi as it is shipped"]
    for title in UNEVEN_LIGHT:
        head += [title, "minus the shipped one"]
    return lines_of(head, lines)


def lit_at_home(rows: Rows) -> str:
    """The policy with uneven light in its last steps beside the shipped one, on the paper's tasks at home."""
    lines = []
    of_shipped = results.read_rows(results.RESULTS / "shipped.jsonl")
    for task in PAPER:
        facts = {"method": "gem-multi", "task": task, "world": "home", "split": "test", "episodes": 50}
        lit = found(rows, config_hash=LIT, **facts)
        shipped = found(of_shipped, demonstrations_world="varied", **facts)
        if lit and shipped:
            lines.append([task, cell(shipped), cell(lit), lead(summaries.pool([lit]), summaries.pool([shipped]))])
    return lines_of(["task", "GEM-multi as it is shipped", "`gem-multi-lit`", "second minus first"], lines)


def refusals(rows: Rows) -> str:
    """How often the refusal refused, by table and by whether the named thing was there."""
    titles = {"MuJoCo": "of MuJoCo", "home": "ours (bowls, everyday objects, pairs of boxes; unseen names)"}
    subsets = ("named thing is there", "named thing is not there")
    lines = []
    for world, title in titles.items():
        asked = [found(rows, task="refusal", world=world, subset=subset) for subset in subsets]
        lines.append([title, *(cell(row) if row else "" for row in asked)])
    return lines_of(["tables", "the named thing is there (100)", "it is not there (50)"], lines)


def sensor_errors(rows: Rows) -> str:
    """A policy by the kind and the size of its cameras' errors."""

    def text(kind: str, size: str, levelled: bool) -> str:
        matches = [row for row in rows if row["kind"] == kind and row["level"] in SIZES[size]]
        chosen = [row for row in matches if bool(row.get("levelled")) == levelled]
        return cell(chosen[0]) if chosen else ""

    columns = [(size, False) for size in SIZES] + [("hard", True), ("twice hard", True)]
    none = found(rows, kind="none")
    first = ["none", cell(none) if none else "", *[""] * (len(columns) - 1)]
    lines = [[title, *(text(kind, *column) for column in columns)] for kind, title in ERRORS.items()]
    head = [f"{size}, levelled" if levelled else size for size, levelled in columns]
    return lines_of(["kind", *head], [first, *lines])
