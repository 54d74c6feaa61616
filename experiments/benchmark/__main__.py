"""``gem-lite results gallery``, ``tables``, ``page`` and ``settings``: what the benchmark's rows make."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import yaml
from drawings import plot_gallery
from tqdm import tqdm
from typing_extensions import override
from tyro.conf import Positional

from gem_lite import tasks
from gem_lite.cli.command import Command, ImportingCommand
from gem_lite.drawing import benchmark_page, plot_benchmark
from gem_lite.evaluation import benchmark, gallery, summaries
from gem_lite.files import write_atomically

SCALED = ((10, 100), (10, 20, 100))
"""The numbers of demonstrations of the pictures of Fig. A5: few tasks are measured with 20."""


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
