"""The benchmark as cells: which policy is measured on which task, and which columns its row has.

A plan is the content of plan.yaml. Snakemake (the Snakefile beside it) turns it into demonstrations, policies and rows.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from gem_lite import clip, tasks
from gem_lite.config import MULTI_TASK, Config
from gem_lite.evaluation import actors, results
from gem_lite.policies import methods
from gem_lite.simulation.environment import SOLVED
from gem_lite.simulation.looks import HOME

FILE = Path(__file__).with_name("plan.yaml")
"""The plan."""
OURS = ("block-insertion", "bars-in-box", "packing-shapes-seen")
"""Tasks that are not the paper's (`tasks.PAPER`). In the first two, the place's or the pick's angle decides. The third
is the paper's training task, which it does not measure."""
WORLD = "varied"
"""The world in which the demonstrations are collected, apart from those of `REAL_TABLE`."""
REAL_TABLE = "real-table"
"""The world of the tasks `tasks.REAL_TABLE`, for demonstrations and for tests."""
ENTRIES = ("demonstrations", "multi", "tiers", "search", "wider_search", "settings", "longer", "skipped")
"""The entries of a plan."""
IDENTITY = tuple(name for name in results.IDENTITY if name not in ("data_sha256", "checkpoint_sha256"))
"""The entries that identify a row of the benchmark. A row of a policy that is trained anew replaces the old one."""


def collection_world(task: str) -> str:
    """The world in which a task's demonstrations are collected."""
    return REAL_TABLE if task in tasks.REAL_TABLE else WORLD


@dataclass(frozen=True)
class Training:
    """One training of a method.

    Attributes:
        method: the name of the method, with its endings.
        tasks: the tasks of the demonstrations; several for a method with the ending "multi".
        demos: the number of demonstrations of each task.
        seed: of the weights and of the batches.
        steps, learning_rate: of the configuration.
        clip_name, clip_fingerprint: of the CLIP; the embedded one has no name here.
    """

    method: str
    tasks: tuple[str, ...]
    demos: int
    seed: int
    steps: int
    learning_rate: float
    clip_name: str
    clip_fingerprint: str

    @property
    def config(self) -> Config:
        """The configuration of the training."""
        return replace(methods.find(self.method)[1], steps=self.steps, learning_rate=self.learning_rate)

    @property
    def facts(self) -> str:
        """The number of demonstrations, and what a training adds to it, for the names of files."""
        model = re.sub(r"\W+", "-", self.clip_name.lower()).strip("-")
        facts = f"demos-{self.demos}-seed-{self.seed}-steps-{self.steps}-rate-{self.learning_rate}"
        return f"{facts}-{model}" if model else facts

    @property
    def name(self) -> str:
        """The name of its checkpoint, without a folder and an ending."""
        several = "real-tables" if self.tasks[0] in tasks.REAL_TABLE else "all"
        task = self.tasks[0] if len(self.tasks) == 1 else several
        return f"{self.method}-{task}-{self.facts}"


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
    def columns(self) -> dict[str, Any]:
        """The columns by which its row is known, with its values of them."""
        columns = {
            "method": self.method, "task": self.task, "subset": "all", "world": self.world, "split": self.split,
            "start": 0, "skipped": list(self.skipped),
        }  # fmt: skip
        if self.training is None:
            config = None if self.method == "expert" else self.preset
            return columns | {"demos": None, "seed": None, "steps": None, "config": config}
        config = self.training.config
        for ending in methods.split(self.method)[1]:  # a rule of acting that is switched off is not in the training
            config = config.ablated(ending)
        world = collection_world(self.training.tasks[0])
        task = tasks.make(self.task, self.split)
        config = config.for_table(task.workspace.limits, task.scale)
        return columns | {
            "demos": self.training.demos, "seed": self.training.seed, "steps": config.steps,
            "learning_rate": config.learning_rate, "config": config.name, "config_hash": config.digest,
            "clip_fingerprint": self.training.clip_fingerprint, "demonstrations_world": world,
        }  # fmt: skip

    @property
    def name(self) -> str:
        """The name of the file into which it is measured, without a folder and an ending."""
        facts = self.training.facts if self.training else self.preset
        skipped = ["without", *map(str, self.skipped)] if self.skipped else []
        return "-".join([self.method, self.task, self.world, facts, self.split, str(self.episodes), *skipped])

    def row(self) -> dict | None:
        """Its row in the table of its task, over at least as many episodes; None if it is not measured yet."""
        columns = self.columns.items()
        rows = results.read_rows(results.benchmark_file(self.task))
        return next((row for row in rows if columns <= row.items() and row["episodes"] >= self.episodes), None)


class Plan:
    """The cells of a plan.

    Attributes:
        several: the tasks of the demonstrations of a method with the ending "multi", but for real tables.
        skipped: by task, the indices of the test episodes that the expert does not solve.

    Args:
        content: of plan.yaml.
        clip_name: the argument of `clip.load`.

    Raises:
        ValueError: an entry is missing, or names a method or a task that is unknown.
    """

    def __init__(self, content: Mapping[str, Any], clip_name: str | None = None) -> None:
        missing = [name for name in ENTRIES if name not in content]
        if missing:
            raise ValueError(f"the plan lacks {', '.join(missing)}")
        self.several = tuple(content["multi"])
        self.skipped: dict[str, tuple[int, ...]] = {
            name: tuple(indices) for name, indices in content["skipped"].items()
        }
        self._shared: dict[str, str] = content["demonstrations"]
        named = (self._shared, self._shared.values(), self.several, content["longer"], self.skipped)
        for name in itertools.chain(*named):
            tasks.family(name)
        self._content = content
        self._clip = {"clip_name": clip_name or "", "clip_fingerprint": clip.load(clip_name).fingerprint}

    @classmethod
    def load(cls, clip_name: str | None = None) -> Plan:
        """The plan of plan.yaml."""
        return cls(yaml.safe_load(FILE.read_text()), clip_name)

    def tier(self, name: str) -> list[Cell]:
        """The cells of a tier, each once; of test episodes, where a group names no other split.

        Raises:
            ValueError: the plan has no such tier.
        """
        tiers = self._content["tiers"]
        if name not in tiers:
            raise ValueError(f"tier must be one of {', '.join(tiers)}, got {name!r}")
        return list(dict.fromkeys(cell for group in tiers[name] for cell in self._cells(group)))

    def search(self, entry: str = "search") -> list[Cell]:
        """The cells on validation episodes of a search for the settings of the methods: every trial of every method.

        Args:
            entry: "search", which chooses the settings, or "wider_search".
        """
        search = self._content[entry]
        cells = []
        for method, task, trial in itertools.product(search["methods"], search["tasks"], search["trials"]):
            training = Training(method, (task,), search["demos"], seed=0, **trial, **self._clip)
            cells.append(Cell(method, task, training, "val", search["episodes"]))
        return cells

    def _cells(self, group: Mapping[str, Any]) -> Iterator[Cell]:
        """The cells of one entry of a tier: all combinations of its methods, tasks, demos, seeds and worlds."""
        sets = {"paper": tasks.PAPER, "all": (*tasks.PAPER, *OURS), "real-table": tasks.REAL_TABLE}
        wanted = sets.get(str(group["tasks"])) or group["tasks"]
        episodes = group.get("episodes", 50)
        split = group.get("split", "test")
        named = group.get("worlds", [HOME.name])
        for method in group["methods"]:
            if method in actors.SCRIPTED:
                for preset, task, world in itertools.product(group.get("presets", ["lite"]), wanted, named):
                    # The expert itself decides which episodes are skipped.
                    skipped = () if method == "expert" else self.skipped.get(task, ())
                    yield Cell(method, task, episodes=episodes, preset=preset, skipped=skipped, world=world)
                continue
            seeds = group.get("seeds", [0])
            for demos, seed, task, world in itertools.product(group["demos"], seeds, wanted, named):
                # A method that differs from another by rules of acting alone has the other's policy.
                training = self._training(methods.trained(method), task, demos, seed, group.get("steps"))
                skipped = self.skipped.get(task, ()) if split == "test" else ()
                yield Cell(method, task, training, split, episodes, skipped=skipped, world=world)

    def _training(self, method: str, task: str, demos: int, seed: int, steps: int | None) -> Training:
        """The training of a cell. ``steps`` takes the place of the number that the search chose."""
        name, endings = methods.split(method)
        config = methods.find(method)[1]
        chosen = self._content["settings"].get(name, {})
        rate = chosen.get("learning_rate", config.learning_rate)
        usual = steps or chosen.get("steps", config.steps)
        if MULTI_TASK in endings:
            seen = [name for name in tasks.REAL_TABLE if name.endswith("-seen")]
            trained = tuple(seen) if task in tasks.REAL_TABLE else self.several
            usual *= len(trained)  # as many for each task as in the training on one task
        else:
            trained = (self._shared.get(task, task),)
            if steps is None:
                usual *= self._content["longer"].get(trained[0], 1)
        return Training(method, trained, demos, seed, usual, rate, **self._clip)


def trainings(cells: Iterable[Cell]) -> list[Training]:
    """The trainings of cells, each once."""
    return list(dict.fromkeys(cell.training for cell in cells if cell.training))


def unsolved(cell: Cell) -> tuple[int, ...]:
    """The indices of the episodes of the expert's cell that it does not solve. The plan's ``skipped`` holds them.

    Raises:
        LookupError: the cell is not measured yet.
    """
    row = cell.row()
    if row is None:
        raise LookupError(f"the expert's row on {cell.task} is not measured yet")
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
            raise LookupError(f"the trial {cell.name} is not measured yet")
        means.setdefault((cell.training.steps, cell.training.learning_rate), []).append(row["mean"])
    steps, rate = max(means, key=lambda trial: sum(means[trial]) / len(means[trial]))
    return {"steps": steps, "learning_rate": rate}
