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
BELOW = ("rgbd", "clip", "maps", "policies", "training")
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


def test_rooms_below_the_line_load_without_the_simulator():
    run("".join(f"import {room}\n" for room in rooms()))


@pytest.mark.parametrize(
    ("words", "start"),
    [
        (["verify", str(STORED)], f"{STORED}: 10 episodes"),
        (["results", "list"], "object-sorting: "),
        (["results", "show", "benchmark/align-rope", "--method", "expert"], "expert on align-rope, in home"),
        (["results", "show", "pointing", "--method", "fused"], "bowls, fused: near "),
    ],
)
def test_stored_rows_and_demonstrations_are_read_without_the_simulator(words, start):
    printed = run(f"from gem_lite.cli import main\nassert main({words}) == 0\n")
    assert printed.startswith(start)


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
