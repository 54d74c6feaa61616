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


def row_of(rewards, task=TASK, **facts):
    found = [Episode(i, float(value), 1, ()) for i, value in enumerate(rewards)]
    return result_row("gem", task, found, "all", FACTS | facts)


def file(*rows):
    results.file_rows(rows, results.RESULTS / "rows.jsonl")


def score(**required):
    """The stored rows of GEM on `TASK` with these entries, as one score."""
    rows = results.read_rows(results.RESULTS / "rows.jsonl")
    return summaries.pool(
        summaries.select(rows, {"method": "gem", "task": TASK} | required, ("demos", "steps", "world"))
    )


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
    found = score()
    assert np.array_equal(found.rewards, stored)
    assert found.mean == pytest.approx(100 * stored.mean(), abs=0.05)
    assert found.interval == mean_and_interval(stored)[1]
    assert found.cpu_seconds == 101.0
    assert found.episodes == tuple(range(40))
    assert score(seed=1).rewards.shape == (1, 40)


def test_a_cell_that_is_not_there_says_what_is(stored):
    with pytest.raises(LookupError, match=r"no row with .*steps 300\. There are: .*steps 1500, world home"):
        score(steps=300)
    with pytest.raises(LookupError, match=r"no row with method cliport.* There are: demos 10"):
        score(method="cliport")
    with pytest.raises(LookupError, match="There are: none of this task"):
        score(task="bars-in-box")


def test_rows_that_differ_in_more_than_the_seed_are_no_cell(stored):
    file(row_of(np.ones(40), seed=3, config_hash="other"))
    with pytest.raises(LookupError, match=f"differ in config_hash: {LITE.digest}, other; ask for one"):
        score()
    assert score(config_hash=LITE.digest).rewards.shape == (3, 40)
    assert score(config_hash="other").mean == 100.0


def test_two_trainings_with_one_seed_are_no_two_seeds(stored):
    file(row_of(np.ones(40), seed=0, checkpoint_sha256="trained-again"))
    with pytest.raises(LookupError, match=r"same training seed, of the checkpoints sha-0, sha-1, sha-2, trained-agai"):
        score()


def test_rows_of_unlike_episodes_are_no_cell(stored):
    path = results.RESULTS / "rows.jsonl"
    rows = results.read_rows(path)
    rows[0]["rewards"].pop("3")
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(LookupError, match="different episodes"):
        score()


@pytest.mark.parametrize("name", results.IDENTITY)
def test_everything_that_changes_a_row_names_it(stored, name):
    path = results.RESULTS / "rows.jsonl"
    before = results.read_rows(path)
    same = row_of(np.ones(40), checkpoint_sha256="sha-0")
    results.file_rows([same | {name: [7] if name == "skipped" else "another"}], path)
    assert results.read_rows(path)[:-1] == before
    results.file_rows([same], path)
    assert len(results.read_rows(path)) == len(before) + 1


def test_a_row_is_replaced_by_one_as_long_and_never_by_a_shorter_or_an_older_kind(stored):
    path = results.RESULTS / "rows.jsonl"
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
    assert score(seed=1).mean == 0.0
    file(row_of(np.ones(41), **same))
    assert score(seed=1).rewards.shape == (1, 41)
    assert len(results.read_rows(path)) == 3


def test_a_row_that_names_no_skipped_episodes_skipped_none(stored):
    path = results.RESULTS / "rows.jsonl"
    older = [{name: value for name, value in row.items() if name != "skipped"} for row in results.read_rows(path)]
    path.write_text("".join(json.dumps(row) + "\n" for row in older))
    file(row_of(np.ones(40), seed=0, checkpoint_sha256="sha-0"))
    assert len(results.read_rows(path)) == len(older)
    assert score().rewards.shape == (3, 40)
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


def test_a_file_that_cannot_be_written_is_named_before_and_the_rows_are_printed_after(stored, monkeypatch, capsys):
    row = row_of(np.ones(40))
    blocked = results.RESULTS / "rows.jsonl" / "rows.jsonl"  # its folder is a file
    with pytest.raises(OSError, match=rf"{blocked} cannot be written: "):
        results.check_rows([row], blocked)
    path = results.RESULTS / "other.jsonl"
    results.check_rows([row], path)
    assert not path.exists()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results, "write_atomically", full)
    with pytest.raises(OSError, match=rf"{path} cannot be written, its rows are printed instead: .*No space left"):
        results.file_rows([row], path)
    assert json.loads(capsys.readouterr().out) == row


def test_a_row_tells_under_which_rules_a_policy_acted():
    learned = {"checkpoint_sha256": "a", "clip_fingerprint": "b"}
    assert not results.is_outdated(row_of([1.0], **learned))
    assert results.is_outdated(row_of([1.0], **learned) | {"acting_rules": results.ACTING_RULES - 1})
    assert results.is_outdated(learned) and not results.is_outdated({"clip_fingerprint": None})


def test_stored_rows_are_complete():
    rows = [row for path in results.RESULTS.glob("**/*.jsonl") for row in results.read_rows(path)]
    assert len(rows) > 70
    for row in rows:
        assert {"world", "config", "config_hash", "clip", "clip_fingerprint", "episodes", "date"} <= row.keys()
        assert row["config_hash"] or row["method"] == "expert"
    of_policies = [row for row in rows if "method" in row]  # the pointing game's have other keys
    for row in of_policies:
        identity = table_poses.IDENTITY if "poses" in row else results.IDENTITY
        assert {*identity, "demonstrations_world"} - {"skipped"} <= row.keys()
        assert row["episodes"] == len(row["rewards"])
        rewards = list(row["rewards"].values())
        assert row["mean"] == pytest.approx(100 * np.mean(rewards), abs=0.06)  # rewards and mean are rounded
        _, interval = mean_and_interval(rewards)
        assert row["ci95"] == pytest.approx(interval, abs=0.11) and row["interval"] == statistics.INTERVAL
        learned = row["method"] not in (*actors.SCRIPTED, pointing.METHOD)
        assert learned == bool(row["demos"] and row["clip_fingerprint"] and row["checkpoint_sha256"])


def test_no_two_stored_rows_have_one_name():
    for path in results.RESULTS.glob("**/*.jsonl"):
        identity = {"pointing": pointing.IDENTITY, "object-sorting": table_poses.IDENTITY}
        names = [
            tuple(str(row.get(key)) for key in identity.get(path.stem, results.IDENTITY))
            for row in results.read_rows(path)
        ]
        assert len(set(names)) == len(names)


def test_pairs_are_of_the_same_episodes(stored):
    one = score()
    found = summaries.paired_difference(one, score(seed=2))
    assert found == statistics.paired_difference(stored, stored[2]) and found.seeds == (3, 1)
    file(row_of(np.ones(50), task="put-block-in-bowl-unseen-colors"))
    row = results.read_rows(results.RESULTS / "rows.jsonl")[-1]
    moved = row | {"rewards": {str(int(index) + 10): reward for index, reward in row["rewards"].items()}}
    for other in (row, moved):
        # As many episodes, or not, they are not the same ones.
        with pytest.raises(ValueError, match=r"same episodes, got 40 episodes \(0 to 39\) and"):
            summaries.paired_difference(one, summaries.pool([other]))


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


def test_a_push_is_compared_with_the_experts():
    done = Push(Pose2(0.5, 0.0), Pose2(0.6, 0.0))
    right = ExpertAction(Push(Pose2(0.5, 0.01), Pose2(0.6, 0.03)), 0.0, 0.0)
    choice = Choice("", None, None, None, None, (0, 0, 0), (0, 0, 0), done)
    reason = failures.reason(choice, right, ("pile", "table"), ("pile", "table"), False)
    assert reason == "began 10 mm and ended 30 mm from the expert's push"


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
        def decide(self, observation, instruction, empty_picks):
            action = PickPlace(Pose2(0.684375, -0.346875, 1.92), Pose2(0.653125, -0.253125, 4.54))
            return Choice(instruction, None, None, None, None, (0, 0, 0), (0, 0, 0), action)

    with World(style=looks.style("touching")) as touching:
        failure = failures.first_failure(touching, Stubborn(), TASK, 24)
    assert failure.reason == "picked the purple block, not the green block"
