"""Prepared steps in files: equal to those in memory, never more than one of them alive, never stale."""

import dataclasses
import gc
import itertools
import json
import weakref
import zlib

import numpy as np
import pytest
import torch

from gem_lite import clip, demonstrations
from gem_lite.policies import methods
from gem_lite.policies.inputs import PreparedStep, Sample
from gem_lite.policies.transporter import TransporterLan
from gem_lite.training import mixture, step_files, train

SMALL = dataclasses.replace(
    methods.find("transporter-lan")[1], widths=(4, 4, 8, 8), angles=12, query=15, steps=3, batch=2
)
SOURCE = {"data": "a", "method": "m"}


def made_step(number: int) -> PreparedStep:
    """A step whose values all tell its number; its two samples differ in the maps alone."""
    maps = {role: torch.full((1, 16, 16), number + part) for role, part in (("place", 0.25), ("pick", 0.125))}
    text_only = Sample(
        rgbd=torch.full((4, 16, 16), float(number)), maps=maps,
        features={"coarse": torch.arange(12.0).reshape(3, 2, 2) + number},
        words={"pick": torch.ones(8) * number, "place": torch.zeros(8)}, pick=(number + 0.1, 2.5), place=(3.0, 1 / 3),
        pick_yaw=0.1 * number, delta=-0.7, pick_symmetry=0.0, place_symmetry=2 * np.pi,
    )  # fmt: skip
    return text_only, dataclasses.replace(text_only, maps={key: one + 0.5 for key, one in maps.items()})


def steps_from(count: int):
    return lambda start: map(made_step, range(start, count))


def plain(value):
    """A value that compares by content, with its names in their order."""
    if isinstance(value, dict):
        return [(name, plain(member)) for name, member in value.items()]
    return value.tolist() if isinstance(value, torch.Tensor) else value


def values(sample: Sample) -> list:
    return plain(vars(sample))


def test_a_step_comes_back_as_it_was(tmp_path):
    stored = step_files.store(steps_from(3), tmp_path / "steps", SOURCE)
    assert len(stored) == 3
    for number, step in enumerate(stored):
        fresh = made_step(number)
        assert values(step[1]) == values(fresh[1])
        assert values(step[0]) == values(fresh[0])
    assert [step[1].pick[0] for step in stored[1:]] == [1.1, 2.1]
    with pytest.raises(IndexError):
        stored[3]


def test_what_both_samples_share_is_stored_once(tmp_path):
    step = made_step(1)
    step_files.store(lambda _: [(step[1], step[1])], tmp_path / "same", SOURCE)
    differ = step_files.store(lambda _: [step], tmp_path / "differ", SOURCE)
    bytes_of = {
        name: sum(len(zlib.decompress(path.read_bytes())) for path in (tmp_path / name).glob("step*"))
        for name in ("same", "differ")
    }
    maps = sum(semantic.nbytes for semantic in step[1].maps.values())
    assert maps <= bytes_of["differ"] - bytes_of["same"] < 1.2 * maps
    read = differ[0]
    assert read[1].rgbd is read[0].rgbd


def test_real_steps_give_the_same_weights_from_files_as_from_memory(demo_set, tmp_path):
    model, demos, weights, prints = clip.load(), demonstrations.load(demo_set[0]), [], set()
    for folder in (None, tmp_path / "steps"):
        policy = TransporterLan(SMALL, model, seed=2)
        steps = step_files.prepare(policy, demos, folder) if folder else list(policy.prepare(demos))
        train.train(policy, steps, 2, tmp_path / f"run-{folder is None}")
        weights.append(torch.cat([p.detach().flatten() for p in policy.parameters()]))
        prints.add(step_files.fingerprint(steps))
    assert torch.equal(*weights)
    assert len(prints) == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda one: (one[0], dataclasses.replace(one[1], delta=0.2)),
        lambda one: (one[0], dataclasses.replace(one[1], words={"pick": torch.ones(8)})),
        lambda one: (dataclasses.replace(one[0], maps=one[1].maps), one[1]),
        lambda one: (one[0], dataclasses.replace(one[1], features={"coarse": torch.zeros(12, 1, 1)})),
        lambda one: (one[1], one[0]),
    ],
    ids=["label", "words", "text map", "shape", "order"],
)
def test_the_fingerprint_depends_on_all_that_a_step_holds(change, tmp_path):
    steps = [made_step(0), made_step(1)]
    stored = step_files.store(lambda start: steps[start:], tmp_path, SOURCE)
    assert step_files.fingerprint(stored) == step_files.fingerprint(steps) == step_files.fingerprint(list(stored))
    changed = change(steps[0])
    assert step_files.fingerprint([changed, steps[1]]) != stored.fingerprint
    assert step_files.fingerprint(steps[::-1]) != stored.fingerprint


def test_a_stopped_preparation_is_finished_and_a_finished_one_is_not_begun_again(tmp_path):
    def stopped(start):
        yield from map(made_step, range(start, 2))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        step_files.store(stopped, tmp_path / "steps", SOURCE)
    asked = []
    for _ in range(2):
        resumed = step_files.store(
            lambda start: asked.append(start) or steps_from(4)(start), tmp_path / "steps", SOURCE
        )
    assert asked == [2]
    assert resumed.fingerprint == step_files.store(steps_from(4), tmp_path / "whole", SOURCE).fingerprint


def test_steps_of_another_source_are_refused_and_those_of_another_program_made_anew(tmp_path, capsys):
    first = step_files.store(steps_from(2), tmp_path, SOURCE, code="old")
    with pytest.raises(ValueError, match="holds steps prepared from another method: give another folder by --state"):
        step_files.store(steps_from(2), tmp_path, SOURCE | {"method": "n"}, code="old")
    assert len(list(first)) == 2, "what was refused is untouched"
    again = step_files.store(steps_from(3), tmp_path, SOURCE, code="new")
    assert len(again) == 3
    assert "prepared again" in capsys.readouterr().out


def test_the_key_of_prepared_steps_holds_what_decides_them(demo_set, tmp_path):
    model, demos = clip.load(), demonstrations.load(demo_set[0])
    step_files.prepare(TransporterLan(SMALL, model), demos[:1], tmp_path)
    source = json.loads((tmp_path / "manifest.json").read_text())["source"]
    assert source["clip"] == model.fingerprint
    with pytest.raises(ValueError, match="another data"):
        step_files.prepare(TransporterLan(SMALL, model), demos, tmp_path)
    with pytest.raises(ValueError, match="another config"):
        step_files.prepare(TransporterLan(dataclasses.replace(SMALL, parsing=False), model), demos[:1], tmp_path)


def test_a_damaged_step_is_refused(tmp_path):
    stored = step_files.store(steps_from(2), tmp_path, SOURCE)
    first, second = (tmp_path / name for name in stored.sums)
    first.write_bytes(first.read_bytes()[:-1])
    second.unlink()
    with pytest.raises(ValueError, match="cut off or changed"):
        stored[0]
    with pytest.raises(FileNotFoundError, match="is missing"):
        stored[1]


def test_steps_of_a_folder_that_was_cleaned_in_part_are_made_anew(tmp_path, capsys):
    stored = step_files.store(steps_from(3), tmp_path, SOURCE)
    (tmp_path / list(stored.sums)[1]).unlink()
    again = step_files.store(steps_from(3), tmp_path, SOURCE)
    assert "step-000001.safetensors.zlib is missing" in capsys.readouterr().out
    assert again.fingerprint == stored.fingerprint
    assert len(list(again)) == 3


def live_tensors() -> int:
    gc.collect()
    return sum(type(thing) is torch.Tensor for thing in gc.get_objects())


def test_no_more_steps_are_alive_while_they_are_made_or_drawn_than_one_needs(tmp_path):
    references, most_made, before = [], 0, live_tensors()

    def counted(start):
        nonlocal most_made
        for number in range(start, 40):
            step = made_step(number)
            references.append(weakref.ref(step[0]))
            most_made = max(most_made, sum(reference() is not None for reference in references))
            yield step
            del step

    stored = step_files.store(counted, tmp_path, SOURCE)
    assert most_made <= 2, "the one being made, and the one before"
    assert live_tensors() == before
    rng = np.random.default_rng(0)
    for _ in range(20):
        mixture.draw(stored, rng)
    assert live_tensors() == before


def test_steps_are_prepared_when_they_are_asked_for(demo_set):
    policy, seen = TransporterLan(SMALL, clip.load()), []
    honest = policy.embed
    policy.embed = lambda views: seen.append(1) or honest(views)
    steps = policy.prepare(demo_set[1])
    assert len(seen) == 0
    first, second = itertools.islice(steps, 2)
    assert len(seen) == 2
    assert values(first[0]) != values(second[0])
