"""The rooms of the library: one forward direction, no circle, no simulator below the line (pyproject.toml)."""

import subprocess
import sys
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


def test_the_library_has_few_doors():
    entries = [path for path in (ROOT / "gem_lite").iterdir() if path.name != "__pycache__"]
    assert len(entries) <= 24, sorted(path.name for path in entries)
