"""The benchmark as cells: which policy is measured on which task, and how the files of both are named.

A plan is the content of workflow/benchmark.yaml. Snakemake (workflow/Snakefile) turns it into demonstrations, policies
and rows. The name of each file holds a hash of everything in the plan that decides its content, and not of the program.
So a row that exists belongs to its cell, in a fresh clone too. A policy that is lost and trained anew need not be the
same, on another machine or by another version: `check_policy` and `check_checkpoints` refuse to mix the two.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gem_lite import clip, tasks
from gem_lite.config import MULTI_TASK, Config
from gem_lite.evaluation import actors, results
from gem_lite.policies import methods
from gem_lite.simulation.task import SOLVED
from gem_lite.simulation.worlds import HOME

ROWS = results.RESULTS / "benchmark"
"""The folder of the rows: one file for each cell."""
VARIANTS = (
    "align-rope", "assembling-kits-seq-seen-colors", "assembling-kits-seq-unseen-colors",
    "packing-box-pairs-seen-colors", "packing-box-pairs-unseen-colors", "packing-google-objects-seq-seen",
    "packing-google-objects-seq-unseen", "packing-google-objects-group-seen", "packing-google-objects-group-unseen",
    "packing-shapes-unseen", "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors",
    "separating-piles-seen-colors", "separating-piles-unseen-colors", "stack-block-pyramid-seq-seen-colors",
    "stack-block-pyramid-seq-unseen-colors", "towers-of-hanoi-seq-seen-colors", "towers-of-hanoi-seq-unseen-colors",
)  # fmt: skip
"""The paper's eighteen tasks (A.10); its packing-unseen-shapes is our packing-shapes-unseen."""
WORLD = "varied"
"""The world in which the demonstrations are collected."""
ENTRIES = ("families", "ours", "multi", "tiers", "search", "settings", "longer", "skipped")
"""The entries of a plan."""
MIXED = {("cliport-multi", 10)}
"""Methods and numbers of demonstrations whose rows are known to be of two policies. They are being measured again."""
DIGITS = 12
"""Hexadecimal digits of a hash in a file's name."""


@dataclass(frozen=True)
class Training:
    """One training of a method.

    Attributes:
        method: the name of the method, with its endings.
        tasks: the tasks of the demonstrations; several for a method with the ending "multi".
        demos: the number of demonstrations of each task.
        seed: of the weights and of the batches.
        steps, learning_rate: those of the configuration, if they are None.
        clip_fingerprint: of the CLIP.
    """

    method: str
    tasks: tuple[str, ...]
    demos: int
    seed: int = 0
    steps: int | None = None
    learning_rate: float | None = None
    clip_fingerprint: str = ""

    @property
    def config(self) -> Config:
        """The configuration of the training."""
        config = methods.find(self.method)[1]
        changes = {"steps": self.steps, "learning_rate": self.learning_rate}
        return replace(config, **{name: value for name, value in changes.items() if value is not None})

    @property
    def digest(self) -> str:
        """A hash of everything that decides the weights, except for the program."""
        return _digest(asdict(self) | {"config": self.config.as_dict(), "world": WORLD})

    @property
    def name(self) -> str:
        """The name of its checkpoint, without a folder and an ending."""
        task = self.tasks[0] if len(self.tasks) == 1 else "all"
        return f"{self.method}-{task}-{self.demos}-{self.seed}-{self.digest}"


@dataclass(frozen=True)
class Cell:
    """One row of the benchmark: a policy, or a scripted method, on episodes of a task.

    Attributes:
        method: the name of the method.
        task: the task of the episodes.
        training: None for a scripted method.
        split, episodes: the first episodes of this split.
        skipped: the indices of test episodes that are left out, since the expert does not solve them.
        preset: of the configuration of a scripted method.
        world: of the episodes.
    """

    method: str
    task: str
    training: Training | None = None
    split: tasks.Split = "test"
    episodes: int = 50
    preset: str = "lite"
    skipped: tuple[int, ...] = ()
    world: str = HOME.name

    @property
    def name(self) -> str:
        """The name of the file of its row, without a folder and an ending."""
        entries = [self.method]
        if self.world != HOME.name:
            entries.append(self.world)
        if self.training:
            entries += [str(self.training.demos), str(self.training.seed)]
        elif self.preset != "lite":
            entries.append(self.preset)
        facts = {name: value for name, value in asdict(self).items() if name != "training"}
        trained = self.training.digest if self.training else None
        return "-".join([*entries, self.split, _digest(facts | {"training": trained})])

    @property
    def file(self) -> Path:
        """The file of its row."""
        return ROWS / self.task / f"{self.name}.jsonl"

    def row(self) -> dict | None:
        """Its row, or None if it is not measured yet. A row over a subset of the episodes is not meant."""
        rows = [row for row in results.read_rows(self.file) if row["subset"] == "all"]
        return rows[0] if rows else None


def stored_rows() -> list[dict]:
    """The rows of all cells that are measured, whatever the plan says now, sorted by task and file."""
    return [row for path in sorted(ROWS.glob("*/*.jsonl")) for row in results.read_rows(path)]


def check_checkpoints(rows: Iterable[Mapping[str, Any]]) -> None:
    """Check that all rows of one method, number of demonstrations, training seed and data are of one checkpoint.

    A policy for several tasks has one set of data. A policy for one task has one for its family, or for its variant.
    Methods that differ by rules of acting alone have one policy (`methods.trained`).
    On validation episodes, the trials of a search count as different policies.

    Raises:
        ValueError: rows are of two checkpoints, and the method with this number is not among `MIXED`.
    """
    checkpoints: dict[tuple, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        if row["checkpoint_sha256"] is None or (row["method"], row["demos"]) in MIXED:
            continue
        trial = None if row["split"] == "test" else row["config_hash"]
        facts = ("demos", "seed", "data_sha256", "clip_fingerprint", "config")
        policy = (methods.trained(row["method"]), *(row[name] for name in facts), trial)
        checkpoints.setdefault(policy, {}).setdefault(row["checkpoint_sha256"], row)
    for (method, demos, seed, *_), by_checkpoint in checkpoints.items():
        if len(by_checkpoint) > 1:
            named = ", ".join(f"{sha[:12]} on {row['task']}" for sha, row in by_checkpoint.items())
            raise ValueError(
                f"the rows of {method} with {demos} demonstrations and the training seed {seed} are of several "
                f"policies, {named}: remove the rows of all but one, and measure them again with this one"
            )


def check_policy(cell: Cell, cells: Iterable[Cell], policies: Path) -> None:
    """Check that a cell would be measured with the policy of which the other cells of its training are filed.

    Args:
        cells: all cells of the plan.
        policies: the folder of the checkpoints.

    Raises:
        ValueError: other cells are filed, and the checkpoint is missing, so that a policy would be trained anew, or it
            is another one.
    """
    filed = {}
    for other in cells:
        row = other.row() if other.training == cell.training and other != cell else None
        if row:
            filed[row["checkpoint_sha256"]] = other.file
    if cell.training is None or not filed:
        return
    path = policies / f"{cell.training.name}.safetensors"
    present = hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None
    if set(filed) != {present}:
        state = "is another one" if present else "is missing and would be trained anew"
        rows = ", ".join(f"{sha[:12]} of {file}" for sha, file in filed.items())
        raise ValueError(
            f"{cell.name} on {cell.task}: its policy {path} {state}, but other rows of this training are of the "
            f"checkpoints {rows}: bring this checkpoint back, or remove all rows of this training to measure them anew"
        )


def _digest(facts: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:DIGITS]


class Plan:
    """The cells of a plan.

    Attributes:
        families: for each task of demonstrations, the tasks on which its policy is measured.
        ours: the tasks that are not the paper's.
        several: the tasks of the demonstrations of a method with the ending "multi".
        longer: by task of demonstrations, how many times as long every method is trained on it.
        skipped: by task, the indices of the test episodes that the expert does not solve.

    Args:
        content: of workflow/benchmark.yaml.
        clip_name: the argument of `clip.load`.

    Raises:
        ValueError: an entry is missing, or names a method or a task that is unknown.
    """

    def __init__(self, content: Mapping[str, Any], clip_name: str | None = None) -> None:
        missing = [name for name in ENTRIES if name not in content]
        if missing:
            raise ValueError(f"the plan lacks {', '.join(missing)}")
        self.families: dict[str, tuple[str, ...]] = {
            name: tuple(measured) for name, measured in content["families"].items()
        }
        self.ours = tuple(content["ours"])
        self.several = tuple(content["multi"])
        self.skipped: dict[str, tuple[int, ...]] = {
            name: tuple(indices) for name, indices in content["skipped"].items()
        }
        self.longer: dict[str, int] = dict(content["longer"])
        named = itertools.chain(*self.families.values(), self.families, self.several, self.longer, self.skipped)
        for name in named:
            tasks.family(name)
        self._content = content
        self._clip = clip.load(clip_name).fingerprint

    @property
    def variants(self) -> tuple[str, ...]:
        """The paper's tasks, in the order of the plan."""
        return tuple(task for task in itertools.chain(*self.families.values()) if task not in self.ours)

    def tier(self, name: str) -> list[Cell]:
        """The test cells of a tier, each once. Raises ValueError if the plan has no such tier."""
        tiers = self._content["tiers"]
        if name not in tiers:
            raise ValueError(f"tier must be one of {', '.join(tiers)}, got {name!r}")
        return list(dict.fromkeys(cell for group in tiers[name] for cell in self._cells(group)))

    def search(self) -> list[Cell]:
        """The cells on validation episodes that choose the settings of the methods: every trial of every method."""
        search = self._content["search"]
        cells = []
        for method, task, trial in itertools.product(search["methods"], search["tasks"], search["trials"]):
            training = Training(method, (task,), search["demos"], clip_fingerprint=self._clip, **trial)
            cells.append(Cell(method, task, training, "val", search["episodes"]))
        return cells

    def trainings(self, cells: Iterable[Cell]) -> list[Training]:
        """The trainings of cells, each once."""
        return list(dict.fromkeys(cell.training for cell in cells if cell.training))

    def _cells(self, group: Mapping[str, Any]) -> Iterator[Cell]:
        """The cells of one entry of a tier: all combinations of its methods, tasks, demos, seeds and worlds."""
        wanted = {"paper": self.variants, "all": (*self.variants, *self.ours)}.get(str(group["tasks"]))
        wanted = wanted or tuple(group["tasks"])
        episodes = group.get("episodes", 50)
        for method in group["methods"]:
            if method in actors.SCRIPTED:
                for preset, task in itertools.product(group.get("presets", ["lite"]), wanted):
                    # The expert itself decides which episodes are skipped.
                    skipped = () if method == "expert" else self.skipped.get(task, ())
                    yield Cell(method, task, episodes=episodes, preset=preset, skipped=skipped)
                continue
            seeds = group.get("seeds", [0])
            named = group.get("worlds", [HOME.name])
            for demos, seed, task, world in itertools.product(group["demos"], seeds, wanted, named):
                # A method that differs from another by rules of acting alone has the other's policy.
                training = self._training(methods.trained(method), task, demos, seed, group.get("steps"))
                skipped = self.skipped.get(task, ())
                yield Cell(method, task, training, episodes=episodes, skipped=skipped, world=world)

    def _training(self, method: str, task: str, demos: int, seed: int, steps: int | None) -> Training:
        """The training of a cell. ``steps`` takes the place of the number that the search chose."""
        name, endings = methods.split(method)
        settings = dict(self._content["settings"].get(name, {}))
        if steps is not None:
            settings["steps"] = steps
        if MULTI_TASK in endings:
            steps = settings.get("steps", methods.find(method)[1].steps)
            settings["steps"] = steps * len(self.several)  # as many for each task as in the training on one task
            return Training(method, self.several, demos, seed, clip_fingerprint=self._clip, **settings)
        trained = [source for source, measured in self.families.items() if task in measured]
        if not trained:
            raise ValueError(f"no family of the plan has the task {task!r}")
        if steps is None and trained[0] in self.longer:
            steps = settings.get("steps", methods.find(method)[1].steps)
            settings["steps"] = steps * self.longer[trained[0]]
        return Training(method, (trained[0],), demos, seed, clip_fingerprint=self._clip, **settings)


def unsolved(cell: Cell) -> tuple[int, ...]:
    """The indices of the episodes of the expert's cell that it does not solve. The plan's ``skipped`` holds them.

    Raises:
        LookupError: the cell is not measured yet.
    """
    row = cell.row()
    if row is None:
        raise LookupError(f"the expert's row on {cell.task} is not measured yet: {cell.file}")
    return tuple(sorted(int(index) for index, reward in row["rewards"].items() if reward <= SOLVED))


def chosen(trials: Sequence[Cell], method: str) -> dict[str, Any]:
    """The best trial of a method's search: its steps and learning rate, by the mean over the tasks.

    Raises:
        LookupError: a trial is not measured yet.
    """
    means: dict[tuple, list[float]] = {}
    for cell in trials:
        if cell.method != method or cell.training is None:
            continue
        row = cell.row()
        if row is None:
            raise LookupError(f"the trial {cell.name} of {method} on {cell.task} is not measured yet")
        means.setdefault((cell.training.steps, cell.training.learning_rate), []).append(row["mean"])
    steps, rate = max(means, key=lambda trial: sum(means[trial]) / len(means[trial]))
    return {"steps": steps, "learning_rate": rate}
