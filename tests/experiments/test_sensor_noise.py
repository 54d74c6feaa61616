"""Success against the errors of depth cameras: the cells, the command, and what is stored."""

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
from sensor_errors import HARD, KINDS, SensorErrors

from experiments.sensor_noise.curves import only
from gem_lite.evaluation import results


def start(*words, folder):
    command = [sys.executable, "-m", "experiments.sensor_noise", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=folder, env=environment)


def test_one_kind_alone_at_a_multiple_of_its_size():
    assert only("edges", HARD, 2) == SensorErrors(
        lateral_jitter=2.0, fattening=8, least_fattening=2, mixed=0.4, invalid=0.4
    )
    assert only("holes", HARD, 2).steep_dropout == 1.0
    assert only("position", factor=0) == SensorErrors()


def test_a_point_of_the_curves_is_measured_once(tmp_path):
    words = ("--kinds", "none", "--episodes", 1)
    first, again = (start(*words, folder=tmp_path) for _ in range(2))
    assert "0 of 1 cells" in first.stdout and "1 of 1 cells" in again.stdout, first.stderr
    (row,) = results.read_rows(tmp_path / "runs" / "results" / "sensor-errors.jsonl")
    assert (row["kind"], row["level"], row["episodes"], row["levelled"]) == ("none", "clean", 1, False)
    stored = {row["subset"]: row for row in results.read_rows(results.RESULTS / "sensor-errors.jsonl")}
    assert row.keys() >= stored["sensor errors: none, clean"].keys() - {"levelled"}


def test_the_stored_curves_hold_every_kind_of_error():
    rows = results.read_rows(results.RESULTS / "sensor-errors.jsonl")
    assert {row["kind"] for row in rows} == {"none", "all", *KINDS}
    hard = next(row for row in rows if (row["kind"], row["level"]) == ("rotation", "hard") and not row.get("levelled"))
    assert hard["errors"]["rotation_error"] == HARD.rotation_error == math.radians(1)
    assert hard["errors"]["disparity_noise"] == 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--checkpoint", "none.safetensors"], "the checkpoint none.safetensors is not complete"),
        (["--task", "object-sorting-seen"], "was trained for a table 1.0 m long; the task's is"),
        (["--episodes", "0"], "episodes must be at least 1, got 0"),
        (["--kinds", "weather"], "argument --kinds: invalid choice: 'weather'"),
    ],
)
def test_what_cannot_be_measured_ends_in_one_sentence(words, sentence, tmp_path):
    done = start(*words, folder=tmp_path)
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
