"""Every training and measurement behind the results of the lessons, as one list that can be run again.

An experiment is one training and the tasks it is measured on. Each runs in a process of its own on one
core, as many side by side as there are cores; what was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from gem_lite import clip, evaluate, methods, pointing
from gem_lite.config import ABLATIONS, LITE
from gem_lite.tabletop import tasks

FOLDER = Path("runs/experiments")
BOWL, PYRAMID, PACKING = "put-block-in-bowl-seen-colors", "stack-block-pyramid-seq-seen-colors", "packing-shapes-seen"
INSERTION, BARS = "block-insertion", "bars-in-box"


@dataclass(frozen=True)
class Experiment:
    """A method trained on the first ``demos`` demonstrations of a task, then measured.

    Attributes:
        method: see `methods.NAMES`, `evaluate.SCRIPTED` and `pointing.METHOD`; the latter two are not trained.
        episodes: test episodes of the task, and as many of its unseen variant if it has one.
        steps: of the training.
    """

    method: str
    task: str
    demos: int = 10
    seed: int = 0
    episodes: int = 100
    steps: int = LITE.steps

    @property
    def scripted(self) -> bool:
        """Whether there is nothing to train."""
        return self.method in (*evaluate.SCRIPTED, pointing.METHOD)

    @property
    def family(self) -> str:
        """The task's name without the set of its words."""
        return evaluate.results_file(self.task).stem

    @property
    def name(self) -> str:
        """Names the experiment's files."""
        trained = f"-{self.demos}-{self.seed}" + (f"-{self.steps}" if self.steps != LITE.steps else "")
        return f"{self.method}-{self.family}" + ("" if self.scripted else trained)

    @property
    def measured_on(self) -> tuple[str, ...]:
        """The task itself and its unseen variant."""
        unseen = self.task.replace("-seen", "-unseen")
        return tuple(name for name in tasks.NAMES if name in (self.task, unseen))

    @property
    def checkpoint(self) -> Path:
        """Where its policy is kept: GEM's from ten demonstrations, with seed 0, are shipped."""
        if (self.method, self.demos, self.seed, self.steps) == ("gem", 10, 0, LITE.steps):
            return clip.DATA / f"gem-{self.family}.safetensors"
        return FOLDER / f"{self.name}.safetensors"

    def done(self) -> bool:
        """Whether every row is filed."""
        cell = {"method": self.method, "split": "test", "start": 0, "subset": "all"}
        cell |= {} if self.scripted else {"demos": self.demos, "seed": self.seed, "steps": self.steps}
        rows = [row for row in evaluate.read_rows(evaluate.results_file(self.task)) if cell.items() <= row.items()]
        return {row["task"] for row in rows if row["episodes"] >= self.episodes} >= set(self.measured_on)

    def commands(self) -> list[list[str]]:
        """What has to run, one after the other: arguments of ``python -m``."""
        found, out = [], ["--out", str(self.rows)]
        if self.method == pointing.METHOD:
            count = str(self.episodes)
            return [["gem_lite.pointing", "--task", task, "--scenes", count, *out] for task in self.measured_on]
        if not self.scripted and not self.checkpoint.exists():
            found.append(
                ["gem_lite.train", str(demonstrations_of(self.task)), str(self.checkpoint), "--method", self.method,
                 "--episodes", str(self.demos), "--seed", str(self.seed), "--steps", str(self.steps),
                 "--run", str(FOLDER / "state" / self.name)]
            )  # fmt: skip
        measure = [] if self.scripted else ["--checkpoint", str(self.checkpoint)]
        measure += ["--episodes", str(self.episodes), "--processes", "1", *out]
        return found + [["gem_lite.evaluate", self.method, task, *measure] for task in self.measured_on]

    @property
    def rows(self) -> Path:
        """Its rows, until they are filed with all others."""
        return FOLDER / "rows" / f"{self.name}.jsonl"


TRUE_COLORS = tuple(f"{method}-without-recoloring" for method in ("gem", "cliport", "cliport-grounded"))
"""Methods trained on true colours, with the paper's augmentation alone."""
RIVALS = ("cliport", "cliport-grounded", "transporter-lan")
SHORT = 300
"""Steps of a training that validation episodes preferred for a single demonstration."""
PLAN = (
    *(Experiment("gem", task) for task in (BOWL, INSERTION, BARS, PYRAMID, PACKING)),
    *(Experiment("gem", BOWL, demos) for demos in (1, 5, 20)),
    *(Experiment(method, BOWL, demos) for method in RIVALS for demos in (10, 100, 1)),
    Experiment("gem", INSERTION, 1),
    *(Experiment(f"gem-{ending}", INSERTION, demos, episodes=50) for ending, demos in (
        ("without-steerable-kernel", 10), ("with-free-kernels", 10), ("with-free-kernels", 1))),
    *(Experiment(method, BOWL, seed=seed) for seed in (1, 2) for method in methods.METHODS),
    *(Experiment(method, BOWL, 1, steps=SHORT) for method in methods.METHODS),
    *(Experiment(method, BOWL) for method in TRUE_COLORS),
    *(Experiment(f"gem-{ending}", BOWL, episodes=50) for ending in ABLATIONS if f"gem-{ending}" not in TRUE_COLORS),
    Experiment(pointing.METHOD, PACKING),
    *(Experiment("expert-rounded", task) for task in (INSERTION, BARS, PYRAMID, PACKING)),
    *(Experiment(method, BOWL) for method in evaluate.SCRIPTED),
)  # fmt: skip
"""The comparison, in the order in which it runs."""


def demonstrations_of(task: str) -> Path:
    """The folder of a task's demonstrations; as many as the largest experiment needs."""
    return FOLDER / "demos" / task


def run(experiment: Experiment) -> list[dict]:
    """Train and measure in other processes, on one core; returns the rows.

    Raises:
        RuntimeError: a process failed; the message names its log.
    """
    log = FOLDER / "logs" / f"{experiment.name}.log"
    for path in (log, experiment.rows):
        path.parent.mkdir(parents=True, exist_ok=True)
    with log.open("a") as out:
        for command in experiment.commands():
            ended = subprocess.run(
                [sys.executable, "-m", *command], stdout=out, stderr=out, env={**os.environ, "OMP_NUM_THREADS": "1"}
            )
            if ended.returncode:
                raise RuntimeError(f"{experiment.name} ended with code {ended.returncode}; see {log}")
    return evaluate.read_rows(experiment.rows)


def collect(plan: Sequence[Experiment]) -> None:
    """Collect the demonstrations that ``plan`` needs and that are not there."""
    needed: dict[str, int] = {}
    for experiment in plan:
        if not experiment.scripted:
            needed[experiment.task] = max(experiment.demos, needed.get(experiment.task, 0))
    for task, count in needed.items():
        folder = demonstrations_of(task)
        if not folder.exists() or len(list(folder.glob("*.npz"))) < count:
            command = ["gem_lite.demonstrations", "collect", task, str(folder), "--episodes", str(count)]
            subprocess.run([sys.executable, "-m", *command], check=True)


def main() -> None:
    """Command line: see ``python -m gem_lite.experiments --help``."""
    parser = argparse.ArgumentParser(
        description="Train and measure the whole comparison; experiments whose rows are filed are left out.",
        epilog="examples:\n  python -m gem_lite.experiments --list\n  python -m gem_lite.experiments --only cliport",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", default="", help="only experiments whose name holds this")
    parser.add_argument("--list", action="store_true", help="show what there is, and do nothing")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="how many at once (default: one a core)")
    args = parser.parse_args()
    plan = [experiment for experiment in PLAN if args.only in experiment.name]
    if args.list:
        for experiment in plan:
            print(f"{'filed' if experiment.done() else 'to do':6s} {experiment.name}, {experiment.episodes} episodes")
        return
    plan = [experiment for experiment in plan if not experiment.done()]
    failed = []
    try:
        collect(plan)
    except subprocess.CalledProcessError as error:
        parser.exit(2, f"collecting demonstrations failed: {error}\n")
    with ThreadPoolExecutor(args.jobs) as pool, tqdm(total=len(plan), desc="experiments") as bar:
        running = {pool.submit(run, experiment): experiment for experiment in plan}
        for ended in as_completed(running):
            try:
                rows = ended.result()
            except RuntimeError as error:
                failed.append(str(error))
                bar.write(str(error))
            else:
                evaluate.file_rows(rows, evaluate.results_file(running[ended].task))
                for row in rows:
                    bar.write("{method} on {task}, {subset}: {mean} {ci95}, {episodes} episodes".format(**row))
            bar.update()
    if failed:
        parser.exit(1, f"{len(failed)} experiments failed; the same command tries them again\n")


if __name__ == "__main__":
    main()
