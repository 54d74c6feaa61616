"""docs/results.md and other pages: every number is that of a stored row."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
import summaries

from experiments.benchmark import __main__ as commands
from experiments.benchmark import page, scaling, single_tables
from experiments.benchmark.tables import interval_text
from gem_lite import clip
from gem_lite.evaluation import results
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.tasks import PAPER

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "results.md").read_text()


BOWL, ROPE = "put-block-in-bowl-unseen-colors", "align-rope"


def typed(path):
    """The means with intervals in a page, in its order."""
    return re.findall(r"\d+\.\d \[\d+\.\d, \d+\.\d\]", (ROOT / path).read_text())


def test_the_rows_of_gem_multi_lit_are_of_the_policy_that_is_kept():
    path = ROOT / "experiments" / "foreign_tasks" / "gem-multi-lit.safetensors"
    rows = results.read_rows(results.RESULTS / "foreign-tasks.jsonl")
    of_lit = [row for row in rows if row["config_hash"] == single_tables.LIT]
    assert {row["checkpoint_sha256"] for row in of_lit} == {read_card(path)["sha256"]}
    assert len([row for row in of_lit if row["world"] == "MuJoCo"]) == 4
    assert load_policy(path, clip.load()).config.digest == single_tables.LIT


def test_the_numbers_of_the_readme_are_what_the_rows_give():
    rows = page.lite(results.stored_rows())
    gem, multi, cliport, transporter = (
        summaries.scores(rows, name, 10) for name in ("gem", "gem-multi", "cliport", "transporter-lan")
    )
    means = [interval_text(*summaries.mean_over_tasks({task: of[task] for task in PAPER})) for of in (gem, multi)]
    in_bowls = [multi[BOWL], gem[BOWL], cliport[BOWL], summaries.scores(rows, "cliport", 100)[BOWL]]
    shipped = results.read_rows(results.RESULTS / "shipped.jsonl")
    (again,) = (row for row in shipped if (row["task"], row["method"], row["subset"]) == (BOWL, "gem-multi", "all"))
    numbers = [*map(str, in_bowls), *means, str(transporter[ROPE]), str(summaries.pool([again]))]
    assert typed("README.md") == numbers
    assert max(gem[ROPE].mean, multi[ROPE].mean) < 30  # "both score below 30"


def test_the_numbers_of_the_page_about_ones_own_table_are_what_the_rows_give():
    rows = results.read_rows(results.RESULTS / "own-table.jsonl")
    of_method = {row["method"]: str(summaries.pool([row])) for row in rows if row["task"] == "foreign-block-in-bowl"}
    assert typed("docs/your_table.md") == [of_method["gem"], of_method["gem-multi"]]


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
    for wrong, said in (
        ("no table", r"must name tables of benchmark, .*, sensor errors, got none"),
        ("<!-- wishes -->\n<!-- end of wishes -->\n", "got wishes"),
        ("<!-- end of benchmark -->\n", "the end of the table 'benchmark' and not its beginning"),
    ):
        with pytest.raises(ValueError, match=said):
            page.renewed(wrong, rows)


def test_no_interval_and_no_difference_of_the_page_stands_outside_of_its_tables():
    prose = re.sub(r"<!-- (.+) -->\n.*?<!-- end of \1 -->", "", PAGE, flags=re.S)
    assert len(prose) < len(PAGE) / 2
    number = re.compile(r"\d \[|\[[-+\d]|[-+]\d+\.\d|\d+\.\d (?:to|and) \d")
    assert number.search("scores 7.1 [1.0, 2.0]") and number.search("(-3.5, +1.0)") and number.search("[+2, 3]")
    assert not number.findall(prose)


METHODS = {title: name for name, title in page.OVERVIEW.items()}


def cells_of(name):
    """The cells of a table of the page, without its mean: method, task, number of demonstrations, text."""
    table = PAGE.split(f"<!-- {name} -->\n")[1].split("<!-- end")[0]
    split = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if "|" in line]
    (_, *titles), _, *lines = split
    for first, *cells in lines:
        for title, text in zip(titles, cells, strict=True):
            method, _, count = title.partition(" with ")
            if name == "ablations":
                yield first, title, 10, text
            elif title != "demonstrations" and "mean of" not in first:
                count = count or (cells[0] if name == "demonstrations" else 10)
                yield METHODS[method], first.rstrip("*"), int(count), text


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

    levels = (("gem", 10, 0.5), ("gem", 100, 1.0), ("cliport", 10, 0.0), ("cliport", 100, 0.5))
    rows = [row(method, task, level, count) for method, count, level in levels for task in (BOWL, ROPE)]
    rows.append(row("gem", "bars-in-box", 0.0, 10))
    common, curves = scaling.scaling(rows, ("gem", "cliport"), (10, 100))
    assert common == [ROPE, BOWL]
    means = {name: [mean for mean, _ in points.values()] for name, points in curves.items()}
    assert means == {"gem": [50, 100], "cliport": [0, 50]}
    assert scaling.scaling(rows, ("gem", "cliport"), (10, 20)) == ([], {})
    figure = scaling.show_scaling(common, curves)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "mean over 2 tasks"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["gem", "cliport"]
    plt.close(figure)


def test_new_heights_are_compared_on_the_same_episodes_of_the_same_weights():
    rows = results.read_rows(results.RESULTS / "shipped.jsonl")
    lines = {(method, family): texts for method, family, *texts in cells_of_lines("heights")}
    both_variants = ("put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors")
    now = [
        row for row in rows if row["method"] == "gem-multi" and row["task"] in both_variants and row["subset"] == "all"
    ]
    earlier = [
        row
        for row in results.stored_rows()
        if row["method"] == "gem-multi"
        and row["task"] in both_variants
        and row["demos"] == 10
        and row["subset"] == "all"
    ]
    assert {row["checkpoint_sha256"] for row in now} == {row["checkpoint_sha256"] for row in earlier}
    means = [sum(row["mean"] for row in side) / 2 for side in (earlier, now)]
    episodes, before, after, difference, _ = lines["GEM-multi", "put-block-in-bowl"]
    assert episodes == "100"
    assert [float(text.split()[0]) for text in (before, after)] == pytest.approx(means, abs=0.06)
    assert float(difference.split()[0]) == pytest.approx(means[1] - means[0], abs=0.11)


def cells_of_lines(name):
    """The cells of each line of a table of the page, without its head."""
    table = PAGE.split(f"<!-- {name} -->\n")[1].split("<!-- end")[0]
    split = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if line.startswith("|")]
    return split[2:]


def test_map_sources_are_compared_with_the_newest_rows_of_the_same_weights():
    lines = {(task.strip("*"), world): texts for task, world, *texts in cells_of_lines("map sources")}
    today = results.read_rows(results.RESULTS / "shipped.jsonl")
    for task in ("put-block-in-bowl-seen-colors", "packing-shapes-seen"):
        (row,) = [row for row in today if (row["method"], row["task"], row["world"]) == ("gem", task, "home")]
        assert lines[task, "home"][:2] == ["10", str(summaries.pool([row]))]
    assert lines["pick-object-part-in-brown-box-seen", "real-table"][0] == "5"
