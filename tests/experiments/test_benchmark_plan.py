"""The plan of the benchmark: its cells, the names of their files, and what Snakemake would do."""

import dataclasses
import hashlib
import itertools
import json
import subprocess
import sys
from pathlib import Path

import filelock
import pytest
import yaml

from gem_lite import clip, tasks
from gem_lite.cli import main
from gem_lite.drawing import benchmark_page, plot_benchmark
from gem_lite.evaluation import benchmark, results, summaries
from gem_lite.evaluation.benchmark import Cell, Plan, Training, chosen
from gem_lite.policies import methods
from gem_lite.policies.gem_config import ABLATIONS

ROOT = Path(__file__).resolve().parents[1]
WORKFLOW = ROOT / "workflow"
CONTENT = yaml.safe_load((WORKFLOW / "benchmark.yaml").read_text())
BOWL = "put-block-in-bowl-seen-colors"


@pytest.fixture(scope="module")
def plan():
    return Plan(CONTENT)


def row_of(cell, mean=50.0, **changes):
    facts = {name: None for name in results.IDENTITY} | {"method": cell.method, "task": cell.task, "subset": "all"}
    facts |= {"split": cell.split, "world": cell.world, "episodes": cell.episodes}
    facts |= {"mean": mean, "ci95": [mean - 5, mean + 5], "train_cpu_seconds": None}
    facts |= {"rewards": {str(index): mean / 100 for index in range(cell.episodes)}, "skipped": list(cell.skipped)}
    if cell.training:
        facts |= {"demos": cell.training.demos, "seed": cell.training.seed, "config": "lite"}
    elif cell.method == "expert-rounded":
        facts["config"] = cell.preset
    return facts | changes


def file_row(cell, mean):
    cell.file.parent.mkdir(parents=True, exist_ok=True)
    cell.file.write_text(json.dumps(row_of(cell, mean)) + "\n")


def test_the_plan_has_the_papers_eighteen_tasks(plan):
    assert plan.variants == benchmark.VARIANTS and len(set(plan.variants)) == 18
    assert not set(plan.variants) & set(plan.ours)
    assert len(plan.several) == 10
    assert len({tasks.family(name) for name in plan.several}) == 10


def test_the_first_tier_compares_three_methods_on_every_task(plan):
    cells = plan.tier("must")
    assert len(cells) == len(set(cells)) == len({cell.file for cell in cells})
    for method in ("gem", "cliport", "transporter-lan"):
        measured = {cell.task for cell in cells if cell.method == method and cell.training.demos == 10}
        assert measured == {*plan.variants, "block-insertion"}
    assert all(cell.episodes == 50 and cell.split == "test" for cell in cells)


def test_two_variants_of_colours_share_a_training_and_two_of_objects_do_not(plan):
    gem = {cell.task: cell.training for cell in plan.tier("must") if cell.method == "gem"}
    assert gem[BOWL] == gem["put-block-in-bowl-unseen-colors"]
    assert gem["packing-google-objects-seq-seen"] != gem["packing-google-objects-seq-unseen"]
    assert len(plan.trainings(plan.tier("must"))) < len(plan.tier("must"))


def test_a_policy_for_all_tasks_has_as_many_steps_for_each(plan):
    (training,) = {cell.training for cell in plan.tier("must") if cell.method == "gem-multi"}
    assert training.tasks == plan.several
    assert training.config.steps == CONTENT["settings"]["gem"]["steps"] * 10


def test_a_longer_task_is_longer_for_every_method_and_not_for_the_policy_of_all_tasks(plan):
    steps = {(cell.method, cell.training.tasks): cell.training.config.steps for cell in plan.tier("must")}
    for method in ("gem", "cliport", "transporter-lan"):
        assert steps[method, ("align-rope",)] == 4 * steps[method, ("block-insertion",)]
    assert steps["gem-multi", plan.several] == 10 * steps["gem", ("block-insertion",)]


@pytest.mark.parametrize(
    "change",
    [{"demos": 20}, {"seed": 1}, {"steps": 7}, {"learning_rate": 0.5}, {"tasks": ("bars-in-box",)},
     {"method": "gem-without-image-map"}, {"clip_fingerprint": "other"}],
)  # fmt: skip
def test_whatever_changes_a_policy_changes_its_name(change):
    training = Training("gem", (BOWL,), 10, clip_fingerprint="one")
    changed = dataclasses.replace(training, **change)
    assert training.name != changed.name
    assert Cell("gem", BOWL, training).file != Cell("gem", BOWL, changed).file
    assert dataclasses.replace(training).name == training.name


@pytest.mark.parametrize(
    "change",
    [
        {"split": "val"},
        {"episodes": 10},
        {"preset": "paper"},
        {"task": "align-rope"},
        {"skipped": (3,)},
        {"world": "shadows"},
    ],
)
def test_whatever_changes_a_row_changes_its_file(change):
    cell = Cell("expert-rounded", BOWL)
    assert cell.file != dataclasses.replace(cell, **change).file


def test_the_search_is_the_same_for_every_method_and_on_validation_episodes(plan):
    cells = plan.search()
    trials = {
        method: {(c.task, c.training.steps, c.training.learning_rate) for c in cells if c.method == method}
        for method in CONTENT["search"]["methods"]
    }
    assert len(trials) == 3 and len({frozenset(found) for found in trials.values()}) == 1
    assert all(cell.split == "val" for cell in cells)
    assert len(CONTENT["search"]["trials"]) == 4 and len(CONTENT["search"]["tasks"]) == 2


def test_the_best_trial_has_the_best_mean_over_the_tasks(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "ROWS", tmp_path)
    cells = plan.search()
    with pytest.raises(LookupError, match="is not measured yet"):
        chosen(cells, "gem")
    for cell in cells:
        file_row(cell, cell.training.steps / 100 + 1000 * cell.training.learning_rate)
    assert chosen(cells, "gem") == {"steps": 2000, "learning_rate": 0.001}


def test_the_plan_has_the_settings_that_the_search_chose():
    cells = Plan(CONTENT).search()
    for method in CONTENT["search"]["methods"]:
        if all(cell.row() for cell in cells if cell.method == method):
            assert CONTENT["settings"][method] == chosen(cells, method)
        else:
            assert method not in CONTENT["settings"], "chosen before its search is complete"


def test_what_the_rows_decide_is_printed(plan, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "ROWS", tmp_path)
    command = ["results", "settings", str(WORKFLOW / "benchmark.yaml")]
    assert main(command) == 2
    assert "is not measured yet" in capsys.readouterr().err
    for cell in plan.search():
        file_row(cell, cell.training.steps / 100)
    experts = [cell for cell in plan.tier("experts") if cell.method == "expert"]
    for cell in experts:
        rewards = {str(index): float(index != 3 or cell.task != BOWL) for index in range(cell.episodes)}
        cell.file.parent.mkdir(parents=True, exist_ok=True)
        cell.file.write_text(json.dumps(row_of(cell, rewards=rewards)) + "\n")
    assert main(command) == 0
    printed = yaml.safe_load(capsys.readouterr().out)
    assert printed["settings"]["gem"] == {"steps": 2000, "learning_rate": 0.001}
    assert printed["skipped"] == {BOWL: [3]}


def test_what_the_expert_does_not_solve_is_left_out_for_all_others():
    plan = Plan({**CONTENT, "skipped": {BOWL: [4, 7]}})
    cells = [cell for name in ("experts", "must") for cell in plan.tier(name) if cell.task == BOWL]
    assert {cell.skipped for cell in cells if cell.method != "expert"} == {(4, 7)}
    assert {cell.skipped for cell in cells if cell.method == "expert"} == {()}


def test_the_plan_skips_what_the_experts_rows_say(plan):
    experts = [cell for cell in plan.tier("experts") if cell.method == "expert" and cell.row()]
    for cell in experts:
        unsolved = benchmark.unsolved(cell)
        assert plan.skipped.get(cell.task, ()) == unsolved
        allowed = 0.1 if tasks.family(cell.task) in ("align-rope", "separating-piles") else 0.05
        assert len(unsolved) <= allowed * cell.episodes


def test_a_stored_row_belongs_to_its_cell(plan):
    cells = [*plan.search(), *itertools.chain(*(plan.tier(name) for name in CONTENT["tiers"]))]
    rows = {cell: cell.row() for cell in cells if cell.training and cell.file.exists()}
    assert rows
    for cell, row in rows.items():
        config = cell.training.config
        for ending in methods.split(cell.method)[1]:  # a rule of acting that is switched off changes the configuration
            config = config if ending in config.ablations else config.ablated(ending)
        assert (row["method"], row["task"], row["split"]) == (cell.method, cell.task, cell.split)
        assert (row["demos"], row["seed"]) == (cell.training.demos, cell.training.seed)
        assert (row["steps"], row["learning_rate"]) == (config.steps, config.learning_rate)
        assert row["config_hash"] == config.digest and row["skipped"] == list(cell.skipped)
        assert row["world"] == cell.world
        assert row["clip_fingerprint"] == cell.training.clip_fingerprint and row["episodes"] == cell.episodes


def test_all_rows_of_a_policy_are_of_one_checkpoint():
    rows = benchmark.stored_rows()
    benchmark.check_checkpoints(rows)
    for method, demos in benchmark.MIXED:
        of_policy = [row for row in rows if (row["method"], row["demos"]) == (method, demos)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(benchmark, "MIXED", set())
            with pytest.raises(ValueError, match=f"the rows of {method} with {demos} .* are of several policies"):
                benchmark.check_checkpoints(of_policy)  # if it passes, take the entry out of MIXED


def test_two_checkpoints_of_one_policy_are_refused(plan):
    cells = {cell.task: cell for cell in plan.tier("must") if cell.method == "gem"}
    seen, unseen = cells[BOWL], cells["put-block-in-bowl-unseen-colors"]
    one = row_of(seen, data_sha256="d", checkpoint_sha256="one" * 4)
    other = row_of(unseen, data_sha256="d", checkpoint_sha256="two" * 4)
    fine = [
        other | {"checkpoint_sha256": one["checkpoint_sha256"]},
        other | {"data_sha256": "of another task"},
        other | {"seed": 1},
        other | {"demos": 100},
    ]
    for row in fine:
        benchmark.check_checkpoints([one, row])
    trials = [row | {"split": "val", "config_hash": name} for row, name in ((one, "a"), (other, "b"))]
    benchmark.check_checkpoints(trials)
    refused = f"gem with 10 demonstrations and the training seed 0 are of several policies, {'one' * 4} on {BOWL}, two"
    for rows in (
        [one, other],
        [one, other | {"config_hash": "more steps"}],
        [{**row, "config_hash": "a"} for row in trials],
    ):
        with pytest.raises(ValueError, match=refused):
            benchmark.check_checkpoints(rows)
    with pytest.raises(ValueError, match=refused):
        benchmark_page.renewed("", [one, other])
    with pytest.raises(ValueError, match=refused):
        plot_benchmark.arranged([one, other])


def test_a_policy_is_not_trained_anew_for_the_rest_of_its_cells(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "ROWS", tmp_path / "rows")
    cells = plan.tier("must")
    first, second = [cell for cell in cells if cell.method == "gem" and cell.training.tasks == (BOWL,)]
    policies = tmp_path / "policies"
    benchmark.check_policy(first, cells, policies)  # nothing is filed: it may be trained
    weights = policies / f"{first.training.name}.safetensors"
    policies.mkdir()
    weights.write_bytes(b"weights")
    first.file.parent.mkdir(parents=True)
    row = row_of(first, checkpoint_sha256=hashlib.sha256(b"weights").hexdigest())
    first.file.write_text(json.dumps(row) + "\n")
    benchmark.check_policy(second, cells, policies)
    benchmark.check_policy(first, cells, policies)
    weights.write_bytes(b"trained again")
    with pytest.raises(ValueError, match=r"its policy .* is another one, but other rows of this training are of"):
        benchmark.check_policy(second, cells, policies)
    weights.unlink()
    with pytest.raises(ValueError, match=rf"is missing and would be trained anew, .*{first.file}"):
        benchmark.check_policy(second, cells, policies)
    benchmark.check_policy(first, cells, policies)  # its own row may be measured anew
    benchmark.check_policy(Cell("expert", BOWL), cells, policies)


def test_an_episode_below_the_whole_reward_is_not_solved(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "ROWS", tmp_path)
    cell = Cell("expert", BOWL)
    with pytest.raises(LookupError, match="the expert's row on put-block-in-bowl-seen-colors is not measured yet"):
        benchmark.unsolved(cell)
    cell.file.parent.mkdir()
    rewards = {"0": 1.0, "11": 0.98, "2": 0.5, "3": 0.9951}
    cell.file.write_text(json.dumps(row_of(cell, rewards=rewards)) + "\n")
    assert benchmark.unsolved(cell) == (2, 11)


def test_every_variant_of_every_method_is_measured_somewhere(plan):
    cells = [cell for name in CONTENT["tiers"] for cell in plan.tier(name) if cell.training]
    measured = {methods.split(cell.method) for cell in cells}
    assert set(ABLATIONS) <= {ending for _, endings in measured for ending in endings}
    assert set(methods.METHODS.names()) == {name for name, _ in measured}


def test_a_cell_of_another_world_has_another_file_and_no_place_in_a_table(plan):
    cells = [cell for cell in plan.tier("lessons") if cell.training and "-" not in cell.method]
    elsewhere = [cell for cell in cells if cell.world != "home"]
    assert {"white-floor", "shadows", "touching"} <= {cell.world for cell in elsewhere}
    for cell in elsewhere:
        at_home = dataclasses.replace(cell, world="home")
        assert cell.file != at_home.file and cell.world in cell.name and cell.training == at_home.training
    measured = {"rewards": {"0": 1.0}, "train_cpu_seconds": None}
    rows = [row_of(cell, **measured) for cell in (elsewhere[0], dataclasses.replace(elsewhere[0], world="home"))]
    assert summaries.table_rows(rows)["table-1"] == rows[1:]
    assert summaries.scores(rows[:1], "gem", 10) == {}
    assert set(summaries.scores(rows, "gem", 10, world=elsewhere[0].world)) == {elsewhere[0].task}


def test_a_wrong_plan_is_refused():
    with pytest.raises(ValueError, match="the plan lacks families"):
        Plan({name: value for name, value in CONTENT.items() if name != "families"})
    with pytest.raises(ValueError, match="no task is named 'put-block-in-bowel'"):
        Plan({**CONTENT, "multi": ["put-block-in-bowel"]})
    with pytest.raises(ValueError, match="tier must be one of experts, must"):
        Plan(CONTENT).tier("first")


def test_the_tables_hold_every_row_of_test_episodes(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "ROWS", tmp_path / "rows")
    assert main(["results", "tables", str(tmp_path / "out")]) == 2  # there is nothing to draw yet
    for number, cell in enumerate(plan.tier("experts")):
        file_row(cell, float(number))
    for cell in plan.search()[:3]:
        file_row(cell, 1.0)
    table = plot_benchmark.arranged(benchmark.stored_rows())
    assert set(table) == {"expert", "expert-rounded", "expert-rounded, paper"}
    text = plot_benchmark.markdown(table, [*plan.variants])
    assert text.count("\n") == 2 + 18 + 1
    assert "| 0.0 [-5.0, 5.0] |" in text and "| **mean of the 18** | " in text
    assert main(["results", "tables", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "ceilings.md").read_text().count("\n") == 2 + 21 + 1
    assert (tmp_path / "out" / "ceilings.png").stat().st_size > 10_000


def test_two_rows_for_one_cell_of_a_table_are_refused(plan):
    cell = plan.tier("experts")[0]
    with pytest.raises(ValueError, match="rows must differ"):
        plot_benchmark.arranged([row_of(cell), row_of(cell)])


def snakemake(*words):
    command = [sys.executable, "-m", "snakemake", "--cores", "2", "--quiet", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


def test_snakemake_finds_a_way_to_every_row_of_the_first_tier():
    done = snakemake("--dry-run", "--config", f"clip={clip.EMBEDDED}", "--", "must")
    assert done.returncode == 0, done.stderr[-2000:]


def test_snakemake_refuses_to_train_a_lost_policy_anew_for_one_of_its_rows(plan, tmp_path):
    cell = next(cell for cell in plan.tier("must") if cell.method == "gem-multi")
    done = snakemake("--dry-run", "--config", f"runs={tmp_path}", "--", str(cell.file))
    assert done.returncode == 1 and "is missing and would be trained anew" in done.stdout + done.stderr


def test_a_folder_of_runs_is_refused_while_another_process_works_in_it(tmp_path):
    stamp = tmp_path / "demos" / "block-insertion-10.txt"
    with filelock.FileLock(tmp_path / "lock"):
        done = snakemake("--config", f"runs={tmp_path}", "--", str(stamp))
    assert done.returncode == 1 and "another snakemake works in" in done.stderr and not stamp.parent.exists()
    # Snakemake's own lock would stay after a kill.
    assert yaml.safe_load((ROOT / "workflow/profiles/default/config.yaml").read_text())["nolock"] is True
