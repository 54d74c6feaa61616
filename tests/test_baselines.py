"""The rivals beside GEM: shapes, symmetries, what reaches which module, training and checkpoints."""

import dataclasses
import types

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from small import disturbed, small

from gem_lite.language import LOCATION_CODE_LENGTH
from gem_lite.policies import checkpoints, methods
from gem_lite.policies.augment import apply
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.inputs import Inputs, numbered_steps
from gem_lite.policies.networks import parameter_count
from gem_lite.policies.transporter import turned_crops
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import ImageMotion, angle_bins
from gem_lite.training import train

D, WIDTH, INNER = 16, 24, (12, 6)
L = D + LOCATION_CODE_LENGTH
"""The length of what the networks get of a phrase."""
COARSE = {"cliport": (WIDTH, *INNER), "cliport-grounded": (D, *INNER)}
"""Channels of what CLIP says of a picture's places, where a method asks it: the last features, then inner ones."""
SMALL = {name: small(name) for name in methods.METHODS.names()}
WORKSPACE = SMALL["gem"].workspace
BASELINES = [name for name in methods.METHODS.names() if name != "gem"]


@pytest.fixture(scope="module")
def trained_on(model, demo_set):
    """``trained_on(name)``: a fresh policy of small sizes and its prepared steps; scenes are prepared once."""
    found = {}

    def make(name):
        if name not in found:
            policy = methods.METHODS.find(name)(SMALL[name], model)
            policy.remember(demo_set[1])
            found[name] = list(policy.prepare(demo_set[1])), policy.memory
        prepared, memory = found[name]
        return methods.METHODS.find(name)(SMALL[name], model, memory, seed=1), prepared

    return make


def without_clip(name):
    clip_sizes = types.SimpleNamespace(dim=D, width=WIDTH, inner_widths=INNER)
    return disturbed(methods.METHODS.find(name)(SMALL[name], clip_sizes))


def random_inputs(name, height, width, batch=1):
    channels = COARSE.get(name, ())
    features = [torch.rand(batch, c, height * 2**i // 8, width * 2**i // 8) for i, c in enumerate(channels)]
    roles = ("pick", "place")
    return Inputs(
        rgbd=torch.rand(batch, 4, height, width),
        maps={role: torch.rand(batch, 1, height, width) for role in roles} if name == "gem" else {},
        features={f"level {i}": feature for i, feature in enumerate(features)},
        words={role: F.normalize(torch.randn(batch, L), dim=1) for role in roles},
    )


def changed(inputs, fine=lambda image: image, coarse=lambda feature, cell: feature):
    """The same inputs after a change of their pictures and maps, and one of their features, given their cells' side."""
    height = inputs.rgbd.shape[-2]
    return dataclasses.replace(
        inputs,
        rgbd=fine(inputs.rgbd),
        maps={name: fine(semantic) for name, semantic in inputs.maps.items()},
        features={name: coarse(feature, height // feature.shape[-2]) for name, feature in inputs.features.items()},
    )


def alone(box):
    """Keeps a box of a picture, and nothing around it."""

    def keep(image):
        kept = torch.zeros_like(image)
        kept[box] = image[box]
        return kept

    return keep


@pytest.mark.parametrize("name", methods.METHODS.names())
def test_logits_have_one_shape_and_the_action_is_on_the_table(name, trained_on, demo_set):
    policy, _ = trained_on(name)
    step = demo_set[1][0].steps[0]
    choice = policy.decide(step.observation, step.instruction)
    assert choice.pick_logits.shape == choice.place_logits.shape == (12, *WORKSPACE.shape)
    assert choice.action == policy.act(step.observation, step.instruction)
    for pose in (choice.action.pick, choice.action.place):
        assert WORKSPACE.contains(pose.x, pose.y)
    assert choice.action.delta == pytest.approx((angle_bins(12)[choice.place_cell[0]] + np.pi) % (2 * np.pi) - np.pi)
    with pytest.raises(ValueError, match="no place"):
        policy.act(step.observation, "pick the red block")


@pytest.mark.parametrize("name", methods.METHODS.names())
def test_all_move_with_the_table_by_16_pixels(name):
    # Away from the borders: the content sits in the middle of a wide empty picture.
    policy, full = without_clip(name), random_inputs(name, 320, 32)
    still = changed(
        full,
        alone(np.s_[..., 150:160, 10:20]),
        lambda feature, cell: alone(np.s_[..., 144 // cell : 160 // cell, 8 // cell : 24 // cell])(feature),
    )
    moved = changed(still, lambda image: image.roll(16, dims=2), lambda feature, cell: feature.roll(16 // cell, dims=2))
    inside = slice(140, 180)
    with torch.no_grad():
        picks = policy.score_pick(still), policy.score_pick(moved)
        places = (policy.score_place(one, torch.tensor([[row, 14]])) for one, row in ((still, 155), (moved, 171)))
        for plain, shifted in (picks, places):
            error = (shifted.roll(-16, dims=2) - plain)[..., inside, :].abs().max()
            assert error < 2e-5 * plain[..., inside, :].abs().max()
            assert plain[..., inside, :].std() > 1e-4


@pytest.mark.parametrize("name", BASELINES)
@pytest.mark.parametrize("turns", [1, 2, 3])
def test_place_queries_turn_with_the_object(name, turns):
    # K_i(T_g crop) = K_{i+g}(crop): half of Eq. 6, exact at quarter turns for any weights.
    whole = without_clip(name).place
    place = getattr(whole, "network", whole)
    widths = []
    if name in COARSE:
        widths = [whole.semantics.outputs(SMALL[name]), *(part.out_channels for part in whole.inner)]
    pictures = [torch.rand(1, 4, 33, 33)]
    pictures += [torch.rand(1, width, cells, cells) for width, cells in zip(widths, (3, 11, 33), strict=False)]
    words, centre = torch.randn(1, L), torch.tensor([[16, 16]])

    def kernels(image, *levels):
        return place.kernels(image, words, centre, *levels)

    with torch.no_grad():
        before = kernels(*pictures)
        turned = kernels(*(torch.rot90(picture, turns, dims=(-2, -1)) for picture in pictures))
    expected = before.roll(-turns * SMALL[name].angles // 4, dims=1)
    assert torch.allclose(turned, expected, atol=1e-4 * float(before.abs().max()))
    assert not torch.allclose(turned, before, atol=1e-2 * float(before.abs().max()))


@pytest.mark.parametrize("name", BASELINES)
def test_their_pick_does_not_turn_with_the_table(name):
    policy, inputs = without_clip(name), random_inputs(name, 32, 32)
    turned = changed(inputs, *[lambda image, cell=None: torch.rot90(image, 1, dims=(-2, -1))] * 2)
    with torch.no_grad():
        expected = torch.rot90(policy.score_pick(inputs), 1, dims=(-2, -1)).roll(SMALL[name].angles // 4, dims=1)
        assert (policy.score_pick(turned) - expected).abs().max() > 0.1 * expected.abs().max()


def test_turned_crops_keep_the_pick_at_their_centre():
    image = torch.zeros(1, 1, 40, 40)
    image[0, 0, 10, 30] = 1.0
    image[0, 0, 10, 34] = 0.5  # four pixels to the right of the pick
    crops = turned_crops(image, torch.tensor([[10, 30]]), torch.tensor(angle_bins(4)).float(), 15, (40, 40))[0, :, 0]
    assert torch.allclose(crops[:, 7, 7], torch.ones(4), atol=1e-5)
    # Counter-clockwise: right, up, left, down.
    for crop, (row, col) in zip(crops, [(7, 11), (3, 7), (7, 3), (11, 7)], strict=True):
        assert crop[row, col] == pytest.approx(0.5, abs=1e-5)


def test_turned_crops_of_fewer_cells_are_those_of_the_enlarged_features():
    # Away from the border, a feature that grows evenly is interpolated exactly, whatever the size of its cells.
    rows, cols = torch.meshgrid(torch.arange(64.0), torch.arange(32.0), indexing="ij")
    fine = (2 * rows - 3 * cols)[None, None]
    coarse = F.avg_pool2d(fine, 4)
    angles, picks = torch.tensor([0.0, 0.7, 2.0]), torch.tensor([[30, 15]])
    expected, found = (turned_crops(image, picks, angles, 11, (64, 32)) for image in (fine, coarse))
    assert found.shape == (1, 3, 1, 11, 11)
    assert torch.allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize("name", methods.METHODS.names())
def test_each_phrase_reaches_its_own_module(name):
    policy, inputs, picks = without_clip(name), random_inputs(name, 32, 32), torch.tensor([[12, 20]])
    other = F.normalize(torch.randn(1, L), dim=1)
    with torch.no_grad():
        pick, place = policy.score_pick(inputs), policy.score_place(inputs, picks)
        for role in ("pick", "place"):
            said = dataclasses.replace(inputs, words=inputs.words | {role: other})
            assert torch.allclose(policy.score_pick(said), pick) == (role != "pick")
            assert torch.allclose(policy.score_place(said, picks), place) == (role != "place")


def test_grounding_multiplies_clips_features_with_the_words():
    # A place whose features have nothing in common with the words tells the networks nothing.
    policy, inputs = without_clip("cliport-grounded"), random_inputs("cliport-grounded", 32, 32)
    words = torch.zeros(1, L)
    words[:, :8] = 1.0

    def scores(part, more):
        feature = inputs.features["level 0"].clone()
        feature[:, part] += more
        features = inputs.features | {"level 0": feature}
        return policy.score_pick(dataclasses.replace(inputs, features=features, words={"pick": words}))

    with torch.no_grad():
        plain = scores(slice(8, None), 0.0)
        assert torch.equal(scores(slice(8, None), 1.0), plain)
        assert not torch.allclose(scores(slice(0, 8), 1.0), plain)


@pytest.mark.parametrize(("name", "same"), [("cliport", True), ("cliport-grounded", False)])
def test_only_the_grounded_one_is_told_how_words_and_features_match(name, same):
    # With the axes of the words renamed, and its weights with them, CLIPort says what it said.
    policy, inputs = without_clip(name), random_inputs(name, 32, 32)
    renamed = dataclasses.replace(inputs, words={"pick": inputs.words["pick"].flip(1)})
    with torch.no_grad():
        before = policy.score_pick(inputs)
        assert not torch.allclose(policy.score_pick(renamed), before, rtol=1e-3)
        for layer in policy.pick.modules():
            if isinstance(layer, torch.nn.Linear):
                layer.weight.copy_(layer.weight.flip(1))
        assert torch.allclose(policy.score_pick(renamed), before, rtol=1e-3) == same


def test_clips_dense_features_find_the_named_block(trained_on, demo_set, model):
    steps = list(numbered_steps(demo_set[1]))
    for (_, step), prepared in zip(steps, trained_on("cliport-grounded")[1], strict=True):
        last = prepared[0].features["level 0"].float()
        score = torch.einsum("dhw,d->hw", last, prepared[0].words["pick"][: model.dim])
        row, col = (int(round(pixel) // 8) for pixel in prepared[0].pick)
        assert score.shape == (20, 10)
        assert score[row, col] > score.median() + 0.2, step.instruction


@pytest.mark.release
def test_features_lie_where_the_picture_does(model):
    # A small spot changes the features around it; the middle of the change is the spot, to a pixel of the picture.
    def features(image):
        return [model.dense_features(image, 20), *model.inner_features(image, 20)]

    rng = np.random.default_rng(0)
    offsets = []
    for _ in range(40):
        picture = np.kron(rng.integers(0, 255, (20, 10, 3)), np.ones((8, 8, 1))).astype(np.uint8)
        spotted = picture.copy()
        spot = rng.integers((40, 30), (110, 50))
        spotted[spot[0] : spot[0] + 4, spot[1] : spot[1] + 4] = rng.integers(0, 255, 3)
        for level, (plain, other) in enumerate(zip(features(picture), features(spotted), strict=True)):
            assert plain.shape[1:] == (20 * 2**level, 10 * 2**level)
            change = (other - plain).square().sum(dim=0).numpy()
            middle = np.array([(axis * change).sum() for axis in np.indices(change.shape)]) / change.sum()
            offsets.append((middle + 0.5) * 8 / 2**level - (spot + 2))
    assert np.abs(np.reshape(offsets, (40, 3, 2)).mean(axis=0)).max() < 1


def test_features_are_equally_strong_everywhere(model):
    picture = np.random.default_rng(0).integers(0, 255, (160, 80, 3), dtype=np.uint8)
    features = [model.dense_features(picture, 20), *model.inner_features(picture, 20, 3)]
    assert [len(feature) for feature in features] == [model.width, *model.inner_widths]
    for feature in features:
        assert torch.allclose(feature.square().mean(dim=0), torch.ones(feature.shape[1:]), atol=1e-4)
    assert torch.allclose(model.embed_dense(picture, 20).norm(dim=0), torch.ones(20, 10), atol=1e-5)


def test_inner_features_reach_cliport(model):
    # The skip connections: without them, or with one that is ignored, a changed inner feature would change nothing.
    policy, inputs = without_clip("cliport"), random_inputs("cliport", 32, 32)
    with torch.no_grad():
        plain = policy.score_pick(inputs)
        for name, feature in inputs.features.items():
            other = dataclasses.replace(inputs, features=inputs.features | {name: feature.flip(1)})
            assert not torch.allclose(policy.score_pick(other), plain, rtol=1e-3)


def test_augmentation_moves_coarse_features_along(trained_on):
    sample = trained_on("cliport")[1][0][0]
    coarse = torch.zeros(1, 20, 10)
    coarse[0, 8:10, 3:5] = 1.0
    fine = F.interpolate(coarse[None], scale_factor=8, mode="nearest")[0]
    moved = apply(ImageMotion(0.5, (12.0, 8.0)), dataclasses.replace(sample, rgbd=fine, features={"clip": coarse}))

    def centre(picture, cell):
        rows, cols = torch.meshgrid(*(torch.arange(float(n)) for n in picture.shape), indexing="ij")
        return [float((axis * picture).sum() / picture.sum()) * cell + (cell - 1) / 2 for axis in (rows, cols)]

    assert centre(moved.features["clip"][0], 8) == pytest.approx(centre(moved.rgbd[0], 1), abs=0.6)
    assert moved.rgbd[0].argmax() != fine[0].argmax()


@pytest.mark.parametrize("name", methods.METHODS.names())
def test_a_gradient_step_lowers_both_losses_also_in_mixed_precision(name, trained_on):
    policy, prepared = trained_on(name)
    batch = train.make_batch(policy, prepared, np.random.default_rng(0))
    before = policy.losses(batch)
    assert set(before) == set(policy.roles)
    with torch.autocast("cpu", torch.bfloat16):  # What a GPU does: networks in bfloat16, the rest in float32.
        mixed = policy.losses(batch)
    for role, module in policy.roles.items():
        assert mixed[role].dtype == torch.float32
        assert mixed[role].item() == pytest.approx(before[role].item(), rel=0.02)
        mixed[role].backward()
        assert all(torch.isfinite(parameter.grad).all() for parameter in module.parameters())
        optimizer = torch.optim.Adam(module.parameters(), lr=1e-3)
        optimizer.zero_grad()
        before[role].backward()
        assert [key for key, parameter in module.named_parameters() if parameter.grad is None] == []
        optimizer.step()
    after = policy.losses(batch)
    for role, loss in before.items():
        assert after[role] < loss


def test_sizes_are_those_of_table_a1():
    def count(name, preset, dim, width, inner):
        method, config = methods.find(name, preset)
        return parameter_count(method(config, types.SimpleNamespace(dim=dim, width=width, inner_widths=inner)))

    lite = {name: count(name, "lite", 128, 256, (128, 64)) for name in methods.METHODS.names()}
    # The paper's CLIPort is by far the largest, too.
    assert 1.5 * lite["gem"] < lite["cliport"] < 1.5e6
    assert max(lite[name] for name in methods.METHODS.names() if name != "cliport") < 1.2 * min(lite.values())
    assert count("gem", "paper", 512, 768, (768, 768)) == pytest.approx(5.7e6, rel=0.02)
    assert count("transporter-lan", "paper", 512, 768, (768, 768)) == pytest.approx(6.6e6, rel=0.2)


@pytest.mark.parametrize("name", BASELINES)
def test_the_same_loop_trains_and_checkpoints_bring_back_the_method(name, trained_on, model, tmp_path, demo_set):
    policy, prepared = trained_on(name)
    policy.config = dataclasses.replace(SMALL[name], steps=1, batch=1)
    before = [parameter.clone() for parameter in policy.parameters()]
    train.train(policy, prepared, seed=0, run=tmp_path / "run")
    assert torch.load(tmp_path / "run" / "state.pt")["identity"]["method"] == name
    assert not all(torch.equal(*pair) for pair in zip(before, policy.parameters(), strict=True))
    save_policy(policy, tmp_path / "policy.safetensors", {"task": "t", "demos": 2, "seed": 1})
    loaded = load_policy(tmp_path / "policy.safetensors", model)
    assert type(loaded) is type(policy)
    assert loaded.name == name
    assert checkpoints.read_card(tmp_path / "policy.safetensors")["method"] == name
    step = demo_set[1][0].steps[0]
    before, after = (one.decide(step.observation, step.instruction) for one in (policy, loaded))
    assert np.allclose(before.place_logits, after.place_logits, atol=1e-4)


def test_a_missing_view_is_named(model, demo_set):
    good, bad = demo_set[1]
    step = bad.steps[0]
    one_eyed = dataclasses.replace(step, observation=Observation(step.observation.views[:2]))
    bad = dataclasses.replace(bad, steps=(one_eyed, *bad.steps[1:]))
    policy = methods.METHODS.find("gem")(SMALL["gem"], model)
    policy.remember([good, bad])
    message = rf"1 of {bad.task} \(seed {bad.seed}\) .* views of front, left, but .* front, left, right"
    with pytest.raises(ValueError, match=message):
        list(policy.prepare([good, bad]))
