"""``gem-lite import``: a scene from the files of a camera, a data set or a recording."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from gem_lite.cli.base import make_app

if TYPE_CHECKING:
    from gem_lite.rgbd.observation import RawView

ABOUT = """Make a scene, a folder with cameras.json, of one picture with its depth.

Give several cameras different names: each import adds one to the folder.
If the files have no pose, gem-lite set-up finds it by the table."""

Source = Annotated[Path, Parameter(help="what to read")]
Scene = Annotated[Path, Parameter(help="folder of the scene, made if it is not there")]
Name = Annotated[str, Parameter(help="name of the camera")]
Number = Annotated[int, Parameter(help="number of the picture")]


def bop(source: Source, scene: Scene, /, *, number: Number = 0, name: Name = "front") -> None:
    """A picture of a scene of the BOP challenge: scene_camera.json, rgb/, depth/.

    Examples:
      gem-lite import bop ycbv/test/000048 my-scene --number 1
    """
    from gem_lite import layouts

    with as_a_sentence(source):
        finish(scene, layouts.read_bop(source, number, name))


def tum(
    source: Source, scene: Scene, /, *, number: Number = 0, name: Name = "front",
    intrinsics: Annotated[
        tuple[float, float, float, float], Parameter(help="fx fy cx cy in pixels")
    ] = (525.0, 525.0, 319.5, 239.5),
) -> None:  # fmt: skip
    """A picture of a sequence of TUM's RGB-D benchmark: rgb.txt, depth.txt, perhaps groundtruth.txt.

    Examples:
      gem-lite import tum rgbd_dataset_freiburg1_desk my-scene --number 100
    """
    from gem_lite import layouts

    with as_a_sentence(source):
        finish(scene, layouts.read_tum(source, number, intrinsics, name))


def open3d(source: Source, scene: Scene, /, *, number: Number = 0, name: Name = "front") -> None:
    """A picture of Open3D's RealSense recorder: camera_intrinsic.json, color/, depth/.

    Examples:
      gem-lite import open3d realsense my-scene
    """
    from gem_lite import layouts

    with as_a_sentence(source):
        finish(scene, layouts.read_open3d(source, number, name))


def cloud(
    points: Annotated[Path, Parameter(help="npy file, (H, W, 3): each pixel's point in the camera's axes (m)")],
    colors: Annotated[Path, Parameter(help="npy file, (H, W, 3) uint8 RGB")],
    scene: Scene, /, *, name: Name = "front",
) -> None:  # fmt: skip
    """An organised point cloud: one point for each pixel. The intrinsics are computed from it.

    Examples:
      gem-lite import cloud points.npy colors.npy my-scene
    """
    import numpy as np

    from gem_lite import layouts

    with as_a_sentence(points):
        arrays = [np.load(path, allow_pickle=False) for path in (points, colors)]
        finish(scene, layouts.read_cloud(arrays[0], arrays[1], name))


def bag(
    source: Source, scene: Scene, /, *, name: Name = "front",
    color: Annotated[str, Parameter(help="topic of the colour pictures")] = "/camera/color/image_raw",
    depth: Annotated[str, Parameter(help="topic of the depth that is aligned to them")] = (
        "/camera/aligned_depth_to_color/image_raw"
    ),
    info: Annotated[str, Parameter(help="topic of the colour camera's info")] = "/camera/color/camera_info",
) -> None:  # fmt: skip
    """The first picture of a ROS 1 or ROS 2 bag that has a depth (group ros). Lens distortion is undone.

    Examples:
      gem-lite import bag recording.bag my-scene
    """
    from gem_lite import layouts

    with as_a_sentence(source):
        finish(scene, layouts.read_bag(source, color, depth, info, name))


APP = make_app("import", ABOUT, bop, tum, open3d, cloud, bag)


@contextlib.contextmanager
def as_a_sentence(source: Path) -> Iterator[None]:
    """In this context, any error about a stranger's file is a ValueError with one sentence."""
    try:
        yield
    except (OSError, ValueError):
        raise
    except Exception as error:
        raise ValueError(f"{source} is not as its format says: {type(error).__name__}: {error}") from error


def finish(scene: Path, frame: RawView) -> None:
    """Write a frame into a scene, and say what it is."""
    from gem_lite import layouts
    from gem_lite.rgbd.observation import DEEPEST, DEPTH_SCALE

    layouts.write(scene, frame)
    height, width = frame.depth.shape
    measured = ((frame.depth > 0) & (frame.depth <= DEEPEST * DEPTH_SCALE)).mean()
    print(f"wrote {frame.name} into {scene}: {width} x {height} pixels, {100 * measured:.0f} % of them with a depth")
    if frame.pose is None:
        print(f"it has no pose: gem-lite set-up propose {scene} --camera {frame.name}")
    else:
        print(f"its pose is that of the files: gem-lite check-cameras {scene} says whether the table is at z = 0 there")
