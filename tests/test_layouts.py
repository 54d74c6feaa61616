"""Scenes from other people's files: BOP, TUM, Open3D, organised clouds, ROS bags; and lenses with distortion."""

import importlib.util
import json
import shutil
import types

import cv2
import numpy as np
import pytest
from damages import change_cameras
from scipy.spatial.transform import Rotation

from gem_lite import clip, layouts
from gem_lite.cli import main
from gem_lite.rgbd import lens
from gem_lite.rgbd.observation import Observation, RawView, read_raw

VIEW = next(
    view for view in Observation.load(clip.DATA / "foreign-scenes" / "kitchen").views if view.camera.name == "left"
)
MATRIX = VIEW.camera.matrix
FROM_FIRST_PIXEL = MATRIX - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
"""The intrinsics as all these formats have them: the middle of the first pixel is (0, 0)."""
POSE = np.array(VIEW.camera.pose)
LENS = [-0.28, 0.07, 0.001, -0.002, 0.01]


def write(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture[..., ::-1] if picture.ndim == 3 else picture)


def millimetres(depth, step=0.001):
    return np.round(depth / step).astype(np.uint16)


def bop(folder, number=7):
    write(folder / "rgb" / f"{number:06d}.png", VIEW.rgb)
    write(folder / "depth" / f"{number:06d}.png", millimetres(VIEW.depth, 1e-4))
    to_camera = np.linalg.inv(POSE)
    entry = {"cam_K": FROM_FIRST_PIXEL.ravel().tolist(), "depth_scale": 0.1}
    entry |= {"cam_R_w2c": to_camera[:3, :3].ravel().tolist(), "cam_t_w2c": (1000 * to_camera[:3, 3]).tolist()}
    (folder / "scene_camera.json").write_text(json.dumps({str(number): entry}))


def tum(folder):
    write(folder / "rgb" / "1.png", VIEW.rgb)
    write(folder / "depth" / "1.png", millimetres(VIEW.depth, 1 / 5000))
    (folder / "rgb.txt").write_text("# color images\n100.0 rgb/none.png\n101.500 rgb/1.png\n")
    (folder / "depth.txt").write_text("# depth\n100.9 depth/none.png\n101.512 depth/1.png\n")
    quaternion = Rotation.from_matrix(POSE[:3, :3]).as_quat()
    numbers = " ".join(map(str, [*POSE[:3, 3], *quaternion]))
    (folder / "groundtruth.txt").write_text(f"# t tx ty tz qx qy qz qw\n99 0 0 0 0 0 0 1\n101.49 {numbers}\n")


def open3d(folder):
    write(folder / "color" / "000003.png", VIEW.rgb)
    write(folder / "depth" / "000003.png", millimetres(VIEW.depth))
    (folder / "camera_intrinsic.json").write_text(json.dumps({"intrinsic_matrix": FROM_FIRST_PIXEL.T.ravel().tolist()}))


def same(frame, pose, step=0.001):
    assert np.array_equal(frame.rgb, VIEW.rgb)
    assert np.abs(frame.depth - VIEW.depth).max() <= 0.6 * step and frame.depth.dtype == np.float32
    assert np.allclose(frame.intrinsics, MATRIX, atol=1e-6)
    assert (frame.pose is None) == (pose is None) and (pose is None or np.allclose(frame.pose, pose, atol=1e-6))


def test_bop_tum_and_open3d_give_the_view_that_they_hold(tmp_path):
    bop(tmp_path / "bop")
    same(layouts.read_bop(tmp_path / "bop", 7), POSE)
    tum(tmp_path / "tum")
    fx, fy, cx, cy = FROM_FIRST_PIXEL[[0, 1, 0, 1], [0, 1, 2, 2]]
    same(layouts.read_tum(tmp_path / "tum", 1, (fx, fy, cx, cy)), POSE)
    open3d(tmp_path / "open3d")
    same(layouts.read_open3d(tmp_path / "open3d", 3), None)


def test_an_organised_cloud_gives_the_intrinsics():
    rows, cols = np.indices(VIEW.depth.shape)
    pixels = np.stack([cols + 0.5, rows + 0.5, np.ones(cols.shape)], axis=-1)
    points = (pixels @ np.linalg.inv(MATRIX).T * VIEW.depth[..., None]).astype(np.float32)
    points[:20] = np.nan
    frame = layouts.read_cloud(points, VIEW.rgb)
    assert np.allclose(frame.intrinsics, MATRIX, atol=0.05)
    assert np.array_equal(frame.depth[20:], VIEW.depth[20:]) and not frame.depth[:20].any()
    with pytest.raises(ValueError, match=r"must be \(H, W, 3\), got \(360, 640\) and \(360, 640, 3\)"):
        layouts.read_cloud(points[..., 2], VIEW.rgb)
    with pytest.raises(ValueError, match="points must be measured at 100 pixels or more, with z forward, got 0"):
        layouts.read_cloud(-points, VIEW.rgb)
    with pytest.raises(ValueError, match=r"in its own axes: they appear .* pixels away"):
        layouts.read_cloud((points @ POSE[:3, :3].T + POSE[:3, 3]).astype(np.float32), VIEW.rgb)


def test_imports_make_a_scene_camera_by_camera(tmp_path, capsys):
    bop(tmp_path / "bop")
    open3d(tmp_path / "open3d")
    scene = tmp_path / "scene"
    assert main(["import", "open3d", str(tmp_path / "open3d"), str(scene), "--number", "3", "--name", "a"]) == 0
    assert f"it has no pose: gem-lite set-up propose {scene} --camera a" in capsys.readouterr().out
    assert main(["import", "bop", str(tmp_path / "bop"), str(scene), "--number", "7", "--name", "b"]) == 0
    assert "its pose is that of the files" in capsys.readouterr().out
    assert [view.name for view in read_raw(scene, posed=False)] == ["a", "b"]
    assert main(["set-up", "propose", str(scene), "--camera", "a", "--out", str(tmp_path / "a.png")]) == 0
    assert main(["import", "bop", str(tmp_path / "bop"), str(scene), "--number", "7", "--name", "b"]) == 0
    first, second = Observation.load(scene).views
    assert np.allclose(second.camera.pose, POSE, atol=1e-6), "the same name replaces the camera, and a keeps its pose"
    assert first.camera.pose != second.camera.pose
    assert main(["import", "open3d", str(tmp_path / "open3d"), str(scene), "--number", "3", "--name", "a"]) == 0
    again = next(view for view in Observation.load(scene).views if view.camera.name == "a")
    assert again.camera.pose == first.camera.pose, "new pictures of a camera that stands where it stood"
    change_cameras(scene, lambda entry: entry.update(name=entry["name"] * 2))
    capsys.readouterr()
    assert main(["import", "open3d", str(tmp_path / "open3d"), str(scene), "--number", "3", "--name", "a"]) == 2
    assert "another camera has the pictures of a: give another name" in capsys.readouterr().err


def test_a_scene_is_read_and_written_by_one_process_at_a_time(tmp_path, monkeypatch):
    pictures = np.zeros((4, 4, 3), np.uint8), np.ones((4, 4), np.float32)
    matrix = np.array([[4.0, 0, 2], [0, 4, 2], [0, 0, 1]])
    layouts.write(tmp_path, RawView("front", *pictures, matrix))
    read = layouts._json

    def read_and_try_to_write(path):
        with pytest.raises(OSError, match="another process writes into"):
            layouts.write(tmp_path, RawView("right", *pictures, matrix))
        return read(path)

    monkeypatch.setattr(layouts, "_json", read_and_try_to_write)
    layouts.write(tmp_path, RawView("left", *pictures, matrix))
    names = [camera["name"] for camera in json.loads((tmp_path / "cameras.json").read_text())["cameras"]]
    assert names == ["front", "left"]


@pytest.mark.parametrize(
    ("words", "file", "content"),
    [
        (("bop", "SOURCE"), "scene_camera.json", b'{"0": {"depth_scale": 1}}'),
        (("bop", "SOURCE"), "scene_camera.json", b'{"0": null}'),
        (("open3d", "SOURCE"), "camera_intrinsic.json", b"[1]"),
        (("tum", "SOURCE"), "rgb.txt", b"1"),
        (("cloud", "SOURCE/p.npy", "SOURCE/p.npy"), "p.npy", b""),
        (("bag", "SOURCE/x.bag"), "x.bag", b"garbage"),
    ],
)
def test_a_damaged_file_ends_in_one_sentence(tmp_path, words, file, content, capsys):
    source = tmp_path / "source"
    source.mkdir()
    (source / file).write_bytes(content)
    if file == "rgb.txt":
        (source / "depth.txt").write_text("")
    command = [word.replace("SOURCE", str(source)) for word in words]
    assert main(["import", *command, str(tmp_path / "scene")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and len(error) > 20 and not (tmp_path / "scene").exists()


def test_tums_lists_name_pictures_in_their_folder(tmp_path):
    tum(tmp_path / "tum")
    (tmp_path / "tum" / "rgb.txt").write_text("101.5 ../../secret.png\n")
    with pytest.raises(ValueError, match=r"\.\./\.\./secret\.png and .* must be pictures in"):
        layouts.read_tum(tmp_path / "tum", 0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("bop", "bop", "scene"), "scene_camera.json has no picture 0; it has 7"),
        (("bop", "tum", "scene"), "scene_camera.json"),
        (("tum", "tum", "scene", "--number", "0"), "rgb/none.png has no depth within 0.02 s; the nearest is 0.900 s"),
        (("tum", "tum", "scene", "--number", "2"), "rgb.txt has pictures 0 to 1, got 2"),
        (("open3d", "open3d", "scene", "--number", "9"), "has no picture 000009"),
        (("bag", "none.bag", "scene"), "none.bag"),
    ],
)
def test_what_cannot_be_imported_is_told_and_nothing_is_written(tmp_path, words, message, capsys, monkeypatch):
    for make in (bop, tum, open3d):
        make(tmp_path / make.__name__)
    monkeypatch.chdir(tmp_path)
    assert main(["import", *words]) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error
    assert not (tmp_path / "scene").exists()


def ros_messages(store, make, encoding):
    """A camera's info, a colour picture and a depth picture as ROS messages, with a lens that distorts."""
    color = VIEW.rgb if encoding == "rgb8" else VIEW.rgb[..., ::-1]
    depth = millimetres(VIEW.depth) if make == "ros1" else VIEW.depth
    types_ = store.types
    height, width = VIEW.depth.shape

    def header(second):
        stamp = types_["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
        sequence = {"seq": 0} if make == "ros1" else {}
        return types_["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="camera")

    def image(name, array):
        return types_["sensor_msgs/msg/Image"](
            header=header(1), height=height, width=width, encoding=name, is_bigendian=0, step=array.strides[0],
            data=np.frombuffer(array.tobytes(), np.uint8),
        )  # fmt: skip

    names = ("D", "K", "R", "P") if make == "ros1" else ("d", "k", "r", "p")
    arrays = (np.array(LENS), FROM_FIRST_PIXEL.ravel(), np.eye(3).ravel(), np.zeros(12))
    region = types_["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    info = types_["sensor_msgs/msg/CameraInfo"](
        header=header(1), height=height, width=width, distortion_model="plumb_bob",
        **dict(zip(names, arrays, strict=True)), binning_x=0, binning_y=0, roi=region,
    )  # fmt: skip
    depth_name = "16UC1" if make == "ros1" else "32FC1"
    return {
        "/camera/color/camera_info": ("sensor_msgs/msg/CameraInfo", info),
        "/camera/color/image_raw": ("sensor_msgs/msg/Image", image(encoding, np.ascontiguousarray(color))),
        "/camera/aligned_depth_to_color/image_raw": ("sensor_msgs/msg/Image", image(depth_name, depth)),
    }


@pytest.mark.parametrize(("make", "encoding"), [("ros1", "rgb8"), ("ros2", "bgr8")])
def test_a_ros_bag_gives_the_view_without_its_lens(tmp_path, make, encoding, capsys):
    assert importlib.util.find_spec("rosbags") is not None, "environment.txt has it"
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if make == "ros1" else Stores.ROS2_HUMBLE)
    path = tmp_path / ("recording.bag" if make == "ros1" else "recording")
    with Writer1(path) if make == "ros1" else Writer2(path, version=9) as writer:
        for topic, (kind, message) in ros_messages(store, make, encoding).items():
            connection = writer.add_connection(topic, kind, typestore=store)
            serialize = store.serialize_ros1 if make == "ros1" else store.serialize_cdr
            writer.write(connection, 1_000_000_000, serialize(message, kind))
    assert main(["import", "bag", str(path), str(tmp_path / "scene")]) == 0
    (view,) = read_raw(tmp_path / "scene", posed=False)
    assert np.allclose(view.intrinsics, MATRIX)
    assert np.array_equal(view.rgb, lens.without_distortion(VIEW.rgb, MATRIX, np.array(LENS)))
    wanted = lens.without_distortion(VIEW.depth, MATRIX, np.array(LENS))
    assert np.abs(view.depth - wanted).max() < 0.0006
    assert main(["import", "bag", str(path), str(tmp_path / "scene"), "--color", "/other"]) == 2
    assert "has no topic /other; it has /camera/aligned_depth" in capsys.readouterr().err


def test_pictures_with_padded_rows_and_unknown_encodings():
    data = np.zeros((2, 8), np.uint8)
    data[:, :6] = np.arange(12).reshape(2, 6)
    message = types.SimpleNamespace(height=2, width=2, step=8, encoding="rgb8", is_bigendian=0, data=data.ravel())
    assert layouts._ros_picture(message)[1, 1].tolist() == [9, 10, 11]
    message.encoding = "bayer_rggb8"
    with pytest.raises(ValueError, match=r"encoding must be one of rgb8, .*, got bayer_rggb8"):
        layouts._ros_picture(message)
    depth = np.array([[1, 500]], ">u2")
    message = types.SimpleNamespace(height=1, width=2, step=4, encoding="16UC1", is_bigendian=1, data=depth.tobytes())
    assert layouts._ros_picture(message).tolist() == [[1, 500]]


def test_a_lens_is_undone_where_opencv_says_that_a_point_appears():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.35, 0.35, 40), rng.uniform(-0.2, 0.2, 40), np.ones(40)])
    bent = cv2.projectPoints(points, np.zeros(3), np.zeros(3), FROM_FIRST_PIXEL, np.array(LENS))[0][:, 0]
    straight = points @ FROM_FIRST_PIXEL.T
    assert np.linalg.norm(bent - straight[:, :2], axis=1).max() > 3, "the lens moves pixels"
    for (x, y), (u, v, _) in zip(bent, straight, strict=True):
        picture = np.zeros((360, 640, 3), np.uint8)
        cv2.circle(picture, (round(x * 16), round(y * 16)), 3 * 16, (255, 255, 255), -1, cv2.LINE_AA, 4)
        mended = lens.without_distortion(picture, MATRIX, np.array(LENS))[..., 0].astype(float)
        rows, cols = np.indices(mended.shape)
        centre = np.array([(mended * cols).sum(), (mended * rows).sum()]) / mended.sum()
        assert np.abs(centre - (u, v)).max() < 0.4
    depth = lens.without_distortion(VIEW.depth, MATRIX, np.array(LENS))
    assert set(np.unique(depth)) <= {0.0, *np.unique(VIEW.depth)}, "no mean of a thing and of what is behind it"


def test_a_scenes_lens_is_undone_and_a_wrong_one_refused(tmp_path, capsys):
    folder = shutil.copytree(clip.DATA / "foreign-scenes" / "kitchen", tmp_path / "scene")
    change_cameras(folder, lambda entry: entry.update(distortion=LENS))
    bent = next(view for view in Observation.load(folder).views if view.camera.name == "left")
    assert np.array_equal(bent.rgb, lens.without_distortion(VIEW.rgb, MATRIX, np.array(LENS)))
    assert np.array_equal(bent.depth, lens.without_distortion(VIEW.depth, MATRIX, np.array(LENS)))
    change_cameras(folder, lambda entry: entry.update(distortion=[0.0] * 5))
    straight = next(view for view in Observation.load(folder).views if view.camera.name == "left")
    assert np.array_equal(straight.rgb, VIEW.rgb) and np.array_equal(straight.depth, VIEW.depth)
    for wrong in ([0.1], [0.1, 0.2, 0.3], ["a"]):
        change_cameras(folder, lambda entry, wrong=wrong: entry.update(distortion=wrong))
        with pytest.raises(ValueError, match="distortion"):
            Observation.load(folder)
