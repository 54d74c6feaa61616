"""The students' edition of the lessons."""

import importlib.util
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The handouts of all lessons."""
    spec = importlib.util.spec_from_file_location("handouts", ROOT / "docs" / "handouts.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    new = tmp_path_factory.mktemp("handouts") / "new"
    module.write(new)
    return new


@pytest.fixture(scope="module")
def handouts(folder):
    """(lesson, handout) of every lesson."""
    lessons = sorted((ROOT / "notebooks").glob("*.ipynb"))
    return [tuple(nbformat.read(path, as_version=4) for path in (one, folder / one.name)) for one in lessons]


def tagged(notebook, tag):
    return [cell.source for cell in notebook.cells if tag in cell.metadata.get("tags", [])]


def test_exercises_stay_and_solutions_go(handouts):
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


def test_what_lessons_import_lies_beside_the_handouts(folder):
    lessons = ROOT / "notebooks"
    code = {path.relative_to(lessons) for path in lessons.rglob("*.py")}
    assert code == {path.relative_to(folder) for path in folder.rglob("*.py")}
