"""``gem-lite results``: the rows in data/results, and the tables and pictures that they make."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import yaml
from tqdm import tqdm
from typing_extensions import override
from tyro.conf import Positional

from gem_lite import tasks
from gem_lite.cli.command import Command, ImportingCommand
from gem_lite.evaluation import benchmark, gallery, pointing, results, summaries
from gem_lite.figures import benchmark_page, plot_benchmark, plot_gallery
from gem_lite.files import write_atomically

SCALED = ((10, 100), (10, 20, 100))
"""The numbers of demonstrations of the pictures of Fig. A5: few tasks are measured with 20."""


@dataclass(frozen=True, kw_only=True)
class List(Command):
    """Name the files of results, and the methods (or maps) of their rows."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results list",)

    folder: Path = results.RESULTS
    """folder of the files; results without --file are in runs/results"""

    @override
    def run(self) -> None:
        if not self.folder.is_dir():
            raise FileNotFoundError(f"{self.folder} is no folder of results")
        for name, paths in files_by_name(self.folder).items():
            rows = [row for path in paths for row in results.read_rows(path)]
            names = dict.fromkeys(row.get("method", row.get("map")) for row in rows)
            print(f"{name}: {len(rows)} rows, of {', '.join(names)}")


@dataclass(frozen=True, kw_only=True)
class Show(Command):
    """Print the rows of a file of results, one per line."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results show benchmark/block-insertion --method gem",)

    name: Positional[str]
    """name of the file, as in `gem-lite results list`, or the path of another file"""
    method: str | None = None
    """only rows of this method (or of this map)"""
    task: str | None = None
    """only rows of this task"""
    world: str | None = None
    """only rows that were measured in this world"""

    @override
    def run(self) -> None:
        stored = files_by_name(results.RESULTS)
        paths = stored.get(self.name, [Path(self.name)])
        if not paths[0].is_file():
            raise FileNotFoundError(f"there are no results named {self.name!r}; there are: {', '.join(stored)}")
        rows = [row for path in paths for row in results.read_rows(path) if self.selects(row)]
        if not rows:
            raise ValueError(f"{self.name} has no such row")
        for row in rows:
            print(described(row))

    def selects(self, row: dict) -> bool:
        """Whether a row has the given method, task and world."""
        method = row.get("method", row.get("map"))
        return (
            self.method in (None, method)
            and self.task in (None, row.get("task"))
            and self.world in (None, row.get("world"))
        )


@dataclass(frozen=True, kw_only=True)
class Tables(Command):
    """Draw the benchmark's tables and its scaling (Fig. A5) from the stored rows, as pictures and as Markdown."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results tables build/benchmark",)

    folder: Positional[Path]
    """folder to write"""

    @override
    def run(self) -> None:
        rows = benchmark.stored_rows()
        if not rows:
            raise ValueError(f"there are no rows in {benchmark.ROWS}: measure some with workflow/Snakefile")
        self.folder.mkdir(parents=True, exist_ok=True)
        for name, chosen in summaries.table_rows(rows).items():
            self.write_table(name, chosen)
        for counts in SCALED:
            common, curves = summaries.scaling(rows, summaries.COMPARED, counts)
            if common:
                path = self.folder / f"figure-a5-{'-'.join(map(str, counts))}.png"
                plot_benchmark.show_scaling(common, curves).savefig(path, dpi=110)
                print(f"wrote {path}, means over {', '.join(common)}")

    def write_table(self, name: str, rows: list[dict]) -> None:
        """Write a table as Markdown and as a picture."""
        table = plot_benchmark.arranged(rows)
        measured = {task for column in table.values() for task in column}
        names = [task for task in dict.fromkeys((*benchmark.VARIANTS, *tasks.names())) if task in measured]
        write_atomically(self.folder / f"{name}.md", plot_benchmark.markdown(table, names).encode())
        plot_benchmark.show_table(table, names).savefig(self.folder / f"{name}.png", dpi=110)
        print(f"wrote {name}.md and {name}.png into {self.folder}, from {len(rows)} rows")


@dataclass(frozen=True, kw_only=True)
class Page(Command):
    """Write the benchmark's tables of a Markdown page anew from the stored rows."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results page docs/results.md",)

    file: Positional[Path]
    """the page; comments in it name the tables"""

    @override
    def run(self) -> None:
        page = benchmark_page.renewed(self.file.read_text(), benchmark.stored_rows())
        write_atomically(self.file, page.encode())
        print(f"wrote {self.file}")


@dataclass(frozen=True, kw_only=True)
class Settings(Command):
    """Print what the rows of the search and of the experts decide: the entries settings and skipped of a plan."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results settings workflow/benchmark.yaml",)
    failures: ClassVar[tuple[type[Exception], ...]] = (*Command.failures, LookupError, yaml.YAMLError)

    plan: Positional[Path]
    """file of the plan"""
    clip: str | None = None
    """Hugging Face name or folder of a CLIP (without it: the embedded one)"""

    @override
    def run(self) -> None:
        content = yaml.safe_load(self.plan.read_text())
        plan = benchmark.Plan(content, self.clip)
        settings = {name: benchmark.chosen(plan.search(), name) for name in content["search"]["methods"]}
        experts = [cell for cell in plan.tier("experts") if cell.method == "expert"]
        unsolved = {cell.task: list(benchmark.unsolved(cell)) for cell in experts}
        skipped = {task: indices for task, indices in unsolved.items() if indices}
        print(yaml.safe_dump({"settings": settings, "skipped": skipped}, default_flow_style=None, sort_keys=False))


@dataclass(frozen=True, kw_only=True)
class Gallery(ImportingCommand):
    """Let the expert play the first test episode of tasks, and draw their first and last pictures (Fig. A10)."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite results gallery build/gallery.png --tasks align-rope",)

    file: Positional[Path]
    """picture to write"""
    tasks: tuple[str, ...] = benchmark.VARIANTS
    """names of the tasks (without it: the paper's eighteen)"""

    @override
    def run(self) -> None:
        self.file.parent.mkdir(parents=True, exist_ok=True)  # refused here, not after all episodes
        played = list(tqdm(gallery.stories(self.tasks), "episodes", len(self.tasks), unit="episode"))
        plot_gallery.show_gallery(played).savefig(self.file, dpi=100)
        print(f"wrote {self.file}; the expert scored {min(story.score for story in played):.2f} or more")


def files_by_name(folder: Path) -> dict[str, list[Path]]:
    """The files of rows in a folder. Those of one task of the benchmark have one name, such as benchmark/align-rope."""
    files = {path.stem: [path] for path in sorted(folder.glob("*.jsonl"))}
    for path in sorted(folder.glob("*/*/*.jsonl")):
        files.setdefault(path.parent.relative_to(folder).as_posix(), []).append(path)
    return files


def described(row: dict) -> str:
    """A row in one line: its method, task, world and details, and its mean (0-100, with the 95 % interval)."""
    if row.get("kind") == "pointing":
        return pointing.described(row)
    parts = {"demos": "demos", "steps": "steps", "seed": "seed", "poses": "poses by", "shift": "shift", "turn": "turn"}
    details = [f"{label} {row[name]}" for name, label in parts.items() if row.get(name) is not None]
    subset = row.get("subset", "all")
    where = ", ".join([row["task"], *([subset] if subset != "all" else []), f"in {row['world']}", *details])
    low, high = row["ci95"]
    return f"{row['method']} on {where}: {row['mean']} [{low}, {high}], {row['episodes']} episodes"
