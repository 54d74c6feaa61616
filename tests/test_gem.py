import dataclasses
import math
import types

import numpy as np
import pytest
import torch
from small import SMALL, disturbed

from gem_lite.policies import augment, methods, networks
from gem_lite.policies.augment import apply, random_motion, recolored, relit, rescaled
from gem_lite.policies.gem import PickModule, PlaceModule
from gem_lite.policies.inputs import TABLE_GRAY, Sample, crop_at, cross_entropy, right_bins
from gem_lite.policies.networks import CropKernel, LanguageKernel, UNet
from gem_lite.se2 import ImageMotion

D = 16


def test_shapes_of_both_modules_and_no_layer_normalises_over_the_picture():
    rgbd, semantic, words = torch.randn(2, 4, 32, 16), torch.randn(2, 1, 32, 16), torch.randn(2, D)
    crop = torch.randn(2, 5, SMALL.crop, SMALL.crop)
    for module, more in ((PickModule(SMALL, D), ()), (PlaceModule(SMALL, D), (crop,))):
        assert module(rgbd, semantic, words, *more).shape == (2, 12, 32, 16)
        assert not any("Norm" in type(layer).__name__ for layer in module.modules())


@pytest.mark.parametrize("kernels", ["steerable", "free"])
def test_features_go_on_beyond_the_table_where_a_policy_acts(kernels):
    module = PlaceModule(dataclasses.replace(SMALL, kernels=kernels), D)
    features = torch.ones(1, SMALL.channels, 32, 32)
    kernel = -torch.rand(1, module.kernel_channels, SMALL.kernel, SMALL.kernel)
    scores = {training: module.train(training).score(features, kernel)[0] for training in (True, False)}
    spread = {training: (found - found[:, 16:17, 16:17]).abs().max() for training, found in scores.items()}
    assert spread[False] < 1e-3 * spread[True]
    assert torch.allclose(scores[True][:, 12:20, 12:20], scores[False][:, 12:20, 12:20], rtol=1e-3)


@torch.no_grad()
@pytest.mark.parametrize("encoder", ["plain", "modulated"])
def test_with_a_continued_border_a_bare_table_has_no_edge(encoder):
    config = dataclasses.replace(SMALL, encoder=encoder, continued=True)
    module = disturbed(PickModule(config, D))
    table = torch.tensor([0.0, 0.1, -0.1, 0.0])[None, :, None, None].expand(1, 4, 32, 32)
    semantic, words = torch.full((1, 1, 32, 32), 0.2), torch.randn(1, D)
    spread = {}
    for continued in (True, False):
        module.continue_border(continued)
        features = module.features(table, semantic, words)
        spread[continued] = float((features - features[..., 16:17, 16:17]).abs().max() / features.abs().max())
    assert spread[True] < 1e-5 and spread[False] > 0.05
    kernels = [layer for layer in module.kernel.modules() if isinstance(layer, torch.nn.Conv2d)]
    assert kernels and all(layer.padding_mode == "zeros" for layer in kernels), "a kernel has no table around it"


def test_language_reaches_the_encoder_and_the_kernel():
    one, two = torch.randn(2, 1, D)
    net, kernel = disturbed(UNet(1, 1, D, (4, 4, 4, 4))), disturbed(LanguageKernel(9, 3, D, (4, 8, 8)))
    image = torch.randn(1, 1, 32, 32)
    assert not torch.allclose(net(image, one), net(image, two))
    assert kernel(one).shape == (1, 3, 9, 9) and not torch.allclose(kernel(one), kernel(two))
    with pytest.raises(ValueError, match="multiples of 16"):
        net(torch.zeros(1, 1, 40, 16), one)


def test_a_place_kernel_in_another_precision_leaves_the_others_as_they_are():
    one, other = (disturbed(CropKernel(5, 3, 2)) for _ in range(2))
    crop = torch.randn(1, 5, 17, 17)
    before = one(crop), other(crop)
    assert torch.allclose(one.double()(crop.double()).float(), before[0], atol=1e-4)
    assert torch.equal(other(crop), before[1])
    assert torch.allclose(one.float()(crop), before[0], atol=1e-6)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_pick_is_equivariant_and_place_bi_equivariant(turns):
    # Eq. 5 and 6, the heads alone: turning the object (crop) by g2 turns the best relative angle by -g2 and moves
    # nothing; turning the scene or the goal by g1 turns position and angle by g1.
    crop, features, quarter = torch.randn(1, 5, 17, 17), torch.randn(1, 3, 33, 33), SMALL.angles // 4
    for head, given in ((disturbed(PickModule(SMALL, D)), torch.randn(1, D)), (disturbed(PlaceModule(SMALL, D)), crop)):
        before = head.score(features, head.kernel(given)).detach()
        close = 1e-4 * float(before.abs().max())
        turned = head.score(torch.rot90(features, turns, dims=(-2, -1)), head.kernel(given))
        expected = torch.rot90(before, turns, dims=(-2, -1)).roll(quarter * turns, dims=1)
        assert torch.allclose(turned, expected, atol=close)
    object_turned = head.score(features, head.kernel(torch.rot90(crop, turns, dims=(-2, -1))))
    assert torch.allclose(object_turned, before.roll(-quarter * turns, dims=1), atol=close)


def test_refiner_starts_as_the_raw_map():
    refiner = networks.SemanticRefiner(3)
    raw, height = torch.rand(1, 1, 8, 8), torch.zeros(1, 1, 8, 8)
    assert (refiner(raw, height) - raw).abs().max() < 0.3
    assert torch.corrcoef(torch.stack([refiner(raw, height)[0, 0].flatten(), raw.flatten()]))[0, 1] > 0.99


def test_crop_is_unrotated_and_padded():
    image = torch.arange(24.0).view(1, 1, 4, 6)
    assert torch.equal(crop_at(image, torch.tensor([[1, 2]]), 3)[0, 0], image[0, 0, 0:3, 1:4])
    corner = crop_at(image, torch.tensor([[0, 0]]), 3)[0, 0]
    assert corner[0].sum() == corner[:, 0].sum() == 0
    assert corner[1, 1] == image[0, 0, 0, 0]


def test_right_bins_spread_over_the_symmetry():
    assert right_bins(0.0, 2 * math.pi, 36) == [0]
    assert right_bins(math.radians(44), math.pi / 2, 36) == [4, 13, 22, 31]
    assert right_bins(-math.radians(10), 2 * math.pi, 36) == [35]
    assert right_bins(1.0, 0.0, 4) == [0, 1, 2, 3]


def test_cross_entropy_is_smallest_on_the_right_cells():
    logits = torch.zeros(1, 4, 3, 3)
    uniform = cross_entropy(logits, [([1, 3], 2, 0)])
    assert uniform.item() == pytest.approx(math.log(36))
    logits[0, [1, 3], 2, 0] = 50.0
    assert cross_entropy(logits, [([1, 3], 2, 0)]).item() == pytest.approx(math.log(2), abs=1e-4)
    assert cross_entropy(logits, [([0], 2, 0)]).item() > 40


def named(image: torch.Tensor) -> dict:
    """RGB-D and the maps of pick and place, from their six channels."""
    return {"rgbd": image[:4], "maps": {"pick": image[4:5], "place": image[5:6]}}


def channels(sample: Sample) -> torch.Tensor:
    return torch.cat([sample.rgbd, *sample.maps.values()])


def sample_with_spot(row: int, col: int) -> Sample:
    image = torch.zeros(6, 64, 48)
    image[:, row - 1 : row + 2, col - 1 : col + 2] = 1.0
    return Sample(
        **named(image), pick=(row, col), place=(40.0, 30.0), pick_yaw=0.3, delta=0.7, pick_symmetry=math.pi / 2,
        place_symmetry=0.0,
    )  # fmt: skip


def test_augmentation_moves_image_and_labels_together():
    sample = sample_with_spot(20, 14)
    motion = ImageMotion(math.radians(30), (3.0, -2.0))
    moved = apply(motion, sample)
    rows, cols = torch.meshgrid(torch.arange(64.0), torch.arange(48.0), indexing="ij")
    for channel in channels(moved):
        mass = channel.sum()
        assert float((rows * channel).sum() / mass) == pytest.approx(moved.pick[0], abs=0.1)
        assert float((cols * channel).sum() / mass) == pytest.approx(moved.pick[1], abs=0.1)
    assert moved.pick_yaw == pytest.approx(0.3 + math.radians(30))
    assert moved.delta == sample.delta


def test_random_motion_keeps_pixels_inside():
    rng, shape, keep = np.random.default_rng(0), (64, 48), [(2.0, 2.0), (60.0, 45.0)]
    angles = []
    for _ in range(50):
        motion = random_motion(rng, shape, keep)
        for pixel in keep:
            row, col = motion.move(pixel, shape)
            assert -0.5 <= row <= 63.5
            assert -0.5 <= col <= 47.5
        angles.append(motion.angle)
    assert len(set(angles)) > 10
    shifts = [random_motion(rng, (160, 80), [(80.0, 40.0)], turn=False) for _ in range(20)]
    assert {motion.angle for motion in shifts} == {0.0} and len({motion.shift for motion in shifts}) == 20


def test_recolouring_exchanges_and_scales_colours_and_nothing_else():
    image = torch.rand(6, 8, 8, generator=torch.Generator().manual_seed(0))
    sample, orders = dataclasses.replace(sample_with_spot(2, 2), **named(image)), set()
    for seed in range(40):
        drawn = recolored(np.random.default_rng(seed), sample)
        assert dataclasses.replace(drawn, rgbd=sample.rgbd) == sample and torch.equal(channels(drawn)[3:], image[3:])
        ratios = drawn.rgbd[:3, None] / image[None, :3]  # (new, old, H, W): one constant for each new channel
        constant = ratios.flatten(2).std(dim=2) < 1e-4
        assert constant.sum() == 3 and torch.all(constant.sum(dim=0) == 1)
        gains = ratios[..., 0, 0][constant]
        assert torch.all((gains >= 0.5) & (gains <= 1.5))
        orders.add(tuple(constant.int().argmax(dim=1).tolist()))
    assert len(orders) == 6


def test_recolouring_is_for_methods_that_see_colours_through_clip():
    def recolors(name, **values):
        method, config = methods.find(name)
        sizes = types.SimpleNamespace(dim=D, width=D, inner_widths=(8, 8))
        return method(dataclasses.replace(config, **values), sizes).recolors

    assert [recolors(name) for name in ("gem", "cliport", "transporter-lan")] == [True, True, False]
    assert not recolors("gem-without-semantic-map")
    assert not any(recolors(name, recolor=False) for name in ("gem", "cliport", "cliport-grounded"))


def test_relighting_multiplies_the_raw_colours_by_one_smooth_light_and_changes_nothing_else():
    image = torch.rand(6, 16, 8, generator=torch.Generator().manual_seed(0))
    sample = dataclasses.replace(sample_with_spot(2, 2), **named(image))
    wholes = []
    at_corners = []
    rows, cols = torch.meshgrid(torch.arange(16.0), torch.arange(8.0), indexing="ij")
    terms = torch.stack([torch.ones(16, 8), rows, cols, rows**2, cols**2], dim=-1).flatten(0, 1)
    for seed in range(40):
        drawn = relit(np.random.default_rng(seed), sample, 0.3)
        assert dataclasses.replace(drawn, rgbd=sample.rgbd) == sample and torch.equal(channels(drawn)[3:], image[3:])
        light = (drawn.rgbd[:3] + TABLE_GRAY) / (image[:3] + TABLE_GRAY)
        assert torch.allclose(light, light[:1].expand(3, -1, -1), atol=1e-5)  # all colours alike
        fitted = terms @ torch.linalg.lstsq(terms, light[0].flatten()[:, None]).solution
        assert torch.allclose(fitted[:, 0], light[0].flatten(), atol=1e-4)  # a plane and a bowl
        assert float(light.min()) > 1 - 3 * 0.3
        wholes.append(float(light[0, 7:9, 3:5].mean()))
        at_corners.append(float(light[0, 0, 0] + light[0, -1, -1]) / 2 - wholes[-1])
    assert 0.69 < min(wholes) < 0.8 and 1.2 < max(wholes) < 1.31  # in the middle, the first of the three alone
    assert -0.31 < min(at_corners) < -0.2 and 0.2 < max(at_corners) < 0.31  # towards both corners, the third alone
    assert torch.allclose(channels(relit(np.random.default_rng(0), sample, 0.0)), image)


@pytest.mark.parametrize("most", [0.0, 0.2])
def test_training_draws_another_light_only_where_the_configuration_says_so(monkeypatch, most):
    lights = []
    relit_unwatched = augment.relit

    def watched(rng, sample, light):
        lights.append(light)
        return relit_unwatched(rng, sample, light)

    monkeypatch.setattr(augment, "relit", watched)
    method, config = methods.find("gem")
    sizes = types.SimpleNamespace(dim=D, width=D, inner_widths=(8, 8))
    policy = method(dataclasses.replace(config, uneven_light=most), sizes)
    policy.augmented(sample_with_spot(2, 2), np.random.default_rng(0))
    assert lights == ([most] if most else [])


def test_light_leaves_black_pixels_black_before_their_colours_change(monkeypatch):
    monkeypatch.setattr(augment, "moved", lambda rng, sample, turn: sample)
    method, config = methods.find("gem")
    sizes = types.SimpleNamespace(dim=D, width=D, inner_widths=(8, 8))
    policy = method(dataclasses.replace(config, uneven_light=0.3), sizes)
    bare = sample_with_spot(2, 2)
    black = dataclasses.replace(bare, rgbd=torch.full_like(bare.rgbd, -TABLE_GRAY))
    for seed in range(5):
        drawn = policy.augmented(black, np.random.default_rng(seed)).rgbd[:3]
        assert torch.allclose(drawn, drawn[:, :1, :1].expand_as(drawn)), "only the factor of a channel is left"
        assert (drawn[:, 0, 0] < -0.49 * TABLE_GRAY).all()


def test_rescaling_changes_maps_alone_and_keeps_their_order():
    rng = np.random.default_rng(0)
    image = torch.rand(6, 8, 8)
    sample = dataclasses.replace(sample_with_spot(2, 2), **named(image))
    gains = []
    for _ in range(50):
        changed = channels(rescaled(rng, sample, (0.5, 1.2), 0.1))
        assert torch.equal(changed[:4], image[:4])
        for before, after in zip(image[4:], changed[4:], strict=True):
            assert torch.equal(before.flatten().argsort(), after.flatten().argsort())
            gain = float((after.max() - after.min()) / (before.max() - before.min()))
            offset = float(after.min() - gain * before.min())
            assert abs(offset) <= 0.1 + 1e-5
            gains.append(gain)
    assert 0.5 - 1e-5 <= min(gains) < 0.6 and 1.1 < max(gains) <= 1.2 + 1e-5
    assert torch.allclose(channels(rescaled(rng, sample, (1.0, 1.0), 0.0)), image)
    no_maps = dataclasses.replace(sample, maps={})
    assert torch.equal(channels(rescaled(rng, no_maps, (0.5, 1.2), 0.1)), image[:4])
