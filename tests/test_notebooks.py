"""Reads the stored notebooks: the mistakes that nbval lets pass without a word."""

import ast
import re
from pathlib import Path

import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
LONGEST_CELL = 25
"""Lines that a reader follows at once."""
TAG = "nbval-check-output"
LOAD_TORCH = {"torch", "e2cnn"}
LINK = re.compile(r"\]\(([\w./-]+\.(?:ipynb|md|py|jsonl?|png))\b")


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
    assert path.stat().st_size <= 2_500_000
    assert nb.metadata.kernelspec.name == "python3"


def test_what_is_compared_is_text_that_is_stored(notebook):
    for cell in code_cells(notebook[1]):
        assert "NBVAL" not in cell.source, "tell nbval by the cell's tags: a reader need not see it"
        tags = cell.metadata.get("tags", [])
        if TAG in tags and "raises-exception" not in tags:
            assert cell.outputs, cell.source
            # Only text can be compared; stderr (progress bars) differs from run to run.
            assert all(o.output_type == "stream" and o.name == "stdout" for o in cell.outputs), cell.source


def test_texts_are_texts(notebook):
    for cell in notebook[1].cells:
        if cell.cell_type == "markdown":
            assert len(cell.source.split()) > 1, f"{cell.source!r} is a placeholder"


def test_cells_are_short(notebook):
    for cell in code_cells(notebook[1]):
        assert len(cell.source.splitlines()) <= LONGEST_CELL, cell.source


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


def imported(source):
    """The top-level modules that a cell imports, in order."""
    nodes = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
    names = [[alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module] for node in nodes]
    return [name.partition(".")[0] for several in names for name in several]


def test_gem_lite_comes_before_torch(notebook):
    # It sets how torch's threads wait, which is read once, when torch is loaded: else two open notebooks collapse.
    order = [name for cell in code_cells(notebook[1]) for name in imported(cell.source)]
    assert "gem_lite" in order
    assert not LOAD_TORCH & set(order[: order.index("gem_lite")])


def test_links_to_files_lead_somewhere(notebook):
    path, nb = notebook
    links = [link for cell in nb.cells if cell.cell_type == "markdown" for link in LINK.findall(cell.source)]
    for link in links:
        assert (path.parent / link).exists(), link


def test_cells_are_not_empty_and_have_ids_of_their_own(notebook):
    cells = notebook[1].cells
    assert all(cell.source.strip() for cell in cells)
    assert len({cell.id for cell in cells}) == len(cells)


def test_says_its_time_its_clip_and_has_exercises_with_solutions(notebook):
    text = "\n".join(cell.source for cell in notebook[1].cells if cell.cell_type == "markdown")
    for needed in ("| Time |", "| CLIP |", "| Paper |", "## Try it", "<details>"):
        assert needed in text, needed
