"""``gem-lite demo``: run the quickstart notebook, print its progress and its outcome, and save it and its figures."""

from __future__ import annotations

import base64
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nbformat import NotebookNode

NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "00_quickstart.ipynb"
RESULT = "score of"
"""How the lesson's line with the result begins."""


def demo(*, out: Path = Path("runs/demo")) -> None:
    """Run the quickstart notebook: a sentence in, a placed block out.

    Prints its progress and its outcome, and saves it and its figures.

    Args:
        out: folder to write

    Examples:
      gem-lite demo --out runs/demo
    """
    import nbformat
    from nbclient import NotebookClient

    from gem_lite.foundations.files import write_atomically

    if not NOTEBOOK.exists():
        raise FileNotFoundError(f"the demo needs {NOTEBOOK}: run it in a clone of the repository")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    start = time.time()

    def report(cell: NotebookNode, **_: object) -> None:
        if cell.cell_type == "code":
            title = cell.source.splitlines()[0].lstrip("# ")
            print(f"[{code.index(cell) + 1}/{len(code)}, {time.time() - start:4.0f} s] {title}", flush=True)
            for line in printed(cell):
                print(f"    {line}", flush=True)

    folder = {"metadata": {"path": str(NOTEBOOK.parent)}}
    NotebookClient(notebook, kernel_name="python3", resources=folder, on_cell_executed=report).execute()
    write_atomically(out / NOTEBOOK.name, nbformat.writes(notebook).encode())
    print(f"\nThe executed notebook: {out / NOTEBOOK.name}")
    for tag in ("decision", "outcome"):
        cell = next(cell for cell in code if tag in cell.metadata.get("tags", []))
        picture = next(output.data["image/png"] for output in cell.outputs if "image/png" in output.get("data", {}))
        write_atomically(out / f"{tag}.png", base64.b64decode(picture))
        print(f"The figure of its {tag}: {out / tag}.png")
    print("\n" + next(line for cell in code for line in printed(cell) if line.startswith(RESULT)))
    print("Open the series with: make lab")


def printed(cell: NotebookNode) -> list[str]:
    """The lines that a cell printed."""
    streams = (output for output in cell.outputs if output.output_type == "stream" and output.name == "stdout")
    return [line for stream in streams for line in stream.text.splitlines()]
