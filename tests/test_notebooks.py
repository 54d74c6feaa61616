"""Reads the stored notebooks: the mistakes that nbval lets pass without a word."""

import re
from pathlib import Path

import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
MARKER = "# NBVAL_CHECK_OUTPUT"


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request):
    return request.param, nbformat.read(request.param, as_version=4)


def code_cells(nb):
    return [cell for cell in nb.cells if cell.cell_type == "code"]


def test_there_are_notebooks():
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"{i:02d}" for i in range(len(NOTEBOOKS))]
    assert len(NOTEBOOKS) >= 2


def test_stored_executed_in_order_and_small(notebook):
    path, nb = notebook
    counts = [cell.execution_count for cell in code_cells(nb)]
    assert counts == list(range(1, len(counts) + 1))
    assert path.stat().st_size < 2_000_000
    assert nb.metadata.kernelspec.name == "python3"


def test_markers_are_whole_lines_on_cells_with_output(notebook):
    for cell in code_cells(notebook[1]):
        marked = [line for line in cell.source.splitlines() if "NBVAL" in line]
        assert all(line == MARKER for line in marked), marked
        if marked and "raises-exception" not in cell.metadata.get("tags", []):
            assert cell.outputs, cell.source
            # Only text can be compared; stderr (progress bars) differs from run to run.
            assert all(o.output_type == "stream" and o.name == "stdout" for o in cell.outputs), cell.source


def test_no_error_but_the_intended(notebook):
    for cell in code_cells(notebook[1]):
        if "raises-exception" not in cell.metadata.get("tags", []):
            assert not any(o.output_type == "error" for o in cell.outputs), cell.source


def test_asserts_pictures_and_no_paths(notebook):
    path, nb = notebook
    cells = code_cells(nb)
    assert sum(bool(re.search(r"^\s*assert ", cell.source, re.M)) for cell in cells) >= 3
    assert any("image/png" in o.get("data", {}) for cell in cells for o in cell.outputs)
    assert not re.search(r"/(home|root|tmp|work|Users)/\w", path.read_text())


def test_says_its_time_its_clip_and_has_exercises_with_solutions(notebook):
    text = "\n".join(cell.source for cell in notebook[1].cells if cell.cell_type == "markdown")
    for needed in ("| Time |", "| CLIP |", "| Paper |", "## Try it", "<details>"):
        assert needed in text, needed
