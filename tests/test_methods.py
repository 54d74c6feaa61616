"""A method from outside the library: one class and its configuration."""

from dataclasses import dataclass
from typing import ClassVar

import pytest
import torch

from gem_lite.config import SHARED_ABLATIONS, Ablation
from gem_lite.language import Queries
from gem_lite.policies import methods
from gem_lite.policies.checkpoints import load_policy, save_policy


@pytest.fixture(autouse=True, scope="module")
def toy_method():
    """The toy method of toys.py with an ablation of its own."""
    import toys

    @dataclass(frozen=True)
    class ToyConfig(toys.OneConvolutionConfig):
        ABLATIONS: ClassVar = {"with-pixels": Ablation("it sees one pixel", {"size": 1}), **SHARED_ABLATIONS}

    @methods.METHODS.register("toy")
    class Toy(toys.OneConvolution):
        """One convolution."""

        Config = ToyConfig

    return Toy


def test_a_method_from_outside_has_presets_ablations_and_a_line_of_help(toy_method, model, tmp_path):
    method, config = methods.find("toy-with-pixels-without-parsing", "paper")
    assert method is toy_method and (config.angles, config.size, config.parsing) == (72, 1, False)
    assert methods.canonical("toy-without-parsing-with-pixels") == "toy-with-pixels-without-parsing"
    assert methods.meanings()["toy"] == "One convolution."
    assert methods.meanings()["toy-with-pixels"] == "it sees one pixel"
    with pytest.raises(ValueError, match="preset must be one of lite, paper, tiny, got 'huge'"):
        methods.find("toy", "huge")
    save_policy(method(config, model), tmp_path / "toy.safetensors", {})
    loaded = load_policy(tmp_path / "toy.safetensors", model)
    assert type(loaded) is method and loaded.name == "toy-with-pixels-without-parsing" and loaded.memory is None


def test_a_policy_is_a_module(toy_method, model):
    policy, other = (toy_method(toy_method.Config(), model, seed=seed) for seed in (0, 1))
    assert [name for name, _ in policy.named_parameters()] == ["pick.weight", "pick.bias", "place.weight", "place.bias"]
    assert [name for name, _ in policy.named_children()] == ["pick", "place"], "the CLIP is no part of it"
    assert not torch.equal(other.pick.weight, policy.pick.weight)
    other.load_state_dict(policy.state_dict())
    assert torch.equal(other.pick.weight, policy.pick.weight)
    assert not policy.eval().pick.training and policy.train().place.training


def test_a_parser_is_handed_to_the_policy(toy_method, demo_set, model, tmp_path):
    def german(sentence):
        _, pick, _, place = sentence.split()
        if place != "Kiste":
            raise ValueError(f"no place in {sentence!r}")
        return Queries(pick, place)

    policy = toy_method(toy_method.Config(), model, parser=german)
    observation = demo_set[1][0].steps[0].observation
    assert policy.decide(observation, "lege Becher in Kiste").queries == Queries("Becher", "Kiste")
    with pytest.raises(ValueError, match="no place in"):
        policy.act(observation, "lege Becher in Topf")
    save_policy(policy, tmp_path / "toy.safetensors", {})
    loaded = load_policy(tmp_path / "toy.safetensors", policy.clip, parser=german)
    assert loaded.read("lege Becher in Kiste") == Queries("Becher", "Kiste")
