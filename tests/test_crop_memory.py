import dataclasses
import math
import re

import numpy as np
import pytest
import torch

from gem_lite import tasks
from gem_lite.actions import GripperState, PickPlace
from gem_lite.maps.crop_memory import CropEntry, CropMemory, collect_crops, cut, events, numbered
from gem_lite.rgbd.heightmap import HeightMap, fuse_views
from gem_lite.se2 import Pose2, Workspace, wrap

SIDE = 0.125
WORKSPACE = Workspace()


def picture(seed, shape=(20, 20, 3)):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def entry(phrase="red block", image=None, task="t", episode=0):
    return CropEntry(phrase, picture(0) if image is None else image, task, episode)


@pytest.fixture(scope="module")
def memory(model):
    phrases = ["red block", "green bowl", "red block", "blue block"]
    return CropMemory([entry(phrase, picture(i), episode=i) for i, phrase in enumerate(phrases)], model)


# Events


@pytest.mark.parametrize(
    ("holding", "expected"),
    [
        ((0, 0, 1, 1, 1, 0, 0), {2: "pick", 5: "place"}),
        ((0, 1, 0, 0, 1, 1, 0), {1: "pick", 2: "place", 4: "pick", 6: "place"}),
        ((0, 0, 1, 1), {2: "pick"}), ((1, 1, 0), {2: "place"}), ((0, 0, 0), {}), ((1, 1), {}), ((), {}),
    ],
)  # fmt: skip
def test_events_are_the_edges_of_holding(holding, expected):
    trace = [GripperState(i / 10, -i / 10, i / 10, bool(held)) for i, held in enumerate(holding)]
    assert events(trace) == [(kind, Pose2(i / 10, -i / 10, i / 10)) for i, kind in expected.items()]


def test_a_demonstrations_events_lie_where_the_expert_acted(demo_set):
    for step in (step for demonstration in demo_set[1] for step in demonstration.steps):
        found = events(step.trace)
        assert [kind for kind, _ in found] == ["pick", "place"]
        for (_, pose), meant in zip(found, (step.expert.action.pick, step.expert.action.place), strict=True):
            assert math.hypot(pose.x - meant.x, pose.y - meant.y) < 0.005
            assert abs(wrap(pose.yaw - meant.yaw)) < math.radians(1)


def test_every_action_has_a_trace_of_its_own(demo_set, blind):
    # The second action grasps nothing: it has no event, the first one's included.
    demonstration = demo_set[1][0]
    action = demonstration.steps[0].expert.action
    blind.reset(tasks.make(demonstration.task, demonstration.split), demonstration.seed)
    grasping = blind.step(action)
    free = Pose2(0.3, 0.45)  # outside the objects' workspace: bare table
    missing = blind.step(PickPlace(free, action.place))
    assert (grasping.grasped, missing.grasped) == (True, False)
    assert [kind for kind, _ in events(grasping.trace)] == ["pick", "place"]
    assert events(missing.trace) == []
    assert min(math.hypot(state.x - free.x, state.y - free.y) for state in missing.trace) < 0.001  # it went there


# Crops


def test_a_crop_is_centred_and_stays_inside():
    rgb = picture(0, (*WORKSPACE.shape, 3))
    heightmap = HeightMap(WORKSPACE, rgb, np.zeros(WORKSPACE.shape, np.float32), np.ones(WORKSPACE.shape, bool))
    for x, y, expected in (
        (*WORKSPACE.to_world(80, 40), rgb[70:90, 30:50]),
        (WORKSPACE.x_min + 0.001, WORKSPACE.y_max - 0.001, rgb[:20, :20]),
        (WORKSPACE.x_max - 0.001, WORKSPACE.y_min + 0.001, rgb[-20:, -20:]),
    ):
        assert np.array_equal(cut(heightmap, Pose2(x, y), SIDE), expected)
    for x, side, name in ((0.5, 0.51, "side"), (0.5, 0.001, "side"), (0.2, SIDE, "x, y")):
        with pytest.raises(ValueError, match=name):
            cut(heightmap, Pose2(x, 0.0), side)


def test_crops_show_what_was_picked_and_where_it_was_placed(demo_set):
    entries = list(collect_crops(demo_set[1], WORKSPACE, SIDE))
    steps = [(number, step) for number, demo in enumerate(demo_set[1]) for step in demo.steps]
    for (number, step), pick, place in zip(steps, entries[::2], entries[1::2], strict=True):
        heightmap, action = fuse_views(step.observation.views, WORKSPACE), step.expert.action
        assert (pick.phrase, place.phrase) == (step.phrases.pick, step.phrases.place)
        assert pick.episode == place.episode == number
        assert np.array_equal(pick.image, cut(heightmap, action.pick, SIDE))
        assert np.array_equal(place.image, cut(heightmap, action.place, SIDE))


def test_crops_follow_the_gripper_and_not_the_experts_action(demo_set):
    step = demo_set[1][0].steps[0]

    def crops(**changes):
        changed = dataclasses.replace(demo_set[1][0], steps=(dataclasses.replace(step, **changes),))
        return [crop.image for crop in collect_crops([changed], WORKSPACE, SIDE)]

    elsewhere = dataclasses.replace(step.expert, action=PickPlace(Pose2(0.3, 0.4), Pose2(0.7, -0.4)))
    assert len(crops()) == 2 and np.array_equal(crops(expert=elsewhere), crops())
    moved = tuple(state._replace(x=state.x + 0.05) for state in step.trace)
    assert not np.array_equal(crops(trace=moved)[0], crops()[0])
    assert crops(trace=tuple(state._replace(holding=False) for state in step.trace)) == []

    others = [demo_set[1][0], dataclasses.replace(demo_set[1][0], task="other"), demo_set[1][1]]
    task = others[0].task
    assert [key for key, _ in numbered(others)] == [(task, 0), ("other", 0), (task, 1)], "each task numbers its own"


# Retrieval


def test_retrieval_finds_the_nearest_phrase_and_refuses_far_ones(memory, model):
    threshold = model.calibration.retrieval_threshold
    bowls, blocks, yellow = model.embed_texts(["green bowls", "blue blocks", "yellow bowls"])
    index, cosine = memory.find(bowls)
    assert index == 1 and cosine == pytest.approx(float(memory.keys[1] @ bowls), abs=1e-6) and cosine < 1
    found = memory.retrieve(blocks, threshold)
    assert torch.allclose(found, model.embed_images(picture(3)[None])[0], atol=1e-6)
    assert memory.retrieve(yellow, threshold) is None
    # The threshold is the cosine that is just enough.
    assert torch.equal(memory.retrieve(bowls, cosine), memory.values[1])
    assert memory.retrieve(bowls, math.nextafter(cosine, 1)) is None


def test_a_hidden_episode_is_not_retrieved(memory, model):
    query, bowl = model.embed_texts(["red block", "green bowl"])
    assert [memory.find(query, hidden)[0] for hidden in (None, ("t", 0), ("t", 1), ("sort", 0))] == [0, 2, 0, 0]
    assert memory.retrieve(bowl, 0.99) is not None and memory.retrieve(bowl, 0.99, hidden=("t", 1)) is None
    alone = CropMemory([entry(episode=7), entry("green bowl", episode=7)], model)
    assert alone.find(query, hidden=("t", 7)) is None
    assert alone.retrieve(query, -1.0, hidden=("t", 7)) is None
    tasks_apart = CropMemory([entry(task="pack"), entry(task="stack")], model)
    assert [tasks_apart.find(query, (task, 0))[0] for task in ("pack", "stack")] == [1, 0]


@pytest.mark.parametrize("count", [3, 101])
def test_of_equal_phrases_the_first_is_found(model, count):
    # A matrix product rounds its last rows another way, so the largest cosine alone would not do.
    tied = CropMemory([entry(episode=i) for i in range(count)], model)
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        query = torch.nn.functional.normalize(torch.randn(model.dim, generator=generator), dim=0)
        assert tied.find(query)[0] == 0
        assert tied.find(query, hidden=("t", 0))[0] == 1


def test_a_memory_comes_back_from_its_parts_by_any_clip(model):
    class Other:
        def embed_texts(self, phrases):
            return torch.tensor([[float(len(phrase)), 0.0] for phrase in phrases])

        def embed_images(self, images):
            return torch.from_numpy(images.mean(axis=(1, 2))[:, :2].copy())

    phrase = 'the "größte" 赤い block\n'
    memory = CropMemory([entry(phrase, picture(1, (7, 9, 3)), episode=3), entry(image=picture(2, (7, 9, 3)))], model)
    loaded = CropMemory.unpack(*memory.pack(), Other())
    for one, two in zip(memory.entries, loaded.entries, strict=True):
        assert (one.phrase, one.key) == (two.phrase, two.key) and np.array_equal(one.image, two.image)
    assert loaded.keys[:, 0].tolist() == [len(phrase), 9] and loaded.values.shape == (2, 2)


# Arguments


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        *(({"phrase": phrase}, "phrase must name") for phrase in ("", " \n", 3)),
        *(({"task": task}, "task must be the name") for task in ("", None)),
        *(({"episode": i}, "episode must be a number from 0 on") for i in (-1, 2**63, True, 1.0, "0", None)),
        *(
            ({"image": image}, r"image must be an \(H, W, 3\) uint8 picture, got \(")
            for image in (np.zeros((20, 20, 3), np.float32), *(picture(0, s) for s in ((4, 4), (4, 4, 4), (0, 4, 3))))
        ),
    ],
)
def test_a_wrong_crop_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        entry(**wrong)


def test_wrong_entries_and_queries_of_a_memory_are_refused(memory, model):
    with pytest.raises(ValueError, match="entries is empty"):
        CropMemory([], model)
    with pytest.raises(ValueError, match=r"entries .* one size, got \(20, 20, 3\), \(20, 21, 3\)"):
        CropMemory([entry(), entry(image=picture(0, (20, 21, 3)))], model)
    one = np.stack([picture(0)])
    for images, labels in (
        (one, None), (one, []), (one, [3]), (one, [{"phrase": "red block"}]),
        (one, [{"phrase": 3, "task": "t", "episode": 0}]), (np.array(3, np.uint8), [{"phrase": "red", "episode": 0}]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"labels? must|phrase must"):
            CropMemory.unpack(images, labels, model)
    for shape in ((), (model.dim + 1,), (model.dim, 1), (1, model.dim)):
        with pytest.raises(ValueError, match=re.escape(f"query must have shape ({model.dim},), got {shape}")):
            memory.retrieve(torch.zeros(shape), 0.5)
    for threshold in (-1.01, 1.01, math.nan):
        with pytest.raises(ValueError, match=r"threshold must be a cosine in \[-1, 1\], got "):
            memory.retrieve(torch.zeros(model.dim), threshold)
