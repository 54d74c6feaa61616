"""Reads the stored notebooks: the mistakes that nbval lets pass without a word."""

import ast
import base64
import functools
import re
from collections import Counter
from pathlib import Path

import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
LONGEST_CELL = 25
"""Lines that a reader follows at once."""
MOST_WORDS = 3500
"""What a reader reads in one sitting; the longest lesson had half as many again once."""
PALETTE = 3
"""The kind of colour of a PNG with a palette, its byte 25."""
TAG = "nbval-check-output"
PARTS = ["exercise", "check", "solution"]
"""Tags of an exercise's code cells, in this order."""
BESIDE = {path.stem: path.read_text() for path in NOTEBOOKS[0].parent.glob("*.py")}
LOAD_TORCH = {"torch", "e2cnn"} | {name for name, code in BESIDE.items() if re.search("^import torch", code, re.M)}
LINK = re.compile(r"\]\(([\w./-]+\.(?:ipynb|md|py|jsonl?|png))\b")
REFERENCE = re.compile(r"(?:[Nn]otebook|[Ll]esson) \[?([01]\d)\]?(?:\([\w./]+\))?, sections? (\d+(?:(?:, | and )\d+)*)")


@functools.cache
def read(path):
    return nbformat.read(path, as_version=4)


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def path(request):
    return request.param


@pytest.fixture
def nb(path):
    """The content of a lesson, which no test may change."""
    return read(path)


@pytest.fixture
def cells(nb):
    """The code cells of a lesson."""
    return [cell for cell in nb.cells if cell.cell_type == "code"]


def prose(nb):
    return "\n".join(cell.source for cell in nb.cells if cell.cell_type == "markdown")


def tags(cell):
    return cell.metadata.get("tags", [])


def test_there_are_notebooks():
    *numbered, last = NOTEBOOKS
    assert [path.stem[:2] for path in numbered] == [f"{i:02d}" for i in range(len(numbered))]
    assert last.stem == "gem_from_an_empty_file"
    assert len(numbered) >= 2


def test_stored_executed_in_order_small_and_without_paths(path, nb, cells):
    counts = [cell.execution_count for cell in cells]
    assert counts == list(range(1, len(counts) + 1))
    assert path.stat().st_size <= 2_500_000
    assert nb.metadata.kernelspec.name == "python3"
    assert not re.search(r"/(home|root|tmp|work|Users)/\w", path.read_text())


def test_what_is_compared_is_text_that_is_stored(cells):
    for cell in cells:
        assert "NBVAL" not in cell.source, "tell nbval by the cell's tags: a reader need not see it"
        if TAG in tags(cell) and "raises-exception" not in tags(cell):
            assert cell.outputs, cell.source
            # Only text can be compared; stderr (progress bars) differs from run to run.
            assert all(o.output_type == "stream" and o.name == "stdout" for o in cell.outputs), cell.source


def test_cells_say_and_assert_something_are_short_and_end_without_an_error(nb, cells):
    assert len({cell.id for cell in nb.cells}) == len(nb.cells)
    for cell in nb.cells:
        assert cell.source.strip()
        assert cell.cell_type != "markdown" or len(cell.source.split()) > 1, f"{cell.source!r} is a placeholder"
    for cell in cells:
        assert len(cell.source.splitlines()) <= LONGEST_CELL, cell.source
        assert "raises-exception" in tags(cell) or all(o.output_type != "error" for o in cell.outputs), cell.source
    assert sum(bool(re.search(r"^\s*assert ", cell.source, re.M)) for cell in cells) >= 3


def imported(source):
    """The top-level modules that a cell imports, in order."""
    nodes = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
    names = [[alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module] for node in nodes]
    return [name.partition(".")[0] for several in names for name in several]


def test_a_lesson_is_read_in_one_sitting(nb):
    text = re.sub(r"</?(details|summary|br|b|i|sup|sub)[^<>]*>", " ", prose(nb))
    words = [word for word in text.split() if re.search("[A-Za-z0-9]", word)]
    assert len(words) <= MOST_WORDS


def test_gem_lite_comes_before_torch(cells):
    # It sets how torch's threads wait, which is read once, when torch is loaded: else two open notebooks collapse.
    order = [name for cell in cells for name in imported(cell.source)]
    assert "gem_lite" in order
    assert not LOAD_TORCH & set(order[: order.index("gem_lite")])


def test_links_to_files_and_to_the_neighbours_lead_somewhere(path, nb):
    for link in LINK.findall(prose(nb)):
        assert (path.parent / link).exists(), link
    number = NOTEBOOKS.index(path)
    title = nb.cells[0].source
    end = prose(nb).partition("## Where next")[2]
    if number > 0:
        assert re.search(rf"\| Before \| .*\({NOTEBOOKS[number - 1].name}\)", title)
    if number + 1 < len(NOTEBOOKS):
        following = NOTEBOOKS[number + 1].name
        assert re.search(rf"\| After \| .*\({following}\)", title) and f"({following})" in end
    assert "**References:**" in end and "https://arxiv.org/abs/2406.15677" in end


def test_the_title_says_what_a_reader_needs_and_a_recap_and_questions_end_a_lesson(nb):
    title, text = nb.cells[0].source, prose(nb)
    for part in ("| Paper |", "| Time |", "| Needs |", "| CLIP |", "**You will build**", "**Idea:**"):
        assert part in title, part
    contents = re.search(r"^Sections: (.+)$", title, re.M)
    assert contents, "the contents: Sections: 1 ... · 2 ..."
    sections = re.findall(r"^## (\d+) · ", text, re.M)
    assert sections == [str(i + 1) for i in range(len(sections))]
    assert re.findall(r"(?:^|· )(\d+) ", contents[1]) == sections
    assert "## What was checked where" in text
    questions = re.search(r"^## Check yourself$(.*?)(?=^## |\Z)", text, re.M | re.S)
    assert questions and len(re.findall(r"<details><summary>.+?</summary>\s+\S", questions[1])) == 5


def test_exercises_have_a_scaffold_a_hint_a_check_and_a_folded_solution(nb, cells):
    kinds = [(kind, cell) for cell in cells for kind in PARTS if kind in tags(cell)]
    assert [kind for kind, _ in kinds] == PARTS * (len(kinds) // 3)
    assert 2 <= len(kinds) // 3 <= 4
    for kind, cell in kinds:
        if kind == "exercise":
            assert "..." in cell.source, cell.source
        if kind == "solution":
            assert cell.metadata.jupyter.source_hidden
            assert "assert check_" in cell.source and '== "right"' in cell.source, cell.source
    assert prose(nb).count("<summary>Hint") >= len(kinds) // 3


def test_sections_that_are_named_are_there():
    sections = {path.name[:2]: set(re.findall(r"^## (\d+) · ", prose(read(path)), re.M)) for path in NOTEBOOKS}
    root = NOTEBOOKS[0].parent.parent
    named = {
        (page.name, lesson, section)
        for page in (*NOTEBOOKS, *root.glob("*.md"), *root.glob("docs/*.md"))
        for lesson, several in REFERENCE.findall(page.read_text())
        for section in re.findall(r"\d+", several)
    }
    assert len(named) > 20
    assert sorted(entry for entry in named if entry[2] not in sections[entry[1]]) == []


def test_every_picture_has_a_text_something_moves_and_what_moves_has_a_slider(cells):
    films = 0
    for cell in cells:
        moving = sliders = 0
        for output in cell.outputs:
            picture = output.get("data", {}).get("image/png", "")
            assert not picture or len(output.metadata.get("image/png", {}).get("alt", "")) > 20
            content = base64.b64decode(picture)
            assert not content or content[25] == PALETTE, "stored pictures have few colours: `pictures.described`"
            moving += b"acTL" in content  # begins the frames of an animated PNG
            sliders += "gem-slider" in output.get("data", {}).get("text/html", "")
        assert moving == sliders, cell.source
        films += moving
    assert films > 0


def bound(source):
    """The names that a cell binds outside of its functions and loops: assignments, functions and classes."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        if isinstance(node, ast.Assign):
            names = [name for target in node.targets for name in ast.walk(target) if isinstance(name, ast.Name)]
            yield from (name.id for name in names if isinstance(name.ctx, ast.Store) and name.id != "_")


def test_no_name_means_two_things(cells):
    names = [name for cell in cells for name in set(bound(cell.source))]
    assert sorted(name for name, count in Counter(names).items() if count > 1) == []
