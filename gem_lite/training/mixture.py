"""Several tasks as one training set: every task is drawn equally often, whatever the number of its steps."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Sequence
from typing import TypeVar, overload

import numpy as np
from typing_extensions import override

from gem_lite.policies.inputs import PreparedStep

T = TypeVar("T")


class Joined(Sequence[T]):
    """Several sequences one after the other. Nothing is copied.

    Attributes:
        parts: the sequences.

    Raises:
        ValueError: there is no part, or an empty one.
    """

    def __init__(self, parts: Sequence[Sequence[T]]) -> None:
        lengths = [len(part) for part in parts]
        if not lengths or 0 in lengths:
            raise ValueError(f"parts must be at least one sequence, and none of them empty, got the lengths {lengths}")
        self.parts = tuple(parts)
        self._ends = list(itertools.accumulate(lengths))

    def __len__(self) -> int:
        return self._ends[-1]

    @overload
    def __getitem__(self, index: int) -> T: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...

    @override
    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = range(len(self))[index]
        part = bisect.bisect_right(self._ends, number)
        return self.parts[part][number - self._ends[part]]


def draw(steps: Sequence[PreparedStep], rng: np.random.Generator) -> PreparedStep:
    """A random step. Of `Joined` steps, each part has the same chance."""
    if isinstance(steps, Joined):
        steps = steps.parts[rng.integers(len(steps.parts))]
    return steps[rng.integers(len(steps))]
