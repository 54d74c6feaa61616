import matplotlib.pyplot as plt
import numpy as np
import pytest

from gem_lite.evaluation import benchmark, results, statistics, summaries
from gem_lite.figures import plot_benchmark


def row(method, task, rewards, demos=10, seed=0, **changes):
    facts = {name: None for name in results.IDENTITY}
    facts |= {"method": method, "task": task, "subset": "all", "world": "home", "split": "test", "start": 0}
    facts |= {"demos": demos, "seed": seed}
    return facts | {"train_cpu_seconds": 1.0} | results.reward_entries(dict(enumerate(rewards))) | changes


ROWS = [
    row("gem", "a-seen", [1.0] * 10), row("gem", "a-unseen", [1.0] * 5 + [0.0] * 5), row("gem", "b", [0.5] * 10),
    row("gem", "b", [0.0] * 10, seed=1), row("gem", "a-seen", [0.0] * 10, demos=100),
    row("gem", "a-seen", [0.0] * 10, split="val"), row("gem", "a-seen", [0.0] * 10, subset="new"),
    row("gem", "a-seen", [0.0] * 10, world="shadows"), row("expert", "b", [1.0] * 10, demos=None, seed=None),
]  # fmt: skip


def test_scores_are_of_one_method_number_and_seed():
    found = summaries.scores(ROWS, "gem", 10)
    assert {task: score.mean for task, score in found.items()} == {"a-seen": 100, "a-unseen": 50, "b": 50}
    assert {task: score.mean for task, score in summaries.scores(ROWS, "gem", 100).items()} == {"a-seen": 0}
    assert summaries.scores(ROWS, "expert")["b"].mean == 100
    both = summaries.scores(ROWS, "gem", 10, seeds=(0, 1))
    assert list(both) == ["b"] and both["b"].mean == 25
    with pytest.raises(LookupError, match="same training seed"):
        summaries.scores([*ROWS, ROWS[0]], "gem", 10)


def test_the_mean_counts_every_task_once_and_its_interval_covers():
    found = summaries.scores(ROWS, "gem", 10)
    mean, (low, high) = summaries.mean_over_tasks(found)
    assert mean == pytest.approx(200 / 3, abs=0.1)
    widest = max(score.interval[1] - score.interval[0] for score in found.values())
    assert 0 < low < mean < high < 100 and high - low < widest
    # 300 simulated benchmarks of three tasks: the true mean lies in about 95 % of the intervals, or in more.
    rng = np.random.default_rng(0)
    truth = np.array([0.95, 0.6, 0.2])
    covered = 0
    for _ in range(300):
        drawn = rng.random((3, 20)) < truth[:, None]
        rows = [row("gem", str(i), rewards.astype(float)) for i, rewards in enumerate(drawn)]
        _, (low, high) = summaries.mean_over_tasks(summaries.scores(rows, "gem", 10))
        covered += low <= 100 * truth.mean() <= high
    assert covered >= 0.93 * 300
    with pytest.raises(ValueError, match="at least one task"):
        summaries.mean_over_tasks({})


def test_a_mean_difference_counts_every_task_once_and_may_be_negative():
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(300):
        worse, better = ((rng.random((3, 20)) < np.array(chances)[:, None]).astype(float) for chances in (
            [0.1, 0.5, 0.6], [0.9, 0.6, 0.6],
        ))  # fmt: skip
        differences = {str(i): statistics.paired_difference(worse[i], better[i]) for i in range(3)}
        mean = summaries.mean_difference(differences)
        covered += mean.interval[0] <= -30 <= mean.interval[1]
    assert covered >= 0.93 * 300
    assert mean.mean == pytest.approx(100 * (worse - better).mean(), abs=0.1)
    assert mean.interval[0] < mean.mean < mean.interval[1] < 0
    with pytest.raises(ValueError, match="training seeds"):
        summaries.mean_difference({})


def test_every_row_finds_its_table():
    rows = [
        *ROWS, row("gem-without-image-map", "b", [1.0] * 10), row("gem-multi", "b", [1.0] * 10),
        row("cliport", "b", [0.0] * 10, demos=100),
    ]  # fmt: skip
    tables = {
        name: {(one["method"], one["task"], one["demos"], one["seed"]) for one in chosen}
        for name, chosen in summaries.table_rows(rows).items()
    }
    assert tables == {
        "table-1": {
            ("gem", "a-seen", 10, 0), ("gem", "a-unseen", 10, 0), ("gem", "b", 10, 0), ("gem", "a-seen", 100, 0),
            ("gem-multi", "b", 10, 0), ("cliport", "b", 100, 0),
        },
        "table-a2": {("gem", "b", 10, 0), ("gem-without-image-map", "b", 10, 0)},
        "ceilings": {("expert", "b", None, None)},
        "seeds": {("gem", "b", 10, 0), ("gem", "b", 10, 1)},
    }  # fmt: skip


def test_scaling_is_over_the_tasks_that_have_every_number():
    rows = [
        row(method, task, [level] * 10, demos=count)
        for method, count, level in (("gem", 10, 0.5), ("gem", 100, 1.0), ("cliport", 10, 0.0), ("cliport", 100, 0.5))
        for task in ("a-seen", "b")
    ]
    tasks, curves = summaries.scaling([*rows, row("gem", "c", [0.0] * 10)], ("gem", "cliport"), (10, 100))
    assert tasks == ["a-seen", "b"]
    assert {name: [mean for mean, _ in points.values()] for name, points in curves.items()} == {
        "gem": [50, 100], "cliport": [0, 50],
    }  # fmt: skip
    assert summaries.scaling(rows, ("gem", "cliport"), (10, 20)) == ([], {})
    figure = plot_benchmark.show_scaling(tasks, curves)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "mean over 2 tasks"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["gem", "cliport"]
    plt.close(figure)


def test_seen_and_unseen_are_paired():
    pairs = summaries.seen_and_unseen(benchmark.VARIANTS)
    assert len(pairs) == 8  # align-rope and packing-shapes-unseen have no partner
    assert ("put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors") in pairs
    assert ("packing-google-objects-seq-seen", "packing-google-objects-seq-unseen") in pairs


def test_a_rival_is_better_if_its_paired_difference_is_wholly_above():
    own = summaries.scores([row("gem", "a", [0.0] * 20 + [1.0] * 10)], "gem", 10)["a"]
    rivals = {
        "better": summaries.scores([row("x", "a", [1.0] * 30)], "x", 10)["a"],
        "same": own,
        "a little": summaries.scores([row("y", "a", [0.0] * 19 + [1.0] * 11)], "y", 10)["a"],
    }
    assert summaries.better_rivals(own, rivals) == ["better"]


def test_leads_are_marks_that_are_filled_where_the_interval_is_clear_of_0():
    rows = [row("gem", "clear", [1.0] * 20), row("x", "clear", [0.0] * 20)]
    rows += [row("gem", "unclear", [1.0, 0.0] * 10), row("x", "unclear", [0.0, 1.0] * 10)]
    own, rival = (summaries.scores(rows, name, demos=10) for name in ("gem", "x"))
    leads = {task: results.paired_difference(own[task], rival[task]) for task in own}
    figure = plot_benchmark.show_leads({"x": leads, "itself": {"clear": leads["unclear"]}}, "gem minus it")
    marks = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 1 and line.get_marker() in "os"]
    assert [mark.get_xdata()[0] for mark in marks if mark.get_xdata()[0] is not None] == [100, 0, 0]
    assert [mark.get_markerfacecolor() == "white" for mark in marks] == [False, True, True]
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["clear", "unclear"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["x", "itself"]
    assert figure.axes[0].get_xlabel() == "gem minus it"
    plt.close(figure)


def test_seen_beside_unseen_has_a_panel_for_each_method_and_its_mean():
    panels = {"gem": {"a": (100.0, 90.0), "b": (80.0, 50.0)}, "x": {"a": (60.0, 10.0)}}
    figure = plot_benchmark.show_seen_unseen(panels)
    assert [axes.get_title() for axes in figure.axes] == ["gem\n2 pairs of tasks", "x\n1 pairs of tasks"]
    thick = [line.get_ydata().tolist() for axes in figure.axes for line in axes.lines if line.get_linewidth() == 3]
    assert thick == [[90, 70], [60, 10]]
    plt.close(figure)
