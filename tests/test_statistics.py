"""Intervals: they cover what they should, near 0 and near 100 too. All simulations are seeded."""

import itertools

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from gem_lite.evaluation import statistics
from gem_lite.evaluation.statistics import bounded_interval, mean_and_interval, paired_difference

LEAST = 0.93
"""The coverage that simulations must show, of 0.95."""


@pytest.fixture
def few_draws(monkeypatch):
    """Simulations need no sharp quantiles."""
    monkeypatch.setattr(statistics, "DRAWS", 1000)


def covered(interval, value):
    """Whether the rounded interval (0-100) holds the value (0-1)."""
    return interval[0] - 0.05 <= 100 * value <= interval[1] + 0.05


def rewards_of(rng, mean, parts, shape=(100,)):
    """Rewards 0, 1/parts, ..., 1 of a given mean: 1 or, in the failing share of episodes, less."""
    full = 1 - 2 * parts / (parts + 1) * (1 - mean)  # a failure loses (parts + 1) / (2 parts) on average
    return np.where(rng.random(shape) < full, 1.0, rng.integers(0, parts, shape) / parts)


def drawn_seeds(rng, level, of_seeds, count, hard):
    """(count, 100) rewards of 0 and 1 of several training seeds, in episodes that are more or less ``hard``."""
    return (rng.random((count, 100)) < expit(level + of_seeds * rng.normal(size=(count, 1)) + hard)).astype(float)


@pytest.mark.parametrize("parts", [1, 3, 6])
@pytest.mark.parametrize("mean", [0.5, 0.9, 0.98, 1.0])
def test_intervals_cover_the_mean(few_draws, mean, parts):
    rng = np.random.default_rng(0)
    drawn = [rewards_of(rng, mean, parts) for _ in range(400)]
    assert np.mean(drawn) == pytest.approx(mean, abs=0.01)
    assert np.mean([covered(mean_and_interval(rewards)[1], mean) for rewards in drawn]) >= LEAST


def test_intervals_of_zero_and_one_are_clopper_and_pearson():
    for successes in (0, 1, 50, 98, 99, 100):
        exact = stats.binomtest(successes, 100).proportion_ci(method="exact")
        found = bounded_interval([1.0] * successes + [0.0] * (100 - successes), 0, 1)
        assert found == pytest.approx((exact.low, exact.high))
    assert mean_and_interval([1.0] * 99 + [0.0]) == (99.0, (94.6, 100.0))
    assert mean_and_interval([1.0] * 98 + [0.0] * 2) == (98.0, (93.0, 99.8))
    assert mean_and_interval([0.0] * 32) == (0.0, (0.0, 10.9))
    # A value just beside 0 has no exact branch; its interval is that of 0 itself.
    exact = bounded_interval([1.0] * 95 + [0.0] * 5, 0, 1)
    assert bounded_interval([1.0] * 95 + [0.0] * 4 + [1e-9], 0, 1) == pytest.approx(exact, abs=1e-3)


def test_a_better_episode_never_gives_a_worse_bound():
    for episodes in (10, 100):
        rewards = np.ones(episodes)
        ends = [mean_and_interval(rewards)[1]]
        for index, worse in ((3, 5 / 6), (3, 4 / 6), (3, 0.0), (5, 0.5)):
            rewards[index] = worse
            ends.append(mean_and_interval(rewards)[1])
        assert all(after[0] <= before[0] and after[1] <= before[1] for before, after in itertools.pairwise(ends))
        assert ends[-1][0] < ends[-2][0] < ends[0][0]


def test_intervals_hold_the_mean_shrink_and_repeat():
    rng = np.random.default_rng(0)
    widths = []
    for rewards in (rewards_of(rng, 0.8, 3, episodes) for episodes in (10, 1000)):
        mean, (low, high) = mean_and_interval(rewards)
        assert low < mean < high and (mean, (low, high)) == mean_and_interval(rewards)
        widths.append(high - low)
    assert widths[1] < widths[0] / 5


@pytest.mark.parametrize(("level", "of_seeds"), [(0.0, 0.5), (0.0, 0.0), (2.0, 0.5), (5.0, 0.5)])
def test_several_seeds_cover_the_mean_over_all_seeds_and_episodes(few_draws, level, of_seeds):
    rng = np.random.default_rng(1)
    mean = expit(level + np.hypot(of_seeds, 1.5) * rng.normal(size=200_000)).mean()
    hits = 0
    for _ in range(250):
        rewards = drawn_seeds(rng, level, of_seeds, 3, 1.5 * rng.normal(size=(1, 100)))
        hits += covered(mean_and_interval(rewards)[1], mean)
    assert hits / 250 >= LEAST


def test_a_failing_seed_widens_and_no_failure_is_best():
    ones = np.ones((3, 100))
    assert mean_and_interval(ones) == (100.0, (96.4, 100.0))  # three seeds of the same episodes are no 300 episodes
    once, apart, spread = ones.copy(), ones.copy(), ones.copy()
    once[1, 7] = 0
    assert mean_and_interval(once)[1][0] < 96.4
    apart[0, :30] = 0  # one seed fails in 30 episodes; below, three seeds fail in 10
    spread[:, :10] = 0
    assert mean_and_interval(apart)[0] == mean_and_interval(spread)[0] == 90.0
    assert mean_and_interval(apart)[1][0] < mean_and_interval(spread)[1][0] - 5


@pytest.mark.parametrize(("one", "other"), [(6.0, 6.0), (4.0, 2.0), (1.0, 0.0), (0.0, 5.0)])
@pytest.mark.parametrize(("seeds", "of_seeds"), [((1, 1), 0.0), ((3, 3), 0.4), ((3, 2), 0.4)])
def test_paired_differences_cover_the_difference(few_draws, one, other, seeds, of_seeds):
    rng = np.random.default_rng(2)
    of_all = np.hypot(of_seeds, 1.5) * rng.normal(size=200_000)
    difference = expit(one + of_all).mean() - expit(other + of_all).mean()
    hits = 0
    for _ in range(120):
        hard = 1.5 * rng.normal(size=(1, 100))
        rewards = [drawn_seeds(rng, level, of_seeds, n, hard) for level, n in zip((one, other), seeds, strict=True)]
        hits += covered(paired_difference(*rewards).interval, difference)
    assert hits / 120 >= LEAST


def test_partial_rewards_of_pairs_are_covered_near_the_ceiling(few_draws):
    rng = np.random.default_rng(3)
    found = [paired_difference(rewards_of(rng, 0.98, 6), rewards_of(rng, 0.9, 6)).interval for _ in range(250)]
    assert np.mean([covered(interval, 0.08) for interval in found]) >= LEAST


def test_differences_say_how_many_seeds_they_know():
    found = paired_difference(np.ones(50), np.ones(50))
    assert str(found) == "+0.0 [-7.1, +7.1], one training seed each"  # equal successes leave it open
    rng = np.random.default_rng(0)
    three, one = rewards_of(rng, 0.9, 1, (3, 100)), rewards_of(rng, 0.8, 1)
    found = paired_difference(three, one)
    assert found.seeds == (3, 1) and str(found).endswith("], 3 and 1 training seeds")
    assert found.mean == pytest.approx(100 * (three.mean() - one.mean()), abs=0.051)
    # Seeds that disagree widen the difference, as many seeds that agree do not.
    agreeing = np.repeat(three.mean(axis=0, keepdims=True), 3, axis=0)
    narrow, wide = (paired_difference(rewards, one).interval for rewards in (agreeing, three))
    assert wide[1] - wide[0] > narrow[1] - narrow[0]
    flipped = paired_difference(one, three)
    low, high = found.interval
    assert flipped.mean == -found.mean and flipped.interval == pytest.approx((-high, -low), abs=0.3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([[]], r"shape \(episodes,\) or \(training seeds, episodes\).*got the shape \(1, 0\)"),
        ([[[[1.0]]]], r"got the shape \(1, 1, 1\)"),
        ([[1.0, 1.0], [1.0, 1.0, 1.0]], "of the same episodes, got 2 and 3"),
        *(([[0.5, wrong]], "must lie in") for wrong in (1.5, -0.1, float("nan"))),
        *(([[0.5, 0.5], [0.5, wrong]], "second must lie in") for wrong in (1.5, -0.1, float("nan"))),
    ],
)
def test_what_makes_no_interval_is_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        (mean_and_interval if len(arguments) == 1 else paired_difference)(*arguments)
