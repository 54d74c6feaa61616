"""What a robot's own program needs works where PyBullet cannot be imported."""

import subprocess
import sys
from pathlib import Path

import pytest

import gem_lite
from gem_lite import clip

STORED = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
SCENE = clip.DATA / "foreign-scenes" / "workbench"
EXAMPLE = Path(__file__).parents[1] / "docs" / "robot_example.py"
BELOW = ("rgbd", "clip", "demonstrations", "maps", "planning", "policies", "training")
"""Packages that a robot's own program uses."""
COMMANDS = {
    f"{STORED}: 10 episodes": ["verify", str(STORED)],
    "benchmark/align-rope: ": ["results", "list"],
    "expert on align-rope, in home": ["results", "show", "benchmark/align-rope", "--method", "expert"],
    "bowls, fused: near ": ["results", "show", "pointing", "--method", "fused"],
}
"""By how a line of the answer begins: the words of the command."""


def rooms() -> list[str]:
    """Every module that must not need the simulator: those of `BELOW`, and the files beside them."""
    top = Path(gem_lite.__file__).parent
    files = [*top.glob("*.py"), *(path for package in BELOW for path in (top / package).rglob("*.py"))]
    names = [path.relative_to(top.parent).with_suffix("").as_posix().replace("/", ".") for path in files]
    return sorted(name.removesuffix(".__init__") for name in names)


PROGRAM = f"""
import importlib, runpy, sys
sys.modules["pybullet"] = None  # so that its import fails
for room in {rooms()}:
    importlib.import_module(room)
from gem_lite.cli import main
for words in {[*COMMANDS.values()]}:
    assert main(words) == 0
for thing in ("red block", "red mug"):
    sys.argv = ["example", {str(SCENE)!r}, f"put the {{thing}} in the blue bowl"]
    try:
        runpy.run_path({str(EXAMPLE)!r})
    except SystemExit as end:
        print(end)
import gem_lite.simulation.world
"""


@pytest.fixture(scope="module")
def lines():
    """What the program prints before its last line fails."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=600)
    assert "import of pybullet halted" in done.stderr.splitlines()[-1]
    return done.stdout.splitlines()


def test_rooms_below_the_line_load_and_stored_rows_and_demonstrations_are_read(lines):
    for start in COMMANDS:
        assert any(line.startswith(start) for line in lines)


def test_the_example_drives_a_robot(lines):
    lines = lines[next(i for i, line in enumerate(lines) if line.startswith("confidence")) + 1 :]
    assert lines.pop().startswith('refused: there is no "red mug"')
    assert [line.split()[0] for line in lines] == ["move", "move", "close", "move", "move", "move", "open", "move"]
    # The block is held at its top, 48 mm above its lower side: so it is let go that much above the bowl's floor.
    heights = [float(line.split("(")[1].split(")")[0].split(", ")[2]) for line in lines if line.startswith("move")]
    assert abs(heights[1] - 0.048) < 0.003 and 0.05 < heights[4] < 0.08 and abs(heights[0] - heights[1] - 0.2) < 1e-6
