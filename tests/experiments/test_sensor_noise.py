"""Success against the errors of depth cameras: the cells, the command, and what is stored."""

import math

import torch

from experiments.sensor_noise.__main__ import APP
from experiments.sensor_noise.curves import cells, only
from gem_lite.cli import base
from gem_lite.evaluation import results
from gem_lite.rgbd.sensor_errors import HARD, KINDS, SensorErrors


def test_one_kind_alone_at_a_multiple_of_its_size():
    assert only("edges", HARD, 2) == SensorErrors(
        lateral_jitter=2.0, fattening=8, least_fattening=2, mixed=0.4, invalid=0.4
    )
    assert only("holes", HARD, 2).steep_dropout == 1.0
    assert only("position", factor=0) == SensorErrors()


def test_a_point_of_the_curves_is_measured_once(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    threads = torch.get_num_threads()
    for done in (0, 1):
        assert base.run(APP, ["--kinds", "none", "--episodes", "1"]) == 0
        assert f"{done} of 1 cells" in capsys.readouterr().out
    torch.set_num_threads(threads)
    (row,) = results.read_rows(tmp_path / "runs" / "results" / "sensor-errors.jsonl")
    assert (row["kind"], row["level"], row["episodes"], row["levelled"]) == ("none", "clean", 1, False)
    stored = {row["subset"]: row for row in results.read_rows(results.RESULTS / "sensor-errors.jsonl")}
    assert row.keys() >= stored["sensor errors: none, clean"].keys() - {"levelled"}


def test_the_stored_curves_hold_every_kind_of_error():
    rows = results.read_rows(results.RESULTS / "sensor-errors.jsonl")
    assert {row["kind"] for row in rows} == {"none", "all", *KINDS}
    sizes = {cell.name: cell.errors for cell in cells()}
    assert all(sizes[row["subset"]] == SensorErrors(**row["errors"]) for row in rows)
    hard = next(row for row in rows if (row["kind"], row["level"]) == ("rotation", "hard") and not row.get("levelled"))
    assert hard["errors"]["rotation_error"] == HARD.rotation_error == math.radians(1)
    assert hard["errors"]["disparity_noise"] == 0
