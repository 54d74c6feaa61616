"""The lessons for students, without solutions and answers.

    python -m docs.handouts [FOLDER]

The lessons stay as they are stored, with all outputs. Solutions are left out, and so are the answers of "Check
yourself". Hints stay. What the lessons import from beside them is copied, and so is the experiment of lesson 16.
"""

from __future__ import annotations

import copy
import re
import shutil
import sys
from pathlib import Path

import nbformat

ROOT = Path(__file__).resolve().parents[1]
LESSONS = ROOT / "notebooks"
FOLDER = ROOT / "build" / "handouts"
EXPERIMENT = "picture_prompts"
"""The folder of experiments/ that lesson 16 imports."""
QUESTIONS = re.compile(r"^## Check yourself$.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
ANSWER = re.compile(r"<details>\s*<summary>(.*?)</summary>.*?</details>", re.DOTALL)


def without_solutions(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy of a lesson without the cells with the tag "solution" and without the answers to its questions."""
    handout = copy.deepcopy(notebook)
    handout.cells = [cell for cell in handout.cells if "solution" not in cell.metadata.get("tags", [])]
    for cell in handout.cells:
        if cell.cell_type == "markdown":
            cell.source = QUESTIONS.sub(lambda part: ANSWER.sub(r"- \1", part[0]), cell.source)
    return handout


def copy_beside(folder: Path) -> None:
    """Copy what the lessons import from beside them into a folder."""
    beside = shutil.ignore_patterns("*.ipynb", "__pycache__", ".*")
    shutil.copytree(LESSONS, folder, ignore=beside, dirs_exist_ok=True)
    experiments = folder / "experiments"
    shutil.copytree(ROOT / "experiments" / EXPERIMENT, experiments / EXPERIMENT, ignore=beside, dirs_exist_ok=True)
    shutil.copy(ROOT / "experiments" / "__init__.py", experiments)


def write(folder: Path) -> list[Path]:
    """Write the handouts of all lessons. Returns their files."""
    copy_beside(folder)
    files = []
    for path in sorted(LESSONS.glob("*.ipynb")):
        handout = without_solutions(nbformat.read(path, as_version=4))
        files.append(folder / path.name)
        nbformat.write(handout, files[-1])
    return files


if __name__ == "__main__":
    for file in write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER):
        print(file)
