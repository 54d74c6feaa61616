import dataclasses
import json
import weakref
from collections.abc import Sequence

import numpy as np
import pytest
import torch

from gem_lite import clip, demonstrations
from gem_lite.cli import main
from gem_lite.maps.query_maps import QueryMaps, joined
from gem_lite.policies import augment, choosing
from gem_lite.policies import base as policy_module
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.inputs import numbered_steps
from gem_lite.se2 import angle_off
from gem_lite.training import train

SMALL = dataclasses.replace(
    LITE, widths=(4, 4, 8, 8), kernel_widths=(4, 8, 8), fields=2, rotations=36, frequency=4, angles=12, steps=4, batch=1
)


def prepare(demos, model, settings):
    policy = Gem(settings, model)
    policy.remember(demos)
    return list(policy.prepare(demos)), policy.memory


def same_maps(one, other):
    return all(torch.equal(semantic, other.maps[role]) for role, semantic in one.maps.items())


@pytest.fixture(scope="module")
def model():
    return clip.load()


@pytest.fixture(scope="module")
def demonstrations_small(demo_set):
    return demo_set[1]


@pytest.fixture(scope="module")
def prepared(model, demonstrations_small):
    return prepare(demonstrations_small, model, SMALL)


def weights(policy: Gem) -> torch.Tensor:
    return torch.cat([parameter.detach().flatten() for parameter in policy.parameters()])


def test_labels_lie_on_the_expert(prepared, demonstrations_small):
    steps, _ = prepared
    expert = demonstrations_small[0].steps[0].expert.action
    sample = steps[0][1]
    w = SMALL.workspace
    assert w.to_world(*sample.pick) == pytest.approx((expert.pick.x, expert.pick.y))
    assert sample.pick_yaw == expert.pick.yaw
    assert sample.delta == pytest.approx(expert.delta)
    # The block is really there, in the height channel of the picture.
    assert sample.rgbd[3, round(sample.pick[0]), round(sample.pick[1])] * 0.05 == pytest.approx(0.04, abs=0.004)


def test_the_memory_holds_what_every_step_picked(prepared, demonstrations_small):
    steps, memory = prepared
    assert [entry.key for entry in memory.entries[::2]] == [
        (d.task, i) for i, d in enumerate(demonstrations_small) for _ in d.steps
    ]
    for step, entry in zip(steps, memory.entries[::2], strict=True):
        row, col = (round(coordinate) for coordinate in step[1].pick)
        centre = (step[1].rgbd[:3, row, col].numpy() + 0.2) * 255
        assert np.allclose(entry.image[10, 10], centre, atol=0.1)


def test_training_retrieval_never_finds_its_own_episode(model, demonstrations_small):
    # One episode alone: everything in the memory is its own, so every image map must be missing.
    steps, memory = prepare(demonstrations_small[:1], model, SMALL)
    assert {entry.episode for entry in memory.entries} == {0}
    for step in steps:
        assert same_maps(step[1], step[0])


def test_image_map_is_used_when_another_episode_has_the_phrase(model, demonstrations_small):
    # The same episode twice, as episodes 0 and 1: each may now find the other.
    steps, _ = prepare([demonstrations_small[0], demonstrations_small[0]], model, SMALL)
    assert not torch.equal(steps[0][1].maps["pick"], steps[0][0].maps["pick"])


def test_batches_hide_the_image_map_now_and_then(prepared, model):
    steps, memory = prepared
    black = dataclasses.replace(steps[0][0], rgbd=torch.zeros_like(steps[0][0].rgbd))
    marked = [(black, step[1]) for step in steps]
    policy = Gem(SMALL, model, memory)
    hidden = [
        float(train.make_batch(policy, marked, np.random.default_rng(i))[0].rgbd.abs().sum()) == 0 for i in range(60)
    ]
    assert 5 < sum(hidden) < 40  # drop_image_map is 0.3


def test_training_recolours_if_the_method_does(prepared, model, tmp_path, monkeypatch):
    recolored, honest = [], augment.recolored
    monkeypatch.setattr(augment, "recolored", lambda *args: recolored.append(1) or honest(*args))
    for settings in (SMALL, SMALL.ablated("without-recoloring")):
        train.train(Gem(settings, model, prepared[1]), prepared[0], seed=0, run=tmp_path / settings.variant)
    assert len(recolored) == SMALL.steps * SMALL.batch


def test_a_killed_run_resumes_to_the_same_weights(prepared, model, tmp_path, monkeypatch):
    steps, memory = prepared
    whole = Gem(SMALL, model, memory, seed=3)
    train.train(whole, steps, seed=3, run=tmp_path / "whole")

    monkeypatch.setattr(train, "SAVE_EVERY", 2)
    calls = []
    honest = Gem.losses

    def killed_at_the_fourth_step(*args):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return honest(*args)

    with monkeypatch.context() as patch:
        patch.setattr(Gem, "losses", killed_at_the_fourth_step)
        with pytest.raises(KeyboardInterrupt):
            train.train(Gem(SMALL, model, memory, seed=3), steps, seed=3, run=tmp_path / "killed")
    resumed = Gem(SMALL, model, memory, seed=99)
    train.train(resumed, steps, seed=3, run=tmp_path / "killed")
    assert torch.equal(weights(resumed), weights(whole))
    assert not torch.allclose(weights(Gem(SMALL, model, memory, seed=3)), weights(whole), atol=1e-6)


def test_another_trainings_state_is_refused(prepared, model, tmp_path):
    steps, memory = prepared
    train.train(Gem(SMALL, model, memory), steps, seed=0, run=tmp_path)
    with pytest.raises(ValueError, match="other settings"):
        train.train(Gem(SMALL, model, memory), steps, seed=1, run=tmp_path)


def changed(step, **changes):
    return step[0], dataclasses.replace(step[1], **changes)


def brighter(sample):
    return dataclasses.replace(sample, maps={name: semantic + 0.5 for name, semantic in sample.maps.items()})


@pytest.mark.parametrize(
    "change",
    [
        lambda step: changed(step, pick=(3.0, 4.0)),
        lambda step: changed(step, pick_symmetry=0.0),
        lambda step: changed(step, words=step[1].words | {"pick": step[1].words["pick"] + 1}),
        lambda step: (brighter(step[0]), step[1]),
    ],
    ids=["pick", "symmetry", "words", "text map"],
)
def test_the_state_of_other_labels_words_or_maps_is_refused(change, prepared, model, tmp_path):
    steps, memory = prepared
    train.train(Gem(SMALL, model, memory), steps, seed=0, run=tmp_path)
    with pytest.raises(ValueError, match="other settings"):
        train.train(Gem(SMALL, model, memory), [change(steps[0]), *steps[1:]], seed=0, run=tmp_path)


def test_a_seed_decides_everything(prepared, model, tmp_path):
    settings = dataclasses.replace(SMALL, steps=3)
    found = []
    for number, seed in enumerate((7, 7, 8)):
        policy = Gem(settings, model, prepared[1], seed=seed)
        torch.rand(number)  # what others draw from the global generator must not matter
        train.train(policy, prepared[0], seed=seed, run=tmp_path / str(number))
        found.append(weights(policy))
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])


def test_the_shipped_policy_does_what_its_demonstrations_show(model):
    policy = load_policy(clip.DATA / "gem-put-block-in-bowl.safetensors", model)
    assert policy.name == "gem"
    for demo in demonstrations.load(clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10")[:3]:
        step = demo.steps[-1]  # earlier ones may have several right blocks
        action, right = policy.act(step.observation, step.instruction), step.expert.action
        assert np.hypot(action.pick.x - right.pick.x, action.pick.y - right.pick.y) < 0.01
        assert angle_off(action.pick.yaw - right.pick.yaw, step.expert.pick_symmetry) < np.radians(10)


def test_checkpoint_round_trip(prepared, model, tmp_path):
    memory = prepared[1]
    policy = Gem(SMALL, model, memory, seed=5)
    path = tmp_path / "policy.safetensors"
    save_policy(policy, path, {"task": "t", "demos": 2, "seed": 5})
    loaded = load_policy(path, model, SMALL)
    assert torch.equal(weights(loaded), weights(policy))
    assert [e.phrase for e in loaded.memory.entries] == [e.phrase for e in memory.entries]
    assert torch.allclose(loaded.memory.values, memory.values, atol=1e-6)


def test_bad_checkpoints_are_refused_in_a_sentence(prepared, model, tmp_path):
    policy = Gem(SMALL, model, prepared[1])
    path = tmp_path / "policy.safetensors"
    save_policy(policy, path, {})
    with pytest.raises(ValueError, match=r"another configuration \(.*angles is 12, not 36"):
        load_policy(path, model, dataclasses.replace(SMALL, angles=36))
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps({**card, "clip": {"name": "other", "fingerprint": "0"}}))
    with pytest.raises(ValueError, match="trained with the CLIP 'other'"):
        load_policy(path, model)
    path.with_suffix(".json").write_text(json.dumps({**card, "method": "vima"}))
    with pytest.raises(ValueError, match="unknown method 'vima'"):
        load_policy(path, model)
    path.with_suffix(".json").write_text(json.dumps(card))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match="cut off or changed"):
        load_policy(path, model)
    with pytest.raises(FileNotFoundError, match="missing"):
        load_policy(tmp_path / "none.safetensors", model)


def test_policy_is_deterministic_and_sees_only_views(prepared, model, demonstrations_small):
    policy = Gem(SMALL, model, prepared[1], seed=1)
    step = demonstrations_small[0].steps[0]
    first, again = (policy.decide(step.observation, step.instruction) for _ in range(2))
    assert first.action == again.action
    assert np.array_equal(first.pick_map, again.pick_map)
    assert SMALL.workspace.contains(first.action.pick.x, first.action.pick.y)
    assert set(vars(step.observation)) == {"views"}


def test_policy_refuses_bad_sentences_and_pictures(prepared, model, demonstrations_small):
    policy = Gem(SMALL, model, prepared[1])
    observation = demonstrations_small[0].steps[0].observation
    cases = {"": "empty", "pick the red block": "no place", "put in the bowl": "nothing to pick"}
    for sentence, message in cases.items():
        with pytest.raises(ValueError, match=message):
            policy.act(observation, sentence)
    with pytest.raises(ValueError, match="rgb of camera"):
        dataclasses.replace(observation.views[0], rgb=observation.views[0].rgb[:100])


def test_the_pick_keeps_away_from_where_nothing_was_grasped(prepared, model, demonstrations_small):
    policy = Gem(SMALL, model, prepared[1], seed=1)
    step = demonstrations_small[0].steps[0]
    first = policy.decide(step.observation, step.instruction)
    second = policy.decide(step.observation, step.instruction, [first.action.pick])
    off = np.hypot(second.action.pick.x - first.action.pick.x, second.action.pick.y - first.action.pick.y)
    assert off >= SMALL.empty_radius
    cells = ~choosing.untried([first.action.pick], SMALL)
    radius = SMALL.empty_radius / SMALL.workspace.pixel
    assert int(cells.sum()) == pytest.approx(np.pi * radius**2, rel=0.35)
    assert not cells[second.pick_cell[1:]]
    assert np.array_equal(second.pick_logits, first.pick_logits), "the logits are the network's own"
    allowed = Gem(dataclasses.replace(SMALL, empty_radius=0.0), model, prepared[1], seed=1)
    assert allowed.decide(step.observation, step.instruction, [first.action.pick]).action == first.action


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_policy_acts_where_it_lives(prepared, model, demonstrations_small):
    step = demonstrations_small[0].steps[0]
    here = Gem(SMALL, model, prepared[1], seed=1)
    there = Gem(SMALL, model, prepared[1], seed=1).to("cuda")
    assert there.device.type == "cuda"
    assert there.act(step.observation, step.instruction) == here.act(step.observation, step.instruction)


def test_inputs_follow_the_policy(prepared, model, demonstrations_small, monkeypatch):
    """On any machine: what is collated goes to the policy's device, and results come back."""
    policy = Gem(SMALL, model, prepared[1], seed=1)
    asked = []
    honest = policy_module.collate
    monkeypatch.setattr(
        policy_module, "collate", lambda several, *device: asked.extend(device) or honest(several, *device)
    )
    step = demonstrations_small[0].steps[0]
    policy.act(step.observation, step.instruction)
    policy.losses([prepared[0][0][1]])
    assert asked == [policy.device] * 2
    assert policy.to("cpu") is policy


def test_the_maps_of_two_things_are_joined_at_one_height():
    red, green = np.array([[0.9, 0.1]], np.float32), np.array([[0.05, 0.2]], np.float32)
    both = joined([QueryMaps(red, None, red), QueryMaps(green, green, green)])
    assert np.allclose(both.fused, [[0.9, 0.9]]), "the green thing answers less, and still it is as bright"
    assert np.array_equal(both.image, green)
    assert joined([QueryMaps(red, None, red)]).image is None
    nothing = np.zeros((1, 2), np.float32)
    assert np.array_equal(joined([QueryMaps(red, None, red), QueryMaps(nothing, None, nothing)]).fused, red)


def test_and_means_two_phrases(prepared, model, demonstrations_small):
    policy = Gem(SMALL, model, prepared[1])
    scene = policy.embed(demonstrations_small[0].steps[0].observation.views)
    both = joined([policy.maps(scene, phrase) for phrase in ("green blocks", "blue blocks")]).fused
    assert np.array_equal(policy.maps(scene, "green and blue blocks").fused, both)
    whole = Gem(dataclasses.replace(SMALL, conjuncts=False), model, prepared[1])
    assert not np.array_equal(whole.maps(scene, "green and blue blocks").fused, both)


def test_acting_between_two_steps_changes_no_training(prepared, model, demonstrations_small):
    # e2cnn keeps a filter in evaluation mode; with it, the place kernel had no gradient.
    seen = demonstrations_small[0].steps[0]

    def trained(acts):
        policy = Gem(SMALL, model, prepared[1], seed=1)
        learner = train.Learner(policy, train.Accelerator(cpu=True))
        for step in prepared[0][:3]:
            if acts:
                policy.act(seen.observation, seen.instruction)
            learner.step([step[1]], 1e-3)
        return policy

    plain, acting = trained(False), trained(True)
    kernels = [parameter.grad.abs().max() for parameter in acting.place.kernel.parameters()]
    assert min(kernels) > 0
    assert torch.equal(weights(plain), weights(acting))


def test_its_own_crop_is_found_only_if_asked_for(model, demonstrations_small):
    # One episode alone: every crop in the memory is its own.
    steps, _ = prepare(demonstrations_small[:1], model, dataclasses.replace(SMALL, own_crop=True))
    assert not any(same_maps(step[1], step[0]) for step in steps)


@pytest.mark.parametrize("episodes", ["0", "-1", "3"])
def test_a_number_of_episodes_that_is_not_there_is_refused(episodes, demo_set, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["train", str(demo_set[0]), str(tmp_path / "p.safetensors"), "--episodes", episodes]) == 2
    assert "episodes must be at" in capsys.readouterr().err


@pytest.mark.parametrize("split", ["val", "test"])
def test_demonstrations_that_measure_do_not_train(split, demonstrations_small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    demonstrations.save([dataclasses.replace(one, split=split) for one in demonstrations_small], tmp_path / "demos")
    assert main(["train", "demos", "p.safetensors", "--config.steps", "2"]) == 2
    said = capsys.readouterr().err
    assert f"demonstrations must be of the split 'train', got '{split}' in demos: episodes of that split" in said
    assert not (tmp_path / "p.safetensors").exists()


def test_steps_are_read_one_episode_at_a_time(demonstrations_small):
    """A set that counts how many of its episodes are alive: never more than the one before and the present one."""
    episodes = []
    most = []

    class Counting(Sequence):
        def __len__(self):
            return 6

        def __getitem__(self, index):
            if index >= len(self):
                raise IndexError(index)
            episode = dataclasses.replace(demonstrations_small[0])
            episodes.append(weakref.ref(episode))
            most.append(sum(reference() is not None for reference in episodes))
            return episode

    assert len(list(numbered_steps(Counting()))) == 6 * len(demonstrations_small[0].steps)
    assert max(most) <= 2
