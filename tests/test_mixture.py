"""One policy for several tasks, and policies that push."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from small import SMALL, weights
from torch.utils.data import ConcatDataset

from gem_lite.actions import ExpertAction, Push
from gem_lite.cli import main
from gem_lite.evaluation import collecting
from gem_lite.maps.crop_memory import collect_crops
from gem_lite.policies import checkpoints, methods
from gem_lite.policies.checkpoints import load_policy, read_card, save_policy
from gem_lite.policies.gem import Gem
from gem_lite.training import train
from gem_lite.training.folders import demonstrations_of_tasks

TWO_STEPS = dataclasses.replace(SMALL, steps=2)
MULTI = dataclasses.replace(TWO_STEPS, ablations=("multi",))


@pytest.fixture(scope="module")
def folders(demo_set, tmp_path_factory):
    packing = tmp_path_factory.mktemp("demos") / "packing-2"
    collecting.collect("packing-shapes-seen", 2, packing)
    return demo_set[0], packing


def pushed(demonstration):
    """The demonstration with pushes in the place of its actions."""
    steps = []
    for step in demonstration.steps:
        action = step.expert.action
        sentence = step.instruction.replace("put the", "push the")
        push = ExpertAction(Push(action.pick, action.place))
        steps.append(dataclasses.replace(step, instruction=sentence, expert=push, trace=()))
    return dataclasses.replace(demonstration, steps=tuple(steps))


def test_every_task_is_drawn_equally_often():
    rng = np.random.default_rng(0)
    joined = ConcatDataset([["a"] * 90, ["b"] * 10])
    drawn = [train.draw(joined, rng) for _ in range(1000)]
    assert drawn.count("b") == pytest.approx(500, abs=60)
    assert [train.draw(list(range(10)), np.random.default_rng(i)) for i in range(5)] == [
        int(np.random.default_rng(i).integers(10)) for i in range(5)
    ]


def test_one_policy_is_trained_on_two_tasks_and_remembers_both(folders, model, tmp_path):
    bowl, packing = folders
    checkpoint = tmp_path / "multi.safetensors"
    card = train.train_from_folder(bowl, checkpoint, Gem, MULTI, tmp_path / "run", also=(packing,))
    assert card["method"] == "gem-multi" and card["demos"] == 2
    assert card["task"] == "put-block-in-bowl-seen-colors + packing-shapes-seen"
    policy = load_policy(checkpoint, model)
    assert {entry.task for entry in policy.memory.entries} == {"put-block-in-bowl-seen-colors", "packing-shapes-seen"}
    assert methods.of_card(read_card(checkpoint))[1] == MULTI


def test_the_number_of_folders_must_fit_the_method(folders, tmp_path):
    bowl, packing = folders
    for settings, also in ((TWO_STEPS, (packing,)), (MULTI, ())):
        with pytest.raises(ValueError, match="ending 'multi' needs several folders"):
            train.train_from_folder(bowl, tmp_path / "a.safetensors", Gem, settings, tmp_path / "run", also=also)
    assert not (tmp_path / "a.safetensors").exists()


@pytest.mark.release
def test_tasks_have_equally_many_demonstrations_in_any_number_of_folders(folders, tmp_path):
    bowl, packing = folders
    worlds = [tmp_path / "varied", tmp_path / "home"]
    collecting.collect("packing-shapes-seen", 1, worlds[0], world="varied")
    collecting.collect("packing-shapes-seen", 1, worlds[1], start=1)
    message = "equally many demonstrations, got 2 of put-block-in-bowl-seen-colors, 3 of packing-shapes-seen"
    with pytest.raises(ValueError, match=message):
        demonstrations_of_tasks((bowl, packing, worlds[0]), None, MULTI)
    card = train.train_from_folder(bowl, tmp_path / "a.safetensors", Gem, MULTI, tmp_path / "run", also=worlds)
    assert (card["demos"], card["demonstrations_world"]) == (2, "home + varied")
    assert card["task"] == "put-block-in-bowl-seen-colors + packing-shapes-seen"


@pytest.mark.release
def test_a_training_can_begin_with_the_weights_of_a_checkpoint(trained, model, demo_set, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_policy(trained[0], tmp_path / "start.safetensors", {})
    policy = Gem(dataclasses.replace(SMALL, learning_rate=1e-9, steps=1), model, seed=5)
    assert checkpoints.begin_with(policy, tmp_path / "start.safetensors") == read_card("start.safetensors")["sha256"]
    assert torch.equal(weights(policy), weights(trained[0]))
    save_policy(Gem(MULTI, model), tmp_path / "multi.safetensors", {})
    with pytest.raises(ValueError, match=r"training of gem cannot begin with the checkpoint .* of gem-multi"):
        checkpoints.begin_with(policy, tmp_path / "multi.safetensors")
    wide = Gem(dataclasses.replace(SMALL, fields=SMALL.fields + 1), model)
    with pytest.raises(
        ValueError, match=r"cannot begin with the checkpoint .*: place\.kernel.* must be finite and of shape"
    ):
        checkpoints.begin_with(wide, tmp_path / "start.safetensors")
    card = train.train_from_folder(
        demo_set[0], Path("a.safetensors"), Gem, policy.config, Path("run"), begin_with=Path("start.safetensors")
    )
    assert card["begun_with_sha256"] == read_card("start.safetensors")["sha256"]
    difference = weights(load_policy("a.safetensors", model)) - weights(trained[0])
    assert 0 < difference.abs().max() < 1e-6
    assert main(["train", str(demo_set[0]), "b.safetensors", "--begin-with", "missing.safetensors"]) == 2
    assert "missing.safetensors" in capsys.readouterr().err


def test_a_policy_learns_pushes_and_pushes_if_the_sentence_says_so(demo_set, model):
    demos = [pushed(demonstration) for demonstration in demo_set[1]]
    policy = Gem(SMALL, model)
    policy.remember(demos)
    count = sum(len(demonstration.steps) for demonstration in demos)
    assert len(policy.memory.entries) == 2 * count  # the start and the end of every push
    crops = list(collect_crops(demos, SMALL.workspace, SMALL.top_patch))
    assert crops[0].phrase.endswith("blocks") and crops[1].phrase.endswith("bowl")
    sample = next(policy.prepare(demos))[1]
    action = demos[0].steps[0].expert.action
    assert sample.pick == pytest.approx(SMALL.workspace.to_pixel(action.start.x, action.start.y))
    assert sample.place == pytest.approx(SMALL.workspace.to_pixel(action.end.x, action.end.y))
    assert (sample.pick_symmetry, sample.place_symmetry) == (0.0, 0.0)
    observation = demos[0].steps[0].observation
    assert isinstance(policy.act(observation, demos[0].steps[0].instruction), Push)
    assert not isinstance(policy.act(observation, demo_set[1][0].steps[0].instruction), Push)
