"""The input of a policy: RGB-D views, from arrays or from a folder.

A folder holds ``cameras.json``, and for each camera a colour picture and a depth picture (docs/your_table.md)::

    {"version": 1,
     "cameras": [{"name": "front", "color": "front.color.png", "depth": "front.depth.png", "depth_scale": 0.001,
                  "intrinsics": [[450, 0, 320], [0, 450, 240], [0, 0, 1]],
                  "pose": [[...], [...], [...], [0, 0, 0, 1]]}]}

Colour is 8-bit RGB. Depth is 16-bit, in steps of ``depth_scale`` metres along the camera's axis; 0 means that nothing
was measured. The pictures lie in the folder or below it. ``intrinsics`` and ``pose`` are those of `Camera`.
``"distortion"``, a camera's lens in OpenCV's numbers, is undone when the pictures are read. A folder may also say where
the table is in the frame of a robot's base: ``"base_from_table"``, (4, 4), for `robot_base`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from gem_lite.foundations.files import unchanged, write_together, writing
from gem_lite.foundations.forms import Form, Text
from gem_lite.rgbd import png
from gem_lite.rgbd.camera import Camera, Matrix, View, checked_intrinsics, checked_pose
from gem_lite.rgbd.lens import checked_distortion, without_distortion

CAMERAS_FILE = "cameras.json"
DEPTH_SCALE = 1e-4
"""Metres of one step of a depth picture that `Observation.save` writes. 16 bits reach 6.5535 m."""
DEEPEST = 65535
"""The largest number in a depth picture."""
LARGEST_SCALE = 0.01
"""A depth picture whose steps are larger (m) is refused: its scale was probably given in millimetres."""


def _inside(name: str) -> str:
    if not name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise ValueError("must be a picture in the folder")
    return name


class CameraEntry(Form):
    """A camera in cameras.json."""

    name: Text
    color: Annotated[str, AfterValidator(_inside)]
    depth: Annotated[str, AfterValidator(_inside)]
    depth_scale: float = Field(gt=0, le=LARGEST_SCALE)
    intrinsics: list[list[float]]
    pose: list[list[float]] | None = None
    distortion: list[float] = Field(default=[])


def _named_differently(cameras: list[CameraEntry]) -> list[CameraEntry]:
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names):
        raise ValueError("must have different names")
    return cameras


class CamerasFile(Form):
    """The file cameras.json."""

    version: Literal[1]
    cameras: Annotated[list[CameraEntry], AfterValidator(_named_differently)] = Field(min_length=1)
    base_from_table: list[list[float]] | None = None


@dataclass(frozen=True)
class RawView:
    """What a folder says of one camera, before it is checked whether colour and depth fit together.

    Attributes:
        name: of the camera.
        rgb: (H, W, 3) uint8.
        depth: (h, w) float32 metres; 0 where nothing was measured.
        intrinsics, pose: those of `Camera`. None: the pose is not known.
    """

    name: str
    rgb: np.ndarray
    depth: np.ndarray
    intrinsics: Matrix
    pose: Matrix | None = None

    @property
    def misfit(self) -> str:
        """Why colour and depth do not fit together; "" if they have the same size."""
        if self.depth.shape == self.rgb.shape[:2]:
            return ""
        color, depth = (f"{image.shape[1]} x {image.shape[0]}" for image in (self.rgb, self.depth))
        return f"colour is {color} and depth {depth} pixels: give the depth that is aligned to the colour camera"

    def view(self) -> View:
        """The view. Raises ValueError if colour and depth differ in size, or the pose is not known or a reflection."""
        if self.misfit:
            raise ValueError(f"camera {self.name!r}: {self.misfit}")
        if self.pose is None:
            raise ValueError(f"camera {self.name!r} has no pose: `gem-lite set-up` finds it by the table")
        size = (self.rgb.shape[0], self.rgb.shape[1])
        return View(Camera(self.name, self.intrinsics, self.pose, size), self.rgb, self.depth)


@dataclass(frozen=True)
class Observation:
    """All that a policy sees: RGB-D views of the table. It has no mask, no pose and no rendering from above."""

    views: tuple[View, ...]

    @classmethod
    def from_arrays(
        cls, colors: Sequence[np.ndarray], depths: Sequence[np.ndarray], intrinsics: Sequence[np.ndarray],
        poses: Sequence[np.ndarray], names: Sequence[str] | None = None,
    ) -> Observation:  # fmt: skip
        """An observation from the arrays of a camera's driver, one entry of each argument for each camera.

        Args:
            colors: (H, W, 3) uint8 RGB.
            depths: (H, W) metres along the camera's axis. What is not finite or not above 0 was not measured.
            intrinsics: (3, 3) in pixels, see `Camera`.
            poses: (4, 4) from the camera's axes (x right, y down, z forward) to the table's frame (metres).
            names: of the cameras; by default "camera 0" and so on.

        Raises:
            ValueError: there is no camera; the arguments have different lengths; an array has a wrong shape or type.
        """
        counts = {len(part) for part in (colors, depths, intrinsics, poses, colors if names is None else names)}
        if counts == {0} or len(counts) > 1:
            raise ValueError(f"colors, depths, intrinsics, poses and names must be equally many, got {sorted(counts)}")
        views = []
        for number, (rgb, depth, matrix, pose) in enumerate(zip(colors, depths, intrinsics, poses, strict=True)):
            name = f"camera {number}" if names is None else names[number]
            picture, metres = np.asarray(rgb), np.asarray(depth)
            if picture.ndim != 3 or picture.shape[2] != 3 or metres.ndim != 2:
                raise ValueError(
                    f"colors must be (H, W, 3) and depths (H, W), got {picture.shape} and {metres.shape} for {name!r}"
                )
            if not np.issubdtype(metres.dtype, np.floating):
                raise ValueError(
                    f"depth of {name!r} must be metres as floating point numbers, got {metres.dtype}; multiply whole "
                    "numbers by their scale, such as 0.001"
                )
            finite = metres < np.finfo(np.float32).max
            measured = np.where(finite & (metres > 0), metres, 0).astype(np.float32)
            views.append(RawView(name, picture, measured, matrix, pose).view())
        return cls(tuple(views))

    @classmethod
    def load(cls, folder: Path | str) -> Observation:
        """The observation in a folder of the form above.

        Raises:
            FileNotFoundError: the folder, its cameras.json or a picture is missing.
            ValueError: a file is cut off, or something in it is not allowed. The message names the camera.
        """
        return cls(tuple(raw.view() for raw in read_raw(folder)))

    def save(self, folder: Path | str, depth_scale: float = DEPTH_SCALE) -> None:
        """Write the observation into a folder, for `load`. Depth is rounded to ``depth_scale`` metres (`depth_steps`).

        Raises:
            ValueError: two views have the same name; a name is empty, holds a slash or begins with a dot;
                ``depth_scale`` is not above 0 and at most `LARGEST_SCALE`; no depth of a view fits into 16 bits.
            OSError: a file cannot be written, or another process writes into the folder. The old files stay.
        """
        contents = self.contents(folder, depth_scale)
        with writing(Path(folder)):
            write_together(contents)

    def contents(self, folder: Path | str, depth_scale: float = DEPTH_SCALE) -> dict[Path, bytes]:
        """The files that `save` writes, and what they hold; cameras.json, which names the others, is the last.

        Raises: as `save`.
        """
        folder = Path(folder)
        if not 0 < depth_scale <= LARGEST_SCALE:
            raise ValueError(
                f"depth_scale must be the metres of one step, above 0 and at most {LARGEST_SCALE}, got {depth_scale}"
            )
        names = [view.camera.name for view in self.views]
        if len(set(names)) < len(names) or any("/" in name or name[:1] in ("", ".") for name in names):
            raise ValueError(f"views must have different names without a slash and without a dot in front, got {names}")
        contents: dict[Path, bytes] = {}
        entries = []
        for view in self.views:
            name = view.camera.name
            files = {"color": f"{name}.color.png", "depth": f"{name}.depth.png"}
            contents[folder / files["color"]] = png.encode(view.rgb)
            contents[folder / files["depth"]] = png.encode(depth_steps(view, depth_scale))
            entries.append({
                "name": name, **files, "depth_scale": depth_scale, "intrinsics": view.camera.intrinsics,
                "pose": view.camera.pose,
            })  # fmt: skip
        contents[folder / CAMERAS_FILE] = json.dumps({"version": 1, "cameras": entries}, indent=1).encode()
        return contents


def depth_steps(view: View, scale: float) -> np.ndarray:
    """A view's depth in steps of ``scale`` metres, as depth pictures keep it: (H, W) uint16.

    Depth that is not finite, negative, or beyond the last step was not measured: it becomes 0.

    Raises:
        ValueError: something was measured, and all of it is beyond the last step.
    """
    steps = np.round(view.depth / scale)
    fits = (steps >= 0) & (steps <= DEEPEST)
    beyond = np.isfinite(view.depth) & (steps > DEEPEST)
    if beyond.any() and not steps[fits].any():
        raise ValueError(
            f"camera {view.camera.name!r} sees nothing nearer than {view.depth[beyond].min():.2f} m, but 16 bits reach "
            f"{DEEPEST * scale:.2f} m in steps of {scale} m: give metres, or a larger depth_scale"
        )
    return np.where(fits, steps, 0).astype(np.uint16)


def read_raw(folder: Path | str, posed: bool = True) -> list[RawView]:
    """The cameras of a folder. Other than in `Observation.load`, colour and depth may have different sizes.

    Args:
        posed: whether every camera must have a pose. Otherwise poses are not read.

    Raises: as `Observation.load`.
    """
    folder = Path(folder)
    path = folder / CAMERAS_FILE
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is no folder")
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no scene: there is no {CAMERAS_FILE} in it")

    def read_picture(name: str, channels: int, dtype: type) -> np.ndarray:
        picture = folder / name
        if not picture.is_file():
            raise FileNotFoundError(f"{picture} is missing, though {CAMERAS_FILE} names it")
        return png.decode(picture.read_bytes(), channels, dtype, picture)

    with unchanged(path):
        return raw_views(path.read_bytes(), path, read_picture, posed)


def raw_views(
    content: bytes | str, path: object, read_picture: Callable[[str, int, type], np.ndarray], posed: bool = True
) -> list[RawView]:  # fmt: skip
    """The cameras that the content of a file cameras.json describes.

    Args:
        path: names the file in an error message.
        read_picture: gives the picture of a name, with a number of channels and of a type.
        posed: see `read_raw`.

    Raises:
        ValueError: something in the content is not allowed.
    """
    views = []
    for number, entry in enumerate(CamerasFile.read(content, path).cameras):
        checked_intrinsics(entry.intrinsics, f"{path} cameras {number} intrinsics")
        if entry.pose is None and posed:
            raise ValueError(f"{path} cameras {number} lacks pose: `gem-lite set-up` finds it by the table")
        pose = entry.pose if posed else None
        if pose is not None:
            checked_pose(pose, f"{path} cameras {number} pose", mirrored=True)  # `camera_check` explains a mirror.
        rgb = read_picture(entry.color, 3, np.uint8)
        depth = read_picture(entry.depth, 1, np.uint16).astype(np.float32) * np.float32(entry.depth_scale)
        distortion = checked_distortion(entry.distortion, f"{path} cameras {number} distortion")
        if depth.shape == rgb.shape[:2]:  # Otherwise the view is refused, whatever its lens.
            rgb, depth = (without_distortion(picture, entry.intrinsics, distortion) for picture in (rgb, depth))
        views.append(RawView(entry.name, rgb, depth, entry.intrinsics, pose))
    return views


def robot_base(folder: Path | str) -> np.ndarray | None:
    """(4, 4): from the table's frame to that of a robot's base (m), if the folder's cameras.json says it.

    Raises: as `Observation.load`.
    """
    path = Path(folder) / CAMERAS_FILE
    given = CamerasFile.read(path.read_bytes(), path).base_from_table
    return None if given is None else checked_pose(given, f"{path} base_from_table")
