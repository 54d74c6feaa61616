import itertools
import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
import summaries
import whole_benchmark
from drawings import plot_scores
from summaries import Score

from gem_lite import tasks
from gem_lite.evaluation import results, statistics

SEEN, UNSEEN = "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors"
ROPE, PILES = "align-rope", "separating-piles-seen-colors"


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


def score(rewards, episodes=None):
    """A score of rewards (episodes,) or (training seeds, episodes)."""
    rewards = np.atleast_2d(np.asarray(rewards, float))
    mean, interval = statistics.mean_and_interval(rewards)
    return Score(rewards, mean, interval, None, tuple(episodes or range(rewards.shape[1])))


def test_a_mean_counts_every_task_once_and_layouts_of_a_family_as_one():
    ones, halves = [1.0] * 10, [1.0] * 5 + [0.0] * 5
    mean, (low, high) = summaries.mean_over_tasks({SEEN: score(ones), UNSEEN: score(halves), ROPE: score([0.5] * 10)})
    assert mean == 66.7 and low < mean < high
    # Rewards that fail in the same layouts tell less than those that fail in different ones, or in two families.
    together, apart = statistics.mean_and_interval(halves), statistics.mean_and_interval([0.5] * 10)
    assert summaries.mean_over_tasks({SEEN: score(halves), ROPE: score(halves)}) == statistics.mean_and_interval(
        halves * 2
    )
    for other, expected in (
        (score(halves), together),
        (score(halves[::-1]), apart),
        # The variants skipped other episodes: the first five are shared, and the last five.
        (score(halves, [0, 1, 2, 3, 4, 10, 11, 12, 13, 14]), together),
        (score(halves, range(5, 15)), apart),
    ):
        assert summaries.mean_over_tasks({SEEN: score(halves), UNSEEN: other}) == expected


def test_a_mean_difference_is_paired_and_may_be_negative():
    rng = np.random.default_rng(1)
    first = {task: score(rng.random(40) < 0.3) for task in (SEEN, UNSEEN, ROPE)}
    second = {task: score(rng.random(40) < 0.9) for task in (SEEN, UNSEEN, ROPE, PILES)}
    found = summaries.mean_difference(first, second)
    assert found.mean == pytest.approx(100 * np.mean([first[t].rewards - second[t].rewards for t in first]), abs=0.051)
    assert found.interval[0] < found.mean < found.interval[1] < 0 and found.seeds == (1, 1)
    same = summaries.mean_difference(first, first)
    assert same.mean == 0 and same.interval[1] < 7 and same.interval[1] == pytest.approx(-same.interval[0], abs=0.2)
    one = summaries.mean_difference({ROPE: first[ROPE]}, second)
    assert one.interval == pytest.approx(summaries.paired_difference(first[ROPE], second[ROPE]).interval, abs=0.2)


def test_training_seeds_widen_a_mean():
    rng = np.random.default_rng(2)
    widths = []
    for chances in (np.array([[0.9], [0.6], [0.3]]), 0.6):
        of_tasks = {task: score(rng.random((3, 40)) < chances) for task in (SEEN, ROPE)}
        _, (low, high) = summaries.mean_over_tasks(of_tasks)
        widths.append(high - low)
    assert widths[0] > 3 * widths[1]


def test_what_makes_no_mean_is_refused():
    one, two = score([1.0]), score([1.0, 1.0])
    for of_tasks, said in (
        ({}, "at least one task"),
        ({SEEN: one, UNSEEN: two}, r"put-block-in-bowl must have the same number of episodes, got \[1, 2\]"),
        ({"elsewhere": one}, "no task is named 'elsewhere'"),
        ({SEEN: score([[1.0], [1.0]]), ROPE: one}, "must have the same number of training seeds"),
    ):
        with pytest.raises(ValueError, match=said):
            summaries.mean_over_tasks(of_tasks)
    for second, said in (
        ({}, "second must hold the tasks of first, at least one, got none of align-rope"),
        ({ROPE: two}, f"of the same episodes of {ROPE}"),
    ):
        with pytest.raises(ValueError, match=said):
            summaries.mean_difference({ROPE: one}, second)


FAMILIES = (("assembling-kits-seq-seen-colors", "assembling-kits-seq-unseen-colors"), (SEEN, UNSEEN), (PILES,), (ROPE,))
REPEATS = 600
ALLOWED = 0.025 + 2.5 * math.sqrt(0.025 * 0.975 / REPEATS)
"""The share of the simulations in which the truth may lie beyond one end: 2.5 %, and what chance adds."""
TASKS = [task for family in FAMILIES for task in family]
CEILING = dict.fromkeys(TASKS, 0.985)
MIXED = dict(zip(TASKS, (0.99, 0.98, 0.6, 0.3, 0.99, 0.95), strict=True))


def drawn(rng, chances, parts, shared, episodes=20):
    """Scores of all tasks of `FAMILIES`, with correlated variants.

    Args:
        chances: by the task, of a full episode. Another one gets 0, 1/parts ... of the reward.
        shared: the share of layouts in which all variants of a family have the same outcome.
    """
    scores = {}
    for family in FAMILIES:
        common = rng.random(episodes), rng.integers(0, parts, episodes) / parts
        both = rng.random(episodes) < shared
        for task in family:
            own = rng.random(episodes), rng.integers(0, parts, episodes) / parts
            chance, partial = (np.where(both, *pair) for pair in zip(common, own, strict=True))
            scores[task] = score(np.where(chance < chances[task], 1.0, partial))
    return scores


def truth(chances, parts):
    """The mean over tasks (0-100) of what `drawn` draws."""
    return 100 * np.mean([chance + (1 - chance) * (parts - 1) / (2 * parts) for chance in chances.values()])


@pytest.mark.release
@pytest.mark.parametrize(
    ("chances", "worse", "parts", "shared"),
    [(CEILING, None, 1, 0.0), (CEILING, None, 1, 0.86), (CEILING, None, 5, 0.86), (MIXED, None, 5, 0.86),
     (CEILING, CEILING, 5, 0.86), (CEILING, MIXED, 1, 0.86)],
)  # fmt: skip
def test_neither_end_of_a_mean_or_of_a_difference_is_passed_too_often(monkeypatch, chances, worse, parts, shared):
    # Simulations need no sharp quantiles, and no interval of each task.
    monkeypatch.setattr(statistics, "DRAWS", 1000)
    monkeypatch.setattr(statistics, "mean_and_interval", lambda _: (0.0, (0.0, 0.0)))
    rng = np.random.default_rng(0 if worse is None else 1)
    true = truth(chances, parts) - (truth(worse, parts) if worse else 0)
    found = []
    for _ in range(REPEATS):
        scores = drawn(rng, chances, parts, shared)
        if worse is None:
            found.append(summaries.mean_over_tasks(scores))
        else:
            difference = summaries.mean_difference(scores, drawn(rng, worse, parts, shared))
            found.append((difference.mean, difference.interval))
    assert np.mean([mean for mean, _ in found]) == pytest.approx(true, abs=0.5)
    assert np.mean([low > true + 0.05 for _, (low, _) in found]) <= ALLOWED
    assert np.mean([high < true - 0.05 for _, (_, high) in found]) <= ALLOWED


def layout(world, task, index):
    """Where the bodies lie at the beginning of a test episode."""
    world.begin(tasks.make(task, "test"), tasks.episode_seed("test", index))
    poses = (world.pose(body)[0] for body in world.bodies)
    return {(round(pose.x, 4), round(pose.y, 4)) for pose in poses}


def test_variants_of_a_family_are_paired_and_share_layouts_and_families_do_not(world):
    pairs = whole_benchmark.seen_and_unseen(tasks.PAPER)
    assert len(pairs) == 8  # align-rope and packing-shapes-unseen have no partner
    assert {(SEEN, UNSEEN), ("packing-google-objects-seq-seen", "packing-google-objects-seq-unseen")} < set(pairs)
    assert all(tasks.family(seen) == tasks.family(unseen) for seen, unseen in pairs)
    layouts = {task: layout(world, task, 3) for task in tasks.PAPER}
    same = {pair for pair in itertools.combinations(tasks.PAPER, 2) if layouts[pair[0]] == layouts[pair[1]]}
    assert same == {pair for pair in pairs if "google" not in pair[0]} and len(same) == 6
    # The everyday objects of both variants are others, around a box that is the same.
    assert all(layouts[seen] & layouts[unseen] for seen, unseen in pairs)


def test_every_row_finds_its_table():
    rows = [
        *ROWS, row("gem-without-image-map", "b", [1.0] * 10), row("gem-multi", "b", [1.0] * 10),
        row("cliport", "b", [0.0] * 10, demos=100),
    ]  # fmt: skip
    tables = {
        name: {(one["method"], one["task"], one["demos"], one["seed"]) for one in chosen}
        for name, chosen in whole_benchmark.table_rows(rows).items()
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


def test_a_rival_is_better_if_its_paired_difference_is_wholly_above():
    own = score([0.0] * 20 + [1.0] * 10)
    rivals = {"better": score([1.0] * 30), "same": own, "a little": score([0.0] * 19 + [1.0] * 11)}
    assert whole_benchmark.better_rivals(own, rivals) == ["better"]


def test_leads_are_marks_that_are_filled_where_the_interval_is_clear_of_0():
    clear = summaries.paired_difference(score([1.0] * 20), score([0.0] * 20))
    unclear = summaries.paired_difference(score([1.0, 0.0] * 10), score([0.0, 1.0] * 10))
    figure = plot_scores.show_leads({"x": {"clear": clear, "unclear": unclear}, "itself": {"clear": unclear}}, "minus")
    marks = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 1 and line.get_marker() in "os"]
    assert [mark.get_xdata()[0] for mark in marks if mark.get_xdata()[0] is not None] == [100, 0, 0]
    assert [mark.get_markerfacecolor() == "white" for mark in marks] == [False, True, True]
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["clear", "unclear"]
    plt.close(figure)
