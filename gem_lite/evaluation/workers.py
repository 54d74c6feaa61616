"""Episodes or scenes on several processes, a few in a row on each."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import threading
from collections.abc import Callable, Collection, Sequence
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol, TypeVar

import numpy as np
import torch
from tqdm import tqdm

from gem_lite.foundations import registry

CHUNK = 5
"""Episodes or scenes that one worker runs in a row; fixed, so that results do not depend on the number of cores."""
Outcome = TypeVar("Outcome")


class Job(Protocol):
    """A part of the episodes or scenes: their ``indices``, and whatever else a process needs to run them."""

    @property
    def indices(self) -> Sequence[int]:
        """The indices of the episodes or scenes."""


AnyJob = TypeVar("AnyJob", bound=Job)


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
    run: Callable[[AnyJob], list[Outcome]], jobs: Sequence[AnyJob], label: str,
    reward: Callable[[Outcome], float] | None = None, processes: int | None = None, unit: str = "episode",
) -> list[Outcome]:  # fmt: skip
    """The outcomes of all jobs, in their order, with a progress bar.

    Each process first imports every module that has registered something here (`registry.modules`), so that it knows
    tasks, methods and tools from outside the library, too. A notebook's cell is no module: the processes do not know
    what it registers.

    Args:
        run: does one job; it must be a function of a module.
        jobs: the arguments of ``run``, each for a part of the episodes.
        label: the progress bar's text.
        reward: gives an outcome's reward, for the running mean; None if outcomes have no reward.
        processes: how many run at once; by default as many as there are cores.
        unit: what an index counts.

    Raises:
        ChildProcessError: a process was killed, such as for lack of memory. The message names the episodes that were
            being run. If outcomes have rewards, those that were complete are printed.
    """
    count = min(processes or os.cpu_count() or 1, len(jobs))
    waiting = list(enumerate(jobs))
    running: dict[futures.Future[list[Outcome]], int] = {}
    done: dict[int, list[Outcome]] = {}
    context = multiprocessing.get_context("spawn")
    pool = futures.ProcessPoolExecutor(count, context, _start, (registry.modules(),))
    bar = tqdm(total=sum(len(job.indices) for job in jobs), desc=label, unit=unit)
    with pool, bar:
        try:
            while waiting or running:
                while waiting and len(running) < count:  # no more, so that it is known which ones are being run
                    number, job = waiting.pop(0)
                    running[pool.submit(run, job)] = number
                ended = futures.wait(running, return_when=futures.FIRST_COMPLETED).done
                for future in sorted(ended, key=lambda future: future.exception() is not None):  # good ones first
                    done[running[future]] = future.result()
                    bar.update(len(jobs[running.pop(future)].indices))
                if reward is not None:
                    measured = [reward(outcome) for part in done.values() for outcome in part]
                    bar.set_postfix(mean=f"{100 * np.mean(measured):.1f}")
        except BrokenProcessPool as error:
            lost = sorted(index for number in running.values() for index in jobs[number].indices)
            message = (
                f"{label}: a process was killed (is the memory too small?) while the {unit}s "
                f"{', '.join(map(str, lost))} were being run; nothing is filed"
            )
            if reward is not None:
                for number in sorted(done):
                    print(*done[number], sep="\n")
                complete = sum(len(jobs[number].indices) for number in done)
                message += f", and the outcomes of the {complete} {unit}s that were complete are printed"
            raise ChildProcessError(message) from error
    return [outcome for number in sorted(done) for outcome in done[number]]


def _start(modules: tuple[str, ...]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    torch.set_num_threads(1)
    registry.load(modules)


def _end_with_parent() -> None:
    """Without this, a process would wait for its next job for ever after its parent was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
