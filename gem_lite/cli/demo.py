"""``gem-lite demo``: run the quickstart notebook, print its progress and its outcome, and save it and its figures."""

from __future__ import annotations

import base64
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import nbformat
from nbclient import NotebookClient
from typing_extensions import override

from gem_lite.cli.command import Command
from gem_lite.files import write_atomically

FIGURE_TAGS = ("decision", "outcome")
"""Tags of the notebook's cells whose figures are saved as files."""
NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "00_quickstart.ipynb"


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Run the quickstart notebook: a sentence in, maps, an action in PyBullet, the outcome and its figures."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite demo --out runs/demo",)

    out: Path = Path("runs/demo")
    """folder to write"""

    @override
    def run(self) -> None:
        if not NOTEBOOK.exists():
            raise FileNotFoundError(f"the demo needs {NOTEBOOK}: run it in a clone of the repository")
        notebook = nbformat.read(NOTEBOOK, as_version=4)
        code = [cell for cell in notebook.cells if cell.cell_type == "code"]
        execute(notebook, code)
        write_atomically(self.out / NOTEBOOK.name, nbformat.writes(notebook).encode())
        print(f"\nThe executed notebook: {self.out / NOTEBOOK.name}")
        for tag in FIGURE_TAGS:
            write_atomically(self.out / f"{tag}.png", _tagged_picture(code, tag))
            print(f"The figure of its {tag}: {self.out / tag}.png")
        print("\n" + next(line for line in _printed(code) if line.startswith("outcome of")))
        print("Open the series with: make lab")


def execute(notebook: nbformat.NotebookNode, code: list[nbformat.NotebookNode]) -> None:
    """Execute a notebook in place, and print the first line and the output of each of its ``code`` cells."""
    start = time.time()

    def report(cell: nbformat.NotebookNode, **_: object) -> None:
        if cell.cell_type != "code":
            return
        title = cell.source.splitlines()[0].lstrip("# ")
        print(f"[{code.index(cell) + 1}/{len(code)}, {time.time() - start:4.0f} s] {title}", flush=True)
        for output in cell.outputs:
            if output.output_type == "stream" and output.name == "stdout":
                print("    " + output.text.rstrip().replace("\n", "\n    "), flush=True)

    client = NotebookClient(
        notebook,
        kernel_name="python3",
        resources={"metadata": {"path": str(NOTEBOOK.parent)}},
        on_cell_executed=report,
    )
    client.execute()


def _printed(code: list[nbformat.NotebookNode]) -> list[str]:
    streams = [output for cell in code for output in cell.outputs if output.output_type == "stream"]
    return [line for stream in streams for line in stream.text.splitlines()]


def _tagged_picture(code: list[nbformat.NotebookNode], tag: str) -> bytes:
    cell = next(cell for cell in code if tag in cell.metadata.get("tags", []))
    pictures = (output.data["image/png"] for output in cell.outputs if "image/png" in output.get("data", {}))
    return base64.b64decode(next(pictures))
