"""The clock that the scripts of this folder share."""

import time
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def seconds(work: Callable[[], Result], repeats: int) -> tuple[float, Result]:
    """The fastest of some runs, and what the last one returned."""
    found = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        found.append(time.perf_counter() - start)
    return min(found), result
