"""The foreign table as an experiment: its commands, its demonstrations, its still tables."""

import dataclasses
import hashlib
import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from damages import archive_names

from experiments.foreign_table import measuring
from experiments.foreign_table.__main__ import APP
from gem_lite import clip, demonstrations
from gem_lite.cli import base
from gem_lite.evaluation import results
from gem_lite.policies.checkpoints import read_card
from gem_lite.se2 import Workspace

pytestmark = pytest.mark.release

POLICY = clip.DATA / "gem-foreign-table.safetensors"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs a command in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    threads = torch.get_num_threads()
    yield lambda *words: base.run(APP, [str(word) for word in words])
    torch.set_num_threads(threads)


def test_the_first_stored_demonstration_is_the_one_that_the_command_records(run, tmp_path):
    assert run("record", "demos", "--episodes", 1) == 0
    (fresh,) = demonstrations.load(tmp_path / "demos")
    stored = demonstrations.load(clip.DATA / "foreign-demos")[0]
    assert fresh.steps[0].instruction == stored.steps[0].instruction
    for name in ("pick", "place"):
        a, b = (getattr(part.steps[0].expert.action, name) for part in (fresh, stored))
        assert abs(a.x - b.x) < 1e-3 and abs(a.y - b.y) < 1e-3 and abs(a.yaw - b.yaw) < 1e-3


def test_the_shipped_policy_was_trained_on_the_stored_demonstrations():
    """Its training packed them into archives, whose SHA-256 are on its card."""
    stored = demonstrations.load(clip.DATA / "foreign-demos")
    numbered = [dataclasses.replace(episode, seed=number) for number, episode in enumerate(stored)]
    digest = hashlib.sha256(json.dumps(archive_names(numbered)).encode()).hexdigest()
    assert read_card(POLICY)["data_sha256"] == digest and read_card(POLICY)["demos"] == len(stored) == 5


def test_a_policy_of_smaller_cells_is_played_and_one_of_another_table_is_not(monkeypatch):
    def load(length, pixel):
        config = SimpleNamespace(workspace=Workspace.of_length(length, pixel))
        policy = SimpleNamespace(config=config, eval=lambda: policy)
        monkeypatch.setattr(measuring, "load_policy", lambda *_: policy)
        return measuring.load(POLICY) is policy

    assert load(1.0, 0.003125)
    with pytest.raises(ValueError, match=r"was trained for a table .*; that of the other simulator is x"):
        load(1.06, 0.00625)


def test_a_policy_is_measured(run, tmp_path, capsys):
    assert run("measure", POLICY, "--episodes", 2) == 0
    (row,) = results.read_rows(tmp_path / "runs" / "results" / "own-table.jsonl")
    stored = {row["method"]: row for row in results.read_rows(results.RESULTS / "own-table.jsonl") if row["demos"] == 5}
    assert row["rewards"] == {index: stored["gem"]["rewards"][index] for index in ("0", "1")}
    assert {*row} >= {*stored["gem"]} and "foreign-block-in-bowl" in capsys.readouterr().out
    for name in ("checkpoint_sha256", "config_hash", "steps", "actions", "demos"):
        assert row[name] == stored["gem"][name]


def test_the_stored_still_tables_are_those_that_the_command_renders(run, tmp_path):
    assert run("scenes", "scenes") == 0
    stored = clip.DATA / "foreign-scenes"
    for folder in (path for path in stored.iterdir() if path.is_dir()):
        fresh, kept = (
            json.loads((root / folder.name / "cameras.json").read_text()) for root in (tmp_path / "scenes", stored)
        )
        assert fresh == kept
        pictures = list(folder.glob("*.png"))
        assert len(pictures) == 6
        for path in pictures:
            fresh = cv2.imread(str(tmp_path / "scenes" / folder.name / path.name), cv2.IMREAD_UNCHANGED)
            apart = np.abs(fresh.astype(int) - cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
            assert np.percentile(apart, 99) <= 2  # another renderer may round otherwise
