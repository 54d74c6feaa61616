"""The tables in docs/results.md: written anew from the stored rows, so that no number is typed."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import summaries
from summaries import COMPARED, Score, mean_difference, mean_over_tasks, scores, weighted_sum
from whole_benchmark import seen_and_unseen, table_rows

from experiments.benchmark import single_tables
from experiments.benchmark.checks import check_checkpoints
from experiments.benchmark.plan import OURS
from experiments.benchmark.single_tables import OVERVIEW, Rows, at_home, lead, named, score_cell, signed
from experiments.benchmark.tables import MARK, Row, Table, interval_text, lines_of, markdown
from gem_lite.evaluation import results
from gem_lite.tasks import PAPER

TASKS = (*PAPER, *OURS)
"""The lines of the first table."""
RIVALS = COMPARED[1:]
FOR_SEVERAL_TASKS = ("gem-multi", "cliport-multi")
"""The methods that learned ten tasks at once."""
SEEDS = (0, 1, 2)
"""The training seeds that the table of seeds pools."""


def lite(rows: Rows) -> list[Row]:
    """The rows of the policies' usual cells and angles."""
    return [row for row in rows if row["config"] == "lite"]


def overview(rows: Rows) -> str:
    """The first table: every task, methods with 10 demonstrations and training seed 0, beside the ceiling."""
    table: Table = {title: {} for title in OVERVIEW.values()}
    for row in rows:
        facts = (row["world"], row["split"], row["subset"], row["config"])
        training = (row["demos"], row["seed"])
        wanted = row["method"] in OVERVIEW and training in ((10, 0), (None, None))
        if wanted and facts == ("home", "test", "all", "lite"):
            table[OVERVIEW[row["method"]]][row["task"]] = row
    return markdown(table, TASKS, PAPER)


def ablated(rows: Rows) -> tuple[list[str], list[str]]:
    """The tasks and the methods of Table A2."""
    tasks = [task for task in PAPER if "pyramid" in task or "group" in task]
    measured = {row["method"] for row in table_rows(lite(rows)).get("table-a2", []) if row["task"] in tasks}
    return tasks, sorted(measured)


def ablations(rows: Rows) -> str:
    """Table A2 on the paper's two tasks, seen and unseen: a line for each variant of GEM."""
    tasks, methods = ablated(rows)
    return lines_of(["method", *tasks], ([name, *(at_home(rows, name, task) for task in tasks)] for name in methods))


def parts(rows: Rows) -> str:
    """What GEM scores more than each of its variants, on the same episodes."""
    tasks, methods = ablated(rows)
    gem, *others = [scores(lite(rows), name, 10) for name in methods]
    lines = [
        [name, *(lead(gem.get(task), variant.get(task)) for task in tasks)]
        for name, variant in zip(methods[1:], others, strict=True)
    ]
    return lines_of(["GEM minus", *tasks], lines)


def by_count(
    rows: Rows, methods: Sequence[str] = COMPARED, counts: Sequence[int] = (10, 20, 100)
) -> dict[tuple[str, int], dict[str, Score]]:  # fmt: skip
    """The scores with training seed 0 by method, number of demonstrations and task."""
    return {(name, count): scores(lite(rows), name, count) for name in methods for count in counts}


def demonstrations(rows: Rows) -> str:
    """What 20 and 100 demonstrations give beside 10: a line for each task and number, where anything was measured."""
    lines = []
    for task in TASKS:
        cells = {count: [at_home(rows, name, task, count) for name in COMPARED] for count in (10, 20, 100)}
        if any(cells[20] + cells[100]):
            lines += [[named(task), str(count), *of_count] for count, of_count in cells.items() if any(of_count)]
    return lines_of(["task", "demonstrations", *(OVERVIEW[name] for name in COMPARED)], lines)


def gains(rows: Rows) -> str:
    """What 20 and 100 demonstrations add to 10, on the same episodes."""
    measured = by_count(rows)
    lines = []
    for task in TASKS:
        for count in (20, 100):
            cells = [lead(measured[name, count].get(task), measured[name, 10].get(task)) for name in COMPARED]
            if any(cells):
                lines.append([named(task), f"{count} minus 10", *cells])
    return lines_of(["task", "demonstrations", *(OVERVIEW[name] for name in COMPARED)], lines)


def leads(rows: Rows) -> str:
    """GEM with 10 and with 100 demonstrations minus each rival with 100."""
    measured = by_count(rows, counts=(10, 100))
    pairs = [(count, rival) for count in (10, 100) for rival in RIVALS]
    lines = []
    for task in TASKS:
        cells = [lead(measured["gem", count].get(task), measured[rival, 100].get(task)) for count, rival in pairs]
        if any(cells):
            lines.append([named(task), *cells])
    return lines_of(["task", *(f"GEM {count} - {OVERVIEW[rival]} 100" for count, rival in pairs)], lines)


def several_tasks(rows: Rows) -> str:
    """One policy for ten tasks, from 10 and 100 demonstrations of each: a line for each of the paper's variants."""
    table: Table = {f"{OVERVIEW[name]} with {count}": {} for name in FOR_SEVERAL_TASKS for count in (10, 100)}
    for row in table_rows(lite(rows)).get("table-1", []):
        title = f"{OVERVIEW.get(row['method'])} with {row['demos']}"
        if title in table:
            table[title][row["task"]] = row
    return markdown(table, PAPER, PAPER)


def differences(rows: Rows) -> str:
    """Differences of the policies in the mean over the paper's tasks, and on how many they are clear."""
    measured = by_count(rows, (*COMPARED, *FOR_SEVERAL_TASKS), (10, 100))
    gem, cliport = ([(name, count) for count in (10, 100)] for name in FOR_SEVERAL_TASKS)
    pairs = [(cliport[1], cliport[0]), (gem[1], gem[0])]
    pairs += [(gem[0], cliport[0]), (gem[1], cliport[1]), (gem[0], cliport[1])]
    pairs += [(("gem", 10), (rival, 10)) for rival in RIVALS]
    lines = []
    for one, other in pairs:
        if not set(PAPER) <= measured[one].keys() & measured[other].keys():
            continue
        first, second = ({task: measured[name][task] for task in PAPER} for name in (one, other))
        by_task = {task: summaries.paired_difference(first[task], second[task]) for task in first}
        above = [task for task, difference in by_task.items() if difference.interval[0] > 0]
        below = [task for task, difference in by_task.items() if difference.interval[1] < 0]
        mean = signed(mean_difference(first, second), [*first.values(), *second.values()])
        title = " - ".join(f"{OVERVIEW[name]} {count}" for name, count in (one, other))
        lines.append([title, mean, *(f"{len(tasks)}{_short(tasks)}" for tasks in (above, below))])
    return lines_of(["difference", "mean of the 18", "clearly above 0", "clearly below 0"], lines)


def _short(names: Sequence[str]) -> str:
    """The names of at most three tasks in brackets."""
    return f" ({', '.join(names)})" if 0 < len(names) <= 3 else ""


def unseen(rows: Rows) -> str:
    """Means over the tasks with two variants: of the seen ones, of the unseen ones, and their difference."""
    pairs = seen_and_unseen(PAPER)
    lines = []
    for (name, count), of_method in by_count(rows, (*COMPARED, *FOR_SEVERAL_TASKS), (10, 100)).items():
        if not {task for pair in pairs for task in pair} <= of_method.keys():
            continue
        sides = [{task: of_method[task] for task in side} for side in zip(*pairs, strict=True)]
        mark = MARK if any(score.outdated for side in sides for score in side.values()) else ""
        terms = [
            (sign / len(pairs), task, score)
            for sign, side in zip((1, -1), sides, strict=True)
            for task, score in side.items()
        ]
        lost = interval_text(*weighted_sum(terms), "+")
        cells = [f"{text}{mark}" for text in (*(interval_text(*mean_over_tasks(side)) for side in sides), lost)]
        lines.append([f"{OVERVIEW[name]} with {count}", *cells])
    return lines_of(["method", f"seen variants ({len(pairs)})", "unseen variants", "seen minus unseen"], lines)


def training_seeds(rows: Rows) -> str:
    """10 demonstrations with several training seeds: a line for each task on which every method was trained with each.

    A cell has the pooled score with its interval, then the score of each seed. The last columns are GEM's leads.
    """
    pooled = [scores(lite(rows), name, 10, SEEDS) for name in COMPARED]
    lines = []
    for task in TASKS:
        if not all(task in of_method for of_method in pooled):
            continue
        gem, *rivals = measured = [of_method[task] for of_method in pooled]
        cells = []
        for score in measured:
            means = ", ".join(f"{100 * rewards.mean():.1f}" for rewards in score.rewards)
            cells.append(f"{score_cell(score)} ({means})")
        lines.append([named(task), *cells, *(lead(gem, rival) for rival in rivals)])
    titles = [OVERVIEW[name] for name in COMPARED]
    return lines_of(["task", *titles, *(f"GEM - {title}" for title in titles[1:])], lines)


TABLES: Mapping[str, Callable[[Rows], str]] = {
    "benchmark": overview,
    "ablations": ablations,
    "parts": parts,
    "demonstrations": demonstrations,
    "gains": gains,
    "leads": leads,
    "several tasks": several_tasks,
    "differences": differences,
    "unseen variants": unseen,
    "training seeds": training_seeds,
    "place angle": single_tables.place_angle,
    "worlds": single_tables.worlds,
    "search": single_tables.search,
    "rules": single_tables.rules,
    "encoders": single_tables.encoders,
}
"""By the name in a page's comments, what makes the table of the benchmark's rows."""
OTHER_TABLES: Mapping[str, tuple[str, Callable[[Rows], str]]] = {
    "heights": ("shipped", single_tables.heights),
    "kinect": ("shipped", single_tables.kinects),
    "trained in kinect": ("kinect", single_tables.kinects),
    "map sources": ("shipped", single_tables.sources),
    "two tables": ("object-sorting", single_tables.two_tables),
    "own table": ("own-table", single_tables.own_table),
    "foreign tasks": ("foreign-tasks", single_tables.foreign_tasks),
    "lit at home": ("foreign-tasks", single_tables.lit_at_home),
    "refusals": ("own-table", single_tables.refusals),
    "sensor errors": ("sensor-errors", single_tables.sensor_errors),
}
"""By the name in a page's comments, the file of rows (without its ending) and what makes the table of them."""


def renewed(page: str, rows: Rows) -> str:
    """A page with its tables written anew: those between ``<!-- NAME -->`` and ``<!-- end of NAME -->``.

    Args:
        rows: of the benchmark, see `results.stored_rows`. Other rows are read from `results.RESULTS`.

    Raises:
        ValueError: the page has no such place, or names a table that is not in `TABLES` or `OTHER_TABLES`; or the rows
            mix policies, see `check_checkpoints`.
    """
    check_checkpoints(rows)
    names = re.findall(r"^<!-- end of (.+) -->$", page, re.M)
    known = (*TABLES, *OTHER_TABLES)
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(f"the page must name tables of {', '.join(known)}, got {', '.join(unknown) or 'none'}")
    for name in names:
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        if begin not in page:
            raise ValueError(f"the page has the end of the table {name!r} and not its beginning")
        before, rest = page.split(begin, 1)
        page = f"{before}{begin}{_table(name, rows)}{end}{rest.split(end, 1)[1]}"
    return page


def _table(name: str, rows: Rows) -> str:
    if name in TABLES:
        return TABLES[name](rows)
    file, make = OTHER_TABLES[name]
    return make(results.read_rows(results.RESULTS / f"{file}.jsonl"))
