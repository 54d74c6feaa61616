"""Processes that measure: what is left when one of them, or their parent, is killed."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from gem_lite.evaluation import evaluate, workers
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.evaluation.results import Episode

FATAL = 12


@dataclass(frozen=True)
class Job:
    indices: Sequence[int]


def run_and_be_killed(job):
    """An episode for each index. The process that comes to `FATAL` is killed, as for lack of memory."""
    if FATAL in job.indices:
        os.kill(os.getpid(), signal.SIGKILL)
    return [Episode(index, 1.0, 1, ()) for index in job.indices]


@pytest.mark.release
def test_processes_know_tasks_and_worlds_from_outside_and_outcomes_come_in_the_order_of_the_jobs(monkeypatch):
    import toys  # noqa: F401

    monkeypatch.setattr(workers, "CHUNK", 1)
    episodes = evaluate.evaluate(Measurement("expert", "block-on-plate", 3, "val", world="night"), processes=2)
    assert [(episode.index, episode.reward) for episode in episodes] == [(0, 1.0), (1, 1.0), (2, 1.0)]


def test_a_killed_process_ends_the_work(capsys):
    with pytest.raises(ChildProcessError, match=r"test: .*killed .* while the scenes 12, 13 were .*is filed$"):
        workers.run_jobs(run_and_be_killed, [Job([3]), Job([12, 13])], "test", processes=1, unit="scene")
    assert capsys.readouterr().out == ""


@pytest.mark.release
def test_an_evaluation_whose_process_is_killed_files_no_row_and_prints_what_was_complete(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(evaluate, "run_job", run_and_be_killed)
    path = tmp_path / "rows.jsonl"
    said = r"expert on block-insertion: .* the episodes 8, 9, 10, 11, 12 were .*is filed.* of the 5 episodes"
    with pytest.raises(ChildProcessError, match=said):
        evaluate.measure_and_file(Measurement("expert", "block-insertion", 12, start=3), path, processes=1)
    assert capsys.readouterr().out.splitlines() == [str(Episode(index, 1.0, 1, ())) for index in range(3, 8)]
    assert not path.exists()


def alive(pid):
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads /proc")
def test_processes_end_with_their_parent(tmp_path):
    started, script = tmp_path / "started", tmp_path / "script.py"
    script.write_text("""
import os, pathlib, sys, time, types
from gem_lite.evaluation import workers

def sleep(job):
    pathlib.Path(sys.argv[1]).write_text(str(os.getpid()))
    time.sleep(600)

if __name__ == "__main__":
    workers.run_jobs(sleep, [types.SimpleNamespace(indices=[0])], "test", processes=1)
""")
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    parent = subprocess.Popen([sys.executable, script, started], env=environment)
    try:
        wait_until(lambda: started.exists() and started.read_text())
    finally:
        parent.kill()
        parent.wait()
    worker = int(started.read_text())
    wait_until(lambda: not alive(worker))


def wait_until(condition, seconds=120):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.1)
