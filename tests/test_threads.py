"""How torch's threads wait: OpenMP itself says what it read, when torch is loaded."""

import os
import subprocess
import sys

import pytest

LOAD = "import gem_lite, torch"
IN_A_WORKER = """
import multiprocessing
import gem_lite

if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        pool.apply(exec, ("import torch",))
"""


def what_openmp_reads(command, **environment):
    """OpenMP's settings by name, as the processes of a command printed them."""
    clean = {name: value for name, value in os.environ.items() if name not in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")}
    clean |= {"OMP_DISPLAY_ENV": "verbose"} | environment
    done = subprocess.run([sys.executable, *command], env=clean, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert done.returncode == 0, done.stderr.decode()
    lines = [line.split(" = ") for line in done.stderr.decode().splitlines() if " = '" in line]
    return {name.split()[-1]: value.strip("'") for name, value in lines}


@pytest.mark.parametrize(
    "command", [("-c", LOAD), ("-c", "from gem_lite.cli import main; import torch")], ids=["import", "command"]
)
def test_threads_wait_asleep(command):
    read = what_openmp_reads(command)
    assert (read["OMP_WAIT_POLICY"], read["GOMP_SPINCOUNT"]) == ("PASSIVE", "0")


def test_threads_of_workers_wait_asleep(tmp_path):
    # Only the worker loads torch, so what is printed is the worker's.
    (tmp_path / "program.py").write_text(IN_A_WORKER)
    assert what_openmp_reads([str(tmp_path / "program.py")])["OMP_WAIT_POLICY"] == "PASSIVE"


@pytest.mark.release
def test_who_says_otherwise_is_heard():
    assert what_openmp_reads(("-c", LOAD), OMP_WAIT_POLICY="active")["OMP_WAIT_POLICY"] == "ACTIVE"
    assert what_openmp_reads(("-c", LOAD), GOMP_SPINCOUNT="1000")["GOMP_SPINCOUNT"] == "1000"
