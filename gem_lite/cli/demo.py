"""``make demo``: run the quickstart notebook with progress, print its outcome, keep it and its figure."""

from __future__ import annotations

import argparse
import base64
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from gem_lite.files import write_whole

FIGURE_TAGS = ("decision", "outcome")
"""Tags of the notebook's cells whose figures are kept as files."""
NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "00_quickstart.ipynb"


def main() -> None:
    """Command line: see ``python -m gem_lite.cli.demo --help``."""
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
        kernel_name="python3",
        resources={"metadata": {"path": str(NOTEBOOK.parent)}},
        on_cell_executed=lambda cell, **more: report(cell, **more),
    )
    client.execute()
    write_whole(args.out / NOTEBOOK.name, nbformat.writes(notebook).encode())
    print(f"\nThe executed notebook: {args.out / NOTEBOOK.name}")
    for tag in FIGURE_TAGS:
        write_whole(args.out / f"{tag}.png", _tagged_picture(code, tag))
        print(f"The figure of its {tag}: {args.out / tag}.png")
    print("\n" + next(line for line in _printed(code) if line.startswith("outcome of")))
    print("Open the series with: make lab")


def _printed(code: list[nbformat.NotebookNode]) -> list[str]:
    streams = [output for cell in code for output in cell.outputs if output.output_type == "stream"]
    return [line for stream in streams for line in stream.text.splitlines()]


def _tagged_picture(code: list[nbformat.NotebookNode], tag: str) -> bytes:
    cell = next(cell for cell in code if tag in cell.metadata.get("tags", []))
    return base64.b64decode(next(o.data["image/png"] for o in cell.outputs if "image/png" in o.get("data", {})))


if __name__ == "__main__":
    main()
