"""The commands of gem-lite and of the experiments: helps, examples, bad values in one line, and work end to end."""

import contextlib
import importlib
import io
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
import torch

from gem_lite import clip
from gem_lite.cli import APP, base, demo, main
from gem_lite.clip import calibration
from gem_lite.evaluation import collecting, results
from gem_lite.policies import methods
from gem_lite.policies.checkpoints import read_card
from gem_lite.policies.gem_config import GemConfig
from gem_lite.simulation import looks
from gem_lite.tasks import SPLITS, variants
from gem_lite.tasks import names as task_names
from gem_lite.training import train

TASK = "put-block-in-bowl-seen-colors"
DEMONSTRATIONS = str(clip.DATA / "demos" / f"{TASK}-10")
BOWL_POLICY = str(clip.DATA / "gem-put-block-in-bowl.safetensors")
SORTING_POLICY = str(clip.DATA / "gem-object-sorting.safetensors")
SMALL = ["--config.steps", "2", "--config.batch", "1", "--config.widths", "8", "8", "8", "8"]
EXPERIMENTS = (
    "benchmark", "clip_tabletop", "foreign_table", "foreign_tasks", "other_eyes", "other_words", "picture_prompts",
    "from_an_empty_file", "planning", "pointing", "real_tables", "relations", "sensor_noise",
)  # fmt: skip
COMMANDS = (
    "demo", "collect", "verify", "train", "evaluate", "several-tables", "check-cameras", "look", "read", "plan",
    "import bop", "import tum", "import open3d", "import cloud", "import bag",
    "set-up propose", "set-up clicks", "set-up corners", "set-up points", "set-up tag", "set-up board", "set-up robot",
    "app", "serve", "names", "clip calibrate", "results list", "results show",
    "benchmark file", "benchmark page", "benchmark tables", "benchmark settings", "benchmark gallery",
    "clip_tabletop pretrain", "clip_tabletop card", "clip_tabletop part-peaks", "clip_tabletop crop-search",
    "clip_tabletop withheld-picks",
    "foreign_table record", "foreign_table measure",
    "foreign_table refusals", "foreign_table scenes",
    "foreign_tasks expert", "foreign_tasks measure", "foreign_tasks acts", "foreign_tasks draw",
    "other_eyes pictures", "other_eyes peaks", "other_eyes acts", "other_words fit",
    "other_words measure",
    "picture_prompts collect", "picture_prompts train-gem", "picture_prompts train-rival", "picture_prompts measure",
    "picture_prompts peaks", "planning play", "planning table", "planning nouns", "planning swap", "pointing",
    "real_tables kernels", "real_tables color-bias", "real_tables displaced", "relations play", "relations draw",
    "relations frame", "from_an_empty_file", "sensor_noise",
)  # fmt: skip


def program_of(name):
    """The program of a command, and the words that start it."""
    experiment = name.partition(" ")[0]
    if experiment in EXPERIMENTS:
        program = importlib.import_module(f"experiments.{experiment}.__main__").APP
        return program, ["python", "-m", f"experiments.{experiment}"]
    return APP, ["gem-lite"]


def run(words):
    """Run a command line that begins with the name of an experiment or with a command of gem-lite."""
    program, _ = program_of(" ".join(words))
    return base.run(program, words[1:] if program is not APP else words)


def help_of(name):
    """What ``--help`` prints after the words of ``name``."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert run([*name.split(), "--help"]) == 0
    return printed.getvalue()


def examples():
    """The command lines at the end of each help: there is at least one."""
    endings = {name: help_of(name).partition("Examples:\n")[2] for name in COMMANDS}
    assert all(endings.values())
    return [(name, line.strip()) for name, ending in endings.items() for line in ending.splitlines()]


def said(capsys, *words):
    """What a refused command line says: one line on stderr, nothing on stdout."""
    assert run(words) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    return printed.err.strip()


@pytest.fixture(autouse=True)
def threads_as_they_were():
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.fixture
def started(monkeypatch):
    """Runs `gem-lite train` with these words up to the training. Returns the method and its configuration."""

    def run(*words):
        got = []
        monkeypatch.setattr(train, "train_from_folder", lambda *arguments: got.append(arguments[2:4]))
        assert main(["train", *words]) == 0
        return got[0]

    return run


def test_helps_load_no_heavy_package():
    program = f"""
import importlib, sys
from gem_lite.cli import base, main
for words in {[name.split() for name in ("", *COMMANDS)]}:
    if words and words[0] in {EXPERIMENTS}:
        base.run(importlib.import_module(f"experiments.{{words[0]}}.__main__").APP, [*words[1:], "--help"])
    else:
        main([*words, "--help"])
print(*sys.modules, file=sys.stderr)
"""
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=True)
    assert len(re.findall("Usage: (?:gem-lite|python -m experiments.)", done.stdout)) == 1 + len(COMMANDS)
    heavy = {"torch", "numpy", "scipy", "cv2", "pybullet", "transformers", "matplotlib", "nbformat", "mujoco", "yaml"}
    assert not heavy & set(done.stderr.split())


def test_every_program_of_an_experiment_is_in_the_list():
    folders = (Path(__file__).parents[1] / "experiments").glob("*/__main__.py")
    assert {path.parent.name for path in folders if "make_app" in path.read_text()} == {*EXPERIMENTS}
    assert {name.split()[0] for name in COMMANDS} >= {*EXPERIMENTS}


def test_the_overview_and_a_group_list_their_commands(capsys):
    own = [name.split()[0] for name in COMMANDS if name.split()[0] not in EXPERIMENTS]
    assert all(f"│ {name} " in help_of("") for name in own)
    assert main(["clip"]) == 0
    listed = capsys.readouterr().out
    assert "calibrate" in listed and "Train a method" not in listed
    assert help_of("clip") == listed


@pytest.mark.parametrize(("name", "example"), examples())
def test_an_example_is_read_as_it_stands_and_reads_what_is_there(name, example, started):
    words = shlex.split(example)
    program, start = program_of(name)
    given = words[len(start) :]
    assert words == [*start, *given]
    if name == "train":
        assert given[0] == name
        started(*given[1:])
    else:
        command, _, _ = program.parse_args(given)
        assert name in EXPERIMENTS or command.__name__.strip("_").replace("_", "-") == name.split()[-1]
    for word in words:
        assert not word.startswith("data/") or (clip.DATA.parent / word).exists()
        assert not word.startswith("benchmark/") or (results.RESULTS / f"{word}.jsonl").is_file()


def test_names_are_those_of_the_library(capsys):
    assert set(base.Split.__origin__.__args__) == set(SPLITS)
    assert all(name in help_of("several-tables") for name in variants("object-sorting"))
    assert main(["names"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {f"  {name}" for name in (*task_names(), *looks.names())} <= set(lines)
    assert {line.split()[0] for line in lines} >= set(methods.meanings())


def test_the_help_of_a_method_lists_its_configuration(capsys):
    assert main(["train", "--method", "transporter-lan", "--preset", "paper", "--help"]) == 0
    listed = capsys.readouterr().out
    assert "--config.steps" in listed and "30000" in listed and "--config.rotations" not in listed
    assert "--config.rotations" in help_of("train --method gem")
    assert "--config.steps" not in help_of("train").partition("Examples:")[0]


BAD = f"""
train a b --config.stepz 3 | Unknown option: --config.stepz. Did you mean --config.steps?
train a b --config.steps three | Invalid value for --config.steps: unable to convert "three" into int.
train a b --config.map-gain 1 | --config.map-gain requires 2 positional arguments. Only got 1.
train a b --config.semantic-map all | no map source is named 'all'; the nearest names: multi-view
train a b --config.kernel 16 | kernel must be an odd whole number from 1 on, got 16
train a b --config.table 0.9 | pixel must divide a table of 0.9 m
train a . --seed 3 | checkpoint must be a file to write, got the folder .
train a b.safetensors --seed -1 | seed must be at least 0, got -1
train a b --config.turn maybe | Invalid value "maybe" for --config.turn. Choose from: True, False.
train a b --config.table 2 | --config.table must be left out: the task of the demonstrations sets it
train a b --preset large | preset must be one of lite, paper, got 'large'
train a b --method gpt | method must be one of gem,
train a | Parameter CHECKPOINT requires an argument.
train a b c | Unused Tokens: ['c'].
train nowhere b.safetensors | nowhere holds no demonstrations
train a b --import no_such_module | for --import. No module named 'no_such_module'
collect no-such-task folder | no task is named 'no-such-task'
collect bars-in-box folder --world mars | no world is named 'mars'
collect bars-in-box folder --split all | Invalid value "all" for --split. Choose from: "train", "val", "test".
verify nowhere | nowhere holds no demonstrations
evaluate expert bars-in-box --file --out rows.jsonl | Mutually exclusive arguments: {{--file, --out}}
evaluate expert bars-in-box --out /dev/null/rows.jsonl | rows.jsonl cannot be written
evaluate gem bars-in-box --checkpoint none.safetensors | none.safetensors is missing
several-tables none.safetensors | none.safetensors is missing
several-tables {SORTING_POLICY} --world mars | no world is named 'mars'
several-tables {SORTING_POLICY} --tables 0 | tables must be at least 1, got 0
several-tables {SORTING_POLICY} --tasks object-sorting-seen bars-in-box | got 'bars-in-box'
foreign_table measure {SORTING_POLICY} --episodes 1 | m; that of the other simulator is x 0.250
foreign_tasks measure {SORTING_POLICY} assembling-kits --episodes 1 | m; that of the other simulator is x 0.250
several-tables {BOWL_POLICY} | m; that of object-sorting-seen is x 0.235 to 0.765 m, y -0.530 to 0.530 m
clip calibrate . | the CLIP folder '.' has no configuration: config.json is missing
results show nothing | there are no results named 'nothing'; there are: foreign-tasks, joint,
results show benchmark/bars-in-box --method nobody | benchmark/bars-in-box has no such row
results list --folder nowhere | nowhere is no folder of results
trian | Unknown command "trian". Did you mean "train"? Available commands:
clip calibrat | Did you mean "calibrate"?
clip_tabletop pretrain --scenes 0 | scenes and epochs must be at least 1, got 0 and 7
clip_tabletop crop-search --episodes 0 | episodes must be at least 1, got 0
clip_tabletop part-peaks --text-weight 2 | text_weight must be in [0, 1], got 2
clip_tabletop withheld-picks | name at least one checkpoint
clip_tabletop withheld-picks none.safetensors --episodes 0 | episodes must be at least 1, got 0
clip_tabletop withheld-picks none.safetensors | the checkpoint none.safetensors is not complete
clip_tabletop pretrain --seed -1 | seed must be at least 0, got -1
foreign_table measure none.safetensors | the checkpoint none.safetensors is not complete
foreign_table measure none.safetensors --episodes 0 | episodes must be a whole number from 1 to 1000, got 0
foreign_table refusals --tables 5 | tables must be a whole number from 6 to 1000, got 5
foreign_table scenes | requires an argument
foreign_tasks expert bowls | family must be one of assembling-kits, stack-block-pyramid, towers-of-hanoi, separating-pil
foreign_tasks expert towers-of-hanoi --episodes 0 | episodes must be a whole number from 1 to 1000, got 0
foreign_tasks measure none.safetensors bowls | family must be one of assembling-kits, stack-block-pyramid,
foreign_tasks measure none.safetensors assembling-kits | the checkpoint none.safetensors is not complete
foreign_tasks measure none.safetensors assembling-kits --split train | Choose from: "val", "test".
foreign_tasks acts none.safetensors bowls | family must be one of assembling-kits, stack-block-pyramid,
foreign_tasks acts none.safetensors assembling-kits --episodes 0 | episodes must be a whole number from 1 to 1000
foreign_tasks draw | requires an argument
from_an_empty_file --episodes 0 | episodes must be at least 1, got 0
from_an_empty_file --demos 20 | demos must be at least 1 and at most 10, got 20
other_eyes pictures --out a --episode -1 | episode must be at least 0, got -1
other_eyes pictures --out a --sources owl-vit | detector must be the Hugging Face name or the folder of a model of OWL
other_eyes acts a.png b --kind put-block-in-bowl-seen-colors | checkpoints must be at least two, got 1
other_eyes acts a.png b c --kind put-block-in-bowl-seen-colors --scenes 0 | scenes must be at least 1, got 0
other_eyes acts a.png {BOWL_POLICY} {SORTING_POLICY} --kind put-block-in-bowl-seen-colors | m; that of put-block-in
other_eyes peaks --scenes 0 | scenes must be at least 1, got 0
other_eyes peaks --kinds bowls | kinds must be of put-block-in-bowl-seen-colors, pick-object-part-in-brown-box-seen,
other_eyes peaks --sources eyes | no map source is named 'eyes'; the nearest names:
picture_prompts collect folder --episodes 0 | episodes must be at least 1, got 0
picture_prompts train-gem nowhere a.safetensors --episodes 6 | nowhere holds no demonstrations
picture_prompts train-gem nowhere a.safetensors --episodes 6 --steps 0 | steps must be a whole number from 1 on, got 0
picture_prompts train-rival nowhere a.safetensors --episodes 6 | nowhere holds no demonstrations
picture_prompts train-rival a b.safetensors --episodes 6 --width 20 | width must be a multiple of 8, the number of heads
picture_prompts train-rival a b.safetensors --episodes 6 --dropout 1 | dropout must be from 0 to below 1, got 1
picture_prompts measure none.safetensors | the checkpoint none.safetensors is not complete
picture_prompts measure none.safetensors --level hard | Invalid value "hard" for --level. Choose from: "placement",
picture_prompts train-rival a b.json --episodes 6 | the name of a checkpoint must end in .safetensors, got 'b.json'
picture_prompts train-rival a b.safetensors --episodes 6 --seed -1 | seed must be at least 0, got -1
picture_prompts train-rival {DEMONSTRATIONS} b.safetensors --episodes 2 | must hold demonstrations of one camera above
picture_prompts train-gem {DEMONSTRATIONS} b.safetensors --episodes 2 | must hold demonstrations of one camera above
picture_prompts measure {BOWL_POLICY} | the checkpoint must be one of train-gem or train-rival, got gem
picture_prompts peaks --widths 0.01 | widths must be at least 0.025 m, four cells, got (0.01,)
picture_prompts peaks --scenes 0 | scenes must be at least 1, got 0
pointing --kind circles | Invalid value "circles" for --kind. Choose from: "bowls", "shapes".
pointing --task bars-in-box | Invalid value "bars-in-box" for --task. Choose from: "packing-shapes-seen",
pointing --scenes 0 | scenes must be at least 1, got 0
pointing --clip . | the CLIP folder '.' has no configuration: config.json is missing
real_tables kernels none.safetensors | the checkpoint none.safetensors is not complete
real_tables displaced --episodes 0 | episodes must be at least 1, got 0
real_tables color-bias --scenes 0 | scenes must be at least 1, got 0
sensor_noise --checkpoint none.safetensors | the checkpoint none.safetensors is not complete
sensor_noise --task object-sorting-seen | m; that of object-sorting-seen is x 0.235 to 0.765 m, y
sensor_noise --episodes 0 | episodes must be at least 1, got 0
sensor_noise --kinds weather | kinds must be of none, all, disparity,
"""


@pytest.mark.parametrize(("line", "sentence"), [line.split(" | ") for line in BAD.strip().splitlines()])
def test_bad_values_end_in_one_sentence(line, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sentence in said(capsys, *line.split())
    assert not list(tmp_path.iterdir())


def test_every_value_of_a_configuration_can_be_set(started):
    _, config = started("demos", "out", "--method", "gem-without-parsing", "--config.steps", "3")
    assert (config.parsing, config.variant, config.steps) == (False, "-without-parsing", 3)
    words = (
        "demos out.safetensors --preset paper --config.steps 3 --config.learning_rate 2e-3 --config.turn False "
        "--config.peak-margin None --config.map-gain 1 2 --config.widths 8 8 16 16 --config.kernels free"
    )
    _, config = started(*words.split())
    changed = {
        "steps": 3, "learning_rate": 2e-3, "turn": False, "peak_margin": None, "map_gain": [1.0, 2.0],
        "widths": [8, 8, 16, 16], "kernels": "free",
    }  # fmt: skip
    assert config.as_dict() == GemConfig.preset("paper").as_dict() | changed and type(config) is GemConfig


def test_a_module_from_outside_is_loaded_before_names_are_read(tmp_path, monkeypatch, capsys):
    program = "methods.METHODS.register('mine')(type('Mine', (transporter.TransporterLan,), {}))"
    (tmp_path / "my_method.py").write_text(f"from gem_lite.policies import methods, transporter\n{program}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    words = ("train", "no-demos", "b.safetensors", "--method", "mine")
    assert "got 'mine'" in said(capsys, *words)
    assert "no-demos holds no demonstrations" in said(capsys, *words, "--import", "my_method")


@pytest.mark.parametrize(
    ("line", "module", "function", "where"),
    [
        ("collect a demos", collecting, "collect", "; the same command goes on from the episodes in demos"),
        ("train demos policy.safetensors", train, "train_from_folder",
         "; the same command goes on from the last state in runs/policy-aa3ef115"),
        ("results list", results, "read_rows", ""),
    ],
)  # fmt: skip
def test_ctrl_c_says_how_to_go_on(line, module, function, where, monkeypatch, capsys):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, function, stopped)
    assert main(line.split()) == 130
    assert capsys.readouterr().err.strip() == f"stopped{where}"


@pytest.fixture
def at_home(tmp_path, monkeypatch, capsys):
    """Runs a command line in a folder of its own, where the rows go that it files. Returns what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(results, "RESULTS", tmp_path / "filed")

    def run(*words):
        assert main([str(word) for word in words]) == 0
        return capsys.readouterr().out

    return run


def test_collect_and_verify(at_home, tmp_path):
    collected = at_home("collect", "bars-in-box", "demos", "--episodes", 1, "--world", "varied")
    assert "demos: 1 episodes, 1 steps, data hash " in collected
    assert json.loads((tmp_path / "demos" / "manifest.json").read_text())["world"] == "varied"
    assert at_home("verify", "demos") == collected


def test_train_and_evaluate_and_show(at_home, jobs_here, tmp_path):
    checkpoint = tmp_path / "policy.safetensors"
    printed = at_home("train", DEMONSTRATIONS, checkpoint, "--method", "transporter-lan", "--episodes", 1, *SMALL)
    assert f"wrote {checkpoint} after " in printed
    card = read_card(checkpoint)
    assert (card["config"]["steps"], card["config"]["widths"], card["demos"]) == (2, [8, 8, 8, 8], 1)
    assert card["demonstrations_split"] == "train"
    assert not list((tmp_path / "runs").glob("policy-*/state.pt"))
    printed = at_home("evaluate", "transporter-lan", TASK, "--checkpoint", checkpoint, "--episodes", 1, "--file")
    assert "transporter-lan on put-block-in-bowl-seen-colors, all: " in printed
    (row,) = results.read_rows(tmp_path / "filed" / "put-block-in-bowl.jsonl")
    assert (row["steps"], row["demos"], row["episodes"]) == (2, 1, 1)
    shown = at_home("results", "show", "put-block-in-bowl")
    assert shown.startswith("transporter-lan on put-block-in-bowl-seen-colors, in home, demos 1, steps 2, seed 0: ")
    assert at_home("results", "list", "--folder", "filed") == "put-block-in-bowl: 1 rows, of transporter-lan\n"


def test_several_tables(at_home, jobs_here):
    words = ("--tasks", "object-sorting-seen", "--episodes", 1, "--out", "rows.jsonl")
    printed = at_home("several-tables", SORTING_POLICY, *words)
    assert "object-sorting-seen, tags, 0.0 m, 0.0 rad: " in printed and "object-sorting-seen, truth, " in printed
    assert at_home("results", "show", "rows.jsonl").count("\n") == 2


def test_stored_results_are_shown(capsys):
    for path in results.RESULTS.glob("*.jsonl"):
        assert main(["results", "show", path.stem]) == 0
        assert capsys.readouterr().out.count("\n") == len(results.read_rows(path))


@pytest.mark.parametrize("name", ["other-eyes", "picture-prompts", "real-tables"])
def test_rows_of_experiments_are_listed_and_shown(name, capsys):
    folder = clip.DATA / name
    assert main(["results", "list", "--folder", str(folder)]) == 0
    listed = capsys.readouterr().out
    for path in folder.glob("*.jsonl"):
        assert f"{path.stem}: {len(results.read_rows(path))} rows, of " in listed
        assert main(["results", "show", str(path)]) == 0
        assert capsys.readouterr().out.count("\n") == len(results.read_rows(path))


@pytest.mark.release
def test_calibrate_writes_the_numbers_of_a_clip(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(calibration, "DATA", tmp_path)  # So that the embedded CLIP's own file stays as it is.
    assert main(["clip", "calibrate", str(clip.EMBEDDED), "--scenes", "0"]) == 2
    assert "--scenes must be 1 or more, got 0" in capsys.readouterr().err
    assert main(["clip", "calibrate", str(clip.EMBEDDED), "--scenes", "2"]) == 0
    assert "retrieval_threshold=" in capsys.readouterr().out
    fingerprint = clip.load().fingerprint
    for kind in ("calibration", "calibration-dense"):
        written = json.loads((tmp_path / "gem_lite" / f"{kind}-{fingerprint}.json").read_text())
        shipped = json.loads((clip.EMBEDDED / f"{kind}.json").read_text())
        assert written == pytest.approx(shipped, abs=0.03), "two scenes of eight"


def test_the_demo_finds_its_result_and_its_figures_in_the_stored_lesson():
    cells = [cell for cell in nbformat.read(demo.NOTEBOOK, as_version=4).cells if cell.cell_type == "code"]
    (result,) = [line for cell in cells for line in demo.printed(cell) if line.startswith(demo.RESULT)]
    assert result.endswith(": 100 of 100")
    for tag in ("decision", "outcome"):
        cell = next(cell for cell in cells if tag in cell.metadata.get("tags", []))
        assert any("image/png" in output.get("data", {}) for output in cell.outputs), tag
