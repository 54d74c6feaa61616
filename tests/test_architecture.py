"""The rooms of the library: one forward direction, no circle, no simulator below the line (pyproject.toml)."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import gem_lite

ROOT = Path(gem_lite.__file__).parent.parent


def test_import_contracts_hold():
    program = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", program, "--no-cache"], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 kept, 0 broken" in done.stdout


def test_the_library_imports_no_experiment_and_no_lesson():
    beside = ("experiments", "notebooks", "drawings", *(path.stem for path in (ROOT / "notebooks").glob("*.py")))
    imports = re.compile(rf"^\s*(?:from|import) ({'|'.join(beside)})\b", re.M)
    assert imports.search("    from experiments.benchmark import plan")
    assert not [path for path in (ROOT / "gem_lite").rglob("*.py") if imports.search(path.read_text())]


def test_data_holds_no_code():
    assert not list((ROOT / "data").rglob("*.py"))


def test_mypy_looks_at_all_that_is_below_the_simulator():
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    (below,) = (c["source_modules"] for c in tools["importlinter"]["contracts"] if c["type"] == "forbidden")
    assert sorted(tools["mypy"]["packages"]) == sorted(below)
