"""The scripts of workflow/ that measure: a single case of each, and what is stored of them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gem_lite import clip
from gem_lite.evaluation import results
from gem_lite.learning import recorded
from gem_lite.policies.checkpoints import read_card
from gem_lite.rgbd.sensor_errors import HARD, KINDS
from gem_lite.se2 import Workspace

WORKFLOW = Path(__file__).parents[1] / "workflow"
POLICY = clip.DATA / "gem-foreign-table.safetensors"


def start(script, *words, folder=None):
    command = [sys.executable, str(WORKFLOW / script), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=folder)


def run(script, *words, folder=None):
    done = start(script, *words, folder=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_stored_foreign_demonstrations_are_those_that_the_script_records(tmp_path):
    run("foreign_table.py", "record", tmp_path / "demos", "--episodes", 1)
    (fresh,) = recorded.read(tmp_path / "demos", Workspace())
    stored = next(recorded.read(clip.DATA / "foreign-demos", Workspace()))
    assert fresh.steps[0].instruction == stored.steps[0].instruction
    for name in ("pick", "place"):
        a, b = (getattr(part.steps[0].expert.action, name) for part in (fresh, stored))
        assert abs(a.x - b.x) < 1e-3 and abs(a.y - b.y) < 1e-3


def test_the_shipped_foreign_policy_was_trained_on_the_stored_demonstrations(tmp_path):
    packed = recorded.pack(clip.DATA / "foreign-demos", tmp_path / "packed", Workspace())
    assert read_card(POLICY)["data_sha256"] == packed.digest and read_card(POLICY)["demos"] == len(packed) == 5


def test_a_policy_is_measured_on_the_foreign_table(tmp_path):
    printed = run("foreign_table.py", "measure", POLICY, "--episodes", 2, folder=tmp_path)
    (row,) = results.read_rows(tmp_path / "runs" / "results" / "own-table.jsonl")
    stored = {row["method"]: row for row in results.read_rows(results.RESULTS / "own-table.jsonl") if row["demos"] == 5}
    assert row["rewards"] == {index: stored["gem"]["rewards"][index] for index in ("0", "1")}
    assert row["checkpoint_sha256"] == stored["gem"]["checkpoint_sha256"] and "foreign-block-in-bowl" in printed


def test_a_point_of_the_error_curves_is_measured_once(tmp_path):
    words = ("--kinds", "none", "--episodes", 1)
    assert "0 of 1 cells" in run("sensor_curves.py", *words, folder=tmp_path)
    assert "1 of 1 cells" in run("sensor_curves.py", *words, folder=tmp_path)
    (row,) = results.read_rows(tmp_path / "runs" / "results" / "sensor-errors.jsonl")
    assert (row["kind"], row["level"], row["episodes"], row["levelled"]) == ("none", "clean", 1, False)


def test_the_stored_curves_hold_every_kind_of_error():
    rows = results.read_rows(results.RESULTS / "sensor-errors.jsonl")
    assert {row["kind"] for row in rows} == {"none", "all", *KINDS}
    hard = next(row for row in rows if (row["kind"], row["level"]) == ("rotation", "hard") and not row.get("levelled"))
    assert hard["errors"]["rotation_error"] == HARD.rotation_error and hard["errors"]["disparity_noise"] == 0


@pytest.mark.parametrize(
    ("script", "words", "sentence"),
    [
        ("foreign_table.py", ["measure", "none.safetensors"], "the checkpoint none.safetensors is not complete"),
        ("foreign_table.py", ["measure", "none.safetensors", "--episodes", "0"], "must be from 1 to 1000, got 0"),
        ("sensor_curves.py", ["--checkpoint", "none.safetensors"], "the checkpoint none.safetensors is not complete"),
        ("sensor_curves.py", ["--task", "object-sorting-seen"], "was trained for a table 1.0 m long; the task's is"),
    ],
)
def test_what_cannot_be_measured_ends_in_one_sentence(script, words, sentence, tmp_path):
    done = start(script, *words, folder=tmp_path)
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_cleaning_keeps_what_users_trained():
    command = ["make", "--no-print-directory", "--dry-run", "clean"]
    done = subprocess.run(command, cwd=WORKFLOW.parent, capture_output=True, text=True)
    removed = done.stdout.split()
    assert removed[:2] == ["rm", "-rf"] and ".venv" in removed and "runs" not in removed
