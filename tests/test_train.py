"""Training, checkpoints and decisions of a small GEM on two demonstrations."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
import torch
from small import SMALL, weights

from gem_lite import clip, demonstrations
from gem_lite.cli import main
from gem_lite.evaluation import collecting
from gem_lite.maps.query_maps import QueryMaps, joined
from gem_lite.policies import augment
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.gem import Gem
from gem_lite.se2 import angle_off
from gem_lite.training import folders, train


def test_labels_lie_on_the_expert_and_crops_show_what_it_picked(prepared, demo_set):
    steps, memory = prepared
    expert = demo_set[1][0].steps[0].expert.action
    sample = steps[0][1]
    assert SMALL.workspace.to_world(*sample.pick) == pytest.approx((expert.pick.x, expert.pick.y))
    assert sample.pick_yaw == expert.pick.yaw
    assert sample.delta == pytest.approx(expert.delta)
    # The block is really there, in the height channel of the picture.
    assert sample.rgbd[3, round(sample.pick[0]), round(sample.pick[1])] * 0.05 == pytest.approx(0.04, abs=0.004)
    assert [entry.key for entry in memory.entries[::2]] == [
        (d.task, i) for i, d in enumerate(demo_set[1]) for _ in d.steps
    ]
    for step, entry in zip(steps, memory.entries[::2], strict=True):
        row, col = (round(coordinate) for coordinate in step[1].pick)
        centre = (step[1].rgbd[:3, row, col].numpy() + 0.2) * 255
        assert np.allclose(entry.image[10, 10], centre, atol=0.1)


def test_training_retrieves_crops_of_other_episodes_and_its_own_only_if_asked(model, demos):
    # Of two equal episodes, each finds the other. Alone, every crop in the memory is its own.
    own = dataclasses.replace(SMALL, own_crop=True)
    for given, settings, found in ((demos, SMALL, True), (demos[:1], SMALL, False), (demos[:1], own, True)):
        policy = Gem(settings, model)
        policy.remember(given)
        assert {entry.episode for entry in policy.memory.entries} == set(range(len(given)))
        for text, both in policy.prepare(given):
            assert all(torch.equal(text.maps[role], both.maps[role]) for role in text.maps) != found


def test_batches_hide_the_image_map_now_and_then(prepared, model):
    steps, memory = prepared
    black = dataclasses.replace(steps[0][0], rgbd=torch.zeros_like(steps[0][0].rgbd))
    marked = [(black, step[1]) for step in steps]
    policy = Gem(SMALL, model, memory)
    hidden = [
        float(train.make_batch(policy, marked, np.random.default_rng(i))[0].rgbd.abs().sum()) == 0 for i in range(60)
    ]
    assert 5 < sum(hidden) < 40  # drop_image_map is 0.3


def test_training_recolours_if_the_method_does(prepared, model, monkeypatch):
    recolored, honest = [], augment.recolored
    monkeypatch.setattr(augment, "recolored", lambda *args: recolored.append(1) or honest(*args))
    for settings in (dataclasses.replace(SMALL, batch=3), SMALL.ablated("without-recoloring")):
        train.make_batch(Gem(settings, model, prepared[1]), prepared[0], np.random.default_rng(0))
    assert len(recolored) == 3


def test_any_number_of_workers_makes_the_same_losses(prepared, trained, model, tmp_path):
    steps, memory = prepared
    before = torch.get_rng_state()
    policy, losses = Gem(SMALL, model, memory, seed=3), []
    train.train(policy, steps, 3, tmp_path, watch=lambda step, of_step: losses.append(of_step), workers=2)
    assert torch.equal(torch.get_rng_state(), before), "nothing is drawn from the global generator"
    assert torch.equal(weights(policy), weights(trained[0]))
    batches = train.Batches(Gem(SMALL, model, memory, seed=3), steps, seed=3)
    first = batches.policy.losses(batches[0])
    assert len(losses) == SMALL.steps and losses[0] == {role: loss.item() for role, loss in first.items()}


def test_the_seed_decides_the_batches(prepared, model):
    policy = Gem(SMALL, model, prepared[1])
    one, same, seed, step, process = (
        train.Batches(policy, prepared[0], *of)[number][0].rgbd
        for of, number in (((7,), 0), ((7,), 0), ((8,), 0), ((7,), 1), ((7, 1), 0))
    )
    assert torch.equal(one, same)
    assert not any(torch.equal(one, other) for other in (seed, step, process))


@pytest.mark.parametrize(("changes", "seed"), [({}, 1), ({"pick": (3.0, 4.0)}, 3), ({"pick_symmetry": 0.0}, 3)])
def test_the_state_of_another_training_is_refused(changes, seed, prepared, trained, model):
    (text, both), *others = prepared[0]
    steps = [(text, dataclasses.replace(both, **changes)), *others]
    with pytest.raises(ValueError, match="other settings"):
        train.train(Gem(SMALL, model, prepared[1]), steps, seed=seed, run=trained[1])


def test_the_shipped_policy_does_what_its_demonstrations_show(model):
    policy = load_policy(clip.DATA / "gem-put-block-in-bowl.safetensors", model)
    assert policy.name == "gem"
    for demo in demonstrations.load(clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10")[:3]:
        step = demo.steps[-1]  # earlier ones may have several right blocks
        action, right = policy.act(step.observation, step.instruction), step.expert.action
        assert np.hypot(action.pick.x - right.pick.x, action.pick.y - right.pick.y) < 0.01
        assert angle_off(action.pick.yaw - right.pick.yaw, step.expert.pick_symmetry) < np.radians(10)


def test_the_pick_keeps_away_from_where_nothing_was_grasped(prepared, model, demo_set):
    policy, step = Gem(SMALL, model, prepared[1], seed=1), demo_set[1][0].steps[0]
    first = policy.act(step.observation, step.instruction).pick
    second = policy.act(step.observation, step.instruction, [first]).pick
    assert np.hypot(second.x - first.x, second.y - first.y) >= SMALL.empty_radius


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_policy_acts_where_it_lives(prepared, model, demo_set):
    step = demo_set[1][0].steps[0]
    here = Gem(SMALL, model, prepared[1], seed=1)
    there = Gem(SMALL, model, prepared[1], seed=1).to("cuda")
    assert there.device.type == "cuda"
    assert there.act(step.observation, step.instruction) == here.act(step.observation, step.instruction)


def test_the_maps_of_two_things_are_joined_at_one_height():
    red, green = np.array([[0.9, 0.1]], np.float32), np.array([[0.05, 0.2]], np.float32)
    both = joined([QueryMaps(red, None, red), QueryMaps(green, green, green)])
    assert np.allclose(both.fused, [[0.9, 0.9]]), "the green thing answers less, and still it is as bright"
    assert np.array_equal(both.image, green)
    assert joined([QueryMaps(red, None, red)]).image is None
    nothing = np.zeros((1, 2), np.float32)
    assert np.array_equal(joined([QueryMaps(red, None, red), QueryMaps(nothing, None, nothing)]).fused, red)


def test_and_means_two_phrases(prepared, model, demo_set):
    policy = Gem(SMALL, model, prepared[1])
    scene = policy.embed(demo_set[1][0].steps[0].observation.views)
    both = joined([policy.maps(scene, phrase) for phrase in ("green blocks", "blue blocks")]).fused
    assert np.array_equal(policy.maps(scene, "green and blue blocks").fused, both)
    whole = Gem(dataclasses.replace(SMALL, conjuncts=False), model, prepared[1])
    assert not np.array_equal(whole.maps(scene, "green and blue blocks").fused, both)


def test_acting_between_two_steps_changes_no_training(prepared, model, demo_set):
    # e2cnn keeps a filter in evaluation mode; with it, the place kernel had no gradient.
    seen = demo_set[1][0].steps[0]

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


def test_a_number_of_episodes_that_is_not_there_is_refused(demo_set):
    for episodes in (0, -1, 3):
        with pytest.raises(ValueError, match="episodes must be at"):
            folders.demonstrations_of_tasks([demo_set[0]], episodes, SMALL)


def test_the_manifest_says_how_long_the_table_is(demo_set, tmp_path):
    source, path = demonstrations.load(demo_set[0]), tmp_path / "manifest.json"
    manifest = json.loads((demo_set[0] / "manifest.json").read_text())
    moved = demonstrations.DemonstrationSet(tmp_path, source.sums)
    shutil.copytree(demo_set[0], tmp_path, dirs_exist_ok=True)
    assert manifest["workspace"] == [0.25, 0.75, -0.5, 0.5]
    path.write_text(json.dumps(manifest | {"workspace": [0.235, 0.765, -0.53, 0.53]}))
    assert folders.on_table_of([moved], SMALL) == SMALL.on_table(1.06)
    assert folders.on_table_of([source], SMALL) == SMALL
    with pytest.raises(ValueError, match=r"must have one table .* got \[\(\(0\.235, 0\.765, -0\.53, 0\.53\), 1\.0\), "):
        folders.on_table_of([moved, source], SMALL)
    path.write_text(json.dumps(manifest | {"workspace": [0, 1]}))
    with pytest.raises(ValueError, match=r"manifest\.json workspace lacks 2"):
        folders.on_table_of([moved], SMALL)
    del manifest["workspace"]
    path.write_text(json.dumps(manifest))
    command = r"gem-lite collect put-block-in-bowl-seen-colors .* --episodes 2 --world home"
    with pytest.raises(ValueError, match=command):
        folders.on_table_of([moved], SMALL)
    collecting.collect(source[0].task, 2, tmp_path)
    assert folders.on_table_of([moved], SMALL) == SMALL


def test_demonstrations_that_measure_do_not_train(demo_set, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for split in ("val", "test"):
        demonstrations.save([dataclasses.replace(one, split=split) for one in demo_set[1]], tmp_path / "demos")
        assert main(["train", "demos", "p.safetensors", "--config.steps", "2"]) == 2
        said = capsys.readouterr().err
        assert f"demonstrations must be of the split 'train', got '{split}' in demos: episodes of that split" in said
    assert not (tmp_path / "p.safetensors").exists()
