"""The lessons as a course of nbgrader, which collects the exercises and scores them.

    python -m docs.course [FOLDER]

Each lesson is an assignment of its own: ``source/<lesson>/<lesson>.ipynb``, with what it imports beside it. A cell with
the tag "exercise" is the student's answer and holds the solution between nbgrader's marks. Cells with the tag "check"
are locked. After each of them stands a locked cell that gives the points: 1, or 3 with the tag "points-3".
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path

import nbformat

from docs import handouts

FOLDER = handouts.ROOT / "build" / "course"
SETTINGS = """# nbgrader's settings for this course.
c = get_config()
c.CourseDirectory.course_id = "gem_lite"
c.ClearSolutions.code_stub = {"python": "# Your answer takes the place of ..."}
c.Execute.timeout = 1800  # seconds a cell
"""
SOLVED = re.compile(r'^assert check_\w+\((.+)\) == "right"$', re.MULTILINE)
"""In a solution's cell: everything above is the solution, the group is its name."""
CHECKED = re.compile(r"^print\(.*?(check_\w+)\((\w+)\)\)$", re.MULTILINE)
"""In a check's cell: the check and the name of the answer."""
POINTS = "points-"


def tagged(notebook: nbformat.NotebookNode, tag: str) -> list[nbformat.NotebookNode]:
    """The cells of a notebook with a tag, in order."""
    return [cell for cell in notebook.cells if tag in cell.metadata.get("tags", [])]


def points_of(tags: Iterable[str]) -> int:
    """The points of a check with these tags, such as "points-3"; 1 if none says it."""
    numbers = [tag.removeprefix(POINTS) for tag in tags if tag.startswith(POINTS)]
    if not numbers:
        return 1
    if len(numbers) > 1 or not re.fullmatch("[1-9][0-9]*", numbers[0]):
        raise ValueError(f"tags: one of the kind points-3 is allowed, with a whole number from 1; these are {tags}")
    return int(numbers[0])


def mark(cell: nbformat.NotebookNode, name: str, **what: object) -> None:
    """Tell nbgrader what a cell is: ``solution=True``, ``locked=True``, or ``locked=True, grade=True, points=3``."""
    plain = {"schema_version": 3, "grade_id": name, "grade": False, "solution": False, "locked": False, "task": False}
    cell.metadata["nbgrader"] = plain | what


def to_assignment(lesson: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The teacher's copy of a lesson: nbgrader makes the students' copy from it.

    Raises:
        ValueError: A solution or a check does not end as the lessons' do, or the tags with points are wrong.
    """
    assignment = handouts.without_solutions(lesson)
    exercises, checks, solutions = (
        tagged(notebook, tag)
        for notebook, tag in ((assignment, "exercise"), (assignment, "check"), (lesson, "solution"))
    )
    for number, (exercise, check, solution) in enumerate(zip(exercises, checks, solutions, strict=True), start=1):
        solved, checked = SOLVED.search(solution.source), CHECKED.search(check.source)
        if not solved or not checked:
            raise ValueError(f"lesson: exercise {number} needs print(check_x(answer)), and an assert with check_x")
        definitions = solution.source[: solved.start()].strip()
        exercise.source += f"\n\n\n### BEGIN SOLUTION\n{definitions}\n\n\n{checked[2]} = {solved[1]}\n### END SOLUTION"
        mark(exercise, f"exercise-{number}", solution=True)
        mark(check, f"check-{number}", locked=True)
        score = nbformat.v4.new_code_cell(f'assert {checked[1]}({checked[2]}) == "right"', id=f"points-{number}")
        mark(score, f"points-{number}", locked=True, grade=True, points=points_of(check.metadata.tags))
        assignment.cells.insert(assignment.cells.index(check) + 1, score)
    return assignment


def write(folder: Path) -> list[Path]:
    """Write the assignments of all lessons and nbgrader's settings. Returns the files of the assignments."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "nbgrader_config.py").write_text(SETTINGS)
    files = []
    for path in sorted(handouts.LESSONS.glob("*.ipynb")):
        home = folder / "source" / path.stem
        handouts.copy_beside(home)
        files.append(home / path.name)
        nbformat.write(to_assignment(nbformat.read(path, as_version=4)), files[-1])
    return files


if __name__ == "__main__":
    for file in write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER):
        print(file)
