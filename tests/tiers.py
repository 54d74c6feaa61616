"""Which parameters of a long test `make test` takes, and which `make release` alone."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def for_a_release(values: Iterable[Any], is_long: Callable[[Any], bool]) -> list[Any]:
    """The parameters of a test, those that are long with the mark release. A tuple holds several arguments."""

    def parameter(value: Any) -> Any:
        if not is_long(value):
            return value
        return pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.release)

    return [parameter(value) for value in values]
