"""A camera's pose from the table in its picture: by clicks, known points, a tag, a board, or a robot's frame."""

import json
import math
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from damages import change_cameras
from scipy import ndimage
from scipy.spatial.transform import Rotation

from gem_lite import clip
from gem_lite.cli import main, own_table
from gem_lite.rgbd import planes, table_pose, tags
from gem_lite.rgbd.camera import View, camera_looking_at, rays
from gem_lite.rgbd.observation import CAMERAS_FILE, Observation, read_raw, robot_base
from gem_lite.rgbd.seen import seen_rectangle
from gem_lite.se2 import Pose2, Workspace

FOREIGN = clip.DATA / "foreign-scenes"
SCENES = sorted(folder.name for folder in FOREIGN.iterdir() if folder.is_dir())
CAMERAS = ("overhead", "left", "right")


def to_pixels(view, points):
    """The pixels (N, 2) of points (N, 3) in the table's frame, and their depths (N,)."""
    pose = np.array(view.pose)
    local = (np.asarray(points, float) - pose[:3, 3]) @ pose[:3, :3]
    return (local @ np.array(view.intrinsics).T)[:, :2] / local[:, 2:], local[:, 2]


def bare_points(view):
    """Points (N, 3) of the table that a view sees bare, and their pixels (N, 2): rounded, as a click is."""
    x, y = np.meshgrid(np.arange(0.3, 0.75, 0.05), np.arange(-0.4, 0.45, 0.05))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    pixels, depth = to_pixels(view, points)
    height, width = view.depth.shape
    inside = (pixels > 5).all(axis=1) & (pixels[:, 0] < width - 5) & (pixels[:, 1] < height - 5)
    points, pixels, depth = points[inside], np.floor(pixels[inside]) + 0.5, depth[inside]
    bare = [abs(view.depth[int(v), int(u)] - d) < 0.01 for (u, v), d in zip(pixels, depth, strict=True)]
    return points[bare], pixels[bare]


def farthest(points):
    """The numbers of the two points that are farthest from each other."""
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    return np.unravel_index(distances.argmax(), distances.shape)


def error(found, true):
    """How far two poses are from each other: millimetres and degrees."""
    found, true = np.array(found), np.array(true)
    turn = Rotation.from_matrix(found[:3, :3] @ true[:3, :3].T).magnitude()
    return 1000 * np.linalg.norm(found[:3, 3] - true[:3, 3]), math.degrees(turn)


def is_near(found, true, millimetres=4.0, degrees=0.25):
    off = error(found, true)
    return off[0] < millimetres and off[1] < degrees


def poses_of(folder):
    return {entry["name"]: entry.get("pose") for entry in json.loads((folder / CAMERAS_FILE).read_text())["cameras"]}


@pytest.fixture
def unposed(tmp_path):
    """A copy of a scene whose cameras have no pose, and how they really stand."""
    folder = shutil.copytree(FOREIGN / "desk", tmp_path / "desk")
    true = {view.name: view for view in read_raw(folder)}
    content = json.loads((folder / CAMERAS_FILE).read_text())
    for entry in content["cameras"]:
        del entry["pose"]
    (folder / CAMERAS_FILE).write_text(json.dumps(content))
    return folder, true


@pytest.mark.parametrize("scene", SCENES)
def test_two_clicks_find_each_camera_alone(scene):
    for view in read_raw(FOREIGN / scene):
        points, pixels = bare_points(view)
        one, other = farthest(points)
        ahead = points[other] - points[one]
        at = Pose2(points[one][0], points[one][1], math.atan2(ahead[1], ahead[0]))
        plane = table_pose.table_planes(view.depth, view.intrinsics, pixels[[one, other]])[0]
        found = table_pose.from_clicks(plane, pixels[one], pixels[other], view.intrinsics, at)
        millimetres, degrees = error(found.pose, view.pose)
        assert millimetres < 4 and degrees < 0.25, (view.name, millimetres, degrees)
        assert plane.bend < 0.3 and plane.share > 0.5


def test_known_points_say_how_far_they_are_off():
    view = read_raw(FOREIGN / "nursery")[1]
    points, pixels = bare_points(view)
    plane = table_pose.table_planes(view.depth, view.intrinsics, pixels)[0]
    right = table_pose.pose_from_points(plane, pixels, points[:, :2], view.intrinsics)
    assert max(right.residuals) < 0.005 and is_near(right.pose, view.pose)
    wrong = points[:, :2].copy()
    wrong[3, 0] += 0.08  # a number that somebody mistyped
    found = table_pose.pose_from_points(plane, pixels, wrong, view.intrinsics)
    assert found.residuals.argmax() == 3 and found.residuals[3] > 0.06
    with pytest.raises(ValueError, match=r"the points contradict their places: point 4 is \d\d mm off"):
        found.refuse_if_wrong()
    right.refuse_if_wrong()
    with pytest.raises(ValueError, match="contradict their places"):  # millimetres
        table_pose.pose_from_points(plane, pixels, 1000 * points[:, :2], view.intrinsics).refuse_if_wrong()
    near = table_pose.from_clicks(plane, pixels[0], pixels[0] + 0.3, view.intrinsics, Pose2(0.5, 0.0))
    with pytest.raises(ValueError, match=r"too near to each other: a pixel's error turns the table by \d\d degrees"):
        near.refuse_if_wrong()
    middle = pixels.mean(axis=0)
    along, down = (plane_distance(plane, view, middle, middle + step) for step in (np.array([1, 0]), np.array([0, 1])))
    assert right.pixel == pytest.approx(max(along, down), rel=0.02) and down > 1.2 * along, "a slanted camera"


def plane_distance(plane, view, one, other):
    met = plane.met_by(np.zeros(3), rays(np.stack([one, other]), view.intrinsics))
    return np.linalg.norm(met[1] - met[0])


def test_a_rectangle_is_measured_and_a_skewed_one_is_told():
    view = read_raw(FOREIGN / "workshop")[0]
    corners = np.array([[0.35, -0.2, 0], [0.65, -0.2, 0], [0.65, 0.2, 0], [0.35, 0.2, 0]])
    pixels, _ = to_pixels(view, corners)
    plane = table_pose.table_planes(view.depth, view.intrinsics, pixels)[0]
    found = table_pose.from_rectangle(plane, pixels, view.intrinsics, Pose2(0.5, 0.0))
    assert np.allclose(found.points, corners[:, :2], atol=0.004) and max(found.residuals) < 0.002
    assert is_near(found.pose, view.pose)
    with pytest.raises(ValueError, match="corners must go counter-clockwise"):
        table_pose.from_rectangle(plane, pixels[::-1], view.intrinsics, Pose2(0.5, 0.0))
    turned = table_pose.from_rectangle(plane, pixels, view.intrinsics, Pose2(0.1, 0.2, math.pi / 2))
    assert np.allclose(turned.points[0], (0.1 + 0.2, 0.2 - 0.15), atol=0.004), "the lower left corner, turned"
    pixels[2] += 30
    assert max(table_pose.from_rectangle(plane, pixels, view.intrinsics, Pose2(0.5, 0.0)).residuals) > 0.01


def test_the_floor_is_the_table_where_the_clicks_say_so():
    view = read_raw(FOREIGN / "workbench")[1]
    table, floor = table_pose.table_planes(view.depth, view.intrinsics)
    assert table.share > floor.share > 0.3 and floor.offset - table.offset == pytest.approx(0.75, abs=0.01)
    inner = ndimage.binary_erosion(np.abs(floor.height(_cloud(view))) < 0.01, np.ones((31, 31)))
    on_floor = np.argwhere(inner)[[0, -1], ::-1]
    first, _ = table_pose.table_planes(view.depth, view.intrinsics, on_floor + 0.5)
    assert first.offset == floor.offset
    holes = view.depth.copy()
    for u, v in on_floor:
        holes[max(0, v - 6) : v + 7, max(0, u - 6) : u + 7] = 0  # no depth where it was clicked, but beside it
    assert abs(table_pose.table_planes(holes, view.intrinsics, on_floor + 0.5)[0].offset - floor.offset) < 0.002
    for u, v in on_floor:
        holes[max(0, v - 12) : v + 13, max(0, u - 12) : u + 13] = 0
    with pytest.raises(ValueError, match="the points lie on no plane, or no depth is measured there"):
        table_pose.table_planes(holes, view.intrinsics, on_floor + 0.5)


def _cloud(view):
    rows, cols = np.indices(view.depth.shape)
    pixels = np.stack([cols.ravel() + 0.5, rows.ravel() + 0.5], axis=1)
    return (rays(pixels, view.intrinsics) * view.depth.reshape(-1, 1)).reshape(*view.depth.shape, 3)


def printed(sheet, lower_left, side):
    """A picture of a sheet that lies on a bare table, and its depth, as an oblique camera sees them.

    Args:
        sheet: (H, W) gray, printed with a height of ``side`` metres; its lower edge points to +x.
    """
    camera = camera_looking_at("front", (0.2, -0.6, 0.7), (0.5, 0.0, 0.0))
    rows, cols = sheet.shape
    metre = side / rows
    corners = np.array([[0, 0], [cols * metre, 0], [cols * metre, side], [0, side]]) + lower_left
    local = (np.column_stack([corners, np.zeros(4)]) - camera.position) @ camera.rotation
    pixels = (local @ camera.matrix.T)[:, :2] / local[:, 2:]
    on_sheet = np.array([[0, rows], [cols, rows], [cols, 0], [0, 0]])
    # OpenCV's pictures have their first pixel's middle at (0, 0).
    lift = cv2.getPerspectiveTransform(np.float32(on_sheet - 0.5), np.float32(pixels - 0.5))
    gray = cv2.warpPerspective(sheet, lift, (640, 480), flags=cv2.INTER_AREA, borderValue=150)
    seen = rays(np.stack(np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5), -1).reshape(-1, 2), camera.matrix)
    depth = (-camera.position[2] / (seen @ camera.rotation.T)[:, 2]).reshape(480, 640)
    noise = np.random.default_rng(0).normal(0, 0.001, depth.shape)
    return camera, np.repeat(gray[..., None], 3, axis=2), (depth + noise).astype(np.float32)


def test_a_tag_and_a_board_give_the_pose():
    sheet = np.pad(cv2.aruco.generateImageMarker(tags.DICTIONARY, 5, 320), 40, constant_values=255)
    camera, rgb, depth = printed(sheet, (0.4, -0.1), 0.2)  # its black square is 0.16 m wide
    plane = table_pose.table_planes(depth, camera.matrix)[0]
    pixels, places = table_pose.tag_points(rgb, 5, 0.16, Pose2(0.5, 0.0))
    found = table_pose.pose_from_points(plane, pixels, places, camera.matrix)
    assert is_near(found.pose, camera.pose, 5, 0.4) and max(found.residuals) < 0.002
    _, turned = table_pose.tag_points(rgb, 5, 0.16, Pose2(0.2, 0.1, math.pi / 2))
    assert np.allclose(turned[0], (0.2 - 0.08, 0.1 - 0.08)), "its upper left corner, after a quarter turn"
    with pytest.raises(tags.LocalisationError, match="tag 6 is not in the picture, only tag 5"):
        table_pose.tag_points(rgb, 6, 0.16, Pose2(0.5, 0.0))
    for number, side in ((5, 0.0), (5, -0.16), (5, math.nan), (5, 160.0), (9999, 0.16)):
        with pytest.raises(ValueError, match="tag must be one of 0 to 586 with a side above 0 and below 2"):
            table_pose.tag_points(rgb, number, side, Pose2(0.5, 0.0))

    board = cv2.aruco.CharucoBoard((5, 7), 0.06, 0.045, tags.DICTIONARY)
    drawn = np.pad(board.generateImage((500, 700)), 70, constant_values=255)
    pixels, places = table_pose.board_points(np.repeat(drawn[..., None], 3, 2), (5, 7), 0.06, 0.045, Pose2(0.0, 0.0))
    by_row = np.lexsort(np.round(pixels).T)
    corners = [(70 + 100 * col, 70 + 100 * row) for row in range(1, 7) for col in range(1, 5)]
    assert np.allclose(pixels[by_row], corners, atol=0.05), "the upper left edge of a picture is (0, 0)"
    camera, rgb, depth = printed(board.generateImage((500, 700)), (0.35, -0.2), 0.42)
    pixels, places = table_pose.board_points(rgb, (5, 7), 0.06, 0.045, Pose2(0.35, -0.2))
    found = table_pose.pose_from_points(plane, pixels, places, camera.matrix)
    assert len(pixels) >= 20 and is_near(found.pose, camera.pose, 5, 0.4)
    with pytest.raises(
        tags.LocalisationError, match=r"the board shows 0 of its corners, and four are needed: .* 36h11"
    ):
        table_pose.board_points(np.zeros_like(rgb), (5, 7), 0.04, 0.03, Pose2(0.4, -0.14))
    _, turned = table_pose.board_points(rgb, (5, 7), 0.06, 0.045, Pose2(0.35, -0.2, math.pi / 2))
    assert np.allclose((turned - (0.35, -0.2))[:, 0], -(places - (0.35, -0.2))[:, 1])
    for squares, square, marker in (
        ((5, 7), 0.03, 0.04),
        ((2, 2), 0.06, 0.045),
        ((40, 40), 0.06, 0.045),
        ((5, 7), -1, -2),
    ):
        with pytest.raises(ValueError, match="board must have four inner corners or more"):
            table_pose.board_points(rgb, squares, square, marker, Pose2(0.4, -0.14))


def test_points_that_give_no_pose_are_refused():
    view = read_raw(FOREIGN / "desk")[1]
    plane = table_pose.table_planes(view.depth, view.intrinsics)[0]
    two = np.array([[320.0, 300.0], [320.0, 300.0]])
    with pytest.raises(ValueError, match="points must lie at different places"):
        table_pose.pose_from_points(plane, two, np.array([[0.5, 0], [0.5, 0]]), view.intrinsics)
    with pytest.raises(ValueError, match="points must be two or more, each with its place, got 1 and 1"):
        table_pose.pose_from_points(plane, two[:1], np.array([[0.5, 0]]), view.intrinsics)
    with pytest.raises(ValueError, match=r"pixel \(320, -900\) looks past the table"):
        table_pose.from_clicks(plane, (320, 300), (320, -900), view.intrinsics, Pose2(0.5, 0))
    with pytest.raises(ValueError, match="no plane is seen: 0 measured points"):
        table_pose.table_planes(np.zeros((480, 640), np.float32), view.intrinsics)


def run(*words):
    return main(["set-up", *map(str, words)])


def test_the_command_writes_one_pose_and_the_others_stay(unposed, tmp_path, capsys):
    folder, true = unposed
    points, pixels = bare_points(true["left"])
    one, other = farthest(points)
    ahead = points[other] - points[one]
    at = (points[one][0], points[one][1], math.degrees(math.atan2(ahead[1], ahead[0])))
    clicked = np.floor(pixels[[one, other]]).astype(int).ravel()  # whole numbers, as a viewer shows them
    words = ("clicks", folder, *clicked, "--camera", "left", "--at", *at, "--out", tmp_path)
    assert run(*words) == 0
    shown = capsys.readouterr().out
    assert "left: 0.62" in shown and "another plane" in shown and "the camera sees the table from x " in shown
    poses = poses_of(folder)
    assert poses["overhead"] is None and poses["right"] is None
    assert is_near(poses["left"], true["left"].pose, 8)
    assert (tmp_path / "left.png").stat().st_size > 10_000
    assert main(["check-cameras", str(folder)]) == 2
    assert "cameras 0 lacks pose: `gem-lite set-up` finds it by the table" in capsys.readouterr().err
    for name in ("overhead", "right"):
        points, pixels = bare_points(true[name])
        numbers = [number for row in np.column_stack([np.floor(pixels), points[:, :2]])[::5] for number in row]
        assert run("points", folder, *numbers, "--camera", name, "--out", tmp_path) == 0
    assert "mm from their places on average" in capsys.readouterr().out
    assert main(["check-cameras", str(folder), "--out", str(tmp_path)]) == 0, "three cameras, each set up by itself"


def test_a_proposal_gives_a_level_table(unposed, tmp_path, capsys):
    folder, _ = unposed
    assert run("propose", folder, "--camera", "right", "--at", 0.4, 0.1, 30, "--out", tmp_path) == 0
    assert "if another one is the table, say so by clicks" in capsys.readouterr().out
    (pose,) = (np.array(pose) for pose in poses_of(folder).values() if pose)
    view = next(view for view in read_raw(folder, posed=False) if view.name == "right")
    z = (_cloud(view) @ pose[:3, :3].T + pose[:3, 3])[..., 2][view.depth > 0]
    assert np.mean(np.abs(z) < 0.005) > 0.5
    height, width = view.depth.shape
    seen = rays(np.array([[width / 2, height / 2], [0.6 * width, height / 2]]), view.intrinsics) @ pose[:3, :3].T
    middle, right = (pose[:3, 3] - seen * (pose[2, 3] / seen[:, 2:]))[:, :2]
    assert np.allclose(middle, (0.4, 0.1), atol=1e-6)
    assert math.degrees(math.atan2(*(right - middle)[::-1])) == pytest.approx(30), "the picture's right is +x"


def test_a_tag_a_board_and_corners_through_the_command(tmp_path, capsys):
    sheet = np.pad(cv2.aruco.generateImageMarker(tags.DICTIONARY, 5, 320), 40, constant_values=255)
    board = cv2.aruco.CharucoBoard((5, 7), 0.06, 0.045, tags.DICTIONARY).generateImage((500, 700))
    corners = np.array([[0.35, -0.2, 0], [0.65, -0.2, 0], [0.65, 0.22, 0], [0.35, 0.22, 0]])
    for picture, side, words in (
        ((sheet, (0.4, -0.1)), 0.2, ("tag", 5, 0.16)),
        ((board, (0.35, -0.2)), 0.42, ("board", 5, 7, 0.06, 0.045, "--at", 0.35, -0.2, 0)),
        ((board, (0.35, -0.2)), 0.42, ("corners", "--at", 0.5, 0.01, 0)),
    ):
        camera, rgb, depth = printed(*picture, side)
        folder = tmp_path / words[0]
        Observation((View(camera, rgb, depth),)).save(folder)
        change_cameras(folder, lambda entry: entry.pop("pose"))
        view = read_raw(folder, posed=False)[0]
        if words[0] == "corners":
            clicked = np.floor(to_pixels(replace(view, pose=camera.pose), corners)[0]).astype(int).ravel()
            words = ("corners", folder, *clicked, *words[1:])
        else:
            words = (words[0], folder, *words[1:])
        assert run(*words, "--out", tmp_path) == 0, capsys.readouterr().err
        assert is_near(poses_of(folder)["front"], camera.pose, 8, 0.5), words
    assert re.search(r"the rectangle is 0\.(29|30)\d m along its lower side and 0\.4[12]\d m", capsys.readouterr().out)


def test_a_frame_away_from_the_shipped_rectangle_is_written_and_drawn(unposed, tmp_path, capsys):
    folder, _ = unposed
    at = ("--at", -0.5, -0.1, -90)
    assert run("clicks", folder, 320, 200, 250, 170, "--camera", "left", *at, "--out", tmp_path) == 0
    assert "nothing of the shipped policies' rectangle" in capsys.readouterr().out
    assert (tmp_path / "left.png").exists() and poses_of(folder)["left"] is not None
    limits = {}
    for shift in (0.0, 2.0):
        assert run("clicks", folder, 320, 200, 250, 170, "--camera", "left", "--at", 0.5 + shift, shift, 0) == 0
        shown = capsys.readouterr().out
        numbers = re.search(r"from x (\S+) to (\S+) m and y (\S+) to (\S+) m;", shown).groups()
        limits[shift] = np.array([float(number) for number in numbers]) - shift
    assert np.allclose(limits[0.0], limits[2.0], atol=0.021), "what is seen does not depend on the frame"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("clicks", "SCENE", 320, 200, "--camera", "left"), "pixels must be x and y of 2 points, got 2 numbers"),
        (("clicks", "SCENE", 320, 200, 250, 170), "--camera must be one of overhead, left, right"),
        (("propose", "SCENE", "--camera", "top"), "--camera must be one of overhead, left, right, got top"),
        (("clicks", "SCENE", 320, 200, 320, 201, "--camera", "left"), "the points are too near to each other"),
        (("clicks", "SCENE", 320, 200, 250, 170, "--camera", "left", "--at", "nan", 0, 0), "finite numbers"),
        (("clicks", "SCENE", 9000, 1, 1, 1, "--camera", "left"), "points must lie in the picture of 640 x 360 pixels"),
        (("points", "SCENE", 1, 2, 3, "--camera", "left"), "points must be x y X Y for two points or more, got 3"),
        (("tag", "SCENE", 0, 0.14, "--camera", "left"), "tag 0 is not in the picture, no tag at all"),
        (("points", "SCENE", 320, 200, 500, 0, 250, 170, 700, 0, "--camera", "left"), "contradict their places"),
        (("robot", "SCENE"), "cameras 0 lacks pose"),
        (("propose", "nowhere"), "nowhere is no folder"),
    ],
)  # fmt: skip
def test_a_command_that_cannot_be_says_why(unposed, words, message, capsys):
    folder, _ = unposed
    before = (folder / CAMERAS_FILE).read_bytes()
    assert run(*(folder if word == "SCENE" else word for word in words)) == 2
    assert message in capsys.readouterr().err
    assert (folder / CAMERAS_FILE).read_bytes() == before


def test_poses_in_a_robots_frame_become_those_of_the_table(tmp_path, capsys, multi, monkeypatch):
    monkeypatch.setattr(own_table, "load", lambda *_: multi)
    folder = shutil.copytree(FOREIGN / "workbench", tmp_path / "scene")
    truth = {view.name: np.array(view.pose) for view in read_raw(folder)}
    base = np.eye(4)
    base[:3, :3] = Rotation.from_euler("xy", (3, -2), degrees=True).as_matrix()
    base[:3, 3] = 0.0, 0.0, -0.31
    content = json.loads((folder / CAMERAS_FILE).read_text())
    for entry in content["cameras"]:
        entry["pose"] = (base @ truth[entry["name"]]).tolist()
    (folder / CAMERAS_FILE).write_text(json.dumps(content))
    assert run("robot", folder) == 0
    assert "the table is at z = -0.31" in capsys.readouterr().out
    found = robot_base(folder)
    assert is_near(found, base, 4, 0.25), "without a turn about the vertical, which no plane shows"
    for name, pose in poses_of(folder).items():
        assert np.allclose(found @ np.array(pose), base @ truth[name], atol=1e-9), (
            "the same places, in the base's frame"
        )
    views = Observation.load(folder).views
    heights = np.concatenate([view.points()[view.depth > 0][:, 2] for view in views])
    assert np.mean(np.abs(heights) < 0.006) > 0.5, "the table is level, and at z = 0"
    for words in (("robot", folder), ("propose", folder, "--camera", "left")):
        assert run(*words) == 2
        assert "has base_from_table, which belongs to its poses" in capsys.readouterr().err
    assert main(["look", str(folder), "put the red block in the blue bowl", "--out", str(tmp_path / "look")]) == 0
    shown = capsys.readouterr().out
    assert "pick in the frame of the robot's base: (" in shown
    written = json.loads((tmp_path / "look" / "look.json").read_text())
    pick, in_base = written["action"]["pick"], np.array(written["in_base"]["pick"])
    assert np.allclose((np.linalg.inv(found) @ in_base)[:2, 3], (pick["x"], pick["y"]), atol=1e-9)


def test_a_robots_frame_without_a_level_plane_is_refused():
    rng = np.random.default_rng(0)
    wall = np.column_stack([np.full(1000, 1.0), rng.uniform(-1, 1, (1000, 2))])
    with pytest.raises(ValueError, match="no plane is level within 20 degrees in the base's frame; tilts seen: 90"):
        table_pose.level_planes([wall], [np.zeros(3)])


def test_a_robots_table_may_be_chosen_by_its_height(tmp_path, capsys):
    folder = shutil.copytree(FOREIGN / "workbench", tmp_path / "scene")
    assert run("robot", folder, "--height", -0.7) == 0
    shown = capsys.readouterr().out
    assert "the table is at z = -0.750 m" in shown and "another level plane is at z = 0.000 m" in shown


def test_mistakes_that_no_pose_mends_are_refused(unposed, capsys):
    folder, _ = unposed
    intact = (folder / CAMERAS_FILE).read_bytes()

    def refused(change, message, words=("propose", folder, "--camera", "left")):
        (folder / CAMERAS_FILE).write_bytes(intact)
        change_cameras(folder, change)
        assert run(*words) == 2
        assert message in capsys.readouterr().err

    refused(
        lambda entry: entry.update(intrinsics=[[0.9, 0, 0.5], [0, 1.2, 0.5], [0, 0, 1]]), "intrinsics are in pixels"
    )
    refused(lambda entry: entry.update(name="cam"), "cameras must have different names")
    mirrored = np.diag([-1.0, 1, 1, 1]).tolist()
    refused(lambda entry: entry.update(pose=mirrored), "no reflection", ("robot", folder))
    (folder / CAMERAS_FILE).write_bytes(intact)
    change_cameras(folder, lambda entry: entry.update(pose=np.zeros((4, 4)).tolist()))
    assert run("propose", folder, "--camera", "left") == 0, "a pose that is nonsense is not read"


def test_the_largest_seen_rectangle_goes_over_shadows_and_not_over_what_is_missing():
    workspace = Workspace(x_min=0.0, x_max=0.8, y_min=0.0, y_max=0.8, pixel=0.01)
    seen = np.zeros(workspace.shape, bool)
    seen[10:70, 20:60] = True
    seen[30:36, 30:38] = False  # the shadow of a thing
    assert seen_rectangle(seen, workspace) == pytest.approx((0.2, 0.6, 0.1, 0.7))
    seen[10:38, 20:40] = False
    assert seen_rectangle(seen, workspace) == pytest.approx((0.2, 0.6, 0.1, 0.42))
    assert seen_rectangle(np.zeros_like(seen), workspace) is None


def test_a_plane_of_a_bent_table_says_so():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (4000, 2)), np.zeros(4000)])
    points[:, 2] = 0.02 * points[:, 0] ** 2 + 1.0
    (bent,) = planes.find_planes(points, np.zeros(3), count=1)
    points[:, 2] = 1.0
    (flat,) = planes.find_planes(points, np.zeros(3), count=1)
    assert bent.bend > 0.5 > flat.bend
