"""Fixtures that several test modules share. Nothing here may reach the network or the user's caches."""

import copy
import dataclasses
import os
import sys
import tempfile
from pathlib import Path

# Before any import that reads them.
_CACHE = tempfile.TemporaryDirectory(prefix="gem-lite-tests-")
os.environ["HF_HUB_OFFLINE"] = "1"
os.environ["XDG_CACHE_HOME"] = _CACHE.name
# The small language model is converted once for all processes of a run, and for later runs.
os.environ["GEM_LITE_CACHE"] = str(Path(__file__).resolve().parents[1] / "build" / "language-models")
os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = _CACHE.name

import pytest  # noqa: E402
import torch  # noqa: E402
from nbval.plugin import IPyNbCell  # noqa: E402
from small import SMALL  # noqa: E402

from gem_lite import clip  # noqa: E402
from gem_lite.evaluation import collecting, workers  # noqa: E402
from gem_lite.foundations import registry  # noqa: E402
from gem_lite.policies.checkpoints import load_policy  # noqa: E402
from gem_lite.policies.gem import Gem  # noqa: E402
from gem_lite.simulation.world import World  # noqa: E402
from gem_lite.tasks import Task  # noqa: E402
from gem_lite.training import train  # noqa: E402


class StagedTask(Task):
    """A task without goals, whose scene and score a test gives: ``builders`` take a client and return a Body."""

    def __init__(self, builders, score, max_steps):
        super().__init__()
        self.builders, self.given_score, self.max_steps = builders, score, max_steps
        self.bodies = []

    def lay_out(self, environment, rng, seed):
        self.bodies = [environment.add(build(environment.client)) for build in self.builders]
        return []

    def score(self, world):
        return self.given_score([world.pose(body) for body in self.bodies])

    def expert(self, world):
        return None


@pytest.fixture(autouse=True)
def seeded():
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def model():
    """The embedded CLIP."""
    return clip.load()


@pytest.fixture(scope="session")
def multi(model):
    """The shipped policy of many tasks. It stays as it is."""
    return load_policy(clip.DATA / "gem-multi.safetensors", model).eval()


@pytest.fixture(scope="session")
def world():
    """One world for all: a test lays out its own scene in it, with `stage` or `World.reset`."""
    with World() as shared:
        yield shared


OUTSIDE = ("toys", "outside_task", "experiments.picture_prompts.register_tasks")
"""Modules that register what is not the library's."""


@pytest.fixture(autouse=True, scope="module")
def registries_as_they_were():
    """What a test file registers from outside is forgotten after it."""
    before = [(table, dict(table._entries), dict(table._modules)) for table in registry._ALL]
    yield
    for table, entries, modules in before:
        table._entries, table._modules = entries, modules
    for name in OUTSIDE:
        sys.modules.pop(name, None)


@pytest.fixture
def no_pictures(monkeypatch):
    """Worlds without cameras: for tests that read the simulator's truth, since pictures take most of the time."""
    monkeypatch.setattr(World, "observe", lambda self: (None,))


@pytest.fixture
def blind(world, no_pictures):
    """The shared world without its cameras."""
    return world


@pytest.fixture(scope="session")
def stage(world):
    """``stage(build, ..., score=..., max_steps=...)`` lays bodies out and returns (bodies, observation)."""

    def lay_out(*builders, score=lambda poses: 0.0, max_steps=10):
        task = StagedTask(builders, score, max_steps)
        (observation,) = world.reset(task, seed=0)
        return task.bodies, observation

    return lay_out


@pytest.fixture(scope="session")
def demo_set(tmp_path_factory):
    """(folder, demonstrations): two saved expert episodes. Copy the folder before damaging it."""
    folder = tmp_path_factory.mktemp("demos") / "bowl-2"
    return folder, list(collecting.collect("put-block-in-bowl-seen-colors", 2, folder))


@pytest.fixture(scope="session")
def demos(demo_set):
    """The first step of one episode, twice, so that each finds a crop of the other."""
    one = dataclasses.replace(demo_set[1][0], steps=demo_set[1][0].steps[:1])
    return [one, one]


@pytest.fixture(scope="session")
def prepared(model, demo_set):
    """(steps, memory): the prepared steps of `demo_set` for `SMALL`, and its crops."""
    policy = Gem(SMALL, model)
    policy.remember(demo_set[1])
    return list(policy.prepare(demo_set[1])), policy.memory


@pytest.fixture(scope="session")
def trained(prepared, model, tmp_path_factory):
    """(policy, run): `SMALL`, trained with the seed 3, and the folder of its state. Both stay as they are."""
    steps, memory = prepared
    policy, run = Gem(SMALL, model, memory, seed=3), tmp_path_factory.mktemp("trained")
    train.train(policy, steps, seed=3, run=run)
    return policy, run


@pytest.fixture
def jobs_here(monkeypatch):
    """Jobs run in this process, without the seconds that others take to start: for what does not test processes."""
    monkeypatch.setattr(workers, "run_jobs", lambda run, jobs, *_, **__: [one for job in jobs for one in run(job)])


def pytest_addoption(parser):
    parser.addoption("--all-lessons-twice", action="store_true", help="run each lesson twice in one kernel")
    parser.addoption("--release", action="store_true", help="run the long tests, too, which have the mark release")


def pytest_collection_modifyitems(config, items):
    """Without ``--release``, the long tests are left out."""
    if not config.getoption("release"):
        left_out = [item for item in items if item.get_closest_marker("release")]
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=left_out)
    if config.getoption("all_lessons_twice"):
        _run_twice(items)


def _run_twice(items):
    """As with *Run All* twice: a second item for each cell of the lessons."""
    again = {}
    for item in items:
        if isinstance(item, IPyNbCell):
            name = item.name.replace("Cell", "Second run, cell")
            cell = copy.deepcopy(item.cell)  # nbval joins the stored outputs of a cell in place
            second = IPyNbCell.from_parent(
                item.parent, name=name, cell_num=item.cell_num, cell=cell, options=item.options
            )
            again.setdefault(item.parent, []).append(second)
    for lesson, second_run in again.items():
        last = max(i for i, item in enumerate(items) if item.parent is lesson)
        items[last + 1 : last + 1] = second_run
