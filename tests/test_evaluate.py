import json

import numpy as np
import pytest

from gem_lite import clip, evaluate
from gem_lite.config import LITE
from gem_lite.evaluate import Episode, file_rows, mean_and_interval, result_row
from gem_lite.tabletop import tasks

TASK = "put-block-in-bowl-seen-colors"


def test_rounding_to_pixels_and_angles_keeps_the_expert_perfect(world):
    actor = evaluate.rounded_expert(LITE)
    for index in range(3):
        assert evaluate.run_episode(world, actor, TASK, "test", index).reward == pytest.approx(1.0)


def test_rounding_is_at_most_half_a_pixel_and_half_a_bin(world):
    observation = world.reset(tasks.make(TASK, "val"), tasks.episode_seed("val", 1))
    exact = evaluate.expert(world, observation)
    rounded = evaluate.rounded_expert(LITE)(world, observation)
    assert exact != rounded
    for one, two in ((exact.pick, rounded.pick), (exact.place, rounded.place)):
        assert max(abs(one.x - two.x), abs(one.y - two.y)) <= LITE.pixel / 2 + 1e-9
    turn = np.angle(np.exp(1j * (exact.pick.yaw - rounded.pick.yaw)))
    assert abs(turn) <= np.pi / LITE.angles + 1e-9


def test_random_actor_scores_little_and_repeats(world):
    def play(seed):
        return [evaluate.run_episode(world, evaluate.random_actor(LITE, seed), TASK, "val", i).reward for i in range(3)]

    assert np.mean(play(0)) <= 1 / 3
    actions = [evaluate.random_actor(LITE, seed)(world, None) for seed in (1, 1, 2)]
    assert actions[0] == actions[1] != actions[2]


def test_interval_holds_the_mean_and_shrinks():
    rng = np.random.default_rng(0)
    few, many = rng.random(10) < 0.8, rng.random(1000) < 0.8
    mean, (low, high) = mean_and_interval(few)
    assert low <= mean <= high
    wide, (a, b) = high - low, mean_and_interval(many)[1]
    assert b - a < wide


def test_interval_of_equal_rewards_is_the_exact_binomial_one():
    # Clopper-Pearson for n of n: low = (0.025)^(1/n). A bootstrap would claim certainty.
    assert mean_and_interval([1.0] * 100) == (100.0, (96.4, 100.0))
    assert mean_and_interval([0.0] * 32) == (0.0, (0.0, 10.9))


def test_rows_replace_their_own_cell_only(tmp_path):
    path = tmp_path / "rows.jsonl"
    bad, good = ([Episode(i, reward, 1, ("red", "blue")) for i in range(4)] for reward in (0.0, 1.0))
    facts = {"demos": 10, "seed": 0, "config": "lite", "split": "test", "start": 0}
    file_rows([result_row("gem", TASK, bad, "all", facts), result_row("random", TASK, bad, "all", facts)], path)
    file_rows([result_row("gem", TASK, good, "all", facts)], path)
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert sorted((row["method"], row["mean"]) for row in rows) == [("gem", 100.0), ("random", 0.0)]
    assert {"task", "episodes", "ci95", "date", "config"} <= set(rows[0])


def test_unknown_method_task_and_count_are_named():
    with pytest.raises(ValueError, match="method must be"):
        evaluate.evaluate("oracle", TASK, 1)
    with pytest.raises(ValueError, match="put-block-in-bowl-seen-colors"):
        evaluate.evaluate("expert", "put-blocks-in-bowl", 1)
    with pytest.raises(ValueError, match="episodes"):
        evaluate.evaluate("expert", TASK, 0)


def test_a_learned_method_needs_its_own_checkpoint():
    with pytest.raises(ValueError, match="cliport needs --checkpoint"):
        evaluate.evaluate("cliport", TASK, 1)
    shipped = clip.DATA / "gem-put-block-in-bowl.safetensors"
    with pytest.raises(ValueError, match="holds gem, not gem-without-parsing"):
        evaluate.make_actor("gem-without-parsing", LITE, shipped, None, seed=0)


def test_stored_rows_are_complete():
    rows = [json.loads(line) for path in evaluate.RESULTS.glob("*.jsonl") for line in path.read_text().splitlines()]
    rows = [row for row in rows if "method" in row]  # a policy's; the pointing game's have other keys
    assert rows
    for row in rows:
        assert row["episodes"] > 0
        assert row["ci95"][0] <= row["mean"] <= row["ci95"][1]
        assert (row["method"] != "gem") or (row["demos"] and row["clip"] and row["checkpoint_sha256"])


def test_every_task_family_has_a_results_file_of_its_own():
    files = {name: evaluate.results_file(name).name for name in tasks.NAMES}
    assert (
        files["put-block-in-bowl-unseen-colors"] == files["put-block-in-bowl-seen-colors"] == "put-block-in-bowl.jsonl"
    )
    assert files["packing-shapes-unseen"] == "packing-shapes.jsonl"
    assert files["block-insertion"] == "block-insertion.jsonl"
    assert len(set(files.values())) == 6
