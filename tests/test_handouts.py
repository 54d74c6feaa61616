"""The students' edition of the lessons."""

import nbformat
import pytest

from docs import handouts
from docs.course import tagged

LESSONS = handouts.LESSONS


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The handouts of all lessons."""
    new = tmp_path_factory.mktemp("handouts") / "new"
    handouts.write(new)
    return new


def test_exercises_hints_and_questions_stay_and_solutions_and_answers_go(folder):
    for path in sorted(LESSONS.glob("*.ipynb")):
        both = lesson, handout = [nbformat.read(one, as_version=4) for one in (path, folder / path.name)]
        assert tagged(lesson, "solution") and not tagged(handout, "solution")
        assert tagged(handout, "exercise") == tagged(lesson, "exercise")
        assert tagged(handout, "check") == tagged(lesson, "check")
        hints = [sum(cell.source.count("<summary>Hint") for cell in notebook.cells) for notebook in both]
        assert hints[0] == hints[1] > 0
        questions, asked = (
            next(cell.source for cell in notebook.cells if "## Check yourself" in cell.source)
            .partition("## Check yourself")[2]
            .partition("\n## ")[0]
            for notebook in both
        )
        assert questions.count("<summary>") == 5
        assert "<details>" not in asked and asked.count("\n- ") == 5
        assert len(asked) < len(questions)


def test_what_lessons_import_lies_beside_the_handouts(folder):
    code = {path.relative_to(LESSONS) for path in LESSONS.rglob("*.py")}
    root = LESSONS.parent
    imported = [root / "experiments" / "__init__.py", *(root / "experiments" / "picture_prompts").rglob("*.py")]
    code |= {path.relative_to(root) for path in imported}
    assert code == {path.relative_to(folder) for path in folder.rglob("*.py")}
