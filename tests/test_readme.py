"""The Python of the README and of docs/installing.md runs as it stands there; what make does to users' files."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def snippets(name):
    return re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)


@pytest.mark.parametrize("name", ["README.md", "docs/installing.md"])
def test_the_python_of_a_page_runs(name, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (snippet,) = snippets(name)
    namespace = {}
    exec(compile(snippet, name, "exec"), namespace)
    if "world" in namespace:
        assert namespace["step"].grasped
    else:
        assert "PickPlace(" in capsys.readouterr().out


def test_every_file_that_a_page_names_is_there():
    folders = ("*.md", "docs/*.md", "notebooks/*.ipynb", "data/*/*.md", "experiments/*/*.md")
    pages = [page for folder in folders for page in ROOT.glob(folder)]
    named = {
        (page.name, path)
        for page in pages
        for path in re.findall(
            r"(?<![\w/])(?:gem_lite|tests|docs|data|notebooks|experiments)/[\w/.-]*\w\.(?:py|md|ipynb|csv)",
            page.read_text(),
        )
    }
    assert len(named) > 20
    assert [entry for entry in sorted(named) if not (ROOT / entry[1]).exists()] == []


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_cleaning_keeps_what_users_trained():
    command = ["make", "--no-print-directory", "--dry-run", "clean"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    removed = done.stdout.split()
    assert removed[:2] == ["rm", "-rf"] and ".venv" in removed and "runs" not in removed
