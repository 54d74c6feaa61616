"""Ablations: their names, and that each changes its part and no other."""

import dataclasses
import json

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from small import SMALL, disturbed, weights
from tiers import for_a_release

from gem_lite.maps import query_maps, semantic_map, sources
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.policies import checkpoints, methods
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.gem import Gem, PickModule
from gem_lite.policies.gem_config import ABLATIONS, LITE, GemConfig
from gem_lite.policies.inputs import Inputs
from gem_lite.policies.networks import parameter_count
from gem_lite.training import train

D = 16
WEIGHTS_DIFFER = {
    "with-free-kernels", "without-language-in-attention", "without-location-code", "with-modulated-encoder",
    "with-steerable-encoder",
}  # fmt: skip
"""Ablations that change what the networks are made of."""
WORDS_DIFFER = {"without-parsing", "without-location-code"}
"""Ablations that change the words which the networks get."""
INPUTS_DIFFER = WORDS_DIFFER | {
    "without-semantic-map", "with-single-view", "with-matched-single-view", "without-image-map",
    "with-part-crops", "with-dense-map", "with-region-map",
}  # fmt: skip
"""Ablations that change what the networks see."""
ALWAYS = {
    "without-semantic-map", "with-single-view", "without-steerable-kernel", "without-image-map", "without-parsing",
    "without-language-in-attention", "with-continued-border", "with-modulated-encoder",
}  # fmt: skip
"""Ablations that `make test` takes; `make release` takes all."""


@pytest.fixture(scope="module", autouse=True)
def seen_once():
    """What the views are embedded to is the same for most ablations: make it once."""
    seen, honest = {}, sources.MultiView.embed

    def embed(self, views):
        if id(views) not in seen:
            seen[id(views)] = views, honest(self, views)  # the views are kept, so that their id stays theirs
        return seen[id(views)][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources.MultiView, "embed", embed)
        yield


@pytest.fixture(scope="module")
def whole(model, demos):
    policy = Gem(SMALL, model)
    return policy, prepare(policy, demos)


def prepare(policy, demos):
    policy.remember(demos)
    return list(policy.prepare(demos))


def test_names_and_configurations_belong_together():
    assert LITE.variant == ""
    for ending, ablation in ABLATIONS.items():
        method, config = methods.find(f"gem-{ending}")
        assert method is Gem
        assert config.variant == f"-{ending}"
        assert config == dataclasses.replace(LITE, **ablation.changes, ablations=(ending,)) != LITE
        assert GemConfig.from_dict(config.as_dict()) == config
    with pytest.raises(ValueError, match=r"no map source is named 'two-view'; the nearest names: .*multi-view"):
        dataclasses.replace(LITE, semantic_map="two-view")
    with pytest.raises(ValueError, match="steerable, unrotated, free"):
        dataclasses.replace(LITE, kernels="rigid")


def test_several_ablations_have_one_name_in_any_order():
    one, other = "gem-without-image-map-without-parsing", "gem-without-parsing-without-image-map"
    assert methods.find(one) == methods.find(other)
    assert methods.find(other)[1] == LITE.ablated("without-parsing").ablated("without-image-map")
    assert methods.canonical(other) == methods.canonical(one) == one
    assert methods.split("cliport-grounded-without-parsing") == ("cliport-grounded", ("without-parsing",))


@pytest.mark.parametrize(
    "name", ["gem-", "gemini", "gem-without-a-clue", "gem-without-parsing-at-all", "cliport-without-steerable-kernel"]
)
def test_endings_that_mean_nothing_are_refused(name):
    with pytest.raises(ValueError, match=rf"method must be one of gem, .* got '{name}'"):
        methods.find(name)


def test_endings_that_contradict_each_other_are_refused(model):
    for ending, other in (("with-single-view", "without-semantic-map"), ("without-semantic-map", "with-single-view")):
        with pytest.raises(ValueError, match=r"needs semantic_map = .* cannot be combined"):
            methods.find(f"gem-{ending}-{other}")
        with pytest.raises(ValueError, match=r"needs semantic_map = .* cannot be combined"):
            LITE.ablated(ending).ablated(other)
    with pytest.raises(ValueError, match="config of cliport must be a ClipPortConfig, got GemConfig"):
        methods.METHODS.find("cliport")(SMALL.ablated("without-steerable-kernel"), model)
    with pytest.raises(ValueError, match=r"the ablation must be one of .* got 'without-a-clue'"):
        LITE.ablated("without-a-clue")


def test_a_digest_stands_for_every_entry_and_a_missing_one_has_its_default():
    digests = {dataclasses.replace(LITE, **changes).digest for changes in ({}, {"steps": 2}, {"widths": (1, 2, 3, 4)})}
    assert len(digests) == 3 and all(len(digest) == 12 for digest in digests)
    assert GemConfig.from_dict(json.loads(json.dumps(LITE.as_dict()))).digest == LITE.digest
    old = {key: value for key, value in LITE.as_dict().items() if key not in ("kernels", "semantic_map", "parsing")}
    assert GemConfig.from_dict(old) == LITE


@pytest.mark.parametrize("ending", for_a_release(ABLATIONS, lambda ending: ending not in ALWAYS))
def test_an_ablation_changes_its_part_alone_and_trains_acts_and_comes_back(ending, whole, model, demos, tmp_path):
    reference, steps = whole
    policy = Gem(SMALL.ablated(ending), model)
    prepared = prepare(policy, demos)
    assert torch.equal(weights(policy), weights(reference)) == (ending not in WEIGHTS_DIFFER)
    one, other = prepared[0][1], steps[0][1]
    assert torch.equal(one.rgbd, other.rgbd)
    assert (one.pick, one.place, one.pick_yaw, one.delta) == (other.pick, other.place, other.pick_yaw, other.delta)
    same_maps = all(torch.allclose(one.maps[role], other.maps[role], atol=1e-5) for role in ("pick", "place"))
    same_words = torch.equal(one.words["pick"], other.words["pick"])
    assert (same_maps and same_words) == (ending not in INPUTS_DIFFER)
    assert same_words == (ending not in WORDS_DIFFER)

    before = policy.pick.encoder.out.weight.clone()
    batch = train.make_batch(policy, prepared, np.random.default_rng(0))
    train.Learner(policy, train.Accelerator(cpu=True)).step(batch, 1e-3)
    save_policy(policy, tmp_path / "policy.safetensors", {})
    loaded = load_policy(tmp_path / "policy.safetensors", model)
    stored = checkpoints.read_card(tmp_path / "policy.safetensors")["method"]
    assert loaded.name == policy.name == stored == f"gem-{ending}"
    assert torch.equal(weights(loaded), weights(policy))
    assert not torch.equal(loaded.pick.encoder.out.weight, before)
    step = demos[0].steps[0]
    assert loaded.act(step.observation, step.instruction) == policy.act(step.observation, step.instruction)


def test_a_changed_map_is_what_its_name_says(model, demos, whole):
    constant = Gem(SMALL.ablated("without-semantic-map"), model)
    for step in prepare(constant, demos):
        assert all(torch.equal(step[1].maps[role], torch.ones(1, *SMALL.workspace.shape)) for role in ("pick", "place"))
    single = Gem(SMALL.ablated("with-single-view"), model)
    step = demos[0].steps[0]
    scene = single.embed(step.observation.views)
    expected = semantic_map.single_view_map(scene, step.phrases.pick, model)
    assert np.array_equal(single.maps(scene, step.phrases.pick).text, expected)
    text_alone = Gem(SMALL.ablated("without-image-map"), model)
    for step, reference in zip(prepare(text_alone, demos), whole[1], strict=True):
        for role, semantic in step[1].maps.items():
            assert torch.equal(semantic, step[0].maps[role])
            assert torch.allclose(semantic, reference[0].maps[role], atol=1e-5)
    assert constant.memory is None and text_alone.memory is None


def test_without_parsing_both_modules_hear_the_whole_sentence_which_is_one_query(model, demos):
    policy = Gem(SMALL.ablated("without-parsing"), model)
    sentence = demos[0].steps[0].instruction
    phrases = policy.read(sentence)
    assert phrases.pick == phrases.place == sentence
    words = policy.words(phrases)
    assert torch.equal(words["pick"], words["place"])
    with pytest.raises(ValueError, match="empty"):
        policy.read(" ")
    policy.remember(demos)
    assert {entry.phrase for entry in policy.memory.entries} == {sentence}, "it finds the crop of its like"
    scene = policy.embed(demos[0].steps[0].observation.views)
    assert policy.maps(scene, sentence).image is not None
    # "and" and location words of a sentence are left to CLIP.
    both = "put the red and blue blocks in a bowl"
    expected = semantic_map.text_conditioned_map(scene, both, model)
    assert np.array_equal(policy.maps(scene, both).text, expected)


@pytest.mark.parametrize("ending", ["with-single-view", "without-semantic-map", "without-image-map"])
def test_location_words_change_only_what_another_response_owns(ending, model, demos):
    policy = Gem(SMALL.ablated(ending), model)
    scene = policy.embed(demos[0].steps[0].observation.views)
    for phrase in ("left block", "right block", "middle block"):
        word = policy.maps(scene, phrase).fused
        plain = Gem(SMALL.ablated(ending).ablated("without-locations"), model).maps(scene, phrase).fused
        assert (word <= plain).all()
        if ending == "without-semantic-map":
            assert np.array_equal(word, plain)
        else:
            row, col = np.unravel_index(word.argmax(), word.shape)
            assert word.max() > plain.max() - query_maps.WITHIN and word[row, col] == plain[row, col]


def test_a_location_word_acts_on_the_fused_map_and_on_the_text_map(model, demos):
    policy = Gem(SMALL, model)
    scene = policy.embed(demos[0].steps[0].observation.views)
    policy.memory = CropMemory([CropEntry("left block", scene.heightmap.rgb[:20, :20].copy(), "task", 0)], model)
    free = Gem(SMALL.ablated("without-locations"), model, policy.memory).maps(scene, "left block")
    maps = policy.maps(scene, "left block")
    assert free.image is not None and not np.array_equal(free.fused, free.text)
    for name in ("text", "fused"):
        expected = query_maps.located(getattr(free, name), "left", SMALL.workspace)
        assert np.array_equal(getattr(maps, name), expected)
        assert not np.array_equal(expected, getattr(free, name))


def test_the_place_crop_has_the_map_of_the_pick(model):
    policy = Gem(SMALL, model)
    maps = {"pick": torch.rand(1, 1, 32, 32), "place": torch.rand(1, 1, 32, 32)}
    crop = policy.place_crop(Inputs(rgbd=torch.rand(1, 4, 32, 32), maps=maps), torch.tensor([[16, 16]]))
    half = SMALL.crop // 2
    around = np.s_[16 - half : 17 + half]
    assert torch.equal(crop[0, 4], maps["pick"][0, 0, around, around])


def test_an_unrotated_kernel_knows_no_angle():
    module = disturbed(PickModule(SMALL.ablated("without-steerable-kernel"), D))
    features, words = torch.randn(2, 3, 32, 32), torch.randn(2, D)
    kernel = module.kernel(words)
    logits = module.score(features, kernel)
    assert torch.equal(logits, logits[:, :1].expand(-1, SMALL.angles, -1, -1))
    beyond = F.pad(features, (8, 8, 8, 8), mode="replicate")  # the module acts: it is not in training
    expected = torch.cat([F.conv2d(f[None], k[None]) for f, k in zip(beyond, kernel, strict=True)])
    assert torch.allclose(logits[:, :1], expected, atol=1e-4 * float(expected.detach().abs().max()))


def test_free_kernels_are_one_for_each_angle():
    module = disturbed(PickModule(SMALL.ablated("with-free-kernels"), D))
    features, words = torch.randn(1, 3, 32, 32), torch.randn(1, D)
    kernels = module.kernel(words)
    assert kernels.shape == (1, SMALL.angles * 3, 17, 17)
    logits = module.score(features, kernels)
    beyond = F.pad(features, (8, 8, 8, 8), mode="replicate")
    for i in (0, 1, 11):
        expected = F.conv2d(beyond, kernels[:, 3 * i : 3 * i + 3])[:, 0]
        assert torch.allclose(logits[:, i], expected, atol=1e-4 * float(expected.detach().abs().max()))
    turned = module.score(torch.rot90(features, 1, dims=(-2, -1)), kernels)
    rotated = torch.rot90(logits, 1, dims=(-2, -1)).roll(SMALL.angles // 4, dims=1)
    assert not torch.allclose(turned, rotated, atol=0.1 * float(rotated.detach().abs().max()))


def test_without_language_in_attention_the_kernel_still_hears():
    module = disturbed(PickModule(SMALL.ablated("without-language-in-attention"), D))
    rgbd, semantic, (one, two) = torch.randn(1, 4, 32, 16), torch.randn(1, 1, 32, 16), torch.randn(2, 1, D)
    assert torch.equal(module.features(rgbd, semantic, one), module.features(rgbd, semantic, two))
    assert not torch.allclose(module.kernel(one), module.kernel(two))
    full = PickModule(SMALL, D)
    assert parameter_count(module) < parameter_count(full)
