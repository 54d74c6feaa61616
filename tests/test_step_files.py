"""Prepared steps in files: equal to those in memory, one alive at a time, none stale, one preparation for many."""

import dataclasses
import sys
import time
import tomllib
import types
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch
from small import small
from torch.utils.data import ConcatDataset

from gem_lite import demonstrations
from gem_lite.cli import main
from gem_lite.clip import calibration
from gem_lite.foundations import files, registry
from gem_lite.policies import gem_config, methods
from gem_lite.policies.inputs import PreparedStep, Sample
from gem_lite.policies.transporter import TransporterLan
from gem_lite.training import step_files, train

FACTS = {"data": "a", "method": "m"}


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
    if isinstance(value, Sample):
        value = vars(value)
    if isinstance(value, dict):
        return [(name, plain(member)) for name, member in value.items()]
    return value.tolist() if isinstance(value, torch.Tensor) else value


def test_a_step_comes_back_as_it_was(tmp_path):
    stored = step_files.store(steps_from(3), tmp_path, FACTS)
    assert len(stored) == 3
    for number, step in enumerate(stored):
        assert [plain(sample) for sample in step] == [plain(sample) for sample in made_step(number)]
        assert step[1].rgbd is step[0].rgbd, "what both samples share is stored once"
    assert [step[1].pick[0] for step in stored[1:]] == [1.1, 2.1]
    with pytest.raises(IndexError):
        stored[3]


def test_the_fingerprint_depends_on_all_that_steps_hold(tmp_path):
    steps = [made_step(0), made_step(1)]
    stored = step_files.store(lambda start: steps[start:], tmp_path, FACTS)
    assert step_files.fingerprint(stored) == step_files.fingerprint(steps) == step_files.fingerprint(list(stored))
    text, both = steps[0]
    changed = [
        (text, dataclasses.replace(both, delta=0.2)),
        (text, dataclasses.replace(both, words={"pick": torch.ones(8)})),
        (dataclasses.replace(text, maps=both.maps), both),
        (text, dataclasses.replace(both, features={"coarse": torch.zeros(12, 1, 1)})),
        (both, text),
    ]
    several = [[step, steps[1]] for step in changed] + [steps, steps[::-1]]
    tasks = [ConcatDataset(parts) for parts in (several[:2], several[1::-1])]
    assert len({step_files.fingerprint(one) for one in [*several, *tasks]}) == len(several) + 2


def test_a_stopped_preparation_is_finished_and_a_finished_one_is_not_begun_again(tmp_path):
    def stopped(start):
        yield from map(made_step, range(start, 2))
        raise KeyboardInterrupt

    asked = []

    def store(**facts):
        return step_files.store(lambda start: asked.append(start) or steps_from(4)(start), tmp_path, FACTS | facts)

    with pytest.raises(KeyboardInterrupt):
        step_files.store(stopped, tmp_path, FACTS)
    resumed = store()
    store()
    assert asked == [2]
    whole = store(code="new")
    assert asked == [2, 0], "steps of other facts are not used"
    assert step_files.fingerprint(resumed) == step_files.fingerprint(whole)
    store()
    assert asked == [2, 0], "and not removed"


def test_a_damaged_step_is_refused_and_a_missing_one_made_anew(tmp_path, capsys):
    stored = step_files.store(steps_from(3), tmp_path, FACTS)
    first, second, _ = (stored.folder / name for name in stored.sums)
    content = first.read_bytes()
    first.write_bytes(content[:-1])
    with pytest.raises(ValueError, match="cut off or changed"):
        stored[0]
    second.unlink()
    with pytest.raises(FileNotFoundError, match="is missing"):
        stored[1]
    again = step_files.store(steps_from(3), tmp_path, FACTS)
    assert "step-000001.safetensors.zlib is missing" in capsys.readouterr().out
    assert step_files.fingerprint(again) == step_files.fingerprint(stored)
    assert first.read_bytes() == content and len(list(again)) == 3


def test_of_two_at_once_one_prepares_and_the_other_waits_and_reads_the_same(tmp_path, capsys):
    made, second = [], ThreadPoolExecutor(1)

    def steps(start):
        made.append(second.submit(step_files.store, steps, tmp_path, FACTS))
        deadline = time.time() + 60
        while "another process prepares the same steps" not in capsys.readouterr().out:
            assert time.time() < deadline
            time.sleep(0.01)
        yield made_step(start)

    stored = step_files.store(steps, tmp_path, FACTS)
    (waited,) = made
    assert step_files.fingerprint(waited.result(60)) == step_files.fingerprint(stored)


def test_no_more_episodes_and_steps_are_alive_than_one_needs(demo_set, model, tmp_path):
    class Counting(list):
        """Its episodes are new ones: it counts how many of them are alive."""

        def __iter__(self):
            for episode in super().__iter__():
                episode = dataclasses.replace(episode)
                counts.append(count_alive(episodes, episode))
                yield episode
                del episode

    def count_alive(references, new):
        references.append(weakref.ref(new))
        return sum(reference() is not None for reference in references)

    def counted(start):
        for step in policy.prepare(Counting(demo_set[1][:1] * 6), start):
            counts.append(count_alive(steps, step[0]))
            yield step
            del step

    policy = TransporterLan(small("transporter-lan"), model)
    episodes, steps, counts = [], [], []
    next(iter(counted(0)))
    assert len(episodes) == len(steps) == 1, "they are prepared when they are asked for"
    stored = step_files.store(counted, tmp_path, FACTS)
    assert len(steps) == 1 + 6 * len(demo_set[1][0].steps)
    assert max(counts) <= 2, "the present one, and the one before"
    rng = np.random.default_rng(0)
    drawn = [weakref.ref(train.draw(stored, rng)[0]) for _ in range(20)]
    assert not any(reference() for reference in drawn)


@pytest.mark.release
def test_trainings_that_differ_after_the_preparation_share_their_steps(demo_set, model, tmp_path):
    demos = demonstrations.load(demo_set[0])[:1]

    def prepared(name, **changes):
        policy = methods.METHODS.find(methods.split(name)[0])(small(name, **changes), model)
        return step_files.prepare(policy, [demos], tmp_path)

    names = ("gem", "gem-without-steerable-kernel", "gem-without-recoloring", "gem")
    shared = [prepared(name, batch=batch) for batch, name in enumerate(names, 1)]
    assert len({one.folder for one in shared}) == len({step_files.fingerprint(one) for one in shared}) == 1
    others = [prepared(name) for name in ("gem-without-parsing", "cliport", "cliport-grounded", "transporter-lan")]
    assert len({one.folder for one in [*shared, *others]}) == 5
    assert max(path.stat().st_size for path in tmp_path.rglob("step-*")) < 333_000


@pytest.mark.release
def test_only_a_memory_of_all_tasks_makes_other_steps(demo_set, model, tmp_path):
    demos = demonstrations.load(demo_set[0])
    sets = [demos[:1], demos[1:]]

    def folders(name, *given):
        policy = methods.METHODS.find(methods.split(name)[0])(small(name), model)
        steps = step_files.prepare(policy, given, tmp_path)
        return [part.folder for part in (steps.datasets if len(given) > 1 else [steps])]

    for name, alone_is_the_same in (("transporter-lan", True), ("gem", False)):
        alone = [folder for one in sets for folder in folders(name, one)]
        joined = folders(f"{name}-multi", *sets)
        assert (joined == alone) == alone_is_the_same
        assert len(set(joined)) == 2
        assert (folders(f"{name}-multi", *sets[::-1]) == joined[::-1]) == alone_is_the_same


class Nosy(TransporterLan):
    """A method whose preparation reads what is no part of its key."""

    def embed(self, views):
        assert self.config.angles
        return super().embed(views)


def test_a_preparation_knows_no_entry_but_those_of_its_key(demo_set, model, tmp_path):
    demos = demonstrations.load(demo_set[0])
    with pytest.raises(AttributeError, match="'InputConfig' object has no attribute 'angles'"):
        step_files.prepare(Nosy(small("transporter-lan"), model), [demos], tmp_path)
    assert not list(tmp_path.rglob("step-*"))


def test_an_entry_that_decides_inputs_gives_other_steps_a_place_of_their_own():
    changes = (
        {"patch": 40, "stride": 20}, {"parsing": False}, {"own_crop": True}, {"image_weight": 0.5},
        {"text_weight": 1.0}, {"semantic_map": "single-view"}, {"conjuncts": False}, {"top_patch": 0.1},
        {"pixel": 0.015625, "top_patch": 0.25}, {"location_code": False}, {"parser": "another"},
    )  # fmt: skip
    parts = [small("gem", **change).inputs for change in changes]
    assert len({str(part.as_dict()) for part in [small("gem").inputs, *parts]}) == len(changes) + 1


def test_ablations_share_the_steps_if_they_change_nothing_before_the_training():
    sharing = {ending for ending in gem_config.ABLATIONS if small("gem").ablated(ending).inputs == small("gem").inputs}
    assert sharing == {
        "with-modulated-encoder", "with-steerable-encoder",
        "without-steerable-kernel", "with-free-kernels", "without-recoloring", "without-language-in-attention",
        "without-rotation-augmentation", "without-map-scaling", "without-peak", "without-empty-spots",
        "with-continued-border", "with-joint-choice", "with-place-peak",
    }  # fmt: skip


def test_other_data_clips_devices_parsers_and_classes_are_other_identities(demo_set, model):
    demos = demonstrations.load(demo_set[0])
    method, config = methods.find("transporter-lan")

    class Heir(method):
        """A class with the same name of its method, and perhaps another preparation."""

    def facts(kind=method, data=demos, parser=None, **changes):
        policy = kind(config, model, parser=parser)
        policy.clip = types.SimpleNamespace(
            fingerprint=changes.get("clip", "a"), device=types.SimpleNamespace(type=changes.get("device", "cpu")),
            folder=None,
        )  # fmt: skip
        return str(step_files.identity(policy, data, [data]))

    calibration_file = calibration.path_for(types.SimpleNamespace(folder=None, fingerprint="calibrated"))
    uncalibrated = facts(clip="calibrated")
    files.write_atomically(calibration_file, b"{}")
    found = [
        uncalibrated, facts(clip="calibrated"),
        facts(), facts(Heir), facts(data=demos[:1]), facts(parser=lambda text: text), facts(clip="b"),
        facts(device="cuda"),
    ]  # fmt: skip
    assert len(set(found)) == len(found)
    assert facts() == found[2]


def test_a_change_of_code_is_seen_where_it_can_decide_steps(model, tmp_path, monkeypatch):
    policy = methods.METHODS.find("transporter-lan")(small("transporter-lan"), model)
    before = step_files.code_digest(policy)
    assert step_files.code_digest(policy) == before
    outside = "from gem_lite.policies import methods, transporter\n"
    outside += "@methods.METHODS.register('mine')\nclass Mine(transporter.TransporterLan): pass\n"
    (tmp_path / "outside_task.py").write_text(outside)  # a name that conftest.py forgets
    monkeypatch.syspath_prepend(tmp_path)
    registry.load(["outside_task"])
    with_mine = step_files.code_digest(policy)
    (tmp_path / "outside_task.py").write_text(outside + "# changed\n")
    changed = step_files.code_digest(policy)
    monkeypatch.delattr(sys.modules["outside_task"], "__file__")  # as in a notebook
    assert len({before, with_mine, changed, step_files.code_digest(policy)}) == 4
    monkeypatch.setattr(step_files.metadata, "version", lambda library: "0")
    assert step_files.code_digest(policy) != before


def test_code_counts_but_for_the_rooms_above_the_training():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    assert sorted(layers[: layers.index("training")]) == list(step_files.ABOVE)


def test_the_command_leaves_the_shared_folder_for_the_next_training(demo_set, tmp_path):
    def run(name, seed):
        command = ["train", demo_set[0], tmp_path / f"{name}.safetensors", "--method", "transporter-lan"]
        command += ["--state", tmp_path / name, "--prepared", tmp_path / "shared", "--seed", seed]
        return main([str(word) for word in [*command, "--config.batch", 1, "--config.steps", 1 + seed]])

    def kept():
        return {path: path.stat().st_mtime_ns for path in (tmp_path / "shared").rglob("step-*")}

    assert run("first", 0) == 0
    first = kept()
    assert len(first) == sum(len(demo.steps) for demo in demo_set[1])
    assert list((tmp_path / "first").iterdir()) == []
    assert run("second", 1) == 0
    assert kept() == first, "nothing is prepared again"
