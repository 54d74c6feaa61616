"""Does nbgrader score the lessons as it should? Right answers earn all points, and an empty hand-in earns none.

    python -m docs.graded [LESSON ...]

A lesson is named by its file's name without the ending; without arguments, two short ones are scored. nbgrader executes
each of them twice, once for each hand-in. It has to be installed: docs/grading.txt.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import nbformat

from docs import course

LESSONS = ("00_quickstart", "01_tabletop_world")
SOLVED, EMPTY = "solved", "empty"
"""The two students."""


def nbgrader(folder: Path, *words: str) -> None:
    """Run a command of nbgrader in a course's folder. It calls alembic, which lies beside this Python."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    command = [sys.executable, "-Wignore", "-m", "nbgrader", *words, "--log-level=WARN"]
    subprocess.run(command, cwd=folder, env=os.environ | {"PATH": path}, check=True)


def hand_in(folder: Path, lesson: str) -> None:
    """Both students hand in their copies: one with the teacher's answers, the other one as it was released."""
    released, source = (
        nbformat.read(folder / step / lesson / f"{lesson}.ipynb", as_version=4) for step in ("release", "source")
    )
    answers = {cell.id: cell.source for cell in course.tagged(source, "exercise")}
    for student in (EMPTY, SOLVED):
        if student == SOLVED:
            for cell in course.tagged(released, "exercise"):
                cell.source = answers[cell.id]
        home = folder / "submitted" / student / lesson
        home.mkdir(parents=True)
        nbformat.write(released, home / f"{lesson}.ipynb")


def score(folder: Path, lessons: list[str]) -> list[dict[str, str]]:
    """Release, hand in and score lessons in a course's new folder. Returns rows of nbgrader's table of grades."""
    course.write(folder)
    for lesson in lessons:
        nbgrader(folder, "generate_assignment", lesson)
        hand_in(folder, lesson)
        nbgrader(folder, "autograde", lesson)
        nbgrader(folder, "generate_feedback", lesson)
        for student in (SOLVED, EMPTY):
            assert (folder / "feedback" / student / lesson / f"{lesson}.html").exists()
    nbgrader(folder, "export", "--to=grades.csv")
    with open(folder / "grades.csv", newline="") as table:
        return list(csv.DictReader(table))


def main(lessons: list[str]) -> bool:
    """Print the points of both hand-ins of lessons. Returns whether they are as they should be."""
    with tempfile.TemporaryDirectory() as folder:
        rows = score(Path(folder) / "course", lessons)
    right = len(rows) == 2 * len(lessons)
    for row in rows:
        points, most = float(row["raw_score"]), float(row["max_score"])
        right &= points == (most if row["student_id"] == SOLVED else 0)
        print(f"{row['assignment']:28s} {row['student_id']:7s} {points:.0f} of {most:.0f}")
    return right


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1:] or list(LESSONS)) else "The points are wrong: all for the solved hand-in, else 0.")
