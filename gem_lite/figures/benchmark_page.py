"""The benchmark's tables in docs/results.md: written anew from the stored rows, so that no number is typed."""

from __future__ import annotations

import re
from collections.abc import Sequence

from gem_lite.evaluation import benchmark
from gem_lite.evaluation.summaries import COMPARED, scores, table_rows
from gem_lite.figures.plot_benchmark import Row, Table, markdown

OVERVIEW = {
    "gem": "GEM",
    "cliport": "CLIPort",
    "transporter-lan": "Transporter-Lan",
    "gem-multi": "GEM-multi",
    "cliport-multi": "CLIPort-multi",
    "expert-rounded": "expert, rounded",
}
"""The columns of the first table: methods, and their titles."""
FOR_SEVERAL_TASKS = ("gem-multi", "cliport-multi")
"""The methods that learned ten tasks at once."""
OURS = ("block-insertion", "bars-in-box", "packing-shapes-seen")
"""Its last lines: tasks that are not the paper's."""
SEEDS = (0, 1, 2)
"""The training seeds that the table of seeds pools."""


def overview(rows: Sequence[Row]) -> str:
    """The first table: every task, methods with 10 demonstrations and training seed 0, beside the ceiling."""
    table: Table = {title: {} for title in OVERVIEW.values()}
    for row in rows:
        facts = (row["world"], row["split"], row["subset"], row["config"])
        training = (row["demos"], row["seed"])
        named = str(row["method"]) in OVERVIEW and training in ((10, 0), (None, None))
        if named and facts == ("home", "test", "all", "lite"):
            table[OVERVIEW[str(row["method"])]][str(row["task"])] = row
    return markdown(table, (*benchmark.VARIANTS, *OURS), benchmark.VARIANTS)


def ablations(rows: Sequence[dict]) -> str:
    """Table A2 on the paper's two tasks, seen and unseen: a line for each variant of GEM."""
    tasks = [task for task in benchmark.VARIANTS if "pyramid" in task or "group" in task]
    cells = {(str(row["method"]), str(row["task"])): row for row in table_rows(rows).get("table-a2", [])}
    methods = list(dict.fromkeys(method for method, task in sorted(cells) if task in tasks))
    lines = [f"| method | {' | '.join(tasks)} |", "|---|" + "---|" * len(tasks)]
    for method in methods:
        found = [cells.get((method, task)) for task in tasks]
        texts = ["{} [{}, {}]".format(row["mean"], *row["ci95"]) if row else "" for row in found]
        lines.append(f"| {method} | {' | '.join(texts)} |")
    return "\n".join(lines) + "\n"


def demonstrations(rows: Sequence[dict]) -> str:
    """What 20 and 100 demonstrations give beside 10: a line for each task and number, where anything was measured."""
    table = {}
    for row in table_rows(rows).get("table-1", []):
        if row["method"] in COMPARED and row["config"] == "lite":
            table[row["task"], row["demos"], row["method"]] = "{} [{}, {}]".format(row["mean"], *row["ci95"])
    more = {task for task, count, _ in table if count > 10}
    lines = [f"| task | demonstrations | {' | '.join(OVERVIEW[name] for name in COMPARED)} |", "|---" * 5 + "|"]
    for task in (*benchmark.VARIANTS, *OURS):
        for count in sorted({number for name, number, _ in table if name == task and task in more}):
            cells = [table.get((task, count, name), "") for name in COMPARED]
            star = "*" if task in OURS else ""
            lines.append(f"| {task}{star} | {count} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def several_tasks(rows: Sequence[dict]) -> str:
    """One policy for ten tasks, from 10 and 100 demonstrations of each: a line for each of the paper's variants."""
    table: Table = {f"{OVERVIEW[name]} with {count}": {} for name in FOR_SEVERAL_TASKS for count in (10, 100)}
    for row in table_rows(rows).get("table-1", []):
        title = f"{OVERVIEW.get(row['method'])} with {row['demos']}"
        if row["config"] == "lite" and title in table:
            table[title][row["task"]] = row
    return markdown(table, benchmark.VARIANTS, benchmark.VARIANTS)


def training_seeds(rows: Sequence[dict]) -> str:
    """10 demonstrations with several training seeds: a line for each task on which every method was trained with each.

    A cell has the pooled score with its interval, then the score of each seed.
    """
    pooled = {name: scores(rows, name, demos=10, seeds=SEEDS) for name in COMPARED}
    lines = [f"| task | {' | '.join(OVERVIEW[name] for name in COMPARED)} |", "|---" * 4 + "|"]
    for task in (*benchmark.VARIANTS, *OURS):
        if not all(task in of_method for of_method in pooled.values()):
            continue
        cells = []
        for of_method in pooled.values():
            means = (f"{100 * rewards.mean():.1f}" for rewards in of_method[task].rewards)
            cells.append(f"{of_method[task]} ({', '.join(means)})")
        star = "*" if task in OURS else ""
        lines.append(f"| {task}{star} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


TABLES = {
    "benchmark": overview,
    "ablations": ablations,
    "demonstrations": demonstrations,
    "several tasks": several_tasks,
    "training seeds": training_seeds,
}
"""By the name in a page's comments, what makes the table."""


def renewed(page: str, rows: Sequence[dict]) -> str:
    """A page with its tables written anew: those between ``<!-- NAME -->`` and ``<!-- end of NAME -->``.

    Args:
        rows: of results, see `benchmark.stored_rows`.

    Raises:
        ValueError: the page has no such place, or names a table that is not in `TABLES`.
    """
    names = re.findall(r"^<!-- end of (.+) -->$", page, re.M)
    unknown = [name for name in names if name not in TABLES]
    if unknown or not names:
        raise ValueError(f"the page must name tables of {', '.join(TABLES)}, got {', '.join(unknown) or 'none'}")
    for name in names:
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        if begin not in page:
            raise ValueError(f"the page has the end of the table {name!r} and not its beginning")
        before, rest = page.split(begin, 1)
        page = f"{before}{begin}{TABLES[name](rows)}{end}{rest.split(end, 1)[1]}"
    return page
