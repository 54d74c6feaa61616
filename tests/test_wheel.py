"""The package as a wheel: what it declares, and what it does when it is installed elsewhere, without a network."""

import ast
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from gem_lite import clip, demonstrations
from gem_lite.foundations import files
from gem_lite.policies import checkpoints

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
GROUPS = PROJECT["project"]["optional-dependencies"]
ROBOT = next(c for c in PROJECT["tool"]["importlinter"]["contracts"] if c["type"] == "forbidden")["source_modules"]
"""The modules that know no simulator."""
GROUP_OF = {
    "gem_lite.language": "words", "gem_lite.drawing": "notebooks", "gem_lite.cli": "demo", "gem_lite.training": "table",
    "gem_lite.serving": "serve", "gem_lite.layouts": "ros", "gem_lite.page": "app",
}  # fmt: skip
"""What these packages need. The others need "core" without the simulator, and "sim" with it."""
POLICY, DEMONSTRATIONS = "gem-put-block-in-bowl.safetensors", "put-block-in-bowl-seen-colors-10"
ACT = f"""
from importlib.util import find_spec
visible = [name for name in ("pybullet", "matplotlib", "shapely", "trimesh", "nbformat", "pytest") if find_spec(name)]
from gem_lite import clip, demonstrations
from gem_lite.evaluation import results
from gem_lite.policies import checkpoints
assert results.stored_rows()
policy = checkpoints.load_policy(clip.DATA / {POLICY!r}, clip.load())
step = demonstrations.load(clip.DATA / "demos" / {DEMONSTRATIONS!r})[0].steps[0]
print(clip.DATA, clip.__file__, visible, policy.act(step.observation, step.instruction), sep="\\n")
"""


def imported(module: str) -> set[str]:
    """The names of the modules from outside that a module or a package of the library imports."""
    path = ROOT.joinpath(*module.split("."))
    modules = set()
    for file in path.rglob("*.py") if path.is_dir() else [path.with_suffix(".py")]:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                modules |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                modules.add(node.module.partition(".")[0])
    return modules - {"gem_lite"} - sys.stdlib_module_names


def group(name: str) -> list[Requirement]:
    """What a group of pyproject.toml asks for, with the core group and the groups that it names."""
    asked = [Requirement(line) for line in PROJECT["project"]["dependencies"] + GROUPS.get(name, [])]
    others = [extra for requirement in asked if requirement.name == "gem_lite" for extra in requirement.extras]
    outside = [requirement for requirement in asked if requirement.name != "gem_lite"]
    return outside + [requirement for extra in others for requirement in group(extra)]


def closure(requirements: list[Requirement]) -> set[str]:
    """The names of all distributions that ``requirements`` bring along here."""
    done: set[tuple[str, ...]] = set()
    waiting = list(requirements)
    while waiting:
        requirement = waiting.pop()
        extras = {"", *requirement.extras}
        key = (canonicalize_name(requirement.name), *sorted(extras))
        if key in done:
            continue
        done.add(key)
        for line in metadata.requires(requirement.name) or []:
            further = Requirement(line)
            if further.marker is None or any(further.marker.evaluate({"extra": extra}) for extra in extras):
                waiting.append(further)
    return {name for name, *_ in done}


def parts() -> list[tuple[str, str]]:
    """Each module or package of the library's top, and the group that it needs."""
    top = [path for path in (ROOT / "gem_lite").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()]
    names = sorted(f"gem_lite.{path.stem}" for path in top if path.stem not in ("__init__", "__main__"))
    return [(name, GROUP_OF.get(name, "core" if name in ROBOT else "sim")) for name in names]


def test_what_the_library_imports_is_declared_and_what_is_declared_is_imported():
    providers = {
        module: {canonicalize_name(name) for name in names}
        for module, names in metadata.packages_distributions().items()
    }
    for module, needs in parts():
        declared = {canonicalize_name(requirement.name) for requirement in group(needs)}
        # gradio is installed in an environment of its own, under the name of its module.
        given = {name: providers.get(name, {canonicalize_name(name)}) for name in imported(module)}
        assert {name for name, packages in given.items() if not declared & packages} == set(), (module, needs)
    declared = {canonicalize_name(requirement.name) for requirement in group("sim")}
    brought_along = {"mapbox-earcut", "typing-extensions"}
    assert declared - set().union(*(providers.get(name, set()) for name in imported("gem_lite"))) <= brought_along


def test_environment_pins_all_that_the_tests_and_the_demo_install_and_the_group_all_holds_every_group():
    lines = (ROOT / "environment.txt").read_text().splitlines()
    pinned = {canonicalize_name(line.partition("==")[0]) for line in lines if "==" in line}
    needed = closure([requirement for name in ("demo", "notebooks", "dev") for requirement in group(name)])
    assert len(needed) > 100
    assert needed - pinned == set()
    everything = {str(requirement) for requirement in group("all")}
    assert everything >= {str(requirement) for name in GROUPS for requirement in group(name)}


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


def run(program, folders, home):
    """The lines that a program prints which sees Python's own library and ``folders``, but no site-packages."""
    paths = [str(folder) for folder in folders]
    command = [sys.executable, "-I", "-S", "-B", "-c", f"import sys\nsys.path[:0] = {paths!r}\n{program}"]
    environment = {"HF_HUB_OFFLINE": "1", "HOME": str(home)}
    done = subprocess.run(command, cwd=home, env=environment, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.release
def test_an_installed_wheel_with_the_core_group_alone_acts_in_another_folder(installed, tmp_path):
    core = tmp_path / "core"
    core.mkdir()
    for name in closure(group("core")):
        distribution = metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files} - {"..", "__pycache__"}:
            if not (core / top).exists():  # two distributions may share a folder
                (core / top).symlink_to(distribution.locate_file(top))
    data, module, visible, action = run(ACT, [installed, core], tmp_path)
    assert Path(data) == installed / "gem_lite_data"
    assert Path(module) == installed / "gem_lite" / "clip" / "__init__.py"
    assert visible == "[]"
    step = demonstrations.load(clip.DATA / "demos" / DEMONSTRATIONS)[0].steps[0]
    here = checkpoints.load_policy(clip.DATA / POLICY, clip.load()).act(step.observation, step.instruction)
    assert action == str(here)


def test_the_wheel_has_every_package_and_names_its_dependencies(installed):
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "gem_lite").rglob("__init__.py")}
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == {".".join(f.parts) for f in folders} | {"gem_lite_data"}
    (folder,) = installed.glob("gem_lite-*.dist-info")
    wheel = metadata.PathDistribution(folder)
    required = [Requirement(line) for line in wheel.requires]
    assert {str(r) for r in required if r.marker is None} == set(PROJECT["project"]["dependencies"])
    assert set(wheel.metadata.get_all("Provides-Extra")) == set(GROUPS)
    assert wheel.metadata["Requires-Python"] == PROJECT["project"]["requires-python"]


def test_the_checkouts_data_comes_first(tmp_path):
    assert clip.DATA == ROOT / "data"
    for folder, found in ((None, "gem_lite_data"), ("data", "gem_lite_data"), ("data/clip-tabletop", "data")):
        if folder:
            (tmp_path / folder).mkdir()  # without the CLIP it is another package's
        assert files.data_folder(tmp_path / "gem_lite") == tmp_path / found
