"""The command gem-lite: helps that end with examples, bad values in one sentence, and every command end to end."""

import importlib
import json
import shlex
import subprocess
import sys
import time

import pytest

from gem_lite import cli, clip
from gem_lite.cli import COMMANDS, main
from gem_lite.cli.command import parse
from gem_lite.clip import calibration
from gem_lite.evaluation import results
from gem_lite.policies.checkpoints import read_card
from gem_lite.policies.gem_config import PAPER

TASK = "put-block-in-bowl-seen-colors"
DEMONSTRATIONS = str(clip.DATA / "demos" / f"{TASK}-10")
BOWL_POLICY = str(clip.DATA / "gem-put-block-in-bowl.safetensors")
SORTING_POLICY = str(clip.DATA / "gem-object-sorting.safetensors")


def kind(name):
    """The class of a subcommand."""
    module, class_name, _ = COMMANDS[name]
    return getattr(importlib.import_module(f"gem_lite.cli.{module}"), class_name)


def examples():
    return [(name, example) for name in COMMANDS for example in kind(name).examples]


def said(capsys, *words):
    """What a refused command line says: one line on stderr, nothing on stdout."""
    assert main([str(word) for word in words]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    return printed.err.strip()


def test_the_overview_names_every_command_and_loads_none():
    began = time.monotonic()
    program = "import sys; from gem_lite.cli import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600, check=True)
    assert all(f"  {name} " in done.stdout for name in COMMANDS)
    assert not {"torch", "pybullet", "numpy", "gem_lite.cli.train"} & set(done.stderr.split())
    assert time.monotonic() - began < 30, "a second and a half on an idle machine"


def test_a_group_lists_its_commands(capsys):
    assert main(["clip"]) == 0
    listed = capsys.readouterr().out
    assert "clip calibrate" in listed and "train a method" not in listed
    assert main(["clip", "--help"]) == 0
    assert capsys.readouterr().out == listed


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_ends_with_its_examples(name, capsys):
    assert main([*name.split(), "--help"]) == 0
    help_text = capsys.readouterr().out
    assert help_text.startswith(f"usage: gem-lite {name} ")
    ending = [f"  {example}" for example in kind(name).examples]
    assert ending and help_text.rstrip("\n").splitlines()[-len(ending) :] == ending


@pytest.mark.parametrize(("name", "example"), examples())
def test_an_example_is_read_as_it_stands(name, example):
    words = shlex.split(example)
    assert words[: 1 + len(name.split())] == ["gem-lite", *name.split()]
    command = cli.read(*cli.split(words[1:]))
    assert isinstance(command, kind(name))


@pytest.mark.parametrize(("name", "example"), examples())
def test_an_example_reads_what_is_there(name, example):
    for word in shlex.split(example):
        if word.startswith("data/"):
            assert (clip.DATA.parent / word).exists()
        assert not word.startswith("benchmark/") or (results.RESULTS / word).is_dir()


def test_the_example_of_a_card_keeps_the_shipped_card_true():
    (example,) = kind("clip card").examples
    assert f"on {shlex.split(example)[-1]} crops" in (clip.EMBEDDED / "README.md").read_text()


LIGHT = (
    "demo", "verify", "check-cameras", "look", "clip pretrain", "clip card", "clip calibrate",
    "results list", "results show",
)  # fmt: skip
"""Commands whose help lists no names that torch's modules or the simulator's register."""


def test_a_help_that_lists_no_names_loads_neither_torch_nor_the_simulator():
    calls = "".join(f"main({[*name.split(), '--help']}); " for name in LIGHT)
    program = f"import sys; from gem_lite.cli import main; {calls}print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout.count("usage: ") == len(LIGHT)
    assert not {"torch", "pybullet", "transformers"} & set(done.stderr.split())


def test_unknown_commands_are_refused_with_the_nearest(capsys):
    assert said(capsys, "trian") == "gem-lite has no command 'trian'; the nearest: train"
    assert said(capsys, "clip", "pretrian") == "gem-lite has no command 'clip pretrian'; the nearest: clip pretrain"
    assert said(capsys, "zzz") == "gem-lite has no command 'zzz'; see gem-lite --help"


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("train a b --config.stepz 3", "gem-lite train has no option --config.stepz; the nearest: --config.steps"),
        ("train a b --config.steps three", "--config.steps must be INT: "),
        ("train a b --config.map-gain 1", "--config.map-gain needs a value: FLOAT FLOAT"),
        ("train a b --config.semantic-map all", "no map source is named 'all'; the nearest names: multi-view"),
        ("train a b --config.steps 0", "steps must be a whole number from 1 on, got 0"),
        ("train a b --config.steps -5", "steps must be a whole number from 1 on, got -5"),
        ("train a b --config.batch 0", "batch must be a whole number from 1 on, got 0"),
        ("train a b --config.angles 0", "angles must be a whole number from 1 on, got 0"),
        ("train a b --config.pixel 0", "pixel must be a number above 0 and up to 5.0, got 0"),
        ("train a b --config.kernel 16", "kernel must be an odd whole number from 1 on, got 16"),
        ("train a b --config.learning-rate nan", "learning_rate must be a number above 0 and up to 1, got nan"),
        ("train a b --config.table 0.9", "pixel must divide a table of 0.9 m"),
        ("train a . --seed 3", "checkpoint must be a file to write, got the folder ."),
        ("train a b.safetensors --seed -1", "seed must be at least 0, got -1"),
        ("train a b --config.table 2", "--config.table must be left out: the task of the demonstrations sets it"),
        ("train a b --preset large", "preset must be one of lite, paper, got 'large'"),
        ("train a b --method gpt", "method must be one of gem, "),
        ("train --seeed 1 a b", "gem-lite train has no option --seeed; the nearest: --seed"),
        ("train a", "gem-lite train needs checkpoint: see gem-lite train --help"),
        ("train a b c", "gem-lite train takes no further 'c'"),
        ("train nowhere b.safetensors", "nowhere holds no demonstrations"),
        ("train a b --import no_such_module", "--import no_such_module: No module named 'no_such_module'"),
        ("collect no-such-task folder", "no task is named 'no-such-task'"),
        ("collect bars-in-box folder --world mars", "no world is named 'mars'"),
        ("collect bars-in-box folder --split all", "--split must be one of test, train, val, got 'all'"),
        ("verify nowhere", "nowhere holds no demonstrations"),
        ("evaluate expert bars-in-box --episodes many", "--episodes must be INT: "),
        ("evaluate expert bars-in-box --file --out rows.jsonl", "--file and --out cannot be given together"),
        ("several-tables none.safetensors", "none.safetensors is missing"),
        ("several-tables none.safetensors --tables 0", "tables must be at least 1, got 0"),
        ("several-tables none.safetensors --tasks object-sorting-seen bars-in-box", "got 'bars-in-box'"),
        (f"several-tables {BOWL_POLICY}", "m; that of object-sorting-seen is x 0.235 to 0.765 m, y -0.530 to 0.530 m"),
        ("clip pretrain --scenes 0", "scenes and epochs must be at least 1, got 0 and 7"),
        ("clip pretrain --seed -1", "seed must be at least 0, got -1"),
        ("clip pretrain --epochs 0", "scenes and epochs must be at least 1, got 3200 and 0"),
        ("clip calibrate .", "the CLIP folder '.' has no configuration: config.json is missing"),
        ("clip card folder", "gem-lite clip card needs --training-crops"),
        ("results show nothing", "there are no results named 'nothing'; there are: object-sorting, "),
        ("results show benchmark/bars-in-box --method nobody", "benchmark/bars-in-box has no such row"),
        ("results list --folder nowhere", "nowhere is no folder of results"),
    ],
)
def test_bad_values_end_in_one_sentence(line, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sentence in said(capsys, *line.split())
    assert not list(tmp_path.iterdir())


def test_every_value_of_a_configuration_can_be_set():
    words = (
        "demos out.safetensors --preset paper --config.steps 3 --config.learning_rate 2e-3 --config.turn False "
        "--config.peak-margin None --config.map-gain 1 2 --config.widths 8 8 16 16 --config.kernels free"
    )
    settings = parse(kind("train"), "train", words.split()).config
    changed = {
        "steps": 3, "learning_rate": 2e-3, "turn": False, "peak_margin": None, "map_gain": [1.0, 2.0],
        "widths": [8, 8, 16, 16], "kernels": "free",
    }  # fmt: skip
    assert settings.as_dict() == PAPER.as_dict() | changed


def test_a_methods_name_sets_what_it_switches_off():
    train = parse(kind("train"), "train", ["demos", "out", "--method", "gem-without-parsing"])
    assert (train.config.parsing, train.config.variant) == (False, "-without-parsing")


def test_a_module_from_outside_is_loaded_before_names_are_read(tmp_path, monkeypatch):
    (tmp_path / "my_method.py").write_text(
        "from gem_lite.policies import methods, transporter\n"
        "@methods.register\n"
        "class Mine(transporter.TransporterLan):\n"
        "    method = 'mine'\n"
    )
    program = (
        "from gem_lite import cli; command = cli.read('train', 'a b --method mine --import my_method'.split()); "
        "print(command.find()[0].method)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.stdout == "mine\n", done.stderr


def test_ctrl_c_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    def stopped(self):
        raise KeyboardInterrupt

    for name, words, sentence in (
        ("collect", [TASK, "demos"], "the same command goes on from the episodes in demos"),
        (
            "train",
            ["demos", "policy.safetensors"],
            "the same command goes on from the last state in runs/policy-aa3ef115",
        ),
        ("clip pretrain", [], "the same command goes on from the last epoch in runs/pretrain_clip"),
        ("verify", ["demos"], "stopped"),
    ):
        monkeypatch.setattr(kind(name), "run", stopped)
        assert main([*name.split(), *words]) == 130
        assert capsys.readouterr().err.strip().endswith(sentence)


@pytest.fixture
def at_home(tmp_path, monkeypatch):
    """Runs a command line in a folder of its own; rows that it files go there, too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(results, "RESULTS", tmp_path / "filed")

    def run(*words):
        return main([str(word) for word in words])

    return run


def test_collect_and_verify(at_home, tmp_path, capsys):
    assert at_home("collect", "bars-in-box", "demos", "--episodes", 1, "--world", "varied") == 0
    collected = capsys.readouterr().out
    assert "demos: 1 episodes, 1 steps, data hash " in collected
    assert json.loads((tmp_path / "demos" / "manifest.json").read_text())["world"] == "varied"
    assert at_home("verify", "demos") == 0
    assert capsys.readouterr().out == collected


def test_train_and_evaluate_and_show(at_home, tmp_path, capsys):
    checkpoint = tmp_path / "policy.safetensors"
    small = ("--config.steps", 2, "--config.batch", 1, "--config.widths", 8, 8, 8, 8)
    assert at_home("train", DEMONSTRATIONS, checkpoint, "--method", "transporter-lan", "--episodes", 1, *small) == 0
    assert f"wrote {checkpoint} after " in capsys.readouterr().out
    card = read_card(checkpoint)
    assert (card["config"]["steps"], card["config"]["widths"], card["demos"]) == (2, [8, 8, 8, 8], 1)
    assert card["demonstrations_split"] == "train"
    assert not list((tmp_path / "runs").glob("policy-*/state.pt"))
    assert at_home("evaluate", "transporter-lan", TASK, "--checkpoint", checkpoint, "--episodes", 1, "--file") == 0
    assert "transporter-lan on put-block-in-bowl-seen-colors, all: " in capsys.readouterr().out
    (row,) = results.read_rows(tmp_path / "filed" / "put-block-in-bowl.jsonl")
    assert (row["steps"], row["demos"], row["episodes"]) == (2, 1, 1)
    assert at_home("results", "show", "put-block-in-bowl") == 0
    shown = capsys.readouterr().out
    assert shown.startswith("transporter-lan on put-block-in-bowl-seen-colors, in home, demos 1, steps 2, seed 0: ")
    assert at_home("results", "list", "--folder", "filed") == 0
    assert capsys.readouterr().out == "put-block-in-bowl: 1 rows, of transporter-lan\n"


def test_several_processes_train_by_the_same_command(tmp_path):
    # What `accelerate launch -m gem_lite.cli train` calls on several GPUs; on CPUs it wants MPI.
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    launch += ["-m", "gem_lite.cli"]
    words = ["train", DEMONSTRATIONS, "policy.safetensors", "--method", "transporter-lan", "--episodes", "1"]
    small = ["--config.steps", "2", "--config.batch", "1", "--config.widths", "8", "8", "8", "8"]
    done = subprocess.run([*launch, *words, *small], cwd=tmp_path, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("wrote policy.safetensors") == 1
    assert read_card(tmp_path / "policy.safetensors")["config"]["steps"] == 2


def test_several_tables(at_home, capsys):
    words = ("--tasks", "object-sorting-seen", "--episodes", 1, "--out", "rows.jsonl")
    assert at_home("several-tables", SORTING_POLICY, *words) == 0
    printed = capsys.readouterr().out
    assert "object-sorting-seen, tags, 0.0 m, 0.0 rad: " in printed and "object-sorting-seen, truth, " in printed
    assert at_home("results", "show", "rows.jsonl") == 0
    assert capsys.readouterr().out.count("\n") == 2


def test_stored_results_are_listed_and_shown(capsys):
    assert main(["results", "list"]) == 0
    listed = capsys.readouterr().out
    assert "pointing: " in listed and "benchmark/align-rope: " in listed
    for path in results.RESULTS.glob("*.jsonl"):
        assert main(["results", "show", path.stem]) == 0
        assert capsys.readouterr().out.count("\n") == len(results.read_rows(path))
    assert main(["results", "show", "benchmark/align-rope", "--method", "expert"]) == 0
    assert capsys.readouterr().out.startswith("expert on align-rope, in home")


def test_calibrate_writes_the_numbers_of_a_clip(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(calibration, "DATA", tmp_path)  # So that the embedded CLIP's own file stays as it is.
    assert main(["clip", "calibrate", str(clip.EMBEDDED)]) == 0
    assert "retrieval_threshold=" in capsys.readouterr().out
    (written,) = (tmp_path / "gem_lite").glob("calibration-*.json")
    shipped = json.loads((clip.EMBEDDED / "calibration.json").read_text())
    assert json.loads(written.read_text()) == pytest.approx(shipped, abs=0.02)


def test_the_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "gem_lite.cli", "results", "shw"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "gem-lite has no command 'results shw'; the nearest: results show\n")
