"""The plan of the benchmark: its cells, where their rows are, and what Snakemake would do."""

import dataclasses
import functools
import itertools
import json
import subprocess
import sys
from pathlib import Path

import filelock
import pytest
import summaries
import whole_benchmark
import yaml

from experiments.benchmark import __main__ as commands
from experiments.benchmark import checks, page, plan, tables
from experiments.benchmark.plan import OURS, Cell, Plan, Training
from gem_lite import clip, tasks
from gem_lite.evaluation import results
from gem_lite.policies import methods
from gem_lite.policies.gem_config import ABLATIONS

ROOT = Path(__file__).resolve().parents[2]
SNAKEFILE = "experiments/benchmark/Snakefile"
CONTENT = yaml.safe_load(plan.FILE.read_text())
BOWL, UNSEEN_BOWL = "put-block-in-bowl-seen-colors", "put-block-in-bowl-unseen-colors"


@pytest.fixture(scope="module")
def whole():
    return Plan.load()


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """No row is filed."""
    monkeypatch.setattr(results, "RESULTS", tmp_path)


def all_cells(whole):
    tiers = [whole.search(), whole.search("wider_search"), *map(whole.tier, CONTENT["tiers"])]
    return list(dict.fromkeys(itertools.chain(*tiers)))


def row_of(cell, mean=50.0, **changes):
    facts = {name: None for name in results.IDENTITY} | cell.columns | {"episodes": cell.episodes}
    facts |= {"mean": mean, "ci95": [mean - 5, mean + 5], "train_cpu_seconds": None}
    return facts | {"rewards": {str(index): mean / 100 for index in range(cell.episodes)}} | changes


def file_row(cell, mean=50.0, **changes):
    results.file_rows([row_of(cell, mean, **changes)], results.benchmark_file(cell.task), plan.IDENTITY)


def test_the_first_tier_compares_three_methods_on_every_task(whole):
    assert len(set(tasks.PAPER)) == 18 and not set(tasks.PAPER) & set(OURS)
    assert len({tasks.family(name) for name in whole.several}) == len(whole.several) == 10
    cells = whole.tier("must")
    assert len(cells) == len({cell.name for cell in cells})
    for method in ("gem", "cliport", "transporter-lan"):
        measured = {cell.task for cell in cells if cell.method == method and cell.training.demos == 10}
        assert measured == {*tasks.PAPER, "block-insertion"}
    assert all(cell.episodes == 50 and cell.split == "test" for cell in cells)


def test_variants_of_colours_share_a_training_variants_of_objects_do_not_and_longer_tasks_have_more_steps(whole):
    cells = whole.tier("must")
    gem = {cell.task: cell.training for cell in cells if cell.method == "gem"}
    assert gem[BOWL] == gem[UNSEEN_BOWL]
    assert gem["packing-google-objects-seq-seen"] != gem["packing-google-objects-seq-unseen"]
    assert len(plan.trainings(cells)) < len(cells)
    steps = {(cell.method, cell.training.tasks): cell.training.config.steps for cell in cells}
    for method in ("gem", "cliport", "transporter-lan"):
        assert steps[method, ("align-rope",)] == 4 * steps[method, ("block-insertion",)]
    assert steps["gem-multi", whole.several] == 10 * steps["gem", ("block-insertion",)]
    assert steps["gem", ("block-insertion",)] == CONTENT["settings"]["gem"]["steps"]


TRAINING = Training("gem", (BOWL,), 10, 0, 2000, 0.001, "", "one")


def test_whatever_changes_a_policy_or_a_row_changes_its_name_and_its_columns():
    cell = Cell("gem", BOWL, TRAINING)
    for change in (
        {"demos": 20}, {"seed": 1}, {"steps": 7}, {"learning_rate": 0.5}, {"tasks": ("bars-in-box",)},
        {"method": "gem-without-image-map"}, {"clip_name": "openai/clip-vit-base-patch32", "clip_fingerprint": "other"},
    ):  # fmt: skip
        changed = dataclasses.replace(TRAINING, **change)
        assert TRAINING.name != changed.name
        other = Cell(changed.method, BOWL, changed)  # the plan has one set of demonstrations for a cell
        assert (cell.columns == other.columns) == (cell.name == other.name) == ("tasks" in change)
    cell = Cell("expert-rounded", BOWL)
    for change in (
        {"split": "val"}, {"episodes": 10}, {"preset": "paper"}, {"task": "align-rope"}, {"skipped": (3,)},
        {"world": "shadows"},
    ):  # fmt: skip
        changed = dataclasses.replace(cell, **change)
        assert cell.name != changed.name
        assert cell.columns != changed.columns or "episodes" in change


def test_every_variant_of_every_method_is_measured_somewhere(whole):
    measured = {methods.split(cell.method) for cell in all_cells(whole) if cell.training}
    assert set(ABLATIONS) <= {ending for _, endings in measured for ending in endings}
    assert set(methods.METHODS.names()) == {name for name, _ in measured}


def test_a_wrong_plan_is_refused():
    for wrong, said in (
        ({name: value for name, value in CONTENT.items() if name != "search"}, "the plan lacks search"),
        ({**CONTENT, "multi": ["put-block-in-bowel"]}, "no task is named 'put-block-in-bowel'"),
    ):
        with pytest.raises(ValueError, match=said):
            Plan(wrong)
    with pytest.raises(ValueError, match="tier must be one of experts, must"):
        Plan(CONTENT).tier("first")


def test_every_stored_row_belongs_to_one_cell(whole):
    found = [row for row in (cell.row() for cell in all_cells(whole)) if row]
    stored = [row for row in results.stored_rows() if row["subset"] == "all"]
    assert len(found) == len(stored) > 300 and all(row in found for row in stored)
    names = [[row.get(name) for name in plan.IDENTITY] for row in results.stored_rows()]
    assert len({str(name) for name in names}) == len(names)


def test_a_cell_finds_its_row_by_the_columns(whole, empty):
    cell = whole.tier("must")[0]
    file_row(dataclasses.replace(cell, world="shadows"))
    file_row(cell, episodes=40)
    assert cell.row() is None
    file_row(cell, 60.0)
    assert cell.row()["mean"] == 60
    file_row(cell, 70.0, checkpoint_sha256="trained again")
    assert cell.row()["mean"] == 70 and len(results.stored_rows()) == 2


def test_measured_rows_are_filed_by_their_task(whole, empty, tmp_path):
    cells = [cell for cell in whole.tier("must") if cell.training.tasks == (BOWL,) and cell.method == "gem"]
    measured = tmp_path / "measured.jsonl"
    measured.write_text("".join(json.dumps(row_of(cell)) + "\n" for cell in cells))
    commands.file(measured)
    assert {cell.row()["task"] for cell in cells} == {BOWL, UNSEEN_BOWL}
    measured.write_text(json.dumps(row_of(cells[0], episodes=40)))
    for wrong, said in ((measured, "holds a row over 50 episodes"), (tmp_path / "none", "holds no rows")):
        with pytest.raises(ValueError, match=said):
            commands.file(wrong)


def test_the_best_trial_and_what_the_expert_does_not_solve_are_printed(whole, empty, capsys):
    with pytest.raises(ValueError, match="is not measured yet"):
        commands.settings()
    for cell in whole.search():
        file_row(cell, cell.training.steps / 100 + 1000 * cell.training.learning_rate)
    with pytest.raises(ValueError, match="the expert's row on align-rope is not measured yet"):
        commands.settings()
    rewards = {"0": 1.0, "11": 0.98, "2": 0.5, "3": 0.9951}
    for cell in whole.tier("experts"):
        file_row(cell, rewards=rewards if cell.task == BOWL else {"0": 1.0})
    commands.settings()
    printed = yaml.safe_load(capsys.readouterr().out)
    assert printed["settings"]["gem"] == {"steps": 2000, "learning_rate": 0.001}
    assert printed["skipped"] == {BOWL: [2, 11]}


def test_the_plan_has_what_the_rows_decide_and_leaves_out_what_the_expert_does_not_solve(whole, capsys):
    commands.settings()
    printed = yaml.safe_load(capsys.readouterr().out)
    assert {name: CONTENT[name] for name in printed} == printed
    for task, left_out in printed["skipped"].items():
        cells = [cell for name in ("experts", "must") for cell in whole.tier(name) if cell.task == task]
        assert all(cell.skipped == (() if cell.method == "expert" else tuple(left_out)) for cell in cells)
        assert len(left_out) <= 56 * (0.1 if tasks.family(task) in ("align-rope", "separating-piles") else 0.05)


def test_a_row_of_another_world_has_no_place_in_a_table(whole):
    cells = [cell for cell in whole.tier("lessons") if cell.method == "gem" and cell.world != "home"]
    assert {"white-floor", "shadows", "touching"} <= {cell.world for cell in cells}
    rows = [row_of(cells[0]), row_of(dataclasses.replace(cells[0], world="home"))]
    assert whole_benchmark.table_rows(rows)["table-1"] == rows[1:]
    assert summaries.scores(rows[:1], "gem", 10) == {}
    assert set(summaries.scores(rows, "gem", 10, world=cells[0].world)) == {cells[0].task}


def test_the_tables_hold_every_row_of_test_episodes(whole, empty, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="no rows are filed"):
        commands.tables(out)
    for number, cell in enumerate(whole.tier("experts")):
        file_row(cell, float(number))
    for cell in whole.search()[:3]:
        file_row(cell, 1.0)
    table = tables.arranged(results.stored_rows())
    assert set(table) == {"expert", "expert-rounded", "expert-rounded, paper"}
    text = tables.markdown(table, tasks.PAPER)
    assert text.count("\n") == 2 + 18 + 1
    assert "| 0.0 [-5.0, 5.0] |" in text and "| **mean of the 18** | " in text
    commands.tables(out)
    assert (out / "ceilings.md").read_text().count("\n") == 2 + 21 + 1
    assert (out / "ceilings.png").stat().st_size > 10_000
    with pytest.raises(ValueError, match="rows must differ"):
        tables.arranged([row_of(whole.tier("experts")[0])] * 2)


def test_two_checkpoints_of_one_policy_are_refused(whole):
    cells = {cell.task: cell for cell in whole.tier("must") if cell.method == "gem"}
    one = row_of(cells[BOWL], data_sha256="d", checkpoint_sha256="one" * 4)
    other = row_of(cells[UNSEEN_BOWL], data_sha256="d", checkpoint_sha256="two" * 4)
    for change in ({"checkpoint_sha256": "one" * 4}, {"data_sha256": "another"}, {"seed": 1}, {"demos": 100}):
        checks.check_checkpoints([one, other | change])
    trials = [row | {"split": "val", "config_hash": name} for row, name in ((one, "a"), (other, "b"))]
    checks.check_checkpoints(trials)
    refused = f"gem with 10 demonstrations and the training seed 0 are of several policies, {'one' * 4} on {BOWL}, two"
    same_trial = [row | {"config_hash": "a"} for row in trials]
    for rows in ([one, other], [one, other | {"config_hash": "more steps"}], same_trial):
        with pytest.raises(ValueError, match=refused):
            checks.check_checkpoints(rows)
    for user in (tables.arranged, functools.partial(page.renewed, "")):
        with pytest.raises(ValueError, match=refused):
            user([one, other])
    checks.check_checkpoints(results.stored_rows())


def test_a_policy_is_not_trained_anew_for_the_rest_of_its_cells_nor_taken_from_another_training(whole, empty, tmp_path):
    cells = whole.tier("must")
    first, second = [cell for cell in cells if cell.method == "gem" and cell.training.tasks == (BOWL,)]
    training, policies = first.training, tmp_path / "policies"
    checks.check_policy(first, cells, policies)  # nothing is filed: it may be trained
    weights = policies / f"{training.name}.safetensors"
    policies.mkdir()
    weights.touch()

    def write_card(**changes):
        card = {
            "method": "gem", "config": training.config.as_dict(), "sha256": "weights", "memory": [], "task": BOWL,
            "clip": {"fingerprint": training.clip_fingerprint}, "demos": 10, "seed": 0,
        }  # fmt: skip
        weights.with_suffix(".json").write_text(json.dumps(card | changes))

    write_card()
    file_row(first, checkpoint_sha256="weights")
    checks.check_policy(first, cells, policies)
    checks.check_policy(second, cells, policies)
    older = {"config": training.config.as_dict() | {"map_offset": 0.0}}
    for change in (older, {"task": "align-rope"}, {"demos": 20}, {"seed": 1}, {"clip": {"fingerprint": "another"}}):
        write_card(**change)
        with pytest.raises(ValueError, match="is of another training than its name says"):
            checks.check_policy(first, cells, policies)
    write_card(sha256="trained again")
    with pytest.raises(ValueError, match=r"its policy .* is another one, but other rows of this training are of"):
        checks.check_policy(second, cells, policies)
    weights.unlink()
    with pytest.raises(ValueError, match=rf"is missing and would be trained anew, .*weights on {BOWL}"):
        checks.check_policy(second, cells, policies)
    checks.check_policy(first, cells, policies)  # its own row may be measured anew
    checks.check_policy(Cell("expert", BOWL), cells, policies)


def test_a_measured_row_that_is_not_filed_is_refused(whole, empty, tmp_path):
    first, second = whole.tier("must")[:2]
    file_row(first)
    measured = tmp_path / f"{second.name}.jsonl"
    (tmp_path / f"{first.name}.jsonl").touch()  # its row is filed
    assert checks.missing([first, second], tmp_path) == [measured]
    measured.touch()
    with pytest.raises(ValueError, match=rf"{second.name}\.jsonl is measured, and .* lacks its row"):
        checks.missing([first, second], tmp_path)


def start_snakemake(runs, *words):
    command = [sys.executable, "-m", "snakemake", "--snakefile", SNAKEFILE, "--cores", "2", "--quiet"]
    command += ["--config", f"runs={runs}", f"clip={clip.EMBEDDED}", *words]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.release
def test_snakemake_finds_a_way_to_all_rows_works_alone_in_a_folder_and_trains_no_lost_policy_anew(tmp_path):
    busy, lost = tmp_path / "busy", tmp_path / "lost"
    busy.mkdir()
    stamp = busy / "demos" / "block-insertion-10.txt"
    cell = next(cell for cell in Plan.load(str(clip.EMBEDDED)).tier("must") if cell.method == "gem-multi")
    with filelock.FileLock(busy / "lock"):
        started = [
            start_snakemake(busy, "--", "more", str(stamp)),  # what is not measured yet, and a small set
            start_snakemake(lost, "--dry-run", "--", str(lost / "rows" / f"{cell.name}.jsonl")),
        ]
        printed = [process.communicate()[0] for process in started]
    for process, text, said in zip(
        started, printed, ("another snakemake works in", "is missing and would be trained anew"), strict=True
    ):
        assert process.returncode == 1 and said in text, text[-2000:]
    assert not stamp.parent.exists()
    # Snakemake's own lock would stay after a kill.
    profile = (ROOT / SNAKEFILE).with_name("profiles") / "default" / "config.yaml"
    assert yaml.safe_load(profile.read_text())["nolock"] is True
