"""The lessons as a course of nbgrader: nbgrader itself scores two of them in `make graded`."""

import copy

import nbformat
import pytest

from docs import course, handouts

LESSONS = sorted(handouts.LESSONS.glob("*.ipynb"))
EXERCISE = "def exercise_1(x):\n    return ..."
CHECK = """def check_double(double):
    if double(1) is ...:
        return "not filled in yet"
    assert double(3) == 6
    return "right"


print(check_double(exercise_1))"""
SOLUTION = """def solution_1(x):
    return 2 * x


assert check_double(solution_1) == "right"
print("what comes of it")"""


def small_lesson(*, solution=SOLUTION, tags=()):
    """A lesson with one exercise."""
    sources = {"exercise": EXERCISE, "check": CHECK, "solution": solution}
    cells = [nbformat.v4.new_code_cell(source, metadata={"tags": [kind]}) for kind, source in sources.items()]
    cells[1].metadata.tags += tags
    return nbformat.v4.new_notebook(cells=cells)


def roles(assignment):
    """What nbgrader is told of each cell that it knows: name, code and metadata."""
    marked = [cell for cell in assignment.cells if "nbgrader" in cell.metadata]
    return [(cell.metadata.nbgrader.grade_id, cell.source, cell.metadata.nbgrader) for cell in marked]


def run(sources):
    names = {}
    for source in sources:
        exec(source, names)


@pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)
def test_each_exercise_has_an_answer_a_locked_check_and_points(path):
    lesson = nbformat.read(path, as_version=4)
    before = copy.deepcopy(lesson)
    assignment = course.to_assignment(lesson)
    nbformat.validate(assignment)
    assert lesson == before
    count = len(course.tagged(lesson, "exercise"))
    assert count >= 2
    assert len(assignment.cells) == len(lesson.cells)  # a cell with points for each solution
    found = roles(assignment)
    names = [f"{kind}-{i + 1}" for i in range(count) for kind in ("exercise", "check", "points")]
    assert [name for name, *_ in found] == names
    for name, source, role in found:
        kind = name.partition("-")[0]
        assert role.solution == (kind == "exercise")
        assert role.locked == (kind != "exercise")
        assert role.grade == (kind == "points")
        assert role.get("points") == (1 if role.grade else None)
        assert source.count("### BEGIN SOLUTION\n") == source.count("\n### END SOLUTION") == int(role.solution)
        compile(source, name, "exec")


def test_the_answer_of_the_teacher_earns_the_points_and_the_students_cell_does_not():
    answer, check, points = (source for _, source, _ in roles(course.to_assignment(small_lesson())))
    run([answer, check, points])
    scaffold, marks, _ = answer.partition("### BEGIN SOLUTION")
    assert marks and scaffold.strip() == EXERCISE
    assert "what comes of it" not in answer
    with pytest.raises(AssertionError):
        run([scaffold, check, points])


def test_a_tag_gives_more_points():
    *_, (name, _, role) = roles(course.to_assignment(small_lesson(tags=["points-3"])))
    assert (name, role.points) == ("points-1", 3)


@pytest.mark.parametrize("tags", [["points-0"], ["points-many"], ["points-1", "points-2"]])
def test_wrong_points_are_refused(tags):
    with pytest.raises(ValueError, match="tags: one of the kind points-3 is allowed"):
        course.to_assignment(small_lesson(tags=tags))


def test_a_solution_without_its_check_is_refused():
    with pytest.raises(ValueError, match="exercise 1 needs print"):
        course.to_assignment(small_lesson(solution="solution_1 = abs"))


def test_what_lessons_import_lies_beside_each_assignment(tmp_path):
    files = course.write(tmp_path)
    assert [file.relative_to(tmp_path).as_posix() for file in files] == [
        f"source/{path.stem}/{path.name}" for path in LESSONS
    ]
    code = {path.relative_to(handouts.LESSONS) for path in handouts.LESSONS.rglob("*.py")}
    for file in files:
        assert code < {path.relative_to(file.parent) for path in file.parent.rglob("*.py")}
        assert (file.parent / "experiments" / "__init__.py").exists()
    assert "code_stub" in (tmp_path / "nbgrader_config.py").read_text()


def test_nbgrader_accepts_a_lesson():
    form = pytest.importorskip("nbgrader.nbgraderformat", reason="needs nbgrader: docs/grading.txt")
    form.MetadataValidator().validate_nb(course.to_assignment(nbformat.read(LESSONS[0], as_version=4)))
