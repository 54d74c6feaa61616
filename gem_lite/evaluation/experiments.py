"""Every training and measurement behind the results of the lessons, as one list that can be run again.

An experiment is one training and the tasks on which its policy is measured. Each runs in its own process on one core,
and several run at once. A training that was stopped goes on where it stopped.
"""

from __future__ import annotations

import functools
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from gem_lite import clip, tasks
from gem_lite.config import Config
from gem_lite.evaluation import evaluate, pointing, results
from gem_lite.policies import methods
from gem_lite.policies.checkpoints import read_card
from gem_lite.policies.gem_config import ABLATIONS, LITE

FOLDER = Path("runs/experiments")
GEM_LITE = (sys.executable, "-m", "gem_lite.cli")
"""The command `gem-lite` of this environment."""
BOWL, PYRAMID, PACKING = "put-block-in-bowl-seen-colors", "stack-block-pyramid-seq-seen-colors", "packing-shapes-seen"
INSERTION, BARS = "block-insertion", "bars-in-box"


DEMONSTRATIONS_WORLD = "varied"
"""The world in which the comparison's demonstrations are collected."""


@functools.cache
def _embedded_fingerprint() -> str:
    return clip.load().fingerprint


@dataclass(frozen=True)
class Experiment:
    """A method trained on the first ``demos`` demonstrations of a task, then measured in the world "home".

    Attributes:
        method: see `methods.meanings`, `evaluate.SCRIPTED` and `pointing.METHOD`; the latter two are not trained.
        episodes: test episodes of the task, and as many of its unseen variant if it has one.
        steps: of the training.
        demonstrations_world: the world in which the demonstrations are collected.
    """

    method: str
    task: str
    demos: int = 10
    seed: int = 0
    episodes: int = 100
    steps: int = LITE.steps
    demonstrations_world: str = DEMONSTRATIONS_WORLD

    @property
    def scripted(self) -> bool:
        """Whether the method needs no training."""
        return self.method in (*evaluate.SCRIPTED, pointing.METHOD)

    @property
    def family(self) -> str:
        """The task's name without the set of its words."""
        return tasks.family(self.task)

    @property
    def name(self) -> str:
        """Names the experiment's files."""
        if self.scripted:
            return f"{self.method}-{self.family}"
        steps = f"-{self.steps}" if self.steps != LITE.steps else ""
        world = f"-{self.demonstrations_world}" if self.demonstrations_world != DEMONSTRATIONS_WORLD else ""
        return f"{self.method}-{self.family}-{self.demos}-{self.seed}{steps}{world}"

    @property
    def measured_on(self) -> tuple[str, ...]:
        """All variants of its task: they differ in the words of test episodes alone."""
        return tasks.variants(self.family)

    @property
    def shipped(self) -> bool:
        """Whether its policy is shipped in data: GEM from ten demonstrations, with seed 0."""
        return self == Experiment("gem", self.task, episodes=self.episodes)

    @property
    def checkpoint(self) -> Path:
        """The file of its policy."""
        return clip.DATA / f"gem-{self.family}.safetensors" if self.shipped else FOLDER / f"{self.name}.safetensors"

    @property
    def config(self) -> Config | None:
        """Its configuration; None if the method does not depend on one."""
        if self.method == "expert":
            return None
        if self.method == pointing.METHOD:
            return LITE
        if self.scripted:
            return evaluate.settings_of(self.task, "test")
        _, settings = methods.find(self.method)
        return evaluate.settings_of(self.task, "test", replace(settings, steps=self.steps))

    def training(self) -> dict:
        """The entries on the training that its rows and its checkpoint's card must have."""
        if self.scripted:
            fingerprint = _embedded_fingerprint() if self.method == pointing.METHOD else None
            hashed = self.config.digest if self.config else None
            return {"config_hash": hashed, "clip_fingerprint": fingerprint}
        return {
            "config_hash": self.config.digest, "clip_fingerprint": _embedded_fingerprint(), "demos": self.demos,
            "seed": self.seed, "demonstrations_world": self.demonstrations_world,
        }  # fmt: skip

    def done(self) -> bool:
        """Whether every row of this training is filed; if the checkpoint exists, the rows must be its own."""
        required = {"method": self.method, "subset": "all", "world": "home", "split": "test", "start": 0}
        required |= self.training()
        if not self.scripted and self.checkpoint.with_suffix(".json").exists():
            required["checkpoint_sha256"] = read_card(self.checkpoint)["sha256"]
        rows = [row for row in results.read_rows(results.results_file(self.task)) if required.items() <= row.items()]
        return {row["task"] for row in rows if row["episodes"] >= self.episodes} >= set(self.measured_on)

    def check_checkpoint(self) -> None:
        """Raises RuntimeError if the checkpoint's file comes from another training."""
        card = read_card(self.checkpoint)
        facts = {"method": card["method"]} | results.facts_of(card, methods.of_card(card)[1])
        required = {"method": self.method} | self.training()
        differences = [f"{key} is {facts[key]}, not {value}" for key, value in required.items() if facts[key] != value]
        if differences:
            raise RuntimeError(
                f"{self.checkpoint} comes from another training than {self.name} ({'; '.join(differences)}): "
                "move it away, so that it is trained anew"
            )

    def commands(self) -> list[list[str]]:
        """The commands to run, one after the other, as arguments of ``gem-lite``.

        Raises:
            RuntimeError: its checkpoint comes from another training.
        """
        out_option = ["--out", str(self.rows)]
        count = str(self.episodes)
        if self.method == pointing.METHOD:
            return [["pointing", "--task", task, "--scenes", count, *out_option] for task in self.measured_on]
        train_commands = []
        measure = ["--episodes", count, "--processes", "1", *out_option]
        if not self.scripted:
            measure = ["--checkpoint", str(self.checkpoint), *measure]
            if self.checkpoint.exists():
                self.check_checkpoint()
            else:
                folder = demonstrations_of(self.task, self.demonstrations_world)
                train_commands.append(
                    ["train", str(folder), str(self.checkpoint), "--method", self.method,
                     "--episodes", str(self.demos), "--seed", str(self.seed), "--config.steps", str(self.steps),
                     "--state", str(FOLDER / "state" / self.name)]
                )  # fmt: skip
        return train_commands + [["evaluate", self.method, task, *measure] for task in self.measured_on]

    @property
    def rows(self) -> Path:
        """The file of its rows, until they are filed with all others."""
        return FOLDER / "rows" / f"{self.name}.jsonl"


TRUE_COLORS = tuple(f"{method}-without-recoloring" for method in ("gem", "cliport", "cliport-grounded"))
"""Methods that train on true colours, with the paper's augmentation only."""
RIVALS = ("cliport", "cliport-grounded", "transporter-lan")
ANGLE_RIVALS = ("transporter-lan", "cliport")
"""Rivals that are measured on block insertion, where the place angle decides."""
SHORT = 300
"""Training steps for a single demonstration, chosen on validation episodes."""
COMPARED = ("gem", "transporter-lan", "cliport", "cliport-grounded")
"""The methods that lesson 08 compares."""
PLAN = (
    *(Experiment("gem", task) for task in (BOWL, INSERTION, BARS, PYRAMID, PACKING)),
    *(Experiment("gem", BOWL, demos) for demos in (1, 5, 20)),
    *(Experiment(method, BOWL, demos) for method in RIVALS for demos in (10, 100, 1)),
    # Where the place angle decides: three seeds at ten demonstrations.
    *(Experiment(method, INSERTION, seed=seed) for seed in (0, 1, 2) for method in ANGLE_RIVALS),
    *(Experiment("gem", INSERTION, seed=seed) for seed in (1, 2)),
    *(Experiment(method, INSERTION, 100) for method in ("gem", *ANGLE_RIVALS)),
    Experiment("gem", INSERTION, 1),
    *(Experiment(f"gem-{ending}", INSERTION, demos, episodes=50) for ending, demos in (
        ("without-steerable-kernel", 10), ("with-free-kernels", 10), ("with-free-kernels", 1),
        ("without-rotation-augmentation", 10))),
    *(Experiment(f"gem-{ending}", BARS, episodes=50) for ending in (
        "without-rotation-augmentation", "with-free-kernels")),
    *(Experiment(method, BOWL, seed=seed) for seed in (1, 2) for method in COMPARED),
    *(Experiment(method, BOWL, 1, steps=SHORT) for method in COMPARED),
    *(Experiment(method, BOWL) for method in TRUE_COLORS),
    *(Experiment(f"gem-{ending}", BOWL, episodes=50) for ending in ABLATIONS if f"gem-{ending}" not in TRUE_COLORS),
    Experiment(pointing.METHOD, PACKING),
    *(Experiment("expert-rounded", task) for task in (INSERTION, BARS, PYRAMID, PACKING)),
    *(Experiment(method, BOWL) for method in evaluate.SCRIPTED),
)  # fmt: skip
"""The comparison, in the order in which it runs."""


def demonstrations_of(task: str, world: str) -> Path:
    """The folder of a task's demonstrations in a world."""
    return FOLDER / "demos" / f"{task}-{world}"


def run(experiment: Experiment) -> list[dict]:
    """Train and measure in other processes, on one core, and return the rows.

    Raises:
        RuntimeError: its checkpoint comes from another training, or a process failed; the message names its log.
    """
    commands = experiment.commands()
    log = FOLDER / "logs" / f"{experiment.name}.log"
    for path in (log, experiment.rows):
        path.parent.mkdir(parents=True, exist_ok=True)
    experiment.rows.unlink(missing_ok=True)  # Rows of an earlier run may be of another training.
    with log.open("a") as out:
        for command in commands:
            process = subprocess.run(
                [*GEM_LITE, *command], stdout=out, stderr=out, env={**os.environ, "OMP_NUM_THREADS": "1"}
            )
            if process.returncode:
                raise RuntimeError(f"{experiment.name} ended with code {process.returncode}; see {log}")
    return results.read_rows(experiment.rows)


def collect(plan: Sequence[Experiment]) -> None:
    """Collect the demonstrations that ``plan`` needs and that do not exist yet."""
    counts: dict[tuple[str, str], int] = {}
    for experiment in plan:
        if not experiment.scripted:
            key = (experiment.task, experiment.demonstrations_world)
            counts[key] = max(experiment.demos, counts.get(key, 0))
    for (task, world), count in counts.items():
        folder = demonstrations_of(task, world)
        if not folder.exists() or len(list(folder.glob("*.npz"))) < count:
            command = ["collect", task, str(folder), "--episodes", str(count), "--world", world]
            subprocess.run([*GEM_LITE, *command], check=True)


def run_all(plan: Sequence[Experiment], jobs: int) -> None:
    """Run the experiments of ``plan`` that are not filed, ``jobs`` at once, and file their rows; prints each row.

    Raises:
        RuntimeError: demonstrations could not be collected, or experiments failed; the others are filed.
    """
    plan = [experiment for experiment in plan if not experiment.done()]
    try:
        collect(plan)
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"collecting demonstrations failed: {error}") from error
    failed = 0
    with ThreadPoolExecutor(jobs) as pool, tqdm(total=len(plan), desc="experiments") as bar:
        running = {pool.submit(run, experiment): experiment for experiment in plan}
        for future in as_completed(running):
            try:
                rows = future.result()
                results.file_rows(rows, results.results_file(running[future].task))
            except (OSError, RuntimeError, ValueError) as error:
                failed += 1
                bar.write(str(error))
            else:
                for row in rows:
                    bar.write("{method} on {task}, {subset}: {mean} {ci95}, {episodes} episodes".format(**row))
            bar.update()
    if failed:
        raise RuntimeError(f"{failed} experiments failed; the same command tries them again")
