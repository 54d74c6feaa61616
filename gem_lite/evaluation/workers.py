"""Processes that measure side by side, one a core."""

from __future__ import annotations

import importlib
import multiprocessing
import os
from collections.abc import Sequence
from multiprocessing.pool import Pool


def pool(jobs: int, processes: int | None = None, imports: Sequence[str] = ()) -> Pool:
    """Fresh processes, at most one a job.

    Args:
        processes: how many at most; None means one a core.
        imports: modules outside the package that register tasks, methods or others: each process imports them.

    Raises:
        ModuleNotFoundError: no such module.
    """
    _import_all(imports)  # Errors surface here, not in a worker.
    count = min(processes or os.cpu_count() or 1, jobs)
    return multiprocessing.get_context("spawn").Pool(count, _import_all, (tuple(imports),))


def _import_all(modules: Sequence[str]) -> None:
    for module in modules:
        importlib.import_module(module)
