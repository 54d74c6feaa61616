"""Means of rewards with 95 % intervals that are valid near 0 and near 100 too, and differences of two methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

INTERVAL = "Gaffke"
"""The name of the intervals over episodes, as rows of results store it."""
TAIL = 0.025
"""How often the mean may lie below an interval, and how often above it."""
DRAWS = 20_000
"""Random draws of a weighted mean."""
BLOCK = 128
"""Episodes whose weights are drawn at once, so that memory does not grow with their number."""


def bounded_interval(
    values: ArrayLike, low: float, high: float, weights: ArrayLike | None = None
) -> tuple[float, float]:  # fmt: skip
    """Gaffke's 95 % interval for the mean of a variable in [``low``, ``high``], from independent draws of it.

    Each value gets a random weight; all weights together are uniform on the simplex. One more value, the
    worst possible one, gets a weight too: ``low`` for the lower bound, ``high`` for the upper one. The bounds
    are the 2.5 % and the 97.5 % quantile of the weighted mean, from `DRAWS` draws: two runs give the same bounds,
    which are within 0.1 % of the exact ones. A larger value never makes a bound smaller. If all values are
    ``low`` or ``high``, this is the interval of Clopper and Pearson, which is computed exactly.

    Sources: Gaffke, "Three test statistics for a nonparametric one-sided hypothesis on the mean of a
    nonnegative variable" (Mathematical Methods of Statistics, 2005); Learned-Miller and Thomas, "A New
    Confidence Interval for the Mean of a Bounded Random Variable" (arXiv:1905.06208). That it covers the mean
    in 95 % is proven for two values and conjectured for all; the tests check it by simulation.

    The draws may be of several variables, such as the rewards of several tasks. Then the interval is for the mean of
    their means. It is rather too wide, since it counts the differences between the variables as chance. For values of
    0 and 1 with one weight, this is proven (Hoeffding, Annals of Mathematical Statistics, 1956).

    Args:
        values: (episodes,).
        weights: (episodes,), above 0, if not every value counts the same: the interval is for the weighted mean. The
            worst possible value gets the largest weight, as in Fay and Feuer (Statistics in Medicine, 1997).

    Raises:
        ValueError: ``values`` has another shape, is empty or lies outside [``low``, ``high``].
    """
    values = np.asarray(values, float)
    if values.ndim != 1 or not values.size:
        raise ValueError(f"values must be of the shape (episodes,) with at least one episode, got {values.shape}")
    if not (values.min() >= low and values.max() <= high):  # NaN is refused as well
        raise ValueError(f"values must lie in [{low}, {high}], got {values.min()} to {values.max()}")
    weights = np.ones(len(values)) if weights is None else np.asarray(weights, float) / np.max(weights)
    order = np.lexsort((weights, values))
    values = values[order]
    weights = weights[order]
    lower = None
    upper = None
    if weights.min() == 1:
        lower = _two_valued(np.append(values, low), TAIL)
        upper = _two_valued(np.append(values, high), 1 - TAIL)
    if lower is None or upper is None:
        below, above = _weighted_means(values, weights, low, high)
        lower = float(np.quantile(below, TAIL)) if lower is None else lower
        upper = float(np.quantile(above, 1 - TAIL)) if upper is None else upper
    return lower, upper


def _two_valued(values: np.ndarray, level: float) -> float | None:
    """The exact quantile of the weighted mean of at most two different values; None if there are more."""
    different, counts = np.unique(values, return_counts=True)
    if len(different) > 2:
        return None
    if len(different) == 1:
        return float(different[0])
    share = stats.beta.ppf(level, counts[1], counts[0])
    return float(different[0] + (different[1] - different[0]) * share)


def _weighted_means(
    values: np.ndarray, weights: np.ndarray, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Draws (`DRAWS`,) of the weighted mean: with ``low``, and with ``high`` as the additional value."""
    rng = np.random.default_rng(0)
    additional = rng.standard_exponential(DRAWS)
    weight = additional.copy()
    total = np.zeros(DRAWS)
    for first in range(0, len(values), BLOCK):
        block = slice(first, first + BLOCK)
        # Exponential weights, divided by their sum, are uniform on the simplex.
        drawn = rng.standard_exponential((len(values[block]), DRAWS))
        total += (weights[block] * values[block]) @ drawn
        weight += weights[block] @ drawn
    return (total + low * additional) / weight, (total + high * additional) / weight


def seed_half_width(*methods: np.ndarray) -> float:
    """Half the width of Welch's 95 % interval over the training seeds' means, of one method or of a difference of two.

    A method with a single seed adds nothing, since it shows no spread of seeds.

    Args:
        methods: each (training seeds, episodes).
    """
    seed_means = [rewards.mean(axis=1) for rewards in methods if len(rewards) > 1]
    variances = np.array([means.var(ddof=1) / len(means) for means in seed_means])
    if variances.sum() == 0:
        return 0.0
    freedom = np.array([len(means) - 1 for means in seed_means])
    degrees = variances.sum() ** 2 / (variances**2 / freedom).sum()
    return float(stats.t.ppf(1 - TAIL, degrees) * np.sqrt(variances.sum()))


def _checked(name: str, rewards: ArrayLike) -> np.ndarray:
    """The rewards of an argument, (training seeds, episodes). Raises ValueError for another shape or other values."""
    rewards = np.atleast_2d(np.asarray(rewards, float))
    if rewards.ndim != 2 or not rewards.size:
        raise ValueError(
            f"{name} must be of the shape (episodes,) or (training seeds, episodes) and not empty, "
            f"got the shape {rewards.shape}"
        )
    if not (rewards.min() >= 0 and rewards.max() <= 1):  # NaN is refused as well
        raise ValueError(f"{name} must lie in [0, 1], got {rewards.min()} to {rewards.max()}")
    return rewards


def widened(mean: float, ends: tuple[float, float], half_width: float) -> tuple[float, float]:
    """An interval around ``mean``, widened by an independent half width on both sides: the squares add up."""
    return mean - float(np.hypot(mean - ends[0], half_width)), mean + float(np.hypot(ends[1] - mean, half_width))


def percent(share: float) -> float:
    """0-100, rounded to 0.1; never minus zero."""
    return round(100 * share, 1) + 0.0


def mean_and_interval(rewards: ArrayLike) -> tuple[float, tuple[float, float]]:
    """Mean (0-100) of rewards in [0, 1] and its 95 % interval, both rounded to 0.1.

    One training seed: `bounded_interval` over the episodes. It says nothing about other seeds.
    Several seeds: that interval for the seeds' mean reward in each episode, widened by Student's interval
    for the seeds' mean over all episodes (`seed_half_width`). The squares of the two parts add up on each side, as
    in Zou and Donner, "Construction of confidence limits about effect measures: a general approach"
    (Statistics in Medicine, 2008). Chance that belongs to one seed in one episode counts in both parts, so
    that the interval is rather too wide. Two or three equal seeds show no spread, which does not mean that
    there is none.

    Args:
        rewards: (episodes,), or (training seeds, episodes) of the same episodes.

    Raises:
        ValueError: ``rewards`` has another shape, is empty or lies outside [0, 1].
    """
    rewards = _checked("rewards", rewards)
    mean = float(rewards.mean())
    low, high = widened(mean, bounded_interval(rewards.mean(axis=0), 0.0, 1.0), seed_half_width(rewards))
    return percent(mean), (percent(max(low, 0.0)), percent(min(high, 1.0)))


@dataclass(frozen=True)
class Difference:
    """How much higher one method scored than another on the same episodes.

    Attributes:
        mean, interval: of the difference (-100 to 100), with 95 %.
        seeds: how many training seeds each method has. The interval holds the seeds' spread of a method only
            if it has several.
    """

    mean: float
    interval: tuple[float, float]
    seeds: tuple[int, int]

    def __str__(self) -> str:
        text = f"{self.mean:+.1f} [{self.interval[0]:+.1f}, {self.interval[1]:+.1f}]"
        if self.seeds == (1, 1):
            return f"{text}, one training seed each"
        return f"{text}, {self.seeds[0]} and {self.seeds[1]} training seeds"


def paired_difference(first: ArrayLike, second: ArrayLike) -> Difference:
    """The mean of ``first`` minus ``second`` with its 95 % interval.

    Where both methods fail in the same episodes, this interval is narrower than that of two separate samples. Where
    they do not, pairing gains nothing. The interval is that of `mean_and_interval`: `bounded_interval` over the
    episodes' differences, which lie in [-1, 1], widened by the seeds' (`seed_half_width`). The seeds of two methods
    are not paired.

    Args:
        first, second: rewards in [0, 1], (episodes,) or (training seeds, episodes), of the same episodes in the
            same order.

    Raises:
        ValueError: a wrong shape, rewards outside [0, 1], or different numbers of episodes.
    """
    first_rewards = _checked("first", first)
    second_rewards = _checked("second", second)
    counts = first_rewards.shape[1], second_rewards.shape[1]
    if counts[0] != counts[1]:
        raise ValueError(f"first and second must be of the same episodes, got {counts[0]} and {counts[1]}")
    differences = first_rewards.mean(axis=0) - second_rewards.mean(axis=0)
    mean = float(differences.mean())
    low, high = widened(mean, bounded_interval(differences, -1.0, 1.0), seed_half_width(first_rewards, second_rewards))
    interval = (percent(max(low, -1.0)), percent(min(high, 1.0)))
    return Difference(percent(mean), interval, (len(first_rewards), len(second_rewards)))
