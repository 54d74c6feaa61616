import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy
import torch

from gem_lite import clip, tasks
from gem_lite.actions import PickPlace
from gem_lite.demonstrations import GripperState
from gem_lite.maps.crop_memory import CropEntry, CropMemory, collect_crops, cut, events, numbered
from gem_lite.rgbd.heightmap import HeightMap, fuse_views
from gem_lite.se2 import Pose2, Workspace, wrap

SIDE = 0.125
WORKSPACE = Workspace()


@pytest.fixture(scope="module")
def model():
    return clip.load()


def picture(seed, shape=(20, 20, 3)):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


@pytest.fixture(scope="module")
def memory(model):
    phrases = ["red block", "green bowl", "red block", "blue block"]
    return CropMemory([CropEntry(phrase, picture(i), "t", i) for i, phrase in enumerate(phrases)], model)


@pytest.fixture(scope="module")
def heightmap():
    """Every cell has a colour of its own."""
    rgb = picture(0, (*WORKSPACE.shape, 3))
    height, seen = np.zeros(WORKSPACE.shape, np.float32), np.ones(WORKSPACE.shape, bool)
    return HeightMap(WORKSPACE, rgb, height, seen)


# Events --------------------------------------------------------------------------------------------------


def states(*holding):
    """A gripper that moves by 0.1 m and 0.1 radians a state."""
    return [GripperState(i / 10, -i / 10, i / 10, bool(held)) for i, held in enumerate(holding)]


def event(kind, number):
    return kind, Pose2(number / 10, -number / 10, number / 10)


@pytest.mark.parametrize(
    ("trace", "expected"),
    [
        (states(0, 0, 1, 1, 1, 0, 0), [event("pick", 2), event("place", 5)]),
        (states(0, 1, 0, 0, 1, 1, 0), [event("pick", 1), event("place", 2), event("pick", 4), event("place", 6)]),
        (states(0, 0, 1, 1), [event("pick", 2)]),
        (states(1, 1, 0), [event("place", 2)]),
        (states(0, 0, 0), []),
        (states(1, 1), []),
        (states(), []),
    ],
    ids=["pick and place", "two picks", "ends while holding", "begins while holding", "never closes", "holds", "empty"],
)
def test_events_are_the_edges_of_holding(trace, expected):
    assert events(trace) == expected


def test_a_demonstrations_events_lie_where_the_expert_acted(demo_set):
    for demonstration in demo_set[1]:
        for step in demonstration.steps:
            found = events(step.trace)
            assert [kind for kind, _ in found] == ["pick", "place"]
            for (_, pose), meant in zip(found, (step.expert.action.pick, step.expert.action.place), strict=True):
                assert math.hypot(pose.x - meant.x, pose.y - meant.y) < 0.005
                assert abs(wrap(pose.yaw - meant.yaw)) < math.radians(1)


def test_every_action_has_a_trace_of_its_own(demo_set, world):
    # The second action grasps nothing: it has no event, the first one's included.
    demonstration = demo_set[1][0]
    action = demonstration.steps[0].expert.action
    world.reset(tasks.make(demonstration.task, demonstration.split), demonstration.seed)
    grasping = world.step(action)
    free = Pose2(0.3, 0.45)  # outside the objects' workspace: bare table
    missing = world.step(PickPlace(free, action.place))
    assert (grasping.grasped, missing.grasped) == (True, False)
    assert [kind for kind, _ in events(grasping.trace)] == ["pick", "place"]
    assert events(missing.trace) == []
    assert min(math.hypot(state.x - free.x, state.y - free.y) for state in missing.trace) < 0.001  # it went there


# Crops ---------------------------------------------------------------------------------------------------


def test_crop_is_centred_and_stays_inside(heightmap):
    x, y = WORKSPACE.to_world(80, 40)
    assert np.array_equal(cut(heightmap, Pose2(x, y), SIDE), heightmap.rgb[70:90, 30:50])
    corner = Pose2(WORKSPACE.x_min + 0.001, WORKSPACE.y_max - 0.001)
    assert np.array_equal(cut(heightmap, corner, SIDE), heightmap.rgb[:20, :20])
    corner = Pose2(WORKSPACE.x_max - 0.001, WORKSPACE.y_min + 0.001)
    assert np.array_equal(cut(heightmap, corner, SIDE), heightmap.rgb[-20:, -20:])


@pytest.mark.parametrize(("x", "side", "name"), [(0.5, 0.51, "side"), (0.5, 0.001, "side"), (0.2, SIDE, "x, y")])
def test_crops_that_do_not_exist_are_refused(heightmap, x, side, name):
    with pytest.raises(ValueError, match=name):
        cut(heightmap, Pose2(x, 0.0), side)


@pytest.fixture(scope="module")
def heightmaps(demo_set):
    return [fuse_views(step.observation.views, WORKSPACE) for demo in demo_set[1] for step in demo.steps]


def test_crops_show_what_was_picked_and_where_it_was_placed(demo_set, heightmaps):
    entries = collect_crops(demo_set[1], heightmaps, SIDE)
    steps = [(number, step) for number, demo in enumerate(demo_set[1]) for step in demo.steps]
    assert len(entries) == 2 * len(steps)
    for (number, step), heightmap, pick, place in zip(steps, heightmaps, entries[::2], entries[1::2], strict=True):
        action = step.expert.action
        assert (pick.phrase, place.phrase) == (step.phrases.pick, step.phrases.place)
        assert pick.episode == place.episode == number
        assert np.array_equal(pick.image, cut(heightmap, action.pick, SIDE))
        assert np.array_equal(place.image, cut(heightmap, action.place, SIDE))


def test_crops_follow_the_gripper_and_not_the_experts_action(demo_set, heightmaps):
    demonstration = demo_set[1][0]
    step = demonstration.steps[0]
    elsewhere = dataclasses.replace(step.expert, action=PickPlace(Pose2(0.3, 0.4), Pose2(0.7, -0.4)))
    lied = dataclasses.replace(demonstration, steps=(dataclasses.replace(step, expert=elsewhere),))
    honest = dataclasses.replace(demonstration, steps=(step,))
    there, here = (collect_crops([demo], heightmaps[:1], SIDE) for demo in (lied, honest))
    assert len(there) == len(here) == 2
    for one, two in zip(there, here, strict=True):
        assert np.array_equal(one.image, two.image)
    moved = tuple(state._replace(x=state.x + 0.05) for state in step.trace)
    shifted = dataclasses.replace(demonstration, steps=(dataclasses.replace(step, trace=moved),))
    assert not np.array_equal(collect_crops([shifted], heightmaps[:1], SIDE)[0].image, here[0].image)


def test_a_step_without_an_event_gives_no_crop(demo_set, heightmaps):
    first, second = demo_set[1]
    idle = tuple(
        dataclasses.replace(step, trace=tuple(state._replace(holding=False) for state in step.trace))
        for step in first.steps
    )
    entries = collect_crops([dataclasses.replace(first, steps=idle), second], heightmaps, SIDE)
    assert [entry.episode for entry in entries] == [1] * 2 * len(second.steps)


def test_another_number_of_height_maps_is_refused(demo_set, heightmaps):
    with pytest.raises(ValueError, match=f"heightmaps must be one for each of {len(heightmaps)} steps, got 1"):
        collect_crops(demo_set[1], heightmaps[:1], SIDE)


# Retrieval -----------------------------------------------------------------------------------------------


def test_retrieval_finds_the_nearest_phrase_and_refuses_far_ones(memory, model):
    threshold = model.calibration.retrieval_threshold
    assert memory.find(model.embed_texts(["green bowls"])[0])[0] == 1
    found = memory.retrieve(model.embed_texts(["blue blocks"])[0], threshold)
    assert torch.allclose(found, model.embed_images(picture(3)[None])[0], atol=1e-6)
    assert memory.retrieve(model.embed_texts(["yellow bowls"])[0], threshold) is None


def test_the_threshold_is_the_cosine_that_is_just_enough(memory, model):
    query = model.embed_texts(["green bowls"])[0]
    cosine = memory.find(query)[1]
    assert cosine == pytest.approx(float(memory.keys[1] @ query), abs=1e-6) and cosine < 1
    assert torch.equal(memory.retrieve(query, cosine), memory.values[1])
    assert memory.retrieve(query, math.nextafter(cosine, 1)) is None


def test_a_hidden_episode_is_not_retrieved(memory, model):
    query = model.embed_texts(["red block"])[0]
    assert memory.find(query)[0] == 0
    assert memory.find(query, hidden=("t", 0))[0] == 2
    assert memory.find(query, hidden=("t", 1))[0] == 0
    bowl = model.embed_texts(["green bowl"])[0]
    assert memory.retrieve(bowl, 0.99) is not None
    assert memory.retrieve(bowl, 0.99, hidden=("t", 1)) is None


def test_a_memory_of_one_hidden_episode_retrieves_nothing(model):
    alone = CropMemory([CropEntry("red block", picture(0), "t", 7), CropEntry("green bowl", picture(1), "t", 7)], model)
    query = model.embed_texts(["red block"])[0]
    assert alone.find(query, hidden=("t", 7)) is None
    assert alone.retrieve(query, -1.0, hidden=("t", 7)) is None


@pytest.mark.parametrize("count", [3, 7, 1001])
def test_of_equal_phrases_the_first_is_found(model, count):
    # A matrix product rounds its last rows another way, so the largest cosine alone would not do.
    tied = CropMemory([CropEntry("red block", picture(0), "t", i) for i in range(count)], model)
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        query = torch.nn.functional.normalize(torch.randn(model.dim, generator=generator), dim=0)
        assert tied.find(query)[0] == 0
        assert tied.find(query, hidden=("t", 0))[0] == 1


# Files ---------------------------------------------------------------------------------------------------


@pytest.fixture
def saved(memory, tmp_path):
    path = tmp_path / "crops.safetensors"
    memory.save(path)
    return path


def test_what_was_saved_is_loaded(memory, saved, model):
    loaded = CropMemory.load(saved, model)
    for one, two in zip(memory.entries, loaded.entries, strict=True):
        assert (one.phrase, one.key) == (two.phrase, two.key)
        assert np.array_equal(one.image, two.image) and two.image.dtype == np.uint8
    for phrase in ("red blocks", "a green bowl", "blue block", "white bowl"):
        query = model.embed_texts([phrase])[0]
        assert loaded.find(query) == memory.find(query)
        assert torch.equal(loaded.retrieve(query, -1.0), memory.retrieve(query, -1.0))
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_a_memory_is_embedded_by_the_clip_that_loads_it(memory, saved):
    class Other:
        def embed_texts(self, phrases):
            return torch.tensor([[float(len(phrase)), 0.0] for phrase in phrases])

        def embed_images(self, images):
            return torch.from_numpy(images.mean(axis=(1, 2))[:, :2].copy())

    loaded = CropMemory.load(saved, Other())
    assert loaded.keys[:, 0].tolist() == [len(entry.phrase) for entry in memory.entries]
    assert loaded.values.shape == (4, 2)


def test_phrases_of_any_script_survive(model, tmp_path):
    phrase = 'the "größte" 赤い block\n'
    CropMemory([CropEntry(phrase, picture(0, (7, 9, 3)), "t", 3)], model).save(tmp_path / "one.safetensors")
    (entry,) = CropMemory.load(tmp_path / "one.safetensors", model).entries
    assert (entry.phrase, entry.episode, entry.image.shape) == (phrase, 3, (7, 9, 3))


def test_saving_again_replaces_the_file(memory, saved, model):
    CropMemory(memory.entries[:1], model).save(saved)
    assert len(CropMemory.load(saved, model).entries) == 1


def test_a_missing_memory_is_named(model, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.safetensors"):
        CropMemory.load(tmp_path / "nowhere.safetensors", model)


@pytest.mark.parametrize("kept", [0, 5, 100, -1])
def test_a_memory_that_is_cut_off(saved, model, kept):
    saved.write_bytes(saved.read_bytes()[:kept])
    with pytest.raises(ValueError, match=r"crops\.safetensors is cut off or no crop memory"):
        CropMemory.load(saved, model)


def test_no_flipped_bit_goes_unseen(saved, model):
    content = saved.read_bytes()
    header = 8 + int.from_bytes(content[:8], "little")
    for place in (*range(header), header, len(content) - 1):
        changed = bytearray(content)
        changed[place] ^= 1
        saved.write_bytes(changed)
        with pytest.raises(ValueError, match=r"crops\.safetensors"):
            CropMemory.load(saved, model)


def test_a_crop_given_another_phrase(saved, model):
    content = saved.read_bytes()
    saved.write_bytes(content.replace(b"green bowl", b"green bell"))
    with pytest.raises(ValueError, match=r"crops\.safetensors was changed or is no crop memory: its SHA-256"):
        CropMemory.load(saved, model)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a text, and a rather long one" * 10, "cut off or no crop memory"),
        (safetensors.numpy.save({"weights": np.zeros(3)}), "cut off or no crop memory"),
        (safetensors.numpy.save({"images": np.zeros((2, 4, 4, 3), np.uint8)}), "changed or is no crop memory"),
    ],
    ids=["text", "weights", "pictures alone"],
)
def test_files_of_another_kind(tmp_path, model, content, message):
    path = tmp_path / "other.safetensors"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"other\.safetensors.*{message}"):
        CropMemory.load(path, model)


def test_an_interrupted_save_leaves_the_old_file(memory, saved, model, monkeypatch):
    write = Path.write_bytes

    def interrupted(self, content):
        write(self, content[: len(content) // 2])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        CropMemory(memory.entries[:1], model).save(saved)
    assert len(CropMemory.load(saved, model).entries) == 4


# Arguments -----------------------------------------------------------------------------------------------


def test_an_empty_memory_is_refused(model):
    with pytest.raises(ValueError, match="entries is empty"):
        CropMemory([], model)


def test_pictures_of_unequal_size_are_refused(model):
    entries = [CropEntry("red block", picture(0), "t", 0), CropEntry("red block", picture(0, (20, 21, 3)), "t", 0)]
    with pytest.raises(ValueError, match=r"entries .* one size, got \(20, 20, 3\), \(20, 21, 3\)"):
        CropMemory(entries, model)


@pytest.mark.parametrize(
    "image",
    [np.zeros((20, 20, 3), np.float32), picture(0, (20, 20)), picture(0, (20, 20, 4)), picture(0, (0, 20, 3))],
    ids=["dtype", "grey", "four channels", "empty"],
)
def test_what_is_no_picture_is_refused(image):
    with pytest.raises(ValueError, match=r"image must be an \(H, W, 3\) uint8 picture, got \("):
        CropEntry("red block", image, "t", 0)


@pytest.mark.parametrize("phrase", ["", " \n"])
def test_an_empty_phrase_is_refused(phrase):
    with pytest.raises(ValueError, match="phrase must name"):
        CropEntry(phrase, picture(0), "t", 0)


def test_a_query_of_another_shape_is_refused(memory, model):
    for shape in ((), (model.dim + 1,), (model.dim, 1), (1, model.dim)):
        with pytest.raises(ValueError, match=re.escape(f"query must have shape ({model.dim},), got {shape}")):
            memory.retrieve(torch.zeros(shape), 0.5)


@pytest.mark.parametrize("threshold", [-1.01, 1.01, math.nan])
def test_a_threshold_that_is_no_cosine_is_refused(memory, model, threshold):
    with pytest.raises(ValueError, match=r"threshold must be a cosine in \[-1, 1\], got "):
        memory.retrieve(model.embed_texts(["red block"])[0], threshold)


@pytest.mark.parametrize("episode", [-1, 2**63, True, 1.0, "0", None])
def test_an_episode_that_is_no_number_is_refused(episode):
    with pytest.raises(ValueError, match="episode must be a number from 0 on"):
        CropEntry("red block", picture(0), "t", episode)


@pytest.mark.parametrize(
    "labels", [None, [], [3], [{"phrase": "red block"}], [{"phrase": 3, "task": "t", "episode": 0}]]
)
def test_labels_that_pack_never_made_are_refused(model, labels):
    with pytest.raises(ValueError, match=r"labels? must|phrase must"):
        CropMemory.unpack(np.stack([picture(0)]), labels, model)


def test_pictures_without_a_dimension_are_refused(model):
    with pytest.raises(ValueError, match="labels must be one for each of 0 pictures"):
        CropMemory.unpack(np.array(3, np.uint8), [{"phrase": "red block", "episode": 0}], model)


def test_tasks_share_a_memory_without_hiding_each_other(model):
    entries = [CropEntry("red block", picture(i), task, 0) for i, task in enumerate(("pack", "stack"))]
    memory = CropMemory(entries, model)
    query = model.embed_texts(["red block"])[0]
    assert memory.find(query, ("pack", 0))[0] == 1 and memory.find(query, ("stack", 0))[0] == 0
    assert memory.find(query, ("sort", 0))[0] == 0, "an episode without crops hides nothing"


def test_each_task_numbers_its_own_episodes(demo_set):
    first, second = demo_set[1]
    other = dataclasses.replace(first, task="other")
    keys = [key for key, _ in numbered([first, other, second])]
    assert keys == [(first.task, 0), ("other", 0), (first.task, 1)]
