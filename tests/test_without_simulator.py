"""What a robot's own program needs works where PyBullet cannot be imported."""

import subprocess
import sys
from pathlib import Path

import pytest

import gem_lite
from gem_lite import clip, demonstrations
from gem_lite.policies import checkpoints

SHIPPED = "gem-put-block-in-bowl.safetensors"
STORED = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
BLOCKED = "import sys; sys.modules['pybullet'] = None  # so that its import fails\n"
BELOW = ("rgbd", "clip", "demonstrations", "maps", "policies", "training")
"""Packages that a robot's own program uses."""


def rooms() -> list[str]:
    """Every module that must not need the simulator: those of `BELOW`, and the files beside them."""
    top = Path(gem_lite.__file__).parent
    files = [*top.glob("*.py"), *(path for package in BELOW for path in (top / package).rglob("*.py"))]
    names = [path.relative_to(top.parent).with_suffix("").as_posix().replace("/", ".") for path in files]
    return sorted(name.removesuffix(".__init__") for name in names)


def run(program: str) -> str:
    done = subprocess.run([sys.executable, "-c", BLOCKED + program], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_block_is_one():
    with pytest.raises(AssertionError, match="pybullet"):
        run("import gem_lite.simulation.world")


COMMANDS = {
    f"{STORED}: 10 episodes": ["verify", str(STORED)],
    "object-sorting: ": ["results", "list"],
    "expert on align-rope, in home": ["results", "show", "benchmark/align-rope", "--method", "expert"],
    "bowls, fused: near ": ["results", "show", "pointing", "--method", "fused"],
}
"""By how a line of the answer begins: the words of the command."""


def test_rooms_below_the_line_load_and_stored_rows_and_demonstrations_are_read_without_the_simulator():
    load = "".join(f"import {room}\n" for room in rooms())
    read = f"from gem_lite.cli import main\nfor words in {[*COMMANDS.values()]}:\n    assert main(words) == 0\n"
    printed = run(load + read)
    for start in COMMANDS:
        assert f"\n{start}" in f"\n{printed}"


def test_a_shipped_policy_acts_on_a_stored_observation_without_the_simulator():
    program = f"""
from gem_lite.policies import checkpoints
from gem_lite import clip, demonstrations
policy = checkpoints.load_policy(clip.DATA / {SHIPPED!r}, clip.load())
step = demonstrations.load({str(STORED)!r})[0].steps[0]
print(policy.act(step.observation, step.instruction))
"""
    step = demonstrations.load(STORED)[0].steps[0]
    here = checkpoints.load_policy(clip.DATA / SHIPPED, clip.load()).act(step.observation, step.instruction)
    assert run(program).strip() == str(here)
