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

FATAL = 12


@dataclass(frozen=True)
class Job:
    indices: Sequence[int]
    started: Path | None = None


def run_and_be_killed(job):
    """The indices as outcomes. The process that comes to `FATAL` is killed, as for lack of memory."""
    if FATAL in job.indices:
        os.kill(os.getpid(), signal.SIGKILL)
    return list(job.indices)


def sleep(job):
    job.started.write_text(str(os.getpid()))
    time.sleep(600)
    return []


def run(episodes, processes=1, **facts):
    jobs = [Job(part) for part in workers.chunks(0, episodes)]
    return workers.run_jobs(run_and_be_killed, jobs, "test", processes=processes, **facts)


def test_outcomes_come_in_the_order_of_the_jobs():
    assert run(9, processes=2) == list(range(9))


@pytest.mark.parametrize(("unit", "reward", "printed"), [("episode", float, range(10)), ("scene", None, ())])
def test_a_killed_process_ends_the_work_and_outcomes_with_rewards_are_printed(capsys, unit, reward, printed):
    with pytest.raises(
        ChildProcessError, match=rf"killed .* while the {unit}s 10, 11, 12, 13, 14 were .*is filed"
    ) as e:
        run(30, unit=unit, reward=reward)
    assert ("of the 10 episodes that were complete" in str(e.value)) == (reward is not None)
    assert capsys.readouterr().out.split() == [str(index) for index in printed]


def killed(job):
    os.kill(os.getpid(), signal.SIGKILL)


def test_an_evaluation_whose_process_is_killed_files_no_row(monkeypatch, tmp_path):
    monkeypatch.setattr(evaluate, "run_job", killed)
    path = tmp_path / "rows.jsonl"
    with pytest.raises(ChildProcessError, match=r"expert on block-insertion: .* the episodes 3, 4 were being run"):
        evaluate.measure_and_file(Measurement("expert", "block-insertion", 2, start=3), path, processes=1)
    assert not path.exists()


def alive(pid):
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads /proc")
def test_processes_end_with_their_parent(tmp_path):
    started = tmp_path / "started"
    script = tmp_path / "script.py"
    script.write_text(f"""
from pathlib import Path
from gem_lite.evaluation import workers
import test_workers
if __name__ == "__main__":
    workers.run_jobs(test_workers.sleep, [test_workers.Job([0], Path({str(started)!r}))], "test", float, 1)
""")
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[1])])
    parent = subprocess.Popen([sys.executable, str(script)], env=os.environ | {"PYTHONPATH": paths})
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
