from types import SimpleNamespace

import numpy as np
import pytest

from gem_lite import clip, tasks
from gem_lite.actions import Outcome, PickPlace, Push
from gem_lite.cli import main
from gem_lite.evaluation import actors, evaluate, results, workers
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.evaluation.results import Episode
from gem_lite.foundations import colors
from gem_lite.policies import methods
from gem_lite.policies.checkpoints import read_card
from gem_lite.policies.gem_config import LITE
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.world import World

TASK = "put-block-in-bowl-seen-colors"
SHIPPED = clip.DATA / "gem-put-block-in-bowl.safetensors"


def test_rounding_to_pixels_and_angles_keeps_the_expert_perfect(blind):
    actor = actors.rounded_expert(LITE)
    for index in range(3):
        assert evaluate.run_episode(blind, actor, TASK, "test", index).reward == pytest.approx(1.0)
    blind.begin(tasks.make(TASK, "val"), tasks.episode_seed("val", 1))
    exact, rounded = actors.expert(blind).action, actor(blind, None)
    assert exact != rounded
    for one, two in ((exact.pick, rounded.pick), (exact.place, rounded.place)):
        assert max(abs(one.x - two.x), abs(one.y - two.y)) <= LITE.pixel / 2 + 1e-9
    turn = np.angle(np.exp(1j * (exact.pick.yaw - rounded.pick.yaw)))
    assert abs(turn) <= np.pi / LITE.angles + 1e-9


def test_random_actor_scores_little_and_repeats(blind):
    played = [evaluate.run_episode(blind, actors.random_actor(LITE, 0), TASK, "val", index) for index in range(3)]
    assert np.mean([episode.reward for episode in played]) <= 1 / 3
    actions = [actors.random_actor(LITE, seed)(blind, None) for seed in (1, 1, 2)]
    assert actions[0] == actions[1] != actions[2]


def test_a_random_push_has_a_length():
    table = LITE.for_table((0.4, 0.4125, -0.00625, 0.00625))
    actor = actors.random_actor(table, 0)
    pusher = SimpleNamespace(effector=SimpleNamespace(actions=(Push,)))
    pushes = [actor(pusher, None) for _ in range(50)]
    assert all((push.start.x, push.start.y) != (push.end.x, push.end.y) for push in pushes)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("oracle", TASK, 1), r"method must be one of gem, .*without a checkpoint: expert, expert-rounded"),
        (("expert", "put-blocks-in-bowl", 1), TASK),
        (("expert", TASK, 0), "episodes must be at least 1, got 0"),
        (("expert", TASK, 1, "test", 0, None, None, "mars"), "no world is named 'mars'; the nearest names: "),
        (("cliport", TASK, 1), "cliport needs --checkpoint"),
        (("gem-without-parsing", TASK, 1, "test", 0, SHIPPED), "holds gem, not gem-without-parsing"),
        (("gem-without-a-clue", TASK, 1, "test", 0, SHIPPED), "method must be one of gem, "),
        (
            ("gem", TASK, 1, "test", 0, clip.DATA / "gem-object-sorting.safetensors"),
            r"a table .* y -0.530 to 0.530 m; that of put-block.* y -0.500 to 0.500 m",
        ),
    ],
)
def test_what_cannot_be_measured_is_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        evaluate.evaluate(Measurement(*arguments))


@pytest.fixture
def command(monkeypatch, tmp_path):
    """``command("expert", TASK, ...)`` runs the command line over fake episodes; the outcome is its exit code."""
    monkeypatch.setattr(results, "RESULTS", tmp_path / "filed")
    monkeypatch.setattr(results, "RUNS", tmp_path / "runs")

    def play(measurement, processes):
        measurement.check()
        return [Episode(measurement.start + i, 1.0, 1, ()) for i in range(measurement.episodes)]

    monkeypatch.setattr(evaluate, "evaluate", play)
    return lambda *words: main(["evaluate", *words])


def test_a_smoke_run_replaces_no_filed_row(command, tmp_path, capsys):
    filed = tmp_path / "filed" / "put-block-in-bowl.jsonl"
    assert command("expert", TASK, "--file") == 0
    before = filed.read_bytes()
    assert command("expert", TASK, "--episodes", "2") == 0  # goes to runs
    assert filed.read_bytes() == before
    assert [row["episodes"] for row in results.read_rows(tmp_path / "runs" / filed.name)] == [2]
    capsys.readouterr()
    assert command("expert", TASK, "--episodes", "2", "--file") == 2
    said = capsys.readouterr()
    assert "holds a row over 100 episodes (method expert, task put-block-in-bowl-seen-colors" in said.err
    assert "run at least 100 episodes" in said.err and not said.out  # before it is measured
    assert filed.read_bytes() == before
    assert command("expert", TASK, "--episodes", "120", "--file") == 0
    assert [row["episodes"] for row in results.read_rows(filed)] == [120]
    assert command("expert", TASK, "--episodes", "120", "--file", "--world", "shadows") == 0
    assert [row["world"] for row in results.read_rows(filed)] == ["home", "shadows"]
    assert command("expert", TASK, "--out", str(tmp_path / "own.jsonl"), "--file") == 2
    assert command("expert", TASK, "--out", str(tmp_path / "own.jsonl")) == 0
    assert len(results.read_rows(tmp_path / "own.jsonl")) == 1


def test_rows_hold_the_card_of_their_policy(command, tmp_path):
    assert command("gem", TASK, "--checkpoint", str(SHIPPED), "--episodes", "3", "--file") == 0
    (row,) = results.read_rows(tmp_path / "filed" / "put-block-in-bowl.jsonl")
    card = read_card(SHIPPED)
    for name in ("demos", "seed", "train_seconds", "data_sha256", "demonstrations_world"):
        assert row[name] == card[name] is not None
    assert (row["steps"], row["config"]) == (card["config"]["steps"], "lite")
    assert row["learning_rate"] == card["config"]["learning_rate"] > 0
    assert row["config_hash"] == methods.of_card(card)[1].digest
    assert row["clip_fingerprint"] == card["clip"]["fingerprint"]
    assert row["checkpoint_sha256"] == card["sha256"]
    assert set(results.IDENTITY) <= row.keys()


def test_scripted_rows_hold_what_they_depend_on(command, tmp_path):
    for method in actors.SCRIPTED:
        assert command(method, TASK, "--episodes", "1", "--file") == 0
    rows = {row["method"]: row for row in results.read_rows(tmp_path / "filed" / "put-block-in-bowl.jsonl")}
    assert rows["expert"]["config_hash"] is None
    assert rows["expert-rounded"]["config_hash"] == rows["random"]["config_hash"] == actors.LITE.digest
    empty = ("steps", "learning_rate", "clip_fingerprint", "seed")
    assert all(row[name] is None for row in rows.values() for name in empty)


def test_an_episode_tells_its_actor_where_nothing_was_grasped_and_counts_who_is_picked_again(blind, monkeypatch):
    """A scripted actor: the empty table, the empty table again, the block, and the placed block once more."""
    told = []

    class OneBlock(tasks.Task):
        max_steps = 4

        def lay_out(self, environment, rng, seed):
            self.block = environment.add(shapes.add_block(environment.client, colors.rgba("red"), Pose2(0.4, 0.0)))
            return []

        def score(self, world):
            return 0.0

        def placed(self, world):
            return {self.block.id} if world.pose(self.block)[0].x > 0.55 else set()

    picks = [Pose2(0.3, 0.3), Pose2(0.3, 0.35), Pose2(0.4, 0.0), Pose2(0.6, 0.0)]

    def actor(world, observation, empty_picks):
        told.append(list(empty_picks))
        return PickPlace(picks[len(told) - 1], Pose2(0.6, 0.0))

    monkeypatch.setattr(evaluate.tasks, "make", lambda name, split: OneBlock())
    episode = evaluate.run_episode(blind, actor, "staged", "val", 0)
    assert told == [[], picks[:1], picks[:2], []]
    assert (episode.placed_decisions, episode.retaken) == (1, 1)


def test_a_subset_of_episodes_has_a_row_of_its_own():
    episodes = [Episode(0, 1.0, 1, ("hard",)), Episode(1, 0.0, 1, ()), Episode(2, 0.5, 1, ("hard", "odd"))]
    rows = {row["subset"]: row["rewards"] for row in evaluate.rows_of("expert", TASK, episodes, {})}
    assert rows == {"all": {"0": 1.0, "1": 0.0, "2": 0.5}, "hard": {"0": 1.0, "2": 0.5}, "odd": {"2": 0.5}}


def test_skipped_episodes_are_replaced_by_later_ones_and_a_world_is_chosen_by_its_name(
    jobs_here, tmp_path, monkeypatch
):
    styles = []
    monkeypatch.setattr(evaluate, "World", lambda style: styles.append(style.name) or World(style=style))
    monkeypatch.setattr(World, "observe", lambda self: (None,))
    measurement = Measurement("expert", TASK, 3, skip=(1, 9), world="shadows")
    rows, _ = evaluate.measure_and_file(measurement, tmp_path / "rows.jsonl")
    assert list(rows[0]["rewards"]) == ["0", "2", "3"] and styles == ["shadows"]
    assert rows[0]["skipped"] == results.read_rows(tmp_path / "rows.jsonl")[0]["skipped"] == [1]


def test_episodes_come_in_chunks():
    assert workers.chunks(3, 7) == [[3, 4, 5, 6, 7], [8, 9]]
    assert workers.chunks(3, 6, skip=(4, 5, 100)) == [[3, 6, 7, 8, 9], [10]]
    with pytest.raises(ValueError, match="episodes must be at least 1, got 0"):
        workers.chunks(0, 0)


@pytest.mark.parametrize(("rewards", "total"), [((0.1, 0.2, -0.3), 0.0), ((0.7, 0.1, 0.2), 1.0), ((0.5, -0.25), 0.25)])
def test_gains_and_losses_add_up_to_a_reward_between_0_and_1(monkeypatch, rewards, total):
    result = SimpleNamespace(observations=(), grasped=True, done=False, outcome=Outcome.PUSHED)
    steps = [SimpleNamespace(**vars(result) | {"reward": reward}) for reward in rewards]
    steps[-1].done = True
    world = SimpleNamespace(begin=lambda *_: None, observe=tuple, steps_taken=0, step=lambda *_, **__: steps.pop(0))
    task = SimpleNamespace(placed=lambda _: set(), subsets=tuple, instruction="")
    monkeypatch.setattr(tasks, "make", lambda *_: task)
    push = Push(Pose2(0.5, 0.0), Pose2(0.6, 0.0))
    episode = evaluate.run_episode(world, lambda *_: push, TASK, "test", 0)
    assert 0.0 <= episode.reward <= 1.0 and episode.reward == pytest.approx(total)
    assert episode.outcomes == ("pushed",) * len(rewards)
    results.reward_entries({0: episode.reward})
