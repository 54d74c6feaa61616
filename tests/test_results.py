import json
from dataclasses import replace

import numpy as np
import pytest

from gem_lite import clip, tasks
from gem_lite.actions import PickPlace
from gem_lite.demonstrations import ExpertAction
from gem_lite.evaluation import evaluate, evaluate_mobile, experiments, failures, pointing, results, statistics
from gem_lite.evaluation.experiments import PLAN, Experiment
from gem_lite.evaluation.results import Episode, result_row
from gem_lite.evaluation.statistics import mean_and_interval
from gem_lite.policies import methods
from gem_lite.policies.base import Choice
from gem_lite.policies.gem_config import LITE
from gem_lite.se2 import Pose2
from gem_lite.simulation import worlds
from gem_lite.simulation.world import World

TASK = "put-block-in-bowl-seen-colors"


FACTS = {"world": "home", "split": "test", "start": 0, **results.facts_of(None, LITE)}
FACTS |= {"demos": 10, "seed": 0, "steps": LITE.steps, "checkpoint_sha256": "a", "train_cpu_seconds": 100.0}


def row_of(rewards, task=TASK, **facts):
    found = [Episode(i, float(value), 1, ()) for i, value in enumerate(rewards)]
    return result_row("gem", task, found, "all", FACTS | facts)


def file(*rows):
    results.file_rows(rows, results.results_file(rows[0]["task"]))


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """Three training seeds of 40 episodes each, as rows in a folder of their own."""
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    rng = np.random.default_rng(0)
    rewards = rng.random((3, 40)) < np.array([[0.9], [0.8], [0.4]])
    for seed, values in enumerate(rewards):
        file(row_of(values, seed=seed, checkpoint_sha256=f"sha-{seed}", train_cpu_seconds=100.0 + seed))
    return rewards


def test_a_cell_pools_the_training_seeds(stored):
    found = results.score("gem", TASK)
    assert np.array_equal(found.rewards, stored)
    assert found.mean == pytest.approx(100 * stored.mean(), abs=0.05)
    assert found.interval == mean_and_interval(stored)[1]
    assert found.cpu_seconds == 101.0
    assert found.episodes == tuple(range(40))
    assert results.score("gem", TASK, episodes=10).rewards.shape == (3, 10)
    assert results.score("gem", TASK, seed=1).rewards.shape == (1, 40)


def test_a_cell_that_is_not_there_says_what_is(stored):
    with pytest.raises(LookupError, match=r"no row with .*steps 300\. There are: .*steps 1500, world home"):
        results.score("gem", TASK, steps=300)
    with pytest.raises(LookupError, match=r"no row with .*world home, old camera.* There are: .*world home"):
        results.score("gem", TASK, world=results.OLD_CAMERA)
    with pytest.raises(LookupError, match=r"no row with method cliport.* There are: method gem, demos 10"):
        results.score("cliport", TASK)
    with pytest.raises(LookupError, match="There are: none of this task"):
        results.score("gem", "bars-in-box")
    with pytest.raises(LookupError, match="have 40 episodes, not 50"):
        results.score("gem", TASK, episodes=50)


def test_rows_that_differ_in_more_than_the_seed_are_no_cell(stored):
    file(row_of(np.ones(40), seed=3, config_hash="other"))
    with pytest.raises(LookupError, match=f"differ in config_hash: {LITE.digest}, other; ask for one"):
        results.score("gem", TASK)
    assert results.score("gem", TASK, config_hash=LITE.digest).rewards.shape == (3, 40)
    assert results.score("gem", TASK, config_hash="other").mean == 100.0


def test_two_trainings_with_one_seed_are_no_two_seeds(stored):
    file(row_of(np.ones(40), seed=0, checkpoint_sha256="trained-again"))
    with pytest.raises(LookupError, match=r"same training seed, of the checkpoints sha-0, sha-1, sha-2, trained-agai"):
        results.score("gem", TASK)


def test_rows_of_unlike_episodes_are_no_cell(stored):
    path = results.results_file(TASK)
    rows = results.read_rows(path)
    rows[0]["rewards"].pop("3")
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(LookupError, match="different episodes"):
        results.score("gem", TASK)


@pytest.mark.parametrize("name", results.IDENTITY)
def test_everything_that_changes_a_row_names_it(stored, name):
    path = results.results_file(TASK)
    before = results.read_rows(path)
    same = row_of(np.ones(40), checkpoint_sha256="sha-0")
    results.file_rows([same | {name: "another"}], path)
    assert results.read_rows(path)[:-1] == before
    results.file_rows([same], path)
    assert len(results.read_rows(path)) == len(before) + 1


def test_a_row_is_replaced_by_one_as_long_and_never_by_a_shorter_or_an_older_kind(stored):
    path = results.results_file(TASK)
    before = path.read_bytes()
    same = {"seed": 1, "checkpoint_sha256": "sha-1"}
    with pytest.raises(ValueError, match=r"holds a row over 40 episodes \(method gem, .*seed 1, .*over 39 does not"):
        file(row_of(np.ones(3), seed=7), row_of(np.ones(39), **same))
    assert path.read_bytes() == before  # nothing of the two was written
    old_kind = row_of(np.ones(100), **same)
    del old_kind["world"], old_kind["config_hash"]
    with pytest.raises(ValueError, match=r"lacks world, config_hash: measure it again"):
        file(old_kind)
    assert path.read_bytes() == before
    file(row_of(np.zeros(40), **same))
    assert results.score("gem", TASK, seed=1).mean == 0.0
    file(row_of(np.ones(41), **same))
    assert results.score("gem", TASK, seed=1).rewards.shape == (1, 41)
    assert len(results.read_rows(path)) == 3


def test_stored_rows_are_complete():
    rows = [row for path in results.RESULTS.glob("*.jsonl") for row in results.read_rows(path)]
    assert len(rows) > 100
    for row in rows:
        assert {"world", "config", "config_hash", "clip", "clip_fingerprint", "episodes", "date"} <= row.keys()
        assert row["config_hash"] or row["method"] == "expert"
    of_policies = [row for row in rows if "method" in row]  # the pointing game's have other keys
    for row in of_policies:
        identity = evaluate_mobile.IDENTITY if "poses" in row else results.IDENTITY
        assert {*identity, "demonstrations_world"} <= row.keys()
        assert row["episodes"] == len(row["rewards"])
        mean, interval = mean_and_interval(list(row["rewards"].values()))
        assert row["mean"] == pytest.approx(mean, abs=0.06)  # rewards are rounded
        assert row["ci95"] == pytest.approx(interval, abs=0.11) and row["interval"] == statistics.INTERVAL
        learned = row["method"] not in (*evaluate.SCRIPTED, pointing.METHOD)
        assert learned == bool(row["demos"] and row["clip_fingerprint"] and row["checkpoint_sha256"])


def test_no_two_stored_rows_have_one_name():
    for path in results.RESULTS.glob("*.jsonl"):
        identity = {"pointing": pointing.IDENTITY, "object-sorting": evaluate_mobile.IDENTITY}
        names = [
            tuple(row[key] for key in identity.get(path.stem, results.IDENTITY)) for row in results.read_rows(path)
        ]
        assert len(set(names)) == len(names)


def test_pairs_are_of_the_same_episodes(stored):
    one = results.score("gem", TASK)
    found = results.paired_difference(one, results.score("gem", TASK, seed=2))
    assert found == statistics.paired_difference(stored, stored[2]) and found.seeds == (3, 1)
    file(row_of(np.ones(50), task="put-block-in-bowl-unseen-colors"))
    row = results.read_rows(results.results_file(TASK))[-1]
    moved = row | {"rewards": {str(int(index) + 10): reward for index, reward in row["rewards"].items()}}
    for other in (row, moved):
        # As many episodes, or not, they are not the same ones.
        with pytest.raises(ValueError, match=r"same episodes, got 40 episodes \(0 to 39\) and"):
            results.paired_difference(one, results.pool([other], 40 if other is moved else None))


def test_the_plan_holds_each_experiment_once_and_what_the_comparison_needs():
    names = [experiment.name for experiment in PLAN]
    assert len(set(names)) == len(names)
    at_ten = {(e.method, e.seed) for e in PLAN if e.task == experiments.BOWL and e.demos == 10}
    assert {(m, s) for m in methods.METHODS.names() for s in (0, 1, 2)} <= at_ten
    assert {e.demos for e in PLAN if (e.method, e.task) == ("gem", experiments.BOWL)} == {1, 5, 10, 20}


def test_an_experiment_is_measured_on_the_unseen_variant_too():
    assert Experiment("gem", TASK).measured_on == (TASK, "put-block-in-bowl-unseen-colors")
    assert Experiment("gem", "packing-shapes-seen").measured_on == ("packing-shapes-seen", "packing-shapes-unseen")
    assert Experiment("gem", "block-insertion").measured_on == ("block-insertion",)


@pytest.fixture
def card(tmp_path, monkeypatch):
    """Writes a checkpoint of an experiment that holds nothing but its card; entries may be given."""
    monkeypatch.setattr(experiments, "FOLDER", tmp_path / "experiments")

    def write(experiment, **other):
        told = {
            "method": experiment.method, "config": experiment.config.as_dict(), "demos": experiment.demos,
            "clip": {"name": "embedded clip-tabletop", "fingerprint": clip.load().fingerprint},
            "seed": experiment.seed, "demonstrations_world": experiment.demonstrations_world, "sha256": "sha-of-it",
            "memory": [],
        }  # fmt: skip
        experiment.checkpoint.parent.mkdir(parents=True, exist_ok=True)
        experiment.checkpoint.write_bytes(b"")
        experiment.checkpoint.with_suffix(".json").write_text(json.dumps(told | other))

    return write


def test_commands_train_unless_there_is_a_checkpoint(card, tmp_path):
    experiment = Experiment("cliport", TASK, demos=5, seed=2)
    trained, *measured = experiment.commands()
    state = tmp_path / "experiments" / "state" / experiment.name
    assert trained[0] == "train" and trained[-2:] == ["--state", str(state)]
    assert [command[2] for command in measured] == list(experiment.measured_on)
    card(experiment)
    assert experiment.commands() == measured
    assert [command[0] for command in Experiment("random", TASK).commands()] == ["evaluate"] * 2


def test_a_checkpoint_of_another_training_is_not_measured(card):
    experiment = Experiment("cliport", TASK, demos=5, seed=2)
    for entries, said in (
        ({"demonstrations_world": None}, "demonstrations_world is None, not varied"),
        ({"demos": 10}, "demos is 10, not 5"),
        ({"config": experiment.config.as_dict() | {"steps": 7}}, "config_hash is "),
        ({"clip": {"name": "other", "fingerprint": "0"}}, "clip_fingerprint is 0, not"),
    ):
        card(experiment, **entries)
        with pytest.raises(RuntimeError, match=f"comes from another training than {experiment.name} .*{said}"):
            experiment.commands()


def test_the_demonstrations_world_names_the_files_where_it_is_not_the_plans(tmp_path, monkeypatch):
    plain, home = Experiment("cliport", TASK), Experiment("cliport", TASK, demonstrations_world="home")
    assert plain.demonstrations_world == experiments.DEMONSTRATIONS_WORLD
    assert home.name == f"{plain.name}-home" and home.checkpoint != plain.checkpoint and home.rows != plain.rows
    assert Experiment("gem", TASK).shipped
    assert not any(
        Experiment("gem", TASK, **other).shipped for other in ({"demonstrations_world": "home"}, {"seed": 1})
    )
    monkeypatch.setattr(experiments, "FOLDER", tmp_path)
    asked = []
    monkeypatch.setattr(experiments.subprocess, "run", lambda command, check: asked.append(command[3:]))
    experiments.collect([plain, home, Experiment("gem", TASK, demos=20), Experiment("expert", TASK)])
    folders = [str(experiments.demonstrations_of(TASK, world)) for world in ("varied", "home")]
    assert len(set(folders)) == 2
    assert asked == [
        ["collect", TASK, folder, "--episodes", count, "--world", world]
        for folder, count, world in zip(folders, ("20", "10"), ("varied", "home"), strict=True)
    ]


def test_an_experiment_is_done_when_every_task_has_its_row(card, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path / "filed")
    experiment = Experiment("gem", TASK, demos=5, episodes=40)
    named = {"demos": 5, "clip_fingerprint": clip.load().fingerprint, "demonstrations_world": "varied"}
    unseen = "put-block-in-bowl-unseen-colors"
    file(row_of(np.ones(40), **named))
    assert not experiment.done()  # the unseen variant is missing
    for other in (
        {"world": "shadows"}, {"demonstrations_world": "home"}, {"config_hash": "other"},
        {"clip_fingerprint": "other"}, {"seed": 1},
    ):  # fmt: skip
        file(row_of(np.ones(40), task=unseen, **(named | other)))
        assert not experiment.done()
    file(row_of(np.ones(40), task=unseen, **named))
    assert experiment.done()
    assert not replace(experiment, episodes=100).done()
    assert not replace(experiment, demos=10).done()
    assert not replace(experiment, demonstrations_world="other").done()
    card(experiment)  # the rows are of another checkpoint than the one that is there
    assert not experiment.done()
    card(experiment, sha256="a")
    assert experiment.done()


def test_scripted_experiments_know_when_they_are_done(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    for method in ("expert", "expert-rounded"):
        experiment = Experiment(method, "bars-in-box", episodes=3)
        settings = None if method == "expert" else evaluate.LITE
        facts = {"world": "home", "split": "test", "start": 0, **results.facts_of(None, settings)}
        found = [Episode(i, 1.0, 1, ()) for i in range(3)]
        file(result_row(method, "bars-in-box", found, "all", facts | {"world": "shadows"}))
        assert not experiment.done()
        file(result_row(method, "bars-in-box", found, "all", facts))
        assert experiment.done()


def test_a_failed_experiment_names_its_log(tmp_path, monkeypatch):
    monkeypatch.setattr(experiments, "FOLDER", tmp_path)
    experiment = Experiment("gem", TASK)
    monkeypatch.setattr(Experiment, "commands", lambda self: [["train", "nowhere", "x.safetensors"]])
    with pytest.raises(RuntimeError, match="ended with code 2"):
        experiments.run(experiment)
    assert "holds no demonstrations" in (tmp_path / "logs" / f"{experiment.name}.log").read_text()


def judged(done: PickPlace, found: tuple[str, str], grasped: bool = True) -> str:
    right = ExpertAction(PickPlace(Pose2(0.5, 0.0, 0.0), Pose2(0.6, 0.0, 0.0)), np.pi / 2, 2 * np.pi)
    choice = Choice("", None, None, None, None, (0, 0, 0), (0, 0, 0), done)
    return failures.reason(choice, right, ("red block", "green bowl"), found, grasped)


def test_reasons_name_the_first_cause():
    off = PickPlace(Pose2(0.5, 0.0, np.radians(100)), Pose2(0.6, 0.02, np.radians(130)))
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


def test_a_reason_names_what_the_tool_lifted():
    """Two blocks touch; the pick lies on the named one, and the tool takes hold of its neighbour."""

    class Stubborn:
        def decide(self, observation, instruction):
            action = PickPlace(Pose2(0.684375, -0.346875, 1.92), Pose2(0.653125, -0.253125, 4.54))
            return Choice(instruction, None, None, None, None, (0, 0, 0), (0, 0, 0), action)

    with World(style=worlds.style("touching")) as touching:
        failure = failures.first_failure(touching, Stubborn(), TASK, 24)
    assert failure.reason == "picked the purple block, not the green block"
