"""Checkpoints: their names, their two files, and copies of a policy."""

import copy
import dataclasses
import io
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from small import SMALL
from tiers import for_a_release

from gem_lite import clip
from gem_lite.cli import main
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.policies.checkpoints import card_path, load_policy, read_card, save_policy
from gem_lite.policies.gem import Gem
from gem_lite.rgbd.observation import Observation

SCENE = clip.DATA / "foreign-scenes" / "workbench"
SENTENCE = "put the red block in the blue bowl"


@pytest.fixture(scope="module")
def policy(model):
    picture = np.arange(20 * 20 * 3, dtype=np.uint8).reshape(20, 20, 3)
    return Gem(SMALL, model, CropMemory([CropEntry("red block", picture, "t", 0)], model), seed=1)


@pytest.fixture(scope="module")
def decided(policy):
    """(observation, what the policy decides there)."""
    observation = Observation.load(SCENE)
    return observation, policy.decide(observation, SENTENCE)


def same(one, other):
    return all(torch.equal(a, b) for a, b in zip(one.parameters(), other.parameters(), strict=True))


def test_names_with_a_dot_are_told_apart(policy, model, tmp_path):
    other = Gem(SMALL, model, policy.memory, seed=2)
    save_policy(policy, tmp_path / "lr-0.1.safetensors", {})
    save_policy(other, tmp_path / "lr-0.2.safetensors", {})
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "lr-0.1.json", "lr-0.1.safetensors", "lr-0.2.json", "lr-0.2.safetensors",
    ]  # fmt: skip
    first = load_policy(tmp_path / "lr-0.1.safetensors", model)
    assert same(first, policy) and same(load_policy(str(tmp_path / "lr-0.2.safetensors"), model), other)
    assert [entry.phrase for entry in first.memory.entries] == ["red block"]
    assert torch.allclose(first.memory.values, policy.memory.values, atol=1e-6)
    assert card_path("runs/lr-0.1.safetensors") == Path("runs/lr-0.1.json")


@pytest.mark.parametrize("name", ["mine.json", "lr-0.1", "mine", "mine.pt", "mine.safetensors.zip", ".safetensors"])
def test_other_endings_are_refused(policy, model, tmp_path, name):
    (tmp_path / name).write_text("of somebody else")
    for refused in (
        lambda: save_policy(policy, tmp_path / name, {}),
        lambda: read_card(tmp_path / name),
        lambda: load_policy(tmp_path / name, model),
    ):
        with pytest.raises(ValueError, match=r"the name of a checkpoint must end in \.safetensors, got '.*"):
            refused()
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "of somebody else")]


def test_a_training_refuses_another_ending_before_it_begins(tmp_path, capsys):
    shipped = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
    assert main(["train", str(shipped), str(tmp_path / "mine.json"), "--state", str(tmp_path / "state")]) == 2
    assert "must end in .safetensors" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_value_names_no_method(model, tmp_path):
    plain = Gem(dataclasses.replace(SMALL, image_weight=0.0), model)
    save_policy(plain, tmp_path / "policy.safetensors", {})
    assert plain.name == load_policy(tmp_path / "policy.safetensors", model).name == "gem"
    assert read_card(tmp_path / "policy.safetensors")["method"] == "gem"


@pytest.mark.parametrize(
    ("changes", "values", "message"),
    [
        ({"clip": {"name": "other", "fingerprint": "0"}}, {}, "trained with the CLIP 'other'"),
        ({"method": "vima"}, {}, "unknown method 'vima'"),
        ({"method": "gem-without-image-map"}, {}, "the ablations of its configuration, none, are not the same"),
        (
            {"method": "gem-without-parsing"}, {"ablations": ["without-parsing"]},
            "without-parsing needs parsing = False, got True",
        ),
        ({}, {"query": 15}, r"unknown entries \['query'\]"),
    ],
)  # fmt: skip
def test_a_card_that_does_not_fit_is_refused(policy, model, tmp_path, changes, values, message):
    path = tmp_path / "policy.safetensors"
    save_policy(policy, path, {})
    card = read_card(path)
    card_path(path).write_text(json.dumps(card | {"config": card["config"] | values} | changes))
    with pytest.raises(ValueError, match=message):
        load_policy(path, model)


def test_bad_checkpoints_are_refused_in_a_sentence(policy, model, tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(policy, path, {})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match="cut off or changed"):
        load_policy(path, model)
    with pytest.raises(FileNotFoundError, match="missing"):
        load_policy(tmp_path / "none.safetensors", model)


@pytest.mark.parametrize("ending", ["", "with-steerable-encoder"])
def test_a_state_dict_is_the_same_in_both_modes_and_loads_in_both(model, ending):
    config = SMALL.ablated(ending) if ending else SMALL
    trained, other = Gem(config, model, seed=1), Gem(config, model, seed=2)
    states = {training: trained.train().train(training).state_dict() for training in (True, False)}
    assert states[True].keys() == states[False].keys() and not any("filter" in key for key in states[False])
    for training in (False, True):
        other.train(training).load_state_dict(states[not training])
        assert same(other, trained)
        found, expected = other.eval(), trained.eval()
        crop = torch.rand(1, found.place.kernel._sizes[0], 17, 17)
        assert torch.equal(found.place.kernel(crop), expected.place.kernel(crop)), "its filters are of these weights"
        for parameter in other.parameters():
            parameter.data.add_(1.0)


def through_a_file(policy):
    content = io.BytesIO()
    torch.save(policy, content)
    content.seek(0)
    return torch.load(content, weights_only=False)


COPIES = {
    "copy.deepcopy": copy.deepcopy,
    "pickle": lambda it: pickle.loads(pickle.dumps(it)),
    "torch.save": through_a_file,
}


@pytest.mark.parametrize("way", for_a_release(COPIES, lambda way: way == "pickle"))
@pytest.mark.parametrize("training", [True, False], ids=["train", "eval"])
def test_a_copy_of_a_policy_decides_as_it_does(policy, decided, way, training):
    observation, choice = decided
    policy.train().train(training)  # e2cnn keeps another tensor after each change.
    copied = COPIES[way](policy)
    assert same(copied, policy) and copied.training == training
    found = copied.decide(observation, SENTENCE)
    # Not to the last bit: torch rounds attention differently at other places in memory.
    assert np.allclose(found.pick_logits, choice.pick_logits, atol=1e-4)
    assert np.allclose(found.place_logits, choice.place_logits, atol=1e-4) and found.action == choice.action
    copied.train()
    with torch.no_grad():
        for weight in copied.parameters():
            weight.zero_()
    assert not same(copied, policy), "the copy has weights of its own"
