"""The rooms of the library: one forward direction, no circle, no simulator below the line (pyproject.toml)."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import gem_lite

ROOT = Path(gem_lite.__file__).parent.parent


def test_import_contracts_hold():
    program = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", program, "--no-cache"], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 kept, 0 broken" in done.stdout


def test_the_library_has_few_doors():
    entries = [path for path in (ROOT / "gem_lite").iterdir() if path.name != "__pycache__"]
    assert len(entries) <= 22, sorted(path.name for path in entries)


def test_data_holds_no_code():
    assert not list((ROOT / "data").rglob("*.py"))


def test_mypy_looks_at_all_that_is_below_the_simulator():
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    (below,) = (c["source_modules"] for c in tools["importlinter"]["contracts"] if c["type"] == "forbidden")
    assert sorted(tools["mypy"]["packages"]) == sorted(below)


@pytest.mark.parametrize("path", sorted((ROOT / "gem_lite").rglob("*.py")), ids=lambda path: path.stem)
def test_files_and_functions_are_short(path):
    source = path.read_text()
    assert source.count("\n") <= 350
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    long = [node.name for node in functions if node.end_lineno - node.lineno + 1 > 50]
    assert long == []
