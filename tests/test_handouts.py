"""The students' edition of the lessons."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def handouts(tmp_path_factory):
    """(lesson, handout) of every lesson."""
    spec = importlib.util.spec_from_file_location("handouts", ROOT / "docs" / "handouts.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    files = module.write(tmp_path_factory.mktemp("handouts") / "new")
    return [
        (nbformat.read(ROOT / "notebooks" / file.name, as_version=4), nbformat.read(file, as_version=4))
        for file in files
    ]


def tagged(notebook, tag):
    return [cell.source for cell in notebook.cells if tag in cell.metadata.get("tags", [])]


def test_exercises_stay_and_solutions_go(handouts):
    assert len(handouts) == len(list((ROOT / "notebooks").glob("*.ipynb")))
    for lesson, handout in handouts:
        assert tagged(lesson, "solution") and not tagged(handout, "solution")
        assert tagged(handout, "exercise") == tagged(lesson, "exercise")
        assert tagged(handout, "check") == tagged(lesson, "check")


def test_questions_stay_and_answers_go(handouts):
    for lesson, handout in handouts:
        questions, asked = (
            next(cell.source for cell in notebook.cells if "## Check yourself" in cell.source)
            .partition("## Check yourself")[2]
            .partition("\n## ")[0]
            for notebook in (lesson, handout)
        )
        assert questions.count("<summary>") == 5
        assert "<details>" not in asked and asked.count("\n- ") == 5
        assert len(asked) < len(questions)


def test_hints_stay(handouts):
    for lesson, handout in handouts:
        hints = [sum(cell.source.count("<summary>Hint") for cell in notebook.cells) for notebook in (lesson, handout)]
        assert hints[0] == hints[1] > 0


def test_what_lessons_import_lies_beside_the_handouts(tmp_path):
    script = ROOT / "docs" / "handouts.py"
    subprocess.run([sys.executable, script, tmp_path / "handouts"], check=True, stdout=subprocess.DEVNULL, timeout=600)
    lessons = ROOT / "notebooks"
    code = {path.relative_to(lessons) for path in lessons.rglob("*.py")}
    assert code == {path.relative_to(tmp_path / "handouts") for path in (tmp_path / "handouts").rglob("*.py")}
