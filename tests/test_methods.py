"""A method from outside the library: one class and its configuration."""

from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
import torch
from torch import nn

from gem_lite.config import SHARED_ABLATIONS, Ablation, Config
from gem_lite.language import Queries
from gem_lite.policies import methods
from gem_lite.policies.base import Policy
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.inputs import Inputs, to_rgbd
from gem_lite.policies.transporter import TopView
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.training import train


@dataclass(frozen=True)
class ToyConfig(Config):
    ABLATIONS: ClassVar = {"without-bias": Ablation("no layer has a bias", {"bias": False}), **SHARED_ABLATIONS}
    bias: bool = True


class Toy(Policy):
    """One linear layer a pixel."""

    Config = ToyConfig

    def build(self):
        bias = self.config.bias
        return tuple(nn.Conv2d(4, self.config.angles, 1, bias=bias) for _ in range(2))

    def embed(self, views):
        return TopView(fuse_views(views, self.config.workspace))

    def inputs(self, scene, queries):
        return Inputs(rgbd=to_rgbd(scene.heightmap))

    def score_pick(self, inputs):
        return self.pick(inputs.rgbd)

    def score_place(self, inputs, picks):
        return self.place(inputs.rgbd)


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    monkeypatch.setattr(methods.METHODS, "_entries", dict(methods.METHODS._entries))
    monkeypatch.setattr(methods.METHODS, "_modules", dict(methods.METHODS._modules))
    methods.METHODS.register("toy")(Toy)


def test_a_method_from_outside_has_presets_ablations_and_a_line_of_help():
    method, config = methods.find("toy-without-bias-without-parsing", "paper")
    assert method is Toy and (config.angles, config.bias, config.parsing) == (72, False, False)
    assert methods.canonical("toy-without-parsing-without-bias") == "toy-without-bias-without-parsing"
    assert methods.meanings()["toy"] == "One linear layer a pixel."
    assert methods.meanings()["toy-without-bias"] == "no layer has a bias"
    with pytest.raises(ValueError, match="preset must be one of lite, paper, got 'huge'"):
        methods.find("toy", "huge")


def test_a_method_from_outside_trains_acts_and_comes_back(demo_set, model, tmp_path):
    method, config = methods.find("toy-without-bias")
    policy = method(replace(config, steps=3), model)
    steps = list(policy.prepare(demo_set[1]))
    before = [parameter.clone() for parameter in policy.parameters()]
    train.train(policy, steps, seed=0, run=tmp_path)
    assert not any(torch.equal(*pair) for pair in zip(before, policy.parameters(), strict=True))
    save_policy(policy, tmp_path / "toy.safetensors", {})
    loaded = load_policy(tmp_path / "toy.safetensors", model)
    assert type(loaded) is Toy and loaded.name == "toy-without-bias" and loaded.memory is None
    step = demo_set[1][0].steps[0]
    assert loaded.act(step.observation, step.instruction) == policy.act(step.observation, step.instruction)


def test_a_policy_is_a_module(model):
    policy = Toy(ToyConfig(), model)
    assert [name for name, _ in policy.named_parameters()] == ["pick.weight", "pick.bias", "place.weight", "place.bias"]
    assert [name for name, _ in policy.named_children()] == ["pick", "place"], "the CLIP is no part of it"
    other = Toy(ToyConfig(), policy.clip, seed=1)
    assert not torch.equal(other.pick.weight, policy.pick.weight)
    other.load_state_dict(policy.state_dict())
    assert torch.equal(other.pick.weight, policy.pick.weight)
    assert not policy.eval().pick.training and policy.train().place.training


def test_a_parser_is_handed_to_the_policy(demo_set, model, tmp_path):
    def german(sentence):
        _, pick, _, place = sentence.split()
        if place != "Kiste":
            raise ValueError(f"no place in {sentence!r}")
        return Queries(pick, place)

    policy = Toy(ToyConfig(), model, parser=german)
    observation = demo_set[1][0].steps[0].observation
    assert policy.decide(observation, "lege Becher in Kiste").queries == Queries("Becher", "Kiste")
    with pytest.raises(ValueError, match="no place in"):
        policy.act(observation, "lege Becher in Topf")
    save_policy(policy, tmp_path / "toy.safetensors", {})
    loaded = load_policy(tmp_path / "toy.safetensors", policy.clip, parser=german)
    assert loaded.read("lege Becher in Kiste") == Queries("Becher", "Kiste")
