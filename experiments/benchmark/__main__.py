"""What the benchmark's rows make."""

from __future__ import annotations

import sys
from pathlib import Path

from gem_lite.cli import base

SCALED = ((10, 100), (10, 20, 100))
"""The numbers of demonstrations of the pictures of Fig. A5: few tasks are measured with 20."""


def file(*paths: Path) -> None:
    """File measured rows in the tables of their tasks, data/results/benchmark/TASK.jsonl.

    Args:
        paths: files of rows

    Examples:
      python -m experiments.benchmark file runs/benchmark/rows/gem-align-rope.jsonl
    """
    from experiments.benchmark import plan
    from gem_lite.evaluation import results

    for path in paths:
        rows = results.read_rows(path)
        if not rows:
            raise ValueError(f"{path} holds no rows")
        for task in dict.fromkeys(row["task"] for row in rows):
            of_task = [row for row in rows if row["task"] == task]
            results.file_rows(of_task, results.benchmark_file(task), plan.IDENTITY)


def page(path: Path, /) -> None:
    """Write the tables of a Markdown page anew from the stored rows.

    Args:
        path: the page; comments in it name the tables

    Examples:
      python -m experiments.benchmark page docs/results.md
    """
    from experiments.benchmark import page
    from gem_lite.evaluation import results
    from gem_lite.foundations.files import write_atomically

    write_atomically(path, page.renewed(path.read_text(), results.stored_rows()).encode())
    print(f"wrote {path}")


def tables(folder: Path, /) -> None:
    """Draw the tables and the scaling (Fig. A5) from the stored rows, as pictures and as Markdown.

    Args:
        folder: folder to write

    Examples:
      python -m experiments.benchmark tables build/tables
    """
    import summaries
    import whole_benchmark
    from drawings import plot_benchmark

    from experiments.benchmark import plan, scaling
    from experiments.benchmark.tables import arranged, markdown
    from gem_lite.evaluation import results
    from gem_lite.foundations.files import write_atomically
    from gem_lite.tasks import PAPER

    rows = results.stored_rows()
    if not rows:
        raise ValueError("no rows are filed: measure some with the Snakefile")
    folder.mkdir(parents=True, exist_ok=True)
    for name, chosen in whole_benchmark.table_rows(rows).items():
        table = arranged(chosen)
        measured = {task for column in table.values() for task in column}
        names = [task for task in (*PAPER, *plan.OURS) if task in measured]
        write_atomically(folder / f"{name}.md", markdown(table, names).encode())
        plot_benchmark.show_table(table, names).savefig(folder / f"{name}.png", dpi=110)
        print(f"wrote {name}.md and {name}.png into {folder}, from {len(chosen)} rows")
    for counts in SCALED:
        common, curves = scaling.scaling(rows, summaries.COMPARED, counts)
        if common:
            path = folder / f"figure-a5-{'-'.join(map(str, counts))}.png"
            scaling.show_scaling(common, curves).savefig(path, dpi=110)
            print(f"wrote {path}, means over {', '.join(common)}")


def settings(*, clip: base.Clip = None) -> None:
    """Print what the rows of the search and of the experts decide: the entries settings and skipped of plan.yaml.

    Examples:
      python -m experiments.benchmark settings
    """
    import yaml

    from experiments.benchmark import plan

    whole = plan.Plan.load(clip)
    search = whole.search()
    experts = [cell for cell in whole.tier("experts") if cell.method == "expert"]
    try:
        chosen = {name: plan.chosen(search, name) for name in dict.fromkeys(cell.method for cell in search)}
        unsolved = {cell.task: list(plan.unsolved(cell)) for cell in experts}
    except LookupError as error:
        raise ValueError(str(error)) from error
    skipped = {task: indices for task, indices in unsolved.items() if indices}
    print(yaml.safe_dump({"settings": chosen, "skipped": skipped}, default_flow_style=None, sort_keys=False))


def gallery(path: Path, /, *, tasks: tuple[str, ...] = ()) -> None:
    """Let the expert play the first test episode of tasks, and draw their first and last pictures (Fig. A10).

    Args:
        path: picture to write
        tasks: names of the tasks (without it: the paper's eighteen)

    Examples:
      python -m experiments.benchmark gallery build/gallery.png
    """
    from drawings import plot_benchmark
    from gallery import stories
    from tqdm import tqdm

    from gem_lite.tasks import PAPER

    names = tasks or PAPER
    path.parent.mkdir(parents=True, exist_ok=True)  # refused here, not after all episodes
    played = list(tqdm(stories(names), "episodes", len(names), unit="episode"))
    plot_benchmark.show_gallery(played).savefig(path, dpi=100)
    print(f"wrote {path}; the expert scored {min(story.score for story in played):.2f} or more")


APP = base.make_app("python -m experiments.benchmark", __doc__, file, page, tables, settings, gallery)

if __name__ == "__main__":
    sys.exit(base.run(APP))
