"""The foreign table as an experiment: its commands, its demonstrations, its still tables."""

import dataclasses
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from damages import archive_names

from gem_lite import clip, demonstrations
from gem_lite.evaluation import results
from gem_lite.policies.checkpoints import read_card

POLICY = clip.DATA / "gem-foreign-table.safetensors"


def start(*words, folder):
    command = [sys.executable, "-m", "experiments.foreign_table", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=folder, env=environment)


def run(*words, folder):
    done = start(*words, folder=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_stored_demonstrations_are_those_that_the_command_records(tmp_path):
    run("record", "demos", "--episodes", 1, folder=tmp_path)
    (fresh,) = demonstrations.load(tmp_path / "demos")
    stored = demonstrations.load(clip.DATA / "foreign-demos")[0]
    assert fresh.steps[0].instruction == stored.steps[0].instruction
    for name in ("pick", "place"):
        a, b = (getattr(part.steps[0].expert.action, name) for part in (fresh, stored))
        assert abs(a.x - b.x) < 1e-3 and abs(a.y - b.y) < 1e-3


def test_the_shipped_policy_was_trained_on_the_stored_demonstrations():
    """Its training packed them into archives, whose SHA-256 are on its card."""
    stored = demonstrations.load(clip.DATA / "foreign-demos")
    numbered = [dataclasses.replace(episode, seed=number) for number, episode in enumerate(stored)]
    digest = hashlib.sha256(json.dumps(archive_names(numbered)).encode()).hexdigest()
    assert read_card(POLICY)["data_sha256"] == digest and read_card(POLICY)["demos"] == len(stored) == 5


def test_a_policy_is_measured(tmp_path):
    printed = run("measure", POLICY, "--episodes", 2, folder=tmp_path)
    (row,) = results.read_rows(tmp_path / "runs" / "results" / "own-table.jsonl")
    stored = {row["method"]: row for row in results.read_rows(results.RESULTS / "own-table.jsonl") if row["demos"] == 5}
    assert row["rewards"] == {index: stored["gem"]["rewards"][index] for index in ("0", "1")}
    assert {*row} >= {*stored["gem"]} and "foreign-block-in-bowl" in printed
    for name in ("checkpoint_sha256", "config_hash", "steps", "actions", "demos"):
        assert row[name] == stored["gem"][name]


def test_the_stored_still_tables_are_those_that_the_command_renders(tmp_path):
    run("scenes", "scenes", folder=tmp_path)
    stored = clip.DATA / "foreign-scenes"
    for folder in (path for path in stored.iterdir() if path.is_dir()):
        for name in ("cameras.json", "truth.json"):
            fresh, kept = (
                json.loads((root / folder.name / name).read_text()) for root in (tmp_path / "scenes", stored)
            )
            assert fresh == kept
        pictures = list(folder.glob("*.png"))
        assert len(pictures) == 6
        for path in pictures:
            fresh = cv2.imread(str(tmp_path / "scenes" / folder.name / path.name), cv2.IMREAD_UNCHANGED)
            apart = np.abs(fresh.astype(int) - cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
            assert np.percentile(apart, 99) <= 2  # another renderer may round otherwise


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["measure", "none.safetensors"], "the checkpoint none.safetensors is not complete"),
        (["measure", "none.safetensors", "--episodes", "0"], "must be a whole number from 1 to 1000, got 0"),
        (["refusals", "--tables", "5"], "--tables must be at least 6, two of each of our tasks, got 5"),
        (["scenes"], "the following arguments are required: folder"),
    ],
)
def test_what_cannot_be_done_ends_in_one_sentence(words, sentence, tmp_path):
    done = start(*words, folder=tmp_path)
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
