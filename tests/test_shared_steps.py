"""Prepared steps that trainings share: what decides them and what does not, one preparation for many, none stale."""

import dataclasses
import functools
import subprocess
import sys
import types
from pathlib import Path

import pytest

from gem_lite import clip, demonstrations
from gem_lite.cli import main
from gem_lite.foundations import registry
from gem_lite.policies import gem_config, methods
from gem_lite.training import step_files

NAMES = tuple(name for name in methods.METHODS.names() if methods.METHODS.find(name).__module__.startswith("gem_lite"))
CHANGED = {
    "name": "paper", "angles": 8, "empty_radius": 0.03, "turn": False, "steps": 7, "batch": 3, "learning_rate": 0.5,
    "ablations": ("multi",), "drop_image_map": 0.9, "map_gain": (0.1, 0.2), "map_offset": 0.4, "recolor": False,
    "peak_margin": 0.3, "peak_radius": 0.05, "rotations": 24, "frequency": 3, "kernel": 9, "crop": 9,
    "widths": (2, 4, 4, 8), "kernel_widths": (2, 4, 4), "fields": 1, "channels": 2, "kernels": "free",
    "language_in_attention": False, "query": 31, "joins": 1, "pick_angles": 1, "map_rules": True,
}  # fmt: skip
"""Another value for each entry that no preparation reads."""
SIZES = {"widths": (4, 4, 8, 8), "kernel_widths": (4, 8, 8), "fields": 2, "rotations": 36, "frequency": 4, "angles": 12}


def small(name, /, **changes):
    """A method's configuration with small networks, and changed entries."""
    config = methods.find(name)[1]
    sizes = {key: value for key, value in SIZES.items() if key in config.as_dict()}
    return dataclasses.replace(config, **sizes | changes)


@pytest.fixture(scope="module")
def model():
    return clip.load()


@pytest.fixture(scope="module")
def encoded(model, demos):
    """``encoded(name, config)``: the bytes of the prepared steps."""

    def prepared(name, config):
        policy = methods.METHODS.find(name)(config, model)
        policy.remember(demos)
        return [step_files._encode(step) for step in policy.prepare(demos)]

    return prepared


@pytest.fixture(scope="module")
def reference(encoded):
    return functools.cache(lambda name: encoded(name, small(name)))


@pytest.mark.parametrize("name", NAMES)
def test_every_entry_is_either_in_the_identity_or_has_another_value_here(name):
    config = methods.find(name)[1]
    unread = config.AFTER_PREPARATION
    entries = {entry.name for entry in dataclasses.fields(config)}
    assert unread <= entries & CHANGED.keys()
    assert config.preparation.keys() == config.as_dict().keys() - unread
    assert {"table", "pixel", "parser", "parsing"} <= config.preparation.keys()


@pytest.mark.parametrize(
    ("name", "entry"), [(name, entry) for name in NAMES for entry in sorted(methods.find(name)[1].AFTER_PREPARATION)]
)
def test_an_entry_outside_the_identity_changes_no_byte(name, entry, encoded, reference):
    other = not getattr(small(name), entry) if entry == "recolor" else CHANGED[entry]  # the methods begin with either
    changed = small(name, **{entry: other})
    assert getattr(changed, entry) != getattr(small(name), entry)
    assert encoded(name, changed) == reference(name)


@pytest.mark.parametrize("name", NAMES)
def test_a_step_takes_at_most_a_third_of_a_megabyte(name, reference):
    assert max(len(step) for step in reference(name)) < 333_000


@pytest.mark.parametrize("name", NAMES)
def test_no_preparation_reads_an_entry_outside_the_identity(name, model, demos):
    config, read = small(name), set()

    class Recording(type(config)):
        def __getattribute__(self, entry):
            read.add(entry)
            return super().__getattribute__(entry)

    policy = methods.METHODS.find(name)(Recording(**vars(config)), model)
    read.clear()
    policy.remember(demos)
    assert len(list(policy.prepare(demos))) == 2
    assert "parsing" in read, "the reading is seen"
    assert not read & config.AFTER_PREPARATION


@pytest.mark.parametrize(
    "change",
    [
        {"patch": 40, "stride": 20}, {"parsing": False}, {"own_crop": True}, {"image_weight": 0.5},
        {"text_weight": 1.0}, {"semantic_map": "single-view"}, {"conjuncts": False}, {"top_patch": 0.1},
        {"pixel": 0.015625, "top_patch": 0.25},
    ],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_an_entry_of_the_identity_gives_other_steps_a_place_of_their_own(change):
    assert small("gem", **change).preparation != small("gem").preparation


@pytest.fixture
def counted(monkeypatch):
    """The methods of the steps that are prepared."""
    made = []
    for name in NAMES:
        kind = methods.METHODS.find(name)
        honest = kind.prepare_step

        def prepare_step(self, *args, honest=honest):
            made.append(self.name)
            return honest(self, *args)

        if kind.__base__ not in map(methods.METHODS.find, NAMES):  # a method derived from another counts there
            monkeypatch.setattr(kind, "prepare_step", prepare_step)
    return made


def test_trainings_that_differ_after_the_preparation_share_their_steps(demo_set, model, counted, tmp_path):
    demos = demonstrations.load(demo_set[0])[:1]
    steps = len(demo_set[1][0].steps)
    prepared = []
    for name in ("gem", "gem-without-steerable-kernel", "gem-without-recoloring", "gem"):
        method, config = methods.find(name)
        policy = method(dataclasses.replace(config, batch=1 + len(prepared)), model)
        prepared.append(step_files.prepare(policy, demos, tmp_path, shared=True))
    assert counted == ["gem"] * steps
    assert len({one.folder for one in prepared}) == len({one.fingerprint for one in prepared}) == 1
    for name in ("gem-without-parsing", "cliport", "cliport-grounded", "transporter-lan"):
        method, config = methods.find(name)
        prepared.append(step_files.prepare(method(config, model), demos, tmp_path, shared=True))
    assert len(counted) == 5 * steps
    assert len({one.folder for one in prepared}) == 5


def test_only_a_memory_of_all_tasks_makes_other_steps(demo_set, model, counted, tmp_path):
    demos = demonstrations.load(demo_set[0])
    sets = [demos[:1], demos[1:]]
    for name, alone_is_the_same in (("transporter-lan", True), ("cliport", True), ("gem", False)):
        single, several = ((methods.find(ending)) for ending in (name, f"{name}-multi"))
        alone = [step_files.prepare(single[0](single[1], model), one, tmp_path, shared=True) for one in sets]
        counted.clear()
        joined = step_files.prepare_tasks(several[0](several[1], model), sets, tmp_path, shared=True)
        folders = [part.folder for part in joined.parts]
        assert (folders == [part.folder for part in alone]) == alone_is_the_same
        assert len(set(folders)) == 2 and bool(counted) != alone_is_the_same
        backwards = step_files.prepare_tasks(several[0](several[1], model), sets[::-1], tmp_path, shared=True)
        assert ([part.folder for part in backwards.parts] == folders[::-1]) == alone_is_the_same


def test_other_data_clips_devices_parsers_and_classes_are_other_identities(demo_set, model):
    demos = demonstrations.load(demo_set[0])
    method, config = methods.find("transporter-lan")

    class Heir(method):
        """A class with the same name of its method, and perhaps another preparation."""

    def facts(kind=method, data=demos, parser=None, **changes):
        policy = kind(config, model, parser=parser)
        policy.clip = types.SimpleNamespace(
            fingerprint=changes.get("clip", "a"), device=types.SimpleNamespace(type=changes.get("device", "cpu"))
        )
        return str(step_files.identity(policy, data, [data]))

    found = [
        facts(), facts(Heir), facts(data=demos[:1]), facts(parser=lambda text: text), facts(clip="b"),
        facts(device="cuda"),
    ]  # fmt: skip
    assert len(set(found)) == len(found)
    assert facts() == found[0]


OUTSIDE = """
from gem_lite.policies import methods
from gem_lite.policies.transporter import TransporterLan

@methods.METHODS.register("mine")
class Mine(TransporterLan):
    pass
"""


def test_a_change_of_code_outside_the_library_is_seen(model, tmp_path, monkeypatch):
    policy = methods.METHODS.find("transporter-lan")(small("transporter-lan"), model)
    before = step_files.code_digest(policy)
    assert step_files.code_digest(policy) == before
    (tmp_path / "outside_task.py").write_text(OUTSIDE)  # a name that conftest.py forgets
    monkeypatch.syspath_prepend(tmp_path)
    registry.load(["outside_task"])
    with_mine = step_files.code_digest(policy)
    (tmp_path / "outside_task.py").write_text(OUTSIDE + "# changed\n")
    changed = step_files.code_digest(policy)
    monkeypatch.delattr(sys.modules["outside_task"], "__file__")  # as in a notebook
    assert len({before, with_mine, changed, step_files.code_digest(policy)}) == 4
    monkeypatch.setattr(step_files.metadata, "version", lambda library: "0")
    assert step_files.code_digest(policy) != before


def test_steps_of_another_program_are_not_used_and_not_removed(tmp_path):
    made = []
    for code in ("old", "new", "old"):
        step_files.share(lambda start: made.append(start) or [], tmp_path, {"data": "a"}, code)
    assert made == [0, 0]
    assert len([path for path in tmp_path.iterdir() if path.is_dir()]) == 2


SLOW = """
import sys, time
from pathlib import Path
import torch
from gem_lite.training import step_files
from gem_lite.policies.inputs import Sample

def steps(start):
    for number in range(start, 6):
        time.sleep(0.2)
        print("made", number, flush=True)
        sample = Sample(rgbd=torch.full((4, 8, 8), float(number)), pick=(1, 2), place=(3, 4), pick_yaw=0.0, delta=0.0,
                        pick_symmetry=0.0, place_symmetry=0.0)
        yield (sample,)

folder = Path(sys.argv[1])
(folder / sys.argv[2]).touch()
while len(list(folder.glob("ready-*"))) < 2:
    time.sleep(0.01)
stored = step_files.share(steps, folder / "shared", {"data": "a"}, "code")
print("read", [int(step[0].rgbd[0, 0, 0]) for step in stored], stored.fingerprint)
"""


def test_two_processes_at_once_prepare_once_and_read_the_same(tmp_path):
    program = [sys.executable, "-c", SLOW, str(tmp_path)]
    pair = [subprocess.Popen([*program, f"ready-{i}"], stdout=subprocess.PIPE, text=True) for i in range(2)]
    said = sorted((process.communicate(timeout=300)[0].splitlines() for process in pair), key=len)
    assert [process.returncode for process in pair] == [0, 0]
    waited, prepared = said
    assert prepared[:-1] == [f"made {number}" for number in range(6)]
    assert "another process prepares the same steps" in waited[0] and len(waited) == 2
    assert waited[-1] == prepared[-1] and "[0, 1, 2, 3, 4, 5]" in waited[-1]


def test_the_command_leaves_the_shared_folder_for_the_next_training(demo_set, counted, tmp_path):
    def run(name, seed):
        command = ["train", demo_set[0], tmp_path / f"{name}.safetensors", "--method", "transporter-lan"]
        command += ["--state", tmp_path / name, "--prepared", tmp_path / "shared", "--seed", seed]
        return main([str(word) for word in [*command, "--config.batch", 1, "--config.steps", 1 + seed]])

    assert run("first", 0) == 0
    assert len(counted) == sum(len(demo.steps) for demo in demo_set[1])
    kept = sorted(path.name for path in Path(tmp_path / "shared").rglob("step-*"))
    assert len(kept) == len(counted)
    assert list((tmp_path / "first").iterdir()) == []
    assert run("second", 1) == 0
    assert len(counted) == len(kept), "nothing is prepared again"


def test_ablations_share_the_steps_if_they_change_nothing_before_the_training():
    sharing = {
        ending
        for ending, ablation in gem_config.ABLATIONS.items()
        if ablation.changes.keys() <= gem_config.GemConfig.AFTER_PREPARATION
    }
    assert sharing == {
        ending
        for ending in gem_config.ABLATIONS
        if gem_config.LITE.ablated(ending).preparation == gem_config.LITE.preparation
    }
    assert {"without-steerable-kernel", "without-recoloring"} <= sharing
    assert {"without-parsing", "keeps-own-crop", "with-single-view"}.isdisjoint(sharing)
