"""``gem-lite results gallery``, ``tables``, ``page`` and ``settings``: what the benchmark's rows make."""

from __future__ import annotations

from pathlib import Path

from gem_lite.cli.base import Clip, Import

SCALED = ((10, 100), (10, 20, 100))
"""The numbers of demonstrations of the pictures of Fig. A5: few tasks are measured with 20."""


def tables(folder: Path, /) -> None:
    """Draw the benchmark's tables and its scaling (Fig. A5) from the stored rows, as pictures and as Markdown.

    Args:
        folder: folder to write

    Examples:
      gem-lite results tables build/benchmark
    """
    from gem_lite.drawing import plot_benchmark
    from gem_lite.evaluation import benchmark, summaries

    rows = benchmark.stored_rows()
    if not rows:
        raise ValueError(f"there are no rows in {benchmark.ROWS}: measure some with workflow/Snakefile")
    folder.mkdir(parents=True, exist_ok=True)
    for name, chosen in summaries.table_rows(rows).items():
        write_table(folder, name, chosen)
    for counts in SCALED:
        common, curves = summaries.scaling(rows, summaries.COMPARED, counts)
        if common:
            path = folder / f"figure-a5-{'-'.join(map(str, counts))}.png"
            plot_benchmark.show_scaling(common, curves).savefig(path, dpi=110)
            print(f"wrote {path}, means over {', '.join(common)}")


def write_table(folder: Path, name: str, rows: list[dict]) -> None:
    """Write a table as Markdown and as a picture."""
    from gem_lite import tasks
    from gem_lite.drawing import plot_benchmark
    from gem_lite.evaluation import benchmark
    from gem_lite.files import write_atomically

    table = plot_benchmark.arranged(rows)
    measured = {task for column in table.values() for task in column}
    names = [task for task in dict.fromkeys((*benchmark.VARIANTS, *tasks.names())) if task in measured]
    write_atomically(folder / f"{name}.md", plot_benchmark.markdown(table, names).encode())
    plot_benchmark.show_table(table, names).savefig(folder / f"{name}.png", dpi=110)
    print(f"wrote {name}.md and {name}.png into {folder}, from {len(rows)} rows")


def page(file: Path, /) -> None:
    """Write the benchmark's tables of a Markdown page anew from the stored rows.

    Args:
        file: the page; comments in it name the tables

    Examples:
      gem-lite results page docs/results.md
    """
    from gem_lite.drawing import benchmark_page
    from gem_lite.evaluation import benchmark
    from gem_lite.files import write_atomically

    write_atomically(file, benchmark_page.renewed(file.read_text(), benchmark.stored_rows()).encode())
    print(f"wrote {file}")


def settings(plan: Path, /, *, clip: Clip = None) -> None:
    """Print what the rows of the search and of the experts decide: the entries settings and skipped of a plan.

    Args:
        plan: file of the plan

    Examples:
      gem-lite results settings workflow/benchmark.yaml
    """
    import yaml

    from gem_lite.evaluation import benchmark

    try:
        content = yaml.safe_load(plan.read_text())
        read = benchmark.Plan(content, clip)
        chosen = {name: benchmark.chosen(read.search(), name) for name in content["search"]["methods"]}
        experts = [cell for cell in read.tier("experts") if cell.method == "expert"]
        unsolved = {cell.task: list(benchmark.unsolved(cell)) for cell in experts}
    except (LookupError, yaml.YAMLError) as error:
        raise ValueError(str(error)) from error
    skipped = {task: indices for task, indices in unsolved.items() if indices}
    print(yaml.safe_dump({"settings": chosen, "skipped": skipped}, default_flow_style=None, sort_keys=False))


def gallery(file: Path, /, *, tasks: tuple[str, ...] = (), import_: Import = ()) -> None:
    """Let the expert play the first test episode of tasks, and draw their first and last pictures (Fig. A10).

    Args:
        file: picture to write
        tasks: names of the tasks (without it: the paper's eighteen)

    Examples:
      gem-lite results gallery build/gallery.png --tasks align-rope
    """
    from drawings import plot_gallery
    from tqdm import tqdm

    from gem_lite.evaluation import benchmark, gallery

    chosen = tasks or benchmark.VARIANTS
    file.parent.mkdir(parents=True, exist_ok=True)  # refused here, not after all episodes
    played = list(tqdm(gallery.stories(chosen), "episodes", len(chosen), unit="episode"))
    plot_gallery.show_gallery(played).savefig(file, dpi=100)
    print(f"wrote {file}; the expert scored {min(story.score for story in played):.2f} or more")
