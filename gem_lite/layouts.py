"""Scenes from the files that people have: BOP, TUM, Open3D's recorder, organised point clouds, ROS bags.

Each reader gives one `RawView`, with a pose if the files have one. `write` puts it into a scene, a folder as
`gem_lite.rgbd.observation` describes it. `gem-lite set-up` then finds the pose if there is none.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gem_lite.foundations.files import write_together, writing
from gem_lite.rgbd.camera import checked_intrinsics, checked_pose
from gem_lite.rgbd.lens import checked_distortion, without_distortion
from gem_lite.rgbd.observation import CAMERAS_FILE, Observation, RawView

TUM_SCALE = 1 / 5000
"""Metres of one step of a depth picture of TUM's benchmark."""
TUM_INTRINSICS = (525.0, 525.0, 319.5, 239.5)
"""The intrinsics that TUM's benchmark recommends where a camera's own are not known: fx, fy, cx, cy."""
SAME_TIME = 0.02
"""Two pictures belong together if they were taken within this time (s)."""
LENSES = ("plumb_bob", "rational_polynomial")
"""ROS's models of a lens that are OpenCV's."""
COLORS = {"rgb8": (3, None), "bgr8": (3, cv2.COLOR_BGR2RGB), "rgba8": (4, cv2.COLOR_RGBA2RGB),
          "bgra8": (4, cv2.COLOR_BGRA2RGB), "mono8": (1, cv2.COLOR_GRAY2RGB)}  # fmt: skip
"""ROS's encodings of colour pictures: how many channels each has, and how it becomes RGB."""


def write(folder: Path, frame: RawView) -> None:
    """Write a frame as a camera of a scene. Other cameras stay; a frame without a pose keeps that of its name.

    Raises: as `Observation.save`; OSError if another process writes into the scene; ValueError if colour and depth
    differ in size, or another camera has these files.
    """
    pose = np.eye(4) if frame.pose is None else frame.pose
    observation = Observation.from_arrays(
        [frame.rgb], [frame.depth], [np.asarray(frame.intrinsics)], [np.asarray(pose)], [frame.name]
    )
    contents = observation.contents(folder)
    cameras = folder / CAMERAS_FILE
    scene = json.loads(contents[cameras])
    if frame.pose is None:
        del scene["cameras"][0]["pose"]
    with writing(folder):
        if cameras.exists():
            scene = _joined(_json(cameras), scene, cameras)
        write_together(contents | {cameras: json.dumps(scene, indent=1).encode()})


def _joined(before: Mapping[str, Any], scene: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """What cameras.json held ``before``, with the one camera of ``scene`` added or replaced.

    Raises:
        ValueError: another camera has these pictures.
    """
    fresh = dict(scene["cameras"][0])
    named = [entry for entry in before["cameras"] if entry["name"] == fresh["name"]]
    others = [entry for entry in before["cameras"] if entry["name"] != fresh["name"]]
    taken = {entry[kind] for entry in others for kind in ("color", "depth")}
    if taken & {fresh["color"], fresh["depth"]}:
        raise ValueError(f"{path}: another camera has the pictures of {fresh['name']}: give another name")
    if "pose" not in fresh and named and "pose" in named[0]:
        fresh["pose"] = named[0]["pose"]  # new pictures of a camera that stands where it stood
    return {**before, "cameras": [*others, fresh]}


def read_bop(scene: Path, number: int, name: str = "front") -> RawView:
    """A picture of a scene in the format of the BOP challenge: scene_camera.json, rgb/ and depth/.

    Raises:
        FileNotFoundError, ValueError: a file is missing, or not as the format says.
    """
    path = scene / "scene_camera.json"
    entries = _json(path)
    if str(number) not in entries:
        raise ValueError(f"{path} has no picture {number}; it has {', '.join(sorted(entries, key=int)[:10])} ...")
    entry = entries[str(number)]
    pose = None
    if "cam_R_w2c" in entry:
        world_to_camera = np.eye(4)
        world_to_camera[:3, :3] = np.reshape(entry["cam_R_w2c"], (3, 3))
        world_to_camera[:3, 3] = np.array(entry["cam_t_w2c"]) / 1000
        pose = checked_pose(np.linalg.inv(world_to_camera), f"{path} {number} cam_R_w2c")
    rgb, depth = (_first(scene / kind, f"{number:06d}") for kind in ("rgb", "depth"))
    metres = _depth(depth) * (entry["depth_scale"] / 1000)
    return RawView(name, _color(rgb), metres, _from_first_pixel(np.reshape(entry["cam_K"], (3, 3)), str(path)), pose)


def read_tum(
    folder: Path, number: int, intrinsics: tuple[float, float, float, float] = TUM_INTRINSICS, name: str = "front"
) -> RawView:  # fmt: skip
    """A picture of a sequence of TUM's RGB-D benchmark: rgb.txt and depth.txt, and a pose if groundtruth.txt has it.

    Args:
        number: of the colour picture, from 0.
        intrinsics: fx, fy, cx, cy.

    Raises:
        FileNotFoundError, ValueError: a file is missing, or no depth belongs to the picture.
    """
    colors, depths = (_timed(folder / f"{kind}.txt") for kind in ("rgb", "depth"))
    if not 0 <= number < len(colors):
        raise ValueError(f"{folder / 'rgb.txt'} has pictures 0 to {len(colors) - 1}, got {number}")
    time, (rgb_file, *_) = colors[number]
    nearest, (depth_file, *_) = min(depths, key=lambda entry: abs(entry[0] - time))
    if abs(nearest - time) > SAME_TIME:
        raise ValueError(
            f"{rgb_file} has no depth within {SAME_TIME} s; the nearest is {abs(nearest - time):.3f} s away"
        )
    pose = None
    if (folder / "groundtruth.txt").exists():
        moment, numbers = min(_timed(folder / "groundtruth.txt"), key=lambda entry: abs(entry[0] - time))
        if abs(moment - time) <= SAME_TIME:
            pose = _pose([float(value) for value in numbers[:7]])
    if any(Path(name).is_absolute() or ".." in Path(name).parts for name in (rgb_file, depth_file)):
        raise ValueError(f"{rgb_file} and {depth_file} must be pictures in {folder}")
    fx, fy, cx, cy = intrinsics
    matrix = _from_first_pixel(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), "intrinsics")
    return RawView(name, _color(folder / rgb_file), _depth(folder / depth_file) * TUM_SCALE, matrix, pose)


def read_open3d(folder: Path, number: int, name: str = "front") -> RawView:
    """A picture of a recording of Open3D's RealSense recorder: camera_intrinsic.json, color/ and depth/ in millimetres.

    Raises:
        FileNotFoundError, ValueError: a file is missing, or not as the format says.
    """
    path = folder / "camera_intrinsic.json"
    matrix = np.reshape(_json(path)["intrinsic_matrix"], (3, 3)).T  # Open3D writes it by columns.
    rgb, depth = (_first(folder / kind, f"{number:06d}") for kind in ("color", "depth"))
    return RawView(name, _color(rgb), _depth(depth) / 1000, _from_first_pixel(matrix, str(path)))


def read_cloud(points: np.ndarray, rgb: np.ndarray, name: str = "front") -> RawView:
    """An organised point cloud: each pixel's point in the camera's axes (x right, y down, z forward).

    The intrinsics are those with which the points appear at their pixels, by least squares.

    Args:
        points: (H, W, 3) metres; not finite, or z = 0, where nothing was measured.
        rgb: (H, W, 3) uint8.

    Raises:
        ValueError: shapes differ; fewer than 100 points; the points are not those of a pinhole camera's pixels.
    """
    if points.ndim != 3 or points.shape[2] != 3 or rgb.shape != points.shape:
        raise ValueError(f"points and rgb must be (H, W, 3), got {points.shape} and {rgb.shape}")
    measured = np.isfinite(points).all(axis=2) & (points[..., 2] > 0)
    if measured.sum() < 100:
        raise ValueError(f"points must be measured at 100 pixels or more, with z forward, got {measured.sum()}")
    x, y, z = points[measured].T.astype(float)
    rows, cols = np.nonzero(measured)
    matrix = np.eye(3)
    off = []
    for axis, slopes, pixels in ((0, x / z, cols + 0.5), (1, y / z, rows + 0.5)):
        focal, middle = np.polyfit(slopes, pixels, 1)
        matrix[axis, axis], matrix[axis, 2] = focal, middle
        off.append(np.median(np.abs(focal * slopes + middle - pixels)))
    if max(off) > 1 or min(matrix[0, 0], matrix[1, 1]) <= 0:
        raise ValueError(
            f"points must be those of a camera's pixels in its own axes: they appear {max(off):.1f} pixels away"
        )
    return RawView(name, np.ascontiguousarray(rgb), np.where(measured, points[..., 2], 0).astype(np.float32), matrix)


def read_bag(path: Path, color: str, depth: str, info: str, name: str = "front") -> RawView:
    """The first picture of a ROS 1 or ROS 2 bag that has a depth picture of about the same time.

    Lens distortion (plumb_bob or rational_polynomial) is undone.

    Args:
        color, depth, info: the topics of the colour pictures, of the depth aligned to them, and of the camera's info.

    Raises:
        ValueError: rosbags is not installed; a topic is not in the bag; nothing belongs together; or the camera's info
            is of another size or has another model of a lens.
    """
    try:
        from rosbags.highlevel import AnyReader
    except ImportError as error:
        raise ValueError("reading a ROS bag needs the package rosbags: pip install rosbags") from error
    found: dict[str, list[tuple[float, Any]]] = {color: [], depth: [], info: []}
    with AnyReader([path]) as reader:
        topics = {connection.topic for connection in reader.connections}
        missing = [topic for topic in found if topic not in topics]
        if missing:
            raise ValueError(f"{path} has no topic {', '.join(missing)}; it has {', '.join(sorted(topics))}")
        chosen = [connection for connection in reader.connections if connection.topic in found]
        for connection, time, raw in reader.messages(connections=chosen):
            found[connection.topic].append((time / 1e9, reader.deserialize(raw, connection.msgtype)))
            pair = _together(found[color], found[depth])
            if pair is not None and found[info]:
                break
        else:
            raise ValueError(f"{path}: no depth within {SAME_TIME} s of a colour picture, or no camera info")
    picture, measured = (_ros_picture(message) for message in pair)
    _, camera = found[info][0]
    fields = vars(camera) if not hasattr(camera, "k") else {"K": camera.k, "D": camera.d}  # ROS 1 and ROS 2
    matrix = _from_first_pixel(np.reshape(fields["K"], (3, 3)), info)
    lens = checked_distortion(fields["D"], f"{info} D")
    if lens.any() and camera.distortion_model not in LENSES:
        raise ValueError(f"{info} has a lens {camera.distortion_model!r}; those that are undone: {', '.join(LENSES)}")
    if (camera.height, camera.width) != picture.shape[:2]:
        size = f"{camera.width} x {camera.height}"
        raise ValueError(f"{info} is for pictures of {size} pixels, got {picture.shape[1]} x {picture.shape[0]}")
    metres = measured.astype(np.float32) / (1000 if measured.dtype == np.uint16 else 1)
    return RawView(name, without_distortion(picture, matrix, lens), without_distortion(metres, matrix, lens), matrix)


def _together(colors: Sequence[tuple[float, Any]], depths: Sequence[tuple[float, Any]]) -> tuple[Any, Any] | None:
    """The first two messages of about the same time."""
    for time, color in colors:
        for other, depth in depths:
            if abs(other - time) <= SAME_TIME:
                return color, depth
    return None


def _ros_picture(message: Any) -> np.ndarray:  # noqa: ANN401 (rosbags makes its classes)
    """The picture of a sensor_msgs/Image: RGB uint8, or depth as uint16 or float32."""
    if message.encoding in ("16UC1", "mono16", "32FC1"):
        kind = np.float32 if message.encoding == "32FC1" else np.uint16
        order = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
        return np.frombuffer(bytes(message.data), order).reshape(message.height, -1)[:, : message.width].astype(kind)
    if message.encoding not in COLORS:
        raise ValueError(f"a picture's encoding must be one of {', '.join(COLORS)}, got {message.encoding}")
    channels, conversion = COLORS[message.encoding]
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    picture = rows[:, : channels * message.width].reshape(message.height, message.width, channels)
    return picture.copy() if conversion is None else cv2.cvtColor(picture, conversion)


def _from_first_pixel(matrix: np.ndarray, name: str) -> np.ndarray:
    """Intrinsics for which the middle of the first pixel is (0, 0), as ours, for which it is (0.5, 0.5)."""
    checked = checked_intrinsics(matrix, name).copy()
    checked[:2, 2] += 0.5
    return checked


def _pose(numbers: Sequence[float]) -> np.ndarray:
    """(4, 4) of tx ty tz qx qy qz qw."""
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(numbers[3:]).as_matrix()
    pose[:3, 3] = numbers[:3]
    return pose


def _json(path: Path) -> Mapping[str, Any]:
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path} is cut off or no JSON: {error}") from None


def _timed(path: Path) -> list[tuple[float, list[str]]]:
    """The lines of a file of TUM's benchmark: a time, and the words after it."""
    lines = (line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#"))
    return [(float(words[0]), words[1:]) for words in lines]


def _first(folder: Path, stem: str) -> Path:
    """The file of a name in a folder, whatever its ending."""
    files = sorted(folder.glob(f"{stem}.*"))
    if not files:
        raise FileNotFoundError(f"{folder} has no picture {stem}")
    return files[0]


def _color(path: Path) -> np.ndarray:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError(f"{path} is missing or no picture")
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def _depth(path: Path) -> np.ndarray:
    """(H, W) float32, in the steps of the file."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.ndim != 2 or picture.dtype != np.uint16:
        found = "no picture" if picture is None else f"{picture.dtype} of shape {picture.shape}"
        raise ValueError(f"{path} must be a 16-bit depth picture, got {found}")
    return picture.astype(np.float32)
