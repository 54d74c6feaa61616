"""The package as a wheel: built without a network, installed elsewhere, used from another folder."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from gem_lite import clip, files

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
USE = """
from gem_lite import clip
from gem_lite.cli import demo
from gem_lite.evaluation import evaluate, results
from gem_lite.learning import train
model = clip.load()
assert model.dim > 0 and model.calibration is not None
assert (clip.DATA / "gem-put-block-in-bowl.safetensors").exists()
assert results.read_rows(results.results_file("put-block-in-bowl-seen-colors"))
print(clip.DATA, clip.__file__, model.name, sep="\\n")
"""


def imported() -> set[str]:
    """The names of all top-level modules that the package imports."""
    modules = set()
    for path in (ROOT / "gem_lite").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                modules.add((node.module or "").partition(".")[0])
    return modules - {"gem_lite"} - sys.stdlib_module_names


def test_every_import_is_a_dependency():
    providers = metadata.packages_distributions()
    names = [re.split("[=<>~! ]", name)[0] for name in PROJECT["project"]["dependencies"]]
    declared = {name.lower().replace("-", "_") for name in names}
    assert len(imported()) > 10
    missing = {
        module for module in imported() if not declared & {p.lower().replace("-", "_") for p in providers[module]}
    }
    assert missing == set()


def test_every_package_is_in_the_wheel():
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "gem_lite").rglob("__init__.py")}
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == {".".join(f.parts) for f in folders} | {"gem_lite_data"}


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the installed wheel. It is built from a copy, so that no build files stay in the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("gem_lite", "data"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    build = ["wheel", "--no-index", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(source)]
    subprocess.run([*pip, *build], check=True, timeout=1800)
    (wheel,) = folder.glob("*.whl")
    target = folder / "installed"
    subprocess.run([*pip, "install", "--no-index", "--no-deps", "--target", target, wheel], check=True, timeout=1800)
    return target


def test_an_installed_wheel_works_from_another_folder(installed, tmp_path):
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(installed)!r})\n{USE}"]
    environment = {"HF_HUB_OFFLINE": "1", "HOME": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    data, module, name = done.stdout.splitlines()
    assert Path(data) == installed / "gem_lite_data"
    assert Path(module) == installed / "gem_lite" / "clip" / "__init__.py"
    assert name == "embedded clip-tabletop"


def test_the_wheel_names_its_dependencies(installed):
    (folder,) = installed.glob("gem_lite-*.dist-info")
    required = metadata.PathDistribution(folder).requires
    assert set(required) == set(PROJECT["project"]["dependencies"])


def test_the_checkouts_data_comes_first(tmp_path):
    assert clip.DATA == ROOT / "data"
    assert files.data_folder(tmp_path / "gem_lite") == tmp_path / "gem_lite_data"
    (tmp_path / "data").mkdir()  # of another package
    assert files.data_folder(tmp_path / "gem_lite") == tmp_path / "gem_lite_data"
    (tmp_path / "data" / "clip-tabletop").mkdir()
    assert files.data_folder(tmp_path / "gem_lite") == tmp_path / "data"
