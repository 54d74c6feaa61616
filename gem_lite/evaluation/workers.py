"""Episodes on several processes, a few in a row on each."""

from __future__ import annotations

import itertools
import multiprocessing
import os
from collections.abc import Callable, Collection, Sequence
from typing import TypeVar

import numpy as np
import torch
from tqdm import tqdm

from gem_lite import registry

CHUNK = 5
"""Episodes that one worker runs in a row; fixed, so that results do not depend on the number of cores."""
Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


def chunks(start: int, episodes: int, skip: Collection[int] = ()) -> list[list[int]]:
    """The first indices from ``start`` on that are not in ``skip``, in groups of `CHUNK`.

    Args:
        episodes: the number of indices.

    Raises:
        ValueError: ``episodes`` is below 1.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    indices = list(itertools.islice((index for index in itertools.count(start) if index not in skip), episodes))
    return [indices[i : i + CHUNK] for i in range(0, episodes, CHUNK)]


def run_jobs(
    run: Callable[[Job], list[Outcome]], jobs: Sequence[Job], reward: Callable[[Outcome], float], label: str,
    episodes: int, processes: int | None = None,
) -> list[Outcome]:  # fmt: skip
    """The outcomes of all jobs, in their order, with a progress bar.

    Each process first imports every module that has registered something here (`registry.modules`), so that it knows
    tasks, methods and tools from outside the library, too. A notebook's cell is no module: the processes do not know
    what it registers.

    Args:
        run: does one job; it must be a function of a module.
        jobs: the arguments of ``run``, each for a part of the episodes.
        reward: gives an outcome's reward, for the running mean.
        label: the progress bar's text.
        episodes: the number of all episodes.
        processes: how many run at once; by default as many as there are cores.
    """
    count = min(processes or os.cpu_count() or 1, len(jobs))
    context = multiprocessing.get_context("spawn")
    outcomes: list[Outcome] = []
    with (
        context.Pool(count, _start, (registry.modules(),)) as pool,
        tqdm(total=episodes, desc=label, unit="episode") as bar,
    ):
        for part in pool.imap(run, jobs):
            outcomes += part
            bar.update(len(part))
            bar.set_postfix(mean=f"{100 * np.mean([reward(outcome) for outcome in outcomes]):.1f}")
    return outcomes


def _start(modules: tuple[str, ...]) -> None:
    torch.set_num_threads(1)
    registry.load(modules)
