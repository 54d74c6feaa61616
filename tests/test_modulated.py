"""The encoders whose words act at every level of the decoder; one commutes with rotations."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from gem_lite.policies.gem import PickModule
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.modulated import ModulatedUNet, RegularConvolution

WIDTHS = (8, 8, 16, 16)
TURNED = (2, 3)


def encoder(rotations, language_dim=6):
    torch.manual_seed(0)
    return ModulatedUNet(4, 3, language_dim, WIDTHS, rotations).eval()


def off_by(left, right):
    """The difference, beside how much ``right`` varies over the picture."""
    return float((left - right).norm() / (right - right.mean(dim=(-2, -1), keepdim=True)).norm())


@pytest.fixture
def picture():
    return torch.rand(2, 4, 48, 48)


@torch.no_grad()
def test_features_of_a_turned_picture_are_turned_features(picture):
    words = torch.randn(2, 6)
    for rotations, low, high in ((8, 0, 1e-5), (4, 0, 1e-5), (1, 0.1, 10)):
        network = encoder(rotations)
        error = off_by(network(picture.rot90(1, TURNED), words), network(picture, words).rot90(1, TURNED))
        assert low <= error < high, f"{rotations} rotations"


@torch.no_grad()
def test_of_gem_the_features_with_their_gate_turn_too(picture):
    words, semantic = torch.randn(2, 6), torch.rand(2, 1, 48, 48)
    for name, low, high in (("steerable", 0, 1e-5), ("modulated", 1e-3, 10), ("plain", 1e-3, 10)):
        torch.manual_seed(0)
        module = PickModule(replace(LITE, widths=WIDTHS, encoder=name), 6).eval()
        turned = module.features(picture.rot90(1, TURNED), semantic.rot90(1, TURNED), words)
        error = off_by(turned, module.features(picture, semantic, words).rot90(1, TURNED))
        assert low <= error < high, name


@torch.no_grad()
def test_between_quarter_turns_a_layer_is_nearly_right():
    rows, cols = np.indices((49, 49)) - 24

    def seen(angle):
        """Two soft spots (1, 1, 49, 49), turned about the middle."""
        along, across = np.cos(angle) * cols - np.sin(angle) * rows, -np.sin(angle) * cols - np.cos(angle) * rows
        spots = np.exp(-((along - 6) ** 2 + across**2) / 20) + 0.6 * np.exp(
            -((along + 2) ** 2 + (across - 7) ** 2) / 12
        )
        return torch.tensor(spots, dtype=torch.float32)[None, None]

    torch.manual_seed(0)
    layer = RegularConvolution(1, 2, 8, plain=True).eval()
    plain, turned = (layer(seen(angle))[0].unflatten(0, (2, 8))[..., 24, 24] for angle in (0, np.pi / 4))
    errors = [float((turned - expected).norm() / plain.norm()) for expected in (plain.roll(1, dims=1), plain)]
    assert errors[0] < 0.1 < 0.3 < errors[1]


@torch.no_grad()
def test_words_change_the_features_and_an_encoder_without_words_has_none(picture):
    network = encoder(8)
    first, second = torch.eye(6)[:2].repeat_interleave(2, dim=0).split(2)
    assert off_by(network(picture, first), network(picture, second)) > 0.05
    assert encoder(8, None)(picture).shape == (2, 3, 48, 48)


@torch.no_grad()
def test_a_copy_has_weights_of_its_own(picture):
    network, words = encoder(8), torch.randn(2, 6)
    other = copy.deepcopy(network)
    assert torch.equal(other(picture, words), network(picture, words))
    other.train()
    for weight in other.parameters():
        weight.zero_()
    assert not torch.equal(other(picture, words), network(picture, words))


def test_widths_and_pictures_that_do_not_fit_are_named():
    with pytest.raises(
        ValueError, match=r"^widths must be multiples of 8, one for each rotation, got \(8, 12, 16, 16\)"
    ):
        ModulatedUNet(4, 3, 6, (8, 12, 16, 16), 8)
    with pytest.raises(ValueError, match=r"^height and width must be multiples of 16, got \(48, 40\)"):
        encoder(1)(torch.rand(1, 4, 48, 40), torch.randn(1, 6))
