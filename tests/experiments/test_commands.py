"""The experiments' commands: helps that load nothing heavy, examples that are read, refusals in one sentence."""

import contextlib
import importlib
import io
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from gem_lite.cli import base

COMMANDS = {
    "benchmark": ("file", "page", "tables", "settings", "gallery"),
    "clip_tabletop": ("pretrain", "card"),
    "foreign_table": ("record", "measure", "refusals", "scenes"),
    "pointing": ("",),
    "sensor_noise": ("",),
}
HELPS = [(name, command) for name, commands in COMMANDS.items() for command in commands]


def run(experiment, *words):
    app = importlib.import_module(f"experiments.{experiment}.__main__").APP
    return base.run(app, [str(word) for word in words])


@pytest.fixture(autouse=True)
def threads_as_they_were():
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_helps_load_no_heavy_package():
    lines = [f"from experiments.{name}.__main__ import APP as {name}" for name in COMMANDS]
    lines += [f"base.run({name}, {[*command.split(), '--help']})" for name, command in HELPS]
    program = "\n".join(["import sys", "from gem_lite.cli import base", *lines, "print(*sys.modules, file=sys.stderr)"])
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.count("Usage: python -m experiments.") == len(HELPS)
    assert not {"torch", "numpy", "pybullet", "matplotlib", "mujoco", "yaml"} & set(done.stderr.split())


@pytest.mark.parametrize(("experiment", "command"), HELPS)
def test_examples_are_read_as_they_stand(experiment, command):
    app = importlib.import_module(f"experiments.{experiment}.__main__").APP
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert run(experiment, *command.split(), "--help") == 0
    examples = printed.getvalue().partition("Examples:\n")[2].splitlines()
    assert examples
    for line in examples:
        words = shlex.split(line)
        assert words[:3] == ["python", "-m", f"experiments.{experiment}"]
        function, _, _ = app.parse_args(words[3:])
        assert function.__name__ == command or not command


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("clip_tabletop pretrain --scenes 0", "scenes and epochs must be at least 1, got 0 and 7"),
        ("clip_tabletop pretrain --seed -1", "seed must be at least 0, got -1"),
        ("clip_tabletop pretrain --epochs 0", "scenes and epochs must be at least 1, got 3200 and 0"),
        ("foreign_table measure none.safetensors", "the checkpoint none.safetensors is not complete"),
        (
            "foreign_table measure none.safetensors --episodes 0",
            "episodes must be a whole number from 1 to 1000, got 0",
        ),
        ("foreign_table record demos --episodes 1001", "episodes must be a whole number from 1 to 1000, got 1001"),
        ("foreign_table refusals --tables 5", "tables must be a whole number from 6 to 1000, got 5"),
        ("foreign_table scenes", "requires an argument"),
        ("pointing --kind circles", 'Invalid value "circles" for --kind. Choose from: "bowls", "shapes".'),
        ("pointing --task bars-in-box", 'Invalid value "bars-in-box" for --task. Choose from: "packing-shapes-seen", '),
        ("pointing --scenes 0", "scenes must be at least 1, got 0"),
        ("pointing --clip .", "the CLIP folder '.' has no configuration: config.json is missing"),
        ("sensor_noise --checkpoint none.safetensors", "the checkpoint none.safetensors is not complete"),
        ("sensor_noise --task object-sorting-seen", "was trained for a table 1.0 m long; the task's is"),
        ("sensor_noise --episodes 0", "episodes must be at least 1, got 0"),
        ("sensor_noise --kinds weather", "kinds must be of none, all, disparity, "),
    ],
)
def test_what_cannot_be_done_ends_in_one_sentence(line, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(*line.split()) == 2
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())
