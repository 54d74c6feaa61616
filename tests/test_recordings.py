"""Demonstrations that a person recorded: their folders, their checks, and a training on them without the simulator."""

import dataclasses
import json
import math
import shutil
import subprocess
import sys

import numpy as np
import pytest

from gem_lite import clip, demonstrations
from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.cli import main
from gem_lite.config import Config
from gem_lite.demonstrations import OWN_WORLD, Demonstration
from gem_lite.maps.crop_memory import step_events
from gem_lite.policies import checkpoints
from gem_lite.policies.gem_config import GemConfig
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.recordings import Recording
from gem_lite.se2 import Pose2, Workspace
from gem_lite.training import recorded_steps

SCENE = clip.DATA / "foreign-scenes" / "workbench"
SENTENCE = "put the red block in the blue bowl"
ACTION = PickPlace(Pose2(0.40, 0.25, math.radians(20)), Pose2(0.62, 0.36, math.radians(110)))


@pytest.fixture
def own(tmp_path):
    """Two episodes: the first of one step, the second of two."""
    observation = Observation.load(SCENE)
    folder = tmp_path / "bench"
    for name in ("episode-2/step-1", "episode-10/step-2", "episode-10/step-10"):
        Recording(observation, SENTENCE, ExpertAction(ACTION, math.pi / 2)).save(folder / name, 2e-4)
    return folder


def change(folder, **entries):
    """Change entries of a step's action.json; None takes one away."""
    path = folder / "action.json"
    content = json.loads(path.read_text()) | entries
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))


def test_a_recording_is_loaded_as_it_was_saved(own):
    loaded = Recording.load(own / "episode-2" / "step-1")
    assert loaded.sentence == SENTENCE and loaded.expert == ExpertAction(ACTION, math.pi / 2, 0)
    assert [view.camera.name for view in loaded.observation.views] == ["overhead", "left", "right"]


def test_an_episode_has_its_steps_in_the_order_of_their_numbers(own):
    change(own / "episode-10" / "step-10", sentence="put the green block in the yellow bowl")
    episode = Demonstration.load(own / "episode-10")
    assert (episode.task, episode.world, len(episode.steps)) == ("bench", OWN_WORLD, 2)
    assert [step.instruction for step in episode.steps] == [SENTENCE, "put the green block in the yellow bowl"]
    assert sum(step.reward for step in episode.steps) == 1
    assert step_events(episode.steps[0]) == [("pick", ACTION.pick), ("place", ACTION.place)]


def test_a_set_of_recorded_episodes_is_the_same_after_packing(own, tmp_path):
    assert recorded_steps.is_recorded(own) and not recorded_steps.is_recorded(SCENE.parent)
    packed = recorded_steps.pack(own, tmp_path / "packed", Workspace())
    assert not recorded_steps.is_recorded(tmp_path / "packed")
    assert [len(episode.steps) for episode in packed] == [1, 2], "episode-2 comes before episode-10"
    fresh = list(recorded_steps.read(own, Workspace()))
    for one, other in zip(fresh, packed, strict=True):
        assert (one.task, one.seed, one.world) == (other.task, other.seed, other.world)
        for a, b in zip(one.steps, other.steps, strict=True):
            assert a.expert == b.expert and a.instruction == b.instruction
            assert np.array_equal(a.observation.views[0].depth, b.observation.views[0].depth)


DAMAGES = {
    "lacks place": lambda step: change(step, place=None),
    "must have version 1, got 3": lambda step: change(step, version=3),
    "pick must have x, y (metres) and yaw (radians)": lambda step: change(step, pick={"x": 0.4, "y": 0.2}),
    "a finite number is needed, got '0.4'": lambda step: change(step, pick={"x": "0.4", "y": 0.2, "yaw": 0}),
    "pick_symmetry must be the smallest turn in radians": lambda step: change(step, pick_symmetry=90),
    "a text is needed, got ''": lambda step: change(step, sentence=""),
    "the pick at (1.400, 0.250) m lies outside the table": lambda step: change(
        step, pick={"x": 1.4, "y": 0.25, "yaw": 0}
    ),
    "does not begin with a known verb": lambda step: change(step, sentence="red block to blue bowl"),
    "is cut off or no JSON": lambda step: (step / "action.json").write_text("{"),
    "left.color.png is missing": lambda step: (step / "left.color.png").unlink(),
    "is cut off or no PNG": lambda step: (step / "left.depth.png").write_bytes(b"\x89PNG"),
}
"""By what the message says: what happens to a step."""


@pytest.mark.parametrize("message", DAMAGES)
def test_a_wrong_step_ends_the_training_in_one_sentence(message, own, capsys, tmp_path):
    DAMAGES[message](own / "episode-10" / "step-2")
    assert main(["train", str(own), str(tmp_path / "mine.safetensors"), "--state", str(tmp_path / "state")]) == 2
    printed = capsys.readouterr().err.strip().splitlines()[-1]
    assert message in printed and "step" in printed and "episode-10" in printed
    assert not (tmp_path / "mine.safetensors").exists()


def test_folders_that_hold_no_episode_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="is no folder"):
        Demonstration.load(tmp_path / "none")
    (tmp_path / "empty" / "episode").mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match="holds no recorded episode"):
        Demonstration.load(tmp_path / "empty" / "episode")
    with pytest.raises(FileNotFoundError, match="holds no recorded step"):
        Recording.load(SCENE)
    with pytest.raises(ValueError, match="must be a pick and place"):
        Recording(Observation.load(SCENE), SENTENCE, ExpertAction(Push(Pose2(0.4, 0), Pose2(0.5, 0))))


def test_a_rectangle_is_padded_to_what_networks_need():
    workspace = Workspace.covering(0.0, 0.61, -0.2, 0.2)
    assert workspace.shape == (64, 112)
    assert workspace.x_min + workspace.x_max == pytest.approx(0.61) and workspace.contains(0.0, 0.2)
    assert Workspace.covering(0.25, 0.75, -0.5, 0.5) == Workspace()
    for wrong in ((0.5, 0.5, 0, 1), (0.5, 0.25, 0, 1), (0, 1, 0, 600)):
        with pytest.raises(ValueError, match="rectangle's"):
            GemConfig.preset("lite").from_dict({"rectangle": list(wrong)})


def test_a_configuration_without_a_rectangle_keeps_its_old_name():
    plain = GemConfig.preset("lite")
    assert "rectangle" not in plain.as_dict()
    own = dataclasses.replace(plain, rectangle=(0.0, 0.6, -0.3, 0.3))
    assert own.workspace.shape == (96, 96) and own.digest != plain.digest
    assert GemConfig.from_dict(json.loads(json.dumps(own.as_dict()))) == own
    assert Config.preset("lite").workspace == Workspace()


def test_a_rectangle_is_refused_for_our_tasks(capsys, tmp_path):
    shipped = str(clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10")
    words = ["train", shipped, str(tmp_path / "a.safetensors"), "--config.rectangle", "0", "1", "0", "1"]
    assert main(words) == 2
    assert "cannot have a rectangle" in capsys.readouterr().err


def test_a_policy_is_trained_and_acts_without_the_simulator(own, tmp_path):
    shutil.rmtree(own / "episode-10" / "step-10")
    rectangle = ["0.20", "0.80", "-0.45", "0.45"]
    words = [
        "train", str(own), str(tmp_path / "mine.safetensors"), "--state", str(tmp_path / "state"), "--config.steps",
        "2", "--config.rectangle", *rectangle,
    ]  # fmt: skip
    program = f"""
import sys
sys.modules["pybullet"] = None  # so that its import fails
from gem_lite.cli import main
sys.exit(main({words!r}) or main(["look", {str(SCENE)!r}, {SENTENCE!r}, "--policy",
    {str(tmp_path / "mine.safetensors")!r}, "--out", {str(tmp_path / "look")!r}])
    or main(["check-cameras", {str(SCENE)!r}, "--out", {str(tmp_path / "look")!r}]))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "2 demonstrations" in done.stdout and "no mistake found" in done.stdout
    assert json.loads((tmp_path / "look" / "look.json").read_text())["action"] is not None
    assert not (tmp_path / "state" / "recorded").exists(), "what was packed for the training is taken away"
    card = checkpoints.read_card(tmp_path / "mine.safetensors")
    assert (card["task"], card["demonstrations_world"]) == ("bench", OWN_WORLD)
    policy = checkpoints.load_policy(tmp_path / "mine.safetensors", clip.load())
    assert policy.config.workspace.shape == (144, 96) and len(policy.memory.entries) == 4
    assert demonstrations.load(clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10")[0].world != OWN_WORLD
