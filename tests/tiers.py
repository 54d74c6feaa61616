"""Which parameters of a long test `make test` takes, and which `make release` alone."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def for_a_release(values: Iterable[Any], is_long: Callable[[Any], bool]) -> list[Any]:
    """The parameters of a test, those that are long with the mark release. A tuple holds several arguments."""
    marked = [pytest.param(*(v if isinstance(v, tuple) else (v,)), marks=pytest.mark.release) for v in values]
    return [mark if is_long(value) else value for value, mark in zip(values, marked, strict=True)]
