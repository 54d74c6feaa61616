"""docs/results.md and other pages: every number is that of a stored row."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from experiments.benchmark import __main__ as commands
from experiments.benchmark import page, scaling
from gem_lite.evaluation import results

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "results.md").read_text()


@pytest.mark.parametrize("path", ["README.md", "docs/your_table.md"])
def test_every_interval_of_a_page_is_that_of_a_row(path):
    rows = results.stored_rows()
    for name in ("object-sorting", "own-table", "sensor-errors"):
        rows += results.read_rows(results.RESULTS / f"{name}.jsonl")
    known = {(row["mean"], *row["ci95"]) for row in rows}
    means = PAGE.split("<!-- benchmark -->")[1].split("**mean of the 18**")[1].splitlines()[0]
    number = r"(\d+(?:\.\d)?)"

    def intervals(text):
        return {tuple(map(float, match)) for match in re.findall(rf"{number} \[{number}, {number}\]", text)}

    assert not intervals((ROOT / path).read_text()) - known - intervals(means)


def test_the_tables_of_the_page_are_those_of_the_rows(tmp_path):
    copy = tmp_path / "results.md"
    copy.write_text(PAGE.replace("100.0 [92.9, 100.0]", "stale"))
    commands.page(copy)
    assert copy.read_text() == PAGE, "run: python -m experiments.benchmark page docs/results.md"
    rows = results.stored_rows()
    one_table = PAGE[PAGE.index("<!-- ablations -->") : PAGE.index("<!-- end of ablations -->")]
    one_table += "<!-- end of ablations -->"
    assert page.renewed(one_table, rows) == one_table
    assert page.renewed(one_table, rows[:5]) != one_table
    assert {*page.TABLES, *page.OTHER_TABLES} == set(re.findall("<!-- end of (.+) -->", PAGE))
    with pytest.raises(ValueError, match=r"must name tables of benchmark, .*, sensor errors, got none"):
        page.renewed("no table", rows)
    with pytest.raises(ValueError, match="got wishes"):
        page.renewed("<!-- wishes -->\n<!-- end of wishes -->\n", rows)
    with pytest.raises(ValueError, match="the end of the table 'benchmark' and not its beginning"):
        page.renewed("<!-- end of benchmark -->\n", rows)


def test_no_interval_and_no_difference_of_the_page_stands_outside_of_its_tables():
    prose = re.sub(r"<!-- (.+) -->\n.*?<!-- end of \1 -->", "", PAGE, flags=re.S)
    assert len(prose) < len(PAGE) / 2
    typed = re.compile(r"\d \[|\[[-+\d]|[-+]\d+\.\d|\d+\.\d (?:to|and) \d")
    assert typed.search("scores 7.1 [1.0, 2.0]") and typed.search("(-3.5, +1.0)") and typed.search("[+2, 3]")
    assert not typed.findall(prose)


METHODS = {
    "GEM": "gem", "CLIPort": "cliport", "Transporter-Lan": "transporter-lan", "GEM-multi": "gem-multi",
    "CLIPort-multi": "cliport-multi", "expert, rounded": "expert-rounded",
}  # fmt: skip


def cells_of(name):
    """The cells of a table of the page, without its mean: method, task, number of demonstrations, text."""
    table = PAGE.split(f"<!-- {name} -->\n")[1].split("<!-- end")[0]
    split = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if "|" in line]
    (_, *titles), _, *lines = split
    for first, *cells in lines:
        if "mean of" in first:
            continue
        task = first.rstrip("*")
        if name == "ablations":
            yield from ((first, task, 10, text) for task, text in zip(titles, cells, strict=True))
        elif name == "demonstrations":
            yield from ((METHODS[t], task, int(cells[0]), c) for t, c in zip(titles[1:], cells[1:], strict=True))
        else:
            for title, text in zip(titles, cells, strict=True):
                method, _, count = title.partition(" with ")
                yield METHODS[method], task, int(count or 10), text


@pytest.mark.parametrize("name", ["benchmark", "ablations", "demonstrations", "several tasks"])
def test_each_cell_of_the_page_is_its_row(name):
    at_home = {"split": "test", "subset": "all", "world": "home", "config": "lite"}
    rows = [row for row in results.stored_rows() if at_home.items() <= row.items() and not row["seed"]]
    cells = list(cells_of(name))
    assert len(cells) > 20
    for method, task, demos, text in cells:
        demos = None if method == "expert-rounded" else demos
        found = [row for row in rows if (row["method"], row["task"], row["demos"]) == (method, task, demos)]
        texts = ["{:.1f} [{:.1f}, {:.1f}]".format(row["mean"], *row["ci95"]) for row in found]
        assert texts == ([] if not text else [text.removesuffix("†")])
        assert all(text.endswith("†") == results.is_outdated(row) for row in found)


def test_scaling_is_over_the_tasks_that_have_every_number():
    def row(method, task, level, demos):
        facts = {"method": method, "task": task, "demos": demos, "seed": 0, "split": "test", "subset": "all"}
        facts |= {"world": "home", "train_cpu_seconds": 1.0, **results.reward_entries(dict.fromkeys(range(10), level))}
        return dict.fromkeys(results.IDENTITY) | facts

    bowl, rope = "put-block-in-bowl-seen-colors", "align-rope"
    levels = (("gem", 10, 0.5), ("gem", 100, 1.0), ("cliport", 10, 0.0), ("cliport", 100, 0.5))
    rows = [row(method, task, level, count) for method, count, level in levels for task in (bowl, rope)]
    rows.append(row("gem", "bars-in-box", 0.0, 10))
    common, curves = scaling.scaling(rows, ("gem", "cliport"), (10, 100))
    assert common == [rope, bowl]
    means = {name: [mean for mean, _ in points.values()] for name, points in curves.items()}
    assert means == {"gem": [50, 100], "cliport": [0, 50]}
    assert scaling.scaling(rows, ("gem", "cliport"), (10, 20)) == ([], {})
    figure = scaling.show_scaling(common, curves)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "mean over 2 tasks"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["gem", "cliport"]
    plt.close(figure)
