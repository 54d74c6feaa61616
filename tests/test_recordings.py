"""Demonstrations that a person recorded: their folders, their checks, and a training on them without the simulator."""

import dataclasses
import json
import math
import re
import shutil
import subprocess
import sys

import pytest

from gem_lite import clip, demonstrations
from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.cli import main
from gem_lite.config import Config
from gem_lite.demonstrations import OWN_WORLD, Demonstration, DemonstrationStep
from gem_lite.maps.crop_memory import step_events
from gem_lite.policies import checkpoints
from gem_lite.policies.gem_config import GemConfig
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, Workspace
from gem_lite.training import folders

SCENE = clip.DATA / "foreign-scenes" / "workbench"
SENTENCE = "put the red block in the blue bowl"
ACTION = PickPlace(Pose2(0.40, 0.25, math.radians(20)), Pose2(0.62, 0.36, math.radians(110)))


@pytest.fixture(scope="module")
def observation():
    return Observation.load(SCENE)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, observation):
    folder = tmp_path_factory.mktemp("recorded")
    DemonstrationStep(observation, SENTENCE, ExpertAction(ACTION, math.pi / 2)).save(folder, 2e-4)
    return folder


@pytest.fixture
def own(tmp_path, recorded):
    """Two episodes, free to be damaged: the first of one step, the second of two."""
    for name in ("episode-2/step-1", "episode-10/step-2", "episode-10/step-10"):
        shutil.copytree(recorded, tmp_path / "bench" / name)
    return tmp_path / "bench"


def change(folder, **entries):
    """Change entries of a step's action.json; None takes one away."""
    path = folder / "action.json"
    content = json.loads(path.read_text()) | entries
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))


def test_recorded_episodes_are_a_set_in_the_order_of_their_numbers(own):
    other = "put the green block in the yellow bowl"
    change(own / "episode-10" / "step-10", sentence=other)
    (first, second) = demonstrations.load(own)
    assert [step.instruction for step in (*first.steps, *second.steps)] == [SENTENCE, SENTENCE, other]
    for episode in (first, second):
        assert (episode.task, episode.split, episode.world) == ("bench", "train", OWN_WORLD)
        assert sum(step.reward for step in episode.steps) == 1
    assert first.steps[0].expert == ExpertAction(ACTION, math.pi / 2, 0)
    assert [view.camera.name for view in first.steps[0].observation.views] == ["overhead", "left", "right"]
    assert step_events(first.steps[0]) == [("pick", ACTION.pick), ("place", ACTION.place)]
    assert demonstrations.load(own)[:1].digest != demonstrations.load(own).digest


def test_a_file_with_the_needed_entries_alone_is_enough_and_a_push_can_be_recorded(own):
    step = own / "episode-2" / "step-1"
    change(step, kind=None, pick_table=None, place_table=None, place_symmetry=None, reward=None, trace=None)
    assert DemonstrationStep.load(step).expert == ExpertAction(ACTION, math.pi / 2)
    pose = {"x": 0.4, "y": 0.2, "yaw": 0.0}
    change(step, kind="push", start=pose, end=pose | {"x": 0.5}, pick=None, place=None)
    assert DemonstrationStep.load(step).expert.action == Push(Pose2(0.4, 0.2), Pose2(0.5, 0.2))


DAMAGES = {
    "it lacks place": lambda step: change(step, place=None),
    "it lacks end": lambda step: change(step, kind="push", start={"x": 0.4, "y": 0.2, "yaw": 0.0}),
    "kind must be 'pick-place' or 'push', got 'throw'": lambda step: change(step, kind="throw"),
    "pick lacks yaw": lambda step: change(step, pick={"x": 0.4, "y": 0.2}),
    "pick_symmetry must be the smallest turn in radians": lambda step: change(step, pick_symmetry=90),
    "sentence must have at least 1 character, got ''": lambda step: change(step, sentence=""),
    "trace 0 3 must be a valid boolean, got 7": lambda step: change(step, trace=[[0.1, 0.2, 0.0, 7]]),
    "the pick at (1.400, 0.200) m lies outside": lambda step: change(step, pick={"x": 1.4, "y": 0.2, "yaw": 0}),
    "does not begin with a known verb": lambda step: change(step, sentence="red block to blue bowl"),
    "action.json is cut off or no JSON": lambda step: (step / "action.json").write_text("{"),
    "holds no recorded step: there is no action.json": lambda step: (step / "action.json").unlink(),
    "left.color.png is missing": lambda step: (step / "left.color.png").unlink(),
}
"""By what the message says: what happens to a step."""


@pytest.mark.parametrize("message", DAMAGES)
def test_a_wrong_step_is_refused_in_one_sentence(message, own):
    DAMAGES[message](own / "episode-10" / "step-2")
    with pytest.raises((ValueError, FileNotFoundError), match=re.escape(message)) as caught:
        folders.check_recorded(demonstrations.load(own), GemConfig.preset("lite"))
    said = str(caught.value)
    assert "step" in said and "episode-10" in said and "\n" not in said


def test_a_wrong_step_or_a_rectangle_for_our_tasks_ends_the_training(own, capsys, tmp_path):
    change(own / "episode-10" / "step-2", sentence="red block to blue bowl")
    assert main(["train", str(own), str(tmp_path / "mine.safetensors"), "--state", str(tmp_path / "state")]) == 2
    printed = capsys.readouterr().err.strip().splitlines()[-1]
    assert "episode-10, step 0: " in printed and "does not begin with a known verb" in printed
    assert not (tmp_path / "mine.safetensors").exists()
    shipped = str(clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10")
    words = ["train", shipped, str(tmp_path / "a.safetensors"), "--config.rectangle", "0", "1", "0", "1"]
    assert main(words) == 2
    assert "cannot have a rectangle" in capsys.readouterr().err


def test_folders_that_hold_no_episode_are_refused(tmp_path, observation):
    with pytest.raises(FileNotFoundError, match="is no folder"):
        Demonstration.load(tmp_path / "none")
    (tmp_path / "empty" / "episode").mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match="holds no recorded episode"):
        Demonstration.load(tmp_path / "empty" / "episode")
    with pytest.raises(FileNotFoundError, match="holds no demonstrations"):
        demonstrations.load(SCENE.parent)
    with pytest.raises(ValueError, match="the sentence is empty"):
        DemonstrationStep(observation, " ", ExpertAction(ACTION))


def test_a_rectangle_is_padded_to_what_networks_need_and_changes_no_other_configuration():
    workspace = Workspace.covering(0.0, 0.61, -0.2, 0.2)
    assert workspace.shape == (64, 112)
    assert workspace.x_min + workspace.x_max == pytest.approx(0.61) and workspace.contains(0.0, 0.2)
    assert Workspace.covering(0.25, 0.75, -0.5, 0.5) == Workspace()
    for wrong in ((0.5, 0.5, 0, 1), (0.5, 0.25, 0, 1), (0, 1, 0, 600)):
        with pytest.raises(ValueError, match="rectangle's"):
            GemConfig.preset("lite").from_dict({"rectangle": list(wrong)})
    plain = GemConfig.preset("lite")
    assert "rectangle" not in plain.as_dict()
    own = dataclasses.replace(plain, rectangle=(0.0, 0.6, -0.3, 0.3))
    assert own.workspace.shape == (96, 96) and own.digest != plain.digest
    assert GemConfig.from_dict(json.loads(json.dumps(own.as_dict()))) == own
    assert Config.preset("lite").workspace == Workspace()


@pytest.mark.release
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
    card = checkpoints.read_card(tmp_path / "mine.safetensors")
    assert (card["task"], card["demonstrations_world"]) == ("bench", OWN_WORLD)
    assert card["data_sha256"] == demonstrations.load(own).digest
    policy = checkpoints.load_policy(tmp_path / "mine.safetensors", clip.load())
    assert policy.config.workspace.shape == (144, 96) and len(policy.memory.entries) == 4
