import json
from concurrent.futures import ThreadPoolExecutor

import failures
import numpy as np
import pytest
import summaries

from experiments.pointing import measure as pointing
from gem_lite import tasks
from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.evaluation import actors, results, statistics, table_poses
from gem_lite.evaluation.results import Episode, result_row
from gem_lite.evaluation.statistics import mean_and_interval
from gem_lite.policies.choosing import Choice
from gem_lite.policies.gem_config import LITE
from gem_lite.se2 import Pose2
from gem_lite.simulation import looks
from gem_lite.simulation.world import World

TASK = "put-block-in-bowl-seen-colors"
FACTS = {"world": "home", "split": "test", "start": 0, **results.policy_entries(None, LITE)}
FACTS |= {"demos": 10, "seed": 0, "steps": LITE.steps, "checkpoint_sha256": "a", "train_cpu_seconds": 100.0}
REWARDS = np.random.default_rng(0).random((3, 40)) < np.array([[0.9], [0.8], [0.4]])


def row_of(rewards, **facts):
    found = [Episode(i, float(value), 1, ()) for i, value in enumerate(rewards)]
    return result_row("gem", TASK, found, "all", FACTS | facts)


def score(path, **required):
    """The stored rows of GEM on `TASK` with these entries, as one score."""
    required = {"method": "gem", "task": TASK} | required
    return summaries.pool(summaries.select(results.read_rows(path), required, ("demos", "steps", "world")))


@pytest.fixture
def path(tmp_path):
    """A file of rows: three training seeds of 40 episodes each."""
    path = tmp_path / "rows.jsonl"
    for seed, values in enumerate(REWARDS):
        row = row_of(values, seed=seed, checkpoint_sha256=f"sha-{seed}", train_cpu_seconds=100.0 + seed)
        results.file_rows([row], path)
    return path


def test_a_cell_pools_the_training_seeds(path):
    found = score(path)
    assert np.array_equal(found.rewards, REWARDS)
    assert found.mean == pytest.approx(100 * REWARDS.mean(), abs=0.05)
    assert found.interval == mean_and_interval(REWARDS)[1]
    assert (found.cpu_seconds, found.episodes) == (101.0, tuple(range(40)))
    assert score(path, seed=1).rewards.shape == (1, 40)


@pytest.mark.parametrize(
    ("required", "said"),
    [
        ({"steps": 300}, r"no row with .*steps 300\. There are: .*steps 1500, world home"),
        ({"method": "cliport"}, r"no row with method cliport.* There are: demos 10"),
        ({"task": "bars-in-box"}, "There are: none of this task"),
    ],
)
def test_a_cell_that_is_not_there_says_what_is(path, required, said):
    with pytest.raises(LookupError, match=said):
        score(path, **required)


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ({"seed": 3, "config_hash": "other"}, f"differ in config_hash: {LITE.digest}, other; ask for one"),
        (
            {"seed": 0, "checkpoint_sha256": "trained-again"},
            r"same training seed, of .* sha-0, sha-1, sha-2, trained-a",
        ),
        ({"seed": 3, "rewards": {"0": 1.0}}, "different episodes"),
    ],
)
def test_rows_that_do_not_belong_together_are_no_cell(path, added, said):
    results.file_rows([row_of(np.ones(40)) | added], path)
    with pytest.raises(LookupError, match=said):
        score(path)


def test_everything_that_changes_a_row_names_it(path):
    same = row_of(np.ones(40), checkpoint_sha256="sha-0")
    for count, name in enumerate(results.IDENTITY, start=1):
        before = results.read_rows(path)
        results.file_rows([same | {name: [7] if name == "skipped" else "another"}], path)
        assert results.read_rows(path)[:-1] == before and len(before) == 2 + count
    results.file_rows([same], path)
    assert len(results.read_rows(path)) == len(before) + 1


def test_a_row_is_replaced_by_one_as_long_and_never_by_a_shorter_or_an_older_kind(path):
    before = path.read_bytes()
    same = {"seed": 1, "checkpoint_sha256": "sha-1"}
    with pytest.raises(ValueError, match=r"holds a row over 40 episodes \(method gem, .*seed 1, .*over 39 does not"):
        results.file_rows([row_of(np.ones(3), seed=7), row_of(np.ones(39), **same)], path)
    old_kind = {name: value for name, value in row_of(np.ones(100), **same).items() if name not in ("world", "config")}
    with pytest.raises(ValueError, match=r"lacks world, config: measure it again"):
        results.file_rows([old_kind], path)
    assert path.read_bytes() == before
    results.file_rows([row_of(np.zeros(40), **same)], path)
    assert score(path, seed=1).mean == 0.0
    results.file_rows([row_of(np.ones(41), **same)], path)
    assert score(path, seed=1).rewards.shape == (1, 41) and len(results.read_rows(path)) == 3


def test_what_was_measured_is_printed_if_it_cannot_be_filed(path, capsys):
    with path.open("a") as file:
        file.write('{"method": "ge')
    row = row_of(np.ones(40), seed=7)
    with pytest.raises(ValueError, match=r"line 4 of .* is cut off"):
        results.file_rows([row], path)
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(row))


def test_a_row_that_names_no_skipped_episodes_skipped_none(path):
    older = [{name: value for name, value in row.items() if name != "skipped"} for row in results.read_rows(path)]
    path.write_text("".join(json.dumps(row) + "\n" for row in older))
    results.file_rows([row_of(np.ones(40), seed=0, checkpoint_sha256="sha-0")], path)
    assert score(path).rewards.shape == (3, 40) and len(results.read_rows(path)) == 3
    path.write_text(json.dumps(older[0] | {"skipped": "some"}))
    with pytest.raises(ValueError, match="is no row: see its skipped"):
        results.read_rows(path)


def test_rows_of_two_writers_all_stay(tmp_path):
    path = tmp_path / "new" / "rows.jsonl"

    def write(seeds):
        for seed in seeds:
            results.file_rows([row_of([1.0], seed=seed)], path)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write, (range(40), range(40, 80))))
    assert {row["seed"] for row in results.read_rows(path)} == set(range(80))


def test_a_file_that_cannot_be_written_is_named_before_and_the_rows_are_printed_after(path, monkeypatch, capsys):
    row = row_of(np.ones(40))
    blocked = path / "rows.jsonl"  # its folder is a file
    with pytest.raises(OSError, match=rf"{blocked} cannot be written: "):
        results.check_rows([row], blocked)
    other = path.with_name("other.jsonl")
    results.check_rows([row], other)
    assert not other.exists()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results, "write_atomically", full)
    with pytest.raises(OSError, match=rf"{other} cannot be written, its rows are printed instead: .*No space left"):
        results.file_rows([row], other)
    assert json.loads(capsys.readouterr().out) == row


def test_a_row_tells_under_which_rules_a_policy_acted():
    learned = {"checkpoint_sha256": "a", "clip_fingerprint": "b"}
    assert not results.is_outdated(row_of([1.0], **learned))
    assert results.is_outdated(row_of([1.0], **learned) | {"acting_rules": results.ACTING_RULES - 1})
    assert results.is_outdated(learned) and not results.is_outdated({"clip_fingerprint": None})


def test_stored_rows_are_complete_and_no_two_have_one_name():
    count = 0
    for path in results.RESULTS.glob("**/*.jsonl"):
        special = {"pointing": pointing.IDENTITY, "object-sorting": table_poses.IDENTITY}
        identity = special.get(path.stem, results.IDENTITY)
        rows = results.read_rows(path)
        count += len(rows)
        assert len({str([row.get(name) for name in identity]) for row in rows}) == len(rows)
        for row in rows:
            assert {"world", "config", "config_hash", "clip", "clip_fingerprint", "episodes", "date"} <= row.keys()
            assert row["config_hash"] or row["method"] == "expert"
            if path.stem == "pointing":
                continue
            assert {*identity, "demonstrations_world"} - {"skipped"} <= row.keys()
            assert row["episodes"] == len(row["rewards"])
            rewards = list(row["rewards"].values())
            assert row["mean"] == pytest.approx(100 * np.mean(rewards), abs=0.06)  # rewards and mean are rounded
            assert row["ci95"] == pytest.approx(mean_and_interval(rewards)[1], abs=0.11)
            assert row["interval"] == statistics.INTERVAL
            learned = row["method"] not in (*actors.SCRIPTED, pointing.METHOD)
            assert learned == bool(row["demos"] and row["clip_fingerprint"] and row["checkpoint_sha256"])
    assert count > 70


def test_pairs_are_of_the_same_episodes(path):
    one = score(path)
    found = summaries.paired_difference(one, score(path, seed=2))
    assert found == statistics.paired_difference(REWARDS, REWARDS[2]) and found.seeds == (3, 1)
    rewards = {str(index + 10): 1.0 for index in range(40)}
    for other in (row_of(np.ones(50)), row_of(np.ones(40)) | {"rewards": rewards}):  # as many episodes, or not
        with pytest.raises(ValueError, match=r"same episodes, got 40 episodes \(0 to 39\) and"):
            summaries.paired_difference(one, summaries.pool([other]))


# Why an action failed

RIGHT = ExpertAction(PickPlace(Pose2(0.5, 0.0, 0.0), Pose2(0.6, 0.0, 0.0)), np.pi / 2, 2 * np.pi)
PICKED = ("red block", "table")
OFF = PickPlace(Pose2(0.5, 0.0, np.radians(100)), Pose2(0.6, 0.02, np.radians(130)))
PUSH = Push(Pose2(0.5, 0.0), Pose2(0.6, 0.0))
RIGHT_PUSH = ExpertAction(Push(Pose2(0.5, 0.01), Pose2(0.6, 0.03)), 0.0, 0.0)


def chosen(action, sentence=""):
    return Choice(sentence, None, None, None, None, (0, 0, 0), (0, 0, 0), action)


@pytest.mark.parametrize(
    ("action", "right", "found", "grasped", "reason"),
    [
        (OFF, RIGHT, ("blue block", "table"), False, "picked the blue block, not the red block"),
        (OFF, RIGHT, PICKED, False, "grasped nothing of the red block, 10° off"),
        (OFF, RIGHT, PICKED, True, "placed on the table, not on the green bowl"),
        (OFF, RIGHT, ("red block", "green bowl"), True, "placed 20 mm and 30° off"),
        (PUSH, RIGHT_PUSH, PICKED, False, "began 10 mm and ended 30 mm from the expert's push"),
    ],
)
def test_reasons_name_the_first_cause(action, right, found, grasped, reason):
    wanted = ("red block", "green bowl" if right is RIGHT else "table")
    assert failures.reason(chosen(action), right, wanted, found, grasped) == reason


def test_thing_at_names_what_lies_on_top(blind):
    task = tasks.make(TASK, "val")
    blind.reset(task, tasks.episode_seed("val", 0))
    for body in blind.bodies:
        assert failures.thing_at(blind, blind.pose(body)[0]) == task.names[body.id]
    assert failures.thing_at(blind, Pose2(blind.workspace.x_min, blind.workspace.y_min)) == "table"


def test_a_reason_names_what_the_tool_lifted():
    """Two blocks touch; the pick lies on the named one, and the tool takes hold of its neighbour."""

    class Stubborn:
        def decide(self, observation, instruction, empty_picks):
            return chosen(PickPlace(Pose2(0.684375, -0.346875, 1.92), Pose2(0.653125, -0.253125, 4.54)), instruction)

    with World(style=looks.style("touching")) as touching:
        failure = failures.first_failure(touching, Stubborn(), TASK, 24)
    assert failure.reason == "picked the purple block, not the green block"
