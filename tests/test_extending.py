"""What is added without an edit: a task, an arm, a method, a map source and a parser from outside (toys.py).

Each is collected, trained for a few steps and evaluated by the library's own commands, in processes of its own.
"""

import json

import pytest
from tiers import for_a_release

from gem_lite import clip, demonstrations, language, tasks
from gem_lite.cli import main
from gem_lite.evaluation import actors
from gem_lite.evaluation.results import read_rows
from gem_lite.evaluation.rollout import rollout
from gem_lite.maps.crop_memory import events
from gem_lite.policies.checkpoints import load_policy

TASK = "block-on-plate"
TINY = ("--config.widths", "4", "4", "8", "8", "--config.kernel-widths", "4", "8", "8", "--config.fields", "2")
METHODS = {
    "one-convolution": ("--preset", "tiny", "--config.size", "3"),
    "gem": (*TINY, "--config.semantic-map", "redness", "--config.angles", "4"),
}
"""The toy method, and GEM with the toy map source; both read with the toy parser."""


def run(*words):
    assert main([*map(str, words), "--import", "toys"]) == 0


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    """The toy task's expert at work."""
    folder = tmp_path_factory.mktemp("toys") / "demos"
    run("collect", TASK, folder, "--episodes", 2)
    return folder


def test_the_toy_task_is_collected(demos):
    episodes = demonstrations.load(demos)
    assert [episode.task for episode in episodes] == [TASK, TASK]
    assert [step.instruction for step in episodes[0].steps] == ["red block -> white plate"]
    assert sum(step.reward for step in episodes[1].steps) == pytest.approx(1.0)


def test_an_arm_that_is_no_floating_tool_plays_an_episode(blind, monkeypatch):
    import toys

    filmed, rewards = [], []
    monkeypatch.setattr(blind, "film", filmed.append)
    task = tasks.make("put-block-in-bowl-by-arm", "val")
    for turn in rollout(blind, task, tasks.episode_seed("val", 0), actors.expert):
        rewards.append(turn.result.reward)
        assert [kind for kind, _ in events(turn.result.trace)] == ["pick", "place"]
        assert filmed[-len(turn.result.trace) :] == list(turn.result.trace)
    assert type(blind.effector) is toys.Arm and toys.Arm.__bases__ == (object,)
    assert len(rewards) == 2 and sum(rewards) == pytest.approx(1.0)


@pytest.mark.parametrize("method", for_a_release(METHODS, lambda method: method == "gem"))
def test_a_toy_method_and_a_toy_map_source_are_trained_and_evaluated(method, demos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    checkpoint = tmp_path / f"{method}.safetensors"
    run(
        "train", demos, checkpoint, "--method", method, *METHODS[method], "--config.parser", "arrow",
        "--config.steps", 2, "--config.batch", 1,
    )  # fmt: skip
    run("evaluate", method, TASK, "--checkpoint", checkpoint, "--episodes", 1, "--out", tmp_path / "rows.jsonl")
    (row,) = read_rows(tmp_path / "rows.jsonl")
    assert (row["method"], row["task"], row["steps"], row["episodes"]) == (method, TASK, 2, 1)
    card = json.loads(checkpoint.with_suffix(".json").read_text())
    assert card["config"]["parser"] == "arrow"
    policy = load_policy(checkpoint, clip.load())
    assert policy.read("red block -> white plate") == language.Queries("red block", "white plate")
    with pytest.raises(ValueError, match="instruction must be like"):
        policy.read("put the red block on the white plate")
