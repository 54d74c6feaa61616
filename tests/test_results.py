import json

import numpy as np
import pytest

from gem_lite import evaluate, experiments, failures, methods, results
from gem_lite.evaluate import Episode, mean_and_interval, result_row
from gem_lite.experiments import PLAN, Experiment
from gem_lite.policy import Choice
from gem_lite.se2 import Action, Pose2
from gem_lite.tabletop import tasks
from gem_lite.tabletop.tasks import ExpertAction

TASK = "put-block-in-bowl-seen-colors"


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """Three training seeds of 40 episodes each, as rows in a folder of their own."""
    monkeypatch.setattr(evaluate, "RESULTS", tmp_path)
    rng = np.random.default_rng(0)
    rewards = rng.random((3, 40)) < np.array([[0.9], [0.8], [0.4]])
    for seed, values in enumerate(rewards):
        found = [Episode(i, float(value), 1, ()) for i, value in enumerate(values)]
        facts = {"split": "test", "start": 0, "demos": 10, "seed": seed, "steps": 1500}
        facts["train_cpu_seconds"] = 100.0 + seed
        evaluate.file_rows([result_row("gem", TASK, found, "all", facts)], evaluate.results_file(TASK))
    return rewards


def test_a_cell_pools_the_training_seeds(stored):
    found = results.cell("gem", TASK)
    assert np.array_equal(found.rewards, stored)
    assert found.mean == pytest.approx(100 * stored.mean(), abs=0.05)
    assert found.cpu_seconds == 101.0
    assert results.cell("gem", TASK, episodes=10).rewards.shape == (3, 10)
    with pytest.raises(LookupError, match="no row of gem"):
        results.cell("gem", TASK, steps=300)


def test_seeds_that_disagree_widen_the_interval(stored):
    def width(rewards):
        low, high = mean_and_interval(rewards)[1]
        return high - low

    assert width(stored) > 1.5 * width(np.repeat(stored.reshape(1, -1), 1, axis=0))
    # Copies of one seed carry no new episodes: the interval stays as it is.
    assert width(np.repeat(stored[:1], 3, axis=0)) == pytest.approx(width(stored[0]), abs=1.0)


def test_bootstrap_agrees_with_drawing_by_hand(stored):
    rng = np.random.default_rng(1)
    by_hand = [stored[rng.integers(3, size=3)][:, rng.integers(40, size=40)].mean() for _ in range(4000)]
    low, high = mean_and_interval(stored)[1]
    # The tails are draws of one seed three times over (1 of 27), so their ends are rough.
    assert [low, high] == pytest.approx(100 * np.percentile(by_hand, [2.5, 97.5]), abs=4)


def test_missing_and_unlike_rows_are_named(stored):
    with pytest.raises(LookupError, match="no row of cliport with 10"):
        results.cell("cliport", TASK)
    path = evaluate.results_file(TASK)
    rows = evaluate.read_rows(path)
    rows[0]["rewards"].pop("3")
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(LookupError, match="different episodes"):
        results.cell("gem", TASK)


def test_paired_differences_are_sharper_than_two_intervals():
    hard = np.tile([1.0, 0.0], 25)
    one = results.Cell(np.array([hard, hard]), 50.0, (36.0, 64.0), None)
    less = hard.copy()
    less[:10:2] = 0
    other = results.Cell(less[None], 40.0, (26.0, 54.0), None)
    mean, (low, high) = results.paired_difference(one, other)
    assert mean == pytest.approx(10.0) and 0 < low < mean < high < 22
    assert results.paired_difference(one, one) == (0.0, (0.0, 0.0))
    with pytest.raises(ValueError, match="same episodes, got 50 and 10"):
        results.paired_difference(one, results.Cell(less[None, :10], 0.0, (0.0, 0.0), None))


def test_the_plan_holds_each_experiment_once_and_what_the_comparison_needs():
    names = [experiment.name for experiment in PLAN]
    assert len(set(names)) == len(names)
    at_ten = {(e.method, e.seed) for e in PLAN if e.task == experiments.BOWL and e.demos == 10}
    assert {(m, s) for m in methods.METHODS for s in (0, 1, 2)} <= at_ten
    assert {e.demos for e in PLAN if (e.method, e.task) == ("gem", experiments.BOWL)} == {1, 5, 10, 20}


def test_an_experiment_is_measured_on_the_unseen_variant_too():
    assert Experiment("gem", TASK).measured_on == (TASK, "put-block-in-bowl-unseen-colors")
    assert Experiment("gem", "packing-shapes-seen").measured_on == ("packing-shapes-seen", "packing-shapes-unseen")
    assert Experiment("gem", "block-insertion").measured_on == ("block-insertion",)


def test_commands_train_unless_there_is_a_checkpoint(tmp_path, monkeypatch):
    monkeypatch.setattr(experiments, "FOLDER", tmp_path)
    experiment = Experiment("cliport", TASK, demos=5, seed=2)
    trained, *measured = experiment.commands()
    assert trained[0] == "gem_lite.train" and trained[-2:] == ["--run", str(tmp_path / "state" / experiment.name)]
    assert [command[2] for command in measured] == list(experiment.measured_on)
    experiment.checkpoint.write_bytes(b"")
    assert experiment.commands() == measured
    assert [command[0] for command in Experiment("random", TASK).commands()] == ["gem_lite.evaluate"] * 2


def test_an_experiment_is_done_when_every_task_has_its_row(stored):
    assert not Experiment("gem", TASK, episodes=40).done()  # the unseen variant is missing
    rows = [
        row | {"task": "put-block-in-bowl-unseen-colors"} for row in evaluate.read_rows(evaluate.results_file(TASK))
    ]
    evaluate.file_rows(rows, evaluate.results_file(TASK))
    assert Experiment("gem", TASK, episodes=40).done()
    assert not Experiment("gem", TASK, episodes=100).done()
    assert not Experiment("gem", TASK, demos=5, episodes=40).done()


def test_a_failed_experiment_names_its_log(tmp_path, monkeypatch):
    monkeypatch.setattr(experiments, "FOLDER", tmp_path)
    experiment = Experiment("gem", TASK)
    monkeypatch.setattr(Experiment, "commands", lambda self: [["gem_lite.train", "nowhere", "x.safetensors"]])
    with pytest.raises(RuntimeError, match="ended with code 2"):
        experiments.run(experiment)
    assert "holds no demonstrations" in (tmp_path / "logs" / f"{experiment.name}.log").read_text()


def judged(done: Action, found: tuple[str, str], grasped: bool = True) -> str:
    right = ExpertAction(Action(Pose2(0.5, 0.0, 0.0), Pose2(0.6, 0.0, 0.0)), np.pi / 2, 2 * np.pi)
    choice = Choice("", None, None, None, None, (0, 0, 0), (0, 0, 0), done)
    return failures.reason(choice, right, ("red block", "green bowl"), found, grasped)


def test_reasons_name_the_first_cause():
    off = Action(Pose2(0.5, 0.0, np.radians(100)), Pose2(0.6, 0.02, np.radians(130)))
    assert judged(off, ("blue block", "table"), False) == "picked the blue block, not the red block"
    assert judged(off, ("red block", "table"), False) == "grasped nothing of the red block, 10° off"
    assert judged(off, ("red block", "table")) == "placed on the table, not on the green bowl"
    assert judged(off, ("red block", "green bowl")) == "placed 20 mm and 30° off"


def test_thing_at_names_what_lies_on_top(world):
    task = tasks.make(TASK, "val")
    world.reset(task, tasks.episode_seed("val", 0))
    for body in world.bodies:
        pose, _ = world.pose(body)
        assert failures.thing_at(world, pose) == task.names[body.id]
    assert failures.thing_at(world, Pose2(world.workspace.x_min, world.workspace.y_min)) == "table"
