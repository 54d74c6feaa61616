"""What a robot's own program gets: poses in its base's frame, confidence, runner-up; and CLIPort's dictionaries."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from docs import cliport_bridge
from gem_lite import clip
from gem_lite.actions import PickPlace, Push
from gem_lite.policies import robot_plan
from gem_lite.policies.choosing import Choice
from gem_lite.rgbd.camera import Camera
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, Workspace
from gem_lite.tasks.assembling_kits import location

SCENE = clip.DATA / "foreign-scenes" / "workbench"
SENTENCE = "put the red block in the blue bowl"
WORKSPACE = Workspace()


def choice_of(logits, action, cell):
    """A choice on an empty table whose height grows with the rows."""
    height = np.linspace(0, 0.1, WORKSPACE.shape[0], dtype=np.float32)[:, None].repeat(WORKSPACE.shape[1], axis=1)
    rgb = np.zeros((*WORKSPACE.shape, 3), np.uint8)
    heightmap = HeightMap(WORKSPACE, rgb, height, np.ones(WORKSPACE.shape, bool))
    return Choice("", None, heightmap, logits, logits, cell, cell, action)


def at(row, col, yaw=0.0):
    return Pose2(*WORKSPACE.to_world(row, col), yaw)


def logits_with(peaks):
    """(36, H, W) logits of -30, and at some (angle, row, col) others."""
    logits = np.full((36, *WORKSPACE.shape), -30.0)
    for cell, value in peaks.items():
        logits[cell] = value
    return logits


@pytest.fixture(scope="module")
def choice():
    """At a cell and elsewhere, with equal logits."""
    return choice_of(logits_with({}), PickPlace(at(80, 40), at(10, 20)), (0, 80, 40))


def test_a_pose_has_the_maps_height_and_turns_into_the_base():
    pick = at(80, 40, np.pi / 6)
    choice = choice_of(logits_with({(3, 80, 40): 0.0}), PickPlace(pick, at(10, 20)), (3, 80, 40))
    found = robot_plan.plan(choice)
    assert found.pick[:3, 3] == pytest.approx([pick.x, pick.y, choice.heightmap.height[80, 40]])
    assert found.pick[:3, 2] == pytest.approx([0, 0, -1]), "the tool's z axis points down"
    assert found.pick[:3, 0] == pytest.approx([np.cos(np.pi / 6), np.sin(np.pi / 6), 0]), "its x axis is at the yaw"
    base = np.eye(4)
    base[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    base[:3, 3] = 1.0, 2.0, 3.0
    turned = robot_plan.plan(choice, base)
    assert turned.pick[:3, 3] == pytest.approx([1 - pick.y, 2 + pick.x, 3 + choice.heightmap.height[80, 40]])
    assert np.allclose(turned.place, base @ found.place)
    with pytest.raises(ValueError, match="must be a pick and place"):
        robot_plan.plan(choice_of(choice.pick_logits, Push(pick, pick), (3, 80, 40)))


def test_what_the_policy_wanted_where_no_camera_saw_is_told():
    logits = logits_with({(3, 80, 40): np.log(3.0), (5, 20, 10): 0.0})  # 0.75 and 0.25 of the probability
    chosen = choice_of(logits, PickPlace(at(80, 40), at(80, 40)), (3, 80, 40))
    seen = np.ones(WORKSPACE.shape, bool)
    seen[:32, :16] = False
    hidden = replace(chosen, heightmap=replace(chosen.heightmap, seen=seen), place_logits=logits_with({(0, 0, 0): 0.0}))
    found = robot_plan.plan(hidden)
    assert found.unseen_pick == pytest.approx(0.25, abs=1e-3) and found.unseen_place == pytest.approx(1.0, abs=1e-3)
    assert found.seen == pytest.approx(1 - 32 * 16 / seen.size)
    everything = robot_plan.plan(chosen)
    assert (everything.seen, everything.unseen_pick, everything.unseen_place) == (1.0, 0.0, 0.0)


def test_confidence_counts_what_lies_near_and_the_runner_up_lies_elsewhere():
    near, far = (7, 81, 41), (20, 30, 60)
    peaks = {(3, 80, 40): np.log(0.5), near: np.log(0.2), far: np.log(0.3)}
    found = robot_plan.plan(choice_of(logits_with(peaks), PickPlace(at(80, 40), at(10, 20)), (3, 80, 40)))
    assert found.confidence == pytest.approx(0.7, abs=0.001)
    expected = at(30, 60)
    assert (found.runner_up.x, found.runner_up.y) == (expected.x, expected.y)
    assert found.runner_up.yaw == pytest.approx(20 * 2 * np.pi / 36)
    assert found.lead == pytest.approx(0.5 / 0.3)


def test_the_shipped_policy_is_sure_of_a_block_and_knows_another(multi):
    choice = multi.decide(Observation.load(SCENE), SENTENCE)
    found = robot_plan.plan(choice)
    assert np.allclose(found.pick[:2, 3], [0.40, 0.25], atol=0.02) and 0.03 < found.pick[2, 3] < 0.06
    assert found.confidence > 0.9 and found.lead > 10
    assert np.hypot(found.runner_up.x - choice.action.pick.x, found.runner_up.y - choice.action.pick.y) >= 0.05


def test_cliports_dictionaries_say_the_same():
    ours = Observation.load(SCENE)
    cameras = [
        {
            "intrinsics": view.camera.matrix.ravel().tolist(),
            "position": view.camera.position.tolist(),
            "rotation": Rotation.from_matrix(view.camera.rotation).as_quat().tolist(),
        }
        for view in ours.views
    ]
    dictionary = {"color": [view.rgb for view in ours.views], "depth": [view.depth for view in ours.views]}
    theirs = cliport_bridge.from_cliport(dictionary, cameras)
    for old, new in zip(ours.views, theirs.views, strict=True):
        assert np.allclose(old.camera.pose, new.camera.pose) and np.array_equal(old.rgb, new.rgb)
    action = PickPlace(at(80, 40, 0.5), at(10, 20, 0.8))
    pair = cliport_bridge.to_cliport(action, choice_of(logits_with({}), action, (0, 80, 40)).heightmap)
    (_, first), (position, second) = pair["pose0"], pair["pose1"]
    assert position[:2] == (action.place.x, action.place.y)
    assert Rotation.from_quat(first).as_euler("xyz")[2] == 0
    assert Rotation.from_quat(second).as_euler("xyz")[2] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("put the red star in the top star hole", "put the red star in the left star hole"),
        ("put the blue letter T shape in the right letter T shape hole",
         "put the blue letter T shape in the top letter T shape hole"),
        ("put the blue ring in the middle ring hole", "put the blue ring in the middle ring hole"),
        ("put the blue ring in the ring hole", "put the blue ring in the ring hole"),
        ("align the rope from back right corner to back left corner",
         "align the rope from back left corner to back right corner"),
        ("put the red block in the left bowl", "put the red block in the left bowl"),
    ],
)  # fmt: skip
def test_cliports_sentences_are_read_in_our_words(theirs, ours):
    assert cliport_bridge.read_cliport(theirs) == ours


def test_the_bridges_words_for_holes_are_those_of_the_two_frames():
    """CLIPort's rule for a hole's word (its x and y take the other's part), for two holes in eight directions."""
    for angle in np.arange(8) * np.pi / 4 + 0.1:
        x, y = np.cos(angle), np.sin(angle)
        vertical = abs(x) > abs(y)
        theirs = ("top" if x < 0 else "bottom") if vertical else ("left" if y < 0 else "right")
        hole, twin = Pose2(x, y), Pose2(0.0, 0.0)
        assert cliport_bridge.HOLES[theirs] == location(hole, [twin])


@pytest.mark.parametrize(
    "wrong",
    [
        np.diag([2.0, 1, 1, 1]),
        np.diag([1.0, 1, -1, 1]),
        np.diag([-1.0, -1, -1, 1]),
        np.where(np.eye(4, dtype=bool), 1.0, np.nan),
        np.array([[1, 0, 0, np.inf], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 5, 5, 9]]),
        np.eye(3),
        [[1, 0], [0]],
        "no pose",
        [[10**400] * 4] * 4,
    ],
    ids=["scale", "mirror", "point", "nan", "inf", "last row", "size", "ragged", "text", "huge"],
)
def test_what_is_no_pose_is_refused(wrong, choice):
    with pytest.raises(ValueError, match=r"base_from_table must be a \(4, 4\) pose: a rotation \(no refl") as caught:
        robot_plan.plan(choice, wrong)
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="pose of camera 'front' must be a"):
        Camera("front", np.diag([450.0, 450, 1]), wrong, (8, 8))


@pytest.mark.parametrize("wrong", [np.diag([1.0, 1, -1]), np.zeros((3, 3)), np.full((3, 3), np.nan), np.eye(4)])
def test_what_is_no_rotation_of_the_tool_is_refused(wrong, choice):
    with pytest.raises(ValueError, match=r"tool must be a \(3, 3\) rotation, and no reflection"):
        robot_plan.plan(choice, tool=wrong)


@pytest.mark.parametrize("wrong", [(0, 450, 1), (450, -450, 1), (450, 450, 2), (450, np.nan, 1), (450, 450)])
def test_intrinsics_of_no_camera_are_refused(wrong):
    with pytest.raises(ValueError, match="intrinsics of camera 'front' must be"):
        Camera("front", np.diag(wrong), np.eye(4), (8, 8))


CLIPORTS_CAMERA = {"intrinsics": (450.0, 0, 4, 0, 450.0, 4, 0, 0, 1), "position": (0, 0, 1), "rotation": (1.0, 0, 0, 0)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rotation": (0, 0, 0, 0)}, r"rotation of camera 1 must be a quaternion of length 1, got \[0\.0"),
        ({"rotation": (3.14, 0, 0, 0)}, "rotation of camera 1 must be a quaternion of length 1"),
        ({"rotation": (3.14, 0, 0)}, "rotation of camera 1 must be 4 finite numbers"),
        ({"rotation": (float("nan"), 0, 0, 1)}, "rotation of camera 1 must be 4 finite numbers"),
        ({"position": (0, 0)}, "position of camera 1 must be 3 finite numbers"),
        ({"position": None}, "position of camera 1 must be 3 finite numbers, got None"),
        ({"position": (0, 0, 10**400)}, "position of camera 1 must be 3 finite numbers"),
        ({"intrinsics": (450.0,)}, "intrinsics of camera 1 must be 9 finite numbers"),
    ],
)
def test_a_wrong_camera_of_cliport_is_refused(changes, message):
    pictures = {"color": [np.zeros((8, 8, 3), np.uint8)] * 2, "depth": [np.ones((8, 8), np.float32)] * 2}
    assert len(cliport_bridge.from_cliport(pictures, [CLIPORTS_CAMERA, CLIPORTS_CAMERA]).views) == 2
    with pytest.raises(ValueError, match=message):
        cliport_bridge.from_cliport(pictures, [CLIPORTS_CAMERA, CLIPORTS_CAMERA | changes])
    with pytest.raises(ValueError, match="position of camera 0 must be 3 finite numbers"):
        cliport_bridge.from_cliport(pictures, [{key: CLIPORTS_CAMERA[key] for key in ("intrinsics", "rotation")}])


def test_a_push_ends_in_cliport_where_it_should():
    heightmap = choice_of(logits_with({}), None, (0, 80, 40)).heightmap
    push = Push(at(80, 40), at(20, 70))
    (start, first), (end, second) = cliport_bridge.to_cliport(push, heightmap).values()
    along = np.array([push.end.x - push.start.x, push.end.y - push.start.y])
    beyond = 0.05 * along / np.linalg.norm(along)  # CLIPort's blade stops that much before the second pose.
    assert np.array(end[:2]) - beyond == pytest.approx([push.end.x, push.end.y])
    assert start == pytest.approx((push.start.x, push.start.y, heightmap.height[80, 40]))
    assert first == second == (0, 0, 0, 1)
    edge = Push(at(80, 40), at(80, 79))
    assert cliport_bridge.to_cliport(edge, heightmap)["pose1"][0][0] > heightmap.workspace.x_max, "beyond the map"
    with pytest.raises(ValueError, match="a push must end elsewhere than it starts"):
        cliport_bridge.to_cliport(Push(at(80, 40), at(80, 40)), heightmap)
    with pytest.raises(ValueError, match="lies outside the workspace"):
        cliport_bridge.to_cliport(Push(at(80, 40), Pose2(5.0, 0.0)), heightmap)
