"""The scripts of workflow/ that measure: a single case of each, and what is stored of them."""

import json
import subprocess
import sys
from pathlib import Path

from gem_lite import clip
from gem_lite.evaluation import results
from gem_lite.learning import recorded
from gem_lite.policies.checkpoints import read_card
from gem_lite.rgbd.sensor_errors import HARD, KINDS
from gem_lite.se2 import Workspace

WORKFLOW = Path(__file__).parents[1] / "workflow"
POLICY = clip.DATA / "gem-foreign-table.safetensors"


def run(script, *words):
    command = [sys.executable, str(WORKFLOW / script), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
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
    printed = run("foreign_table.py", "--out", tmp_path / "rows.jsonl", "measure", POLICY, "--episodes", 2)
    (row,) = results.read_rows(tmp_path / "rows.jsonl")
    stored = {row["method"]: row for row in results.read_rows(results.RESULTS / "own-table.jsonl") if row["demos"] == 5}
    assert row["rewards"] == {index: stored["gem"]["rewards"][index] for index in ("0", "1")}
    assert row["checkpoint_sha256"] == stored["gem"]["checkpoint_sha256"] and "foreign-block-in-bowl" in printed


def test_a_point_of_the_error_curves_is_measured_once(tmp_path):
    words = ("--kinds", "none", "--episodes", 1, "--out", tmp_path / "rows.jsonl")
    assert "0 of 1 cells" in run("sensor_curves.py", *words)
    assert "1 of 1 cells" in run("sensor_curves.py", *words)
    (row,) = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert (row["kind"], row["level"], row["episodes"], row["levelled"]) == ("none", "clean", 1, False)


def test_the_stored_curves_hold_every_kind_of_error():
    rows = results.read_rows(results.RESULTS / "sensor-errors.jsonl")
    assert {row["kind"] for row in rows} == {"none", "all", *KINDS}
    hard = next(row for row in rows if (row["kind"], row["level"]) == ("rotation", "hard") and not row.get("levelled"))
    assert hard["errors"]["rotation_error"] == HARD.rotation_error and hard["errors"]["disparity_noise"] == 0
