"""``make demo``: run the quickstart notebook with progress, print its outcome, keep it and its figure."""

from __future__ import annotations

import argparse
import base64
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from gem_lite.demonstrations import write_whole

NOTEBOOK = Path(__file__).resolve().parent.parent / "notebooks" / "00_quickstart.ipynb"


def main() -> None:
    """Command line: see ``python -m gem_lite.demo --help``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/demo"), help="folder to write (default runs/demo)")
    args = parser.parse_args()
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    began = time.time()

    def report(cell: nbformat.NotebookNode, **_: object) -> None:
        if cell.cell_type != "code":
            return
        title = cell.source.splitlines()[0].lstrip("# ")
        print(f"[{code.index(cell) + 1}/{len(code)}, {time.time() - began:4.0f} s] {title}", flush=True)
        for output in cell.outputs:
            if output.output_type == "stream" and output.name == "stdout":
                print("    " + output.text.rstrip().replace("\n", "\n    "), flush=True)

    client = NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        resources={"metadata": {"path": str(NOTEBOOK.parent)}},
        on_cell_executed=lambda cell, **more: report(cell, **more),
    )
    client.execute()
    pictures = [
        output.data["image/png"]
        for cell in code
        for output in cell.outputs
        if output.output_type in ("display_data", "execute_result") and "image/png" in output.data
    ]
    write_whole(args.out / NOTEBOOK.name, nbformat.writes(notebook).encode())
    write_whole(args.out / "outcome.png", base64.b64decode(pictures[-1]))
    print(f"\nThe executed notebook: {args.out / NOTEBOOK.name}\nIts last figure:       {args.out / 'outcome.png'}")
    print("Open the series with: make lab")


if __name__ == "__main__":
    main()
