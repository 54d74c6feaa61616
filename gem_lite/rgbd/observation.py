"""The input of a policy: RGB-D views, from arrays or from a folder.

A folder holds ``cameras.json``, and for each camera a colour picture and a depth picture (docs/your_table.md)::

    {"version": 1,
     "cameras": [{"name": "front", "color": "front.color.png", "depth": "front.depth.png", "depth_scale": 0.001,
                  "intrinsics": [[450, 0, 320], [0, 450, 240], [0, 0, 1]],
                  "pose": [[...], [...], [...], [0, 0, 0, 1]]}]}

Colour is 8-bit RGB. Depth is 16-bit, in steps of ``depth_scale`` metres along the camera's axis; 0 means that nothing
was measured. The pictures lie in the folder or below it. ``intrinsics`` and ``pose`` are those of `Camera`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gem_lite.foundations.files import as_number, as_text, read_json, unchanged, write_together, writing
from gem_lite.rgbd import png
from gem_lite.rgbd.camera import Camera, Matrix, View

CAMERAS_FILE = "cameras.json"
VERSION = 1
DEPTH_SCALE = 1e-4
"""Metres of one step of a depth picture that `Observation.save` writes. 16 bits reach 6.5535 m."""
DEEPEST = 65535
"""The largest number in a depth picture."""
LARGEST_SCALE = 0.01
"""A depth picture whose steps are larger (m) is refused: its scale was probably given in millimetres."""


@dataclass(frozen=True)
class RawView:
    """What a folder says of one camera, before it is checked whether colour and depth fit together.

    Attributes:
        name: of the camera.
        rgb: (H, W, 3) uint8.
        depth: (h, w) float32 metres; 0 where nothing was measured.
        intrinsics, pose: those of `Camera`.
    """

    name: str
    rgb: np.ndarray
    depth: np.ndarray
    intrinsics: Matrix
    pose: Matrix

    def view(self) -> View:
        """The view. Raises ValueError if colour and depth have different sizes, or the pose is a reflection."""
        size = (self.rgb.shape[0], self.rgb.shape[1])
        if self.depth.shape != size:
            raise ValueError(
                f"camera {self.name!r}: colour is {size[1]} x {size[0]} and depth {self.depth.shape[1]} x "
                f"{self.depth.shape[0]} pixels; give the depth that is aligned to the colour camera"
            )
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
            if not np.issubdtype(np.asarray(depth).dtype, np.floating):
                raise ValueError(
                    f"depth of {name!r} must be metres as floating point numbers, got {np.asarray(depth).dtype}; "
                    "multiply whole numbers by their scale, such as 0.001"
                )
            metres = np.asarray(depth)
            finite = metres < np.finfo(np.float32).max
            measured = np.where(finite & (metres > 0), metres, 0).astype(np.float32)
            raw = RawView(
                name, np.asarray(rgb), measured, _matrix(np.asarray(matrix).tolist(), 3, f"intrinsics of {name!r}"),
                _pose(np.asarray(pose).tolist(), f"pose of {name!r}"),
            )  # fmt: skip
            views.append(raw.view())
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
            ValueError: two views have the same name; a name holds a slash; ``depth_scale`` is not above 0 and at most
                `LARGEST_SCALE`; no depth of a view fits into 16 bits.
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
        _check_scale(depth_scale, "")
        names = [view.camera.name for view in self.views]
        if len(set(names)) < len(names) or any("/" in name or not name for name in names):
            raise ValueError(f"views must have different names without a slash, got {names}")
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
        contents[folder / CAMERAS_FILE] = json.dumps({"version": VERSION, "cameras": entries}, indent=1).encode()
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


def read_raw(folder: Path | str) -> list[RawView]:
    """The cameras of a folder. Other than in `Observation.load`, colour and depth may have different sizes.

    Raises: as `Observation.load`.
    """
    folder = Path(folder)
    path = folder / CAMERAS_FILE
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is no folder")
    if not path.exists():
        raise FileNotFoundError(f"{folder} holds no scene: there is no {CAMERAS_FILE} in it")
    with unchanged(path):
        content = read_json(path.read_bytes(), path)
        if content.get("version") != VERSION:
            raise ValueError(f"{path} must have version {VERSION}, got {content.get('version')!r}")
        entries = content.get("cameras")
        if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
            raise ValueError(f"{path} must have a list of cameras with at least one entry")
        return [_raw_view(folder, entry, f"{path}, camera {number}") for number, entry in enumerate(entries)]


def _raw_view(folder: Path, entry: dict[str, Any], where: str) -> RawView:
    missing = [key for key in ("name", "color", "depth", "depth_scale", "intrinsics", "pose") if key not in entry]
    if missing:
        raise ValueError(f"{where} lacks {', '.join(missing)}")
    try:
        name, color, depth = (as_text(entry[key]) for key in ("name", "color", "depth"))
        scale = as_number(entry["depth_scale"])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    _check_scale(scale, f"{where}: ")
    return RawView(
        name,
        _read_png(folder, color, f"{where}: color", 3, np.uint8),
        _read_png(folder, depth, f"{where}: depth", 1, np.uint16).astype(np.float32) * np.float32(scale),
        _matrix(entry["intrinsics"], 3, f"{where}: intrinsics"),
        _pose(entry["pose"], f"{where}: pose"),
    )


def _check_scale(scale: float, where: str) -> None:
    if not 0 < scale <= LARGEST_SCALE:
        raise ValueError(
            f"{where}depth_scale must be the metres of one step, above 0 and at most {LARGEST_SCALE}, got {scale}"
        )


def _read_png(folder: Path, name: str, where: str, channels: int, dtype: type) -> np.ndarray:
    """A picture of a folder."""
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ValueError(f"{where} must be a picture in the folder, got {name!r}")
    path = folder / name
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing, though {CAMERAS_FILE} names it as {where.rpartition(' ')[2]}")
    return png.decode(path.read_bytes(), channels, dtype, path)


def _matrix(value: object, size: int, name: str) -> Matrix:
    """A square matrix of finite numbers as tuples."""
    if not isinstance(value, list) or len(value) != size or not all(isinstance(row, list) for row in value):
        raise ValueError(f"{name} must be {size} rows of {size} numbers, got {value!r}")
    try:
        rows = tuple(tuple(float(as_number(number)) for number in row) for row in value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    if any(len(row) != size for row in rows):
        raise ValueError(f"{name} must be {size} rows of {size} numbers, got rows of {[len(row) for row in rows]}")
    if size == 3 and (rows[0][0] <= 0 or rows[1][1] <= 0 or rows[2] != (0.0, 0.0, 1.0)):
        raise ValueError(f"{name} must have positive focal lengths and the last row 0 0 1, got {value}")
    return rows


def _pose(value: object, name: str) -> Matrix:
    """A (4, 4) pose. Its rotation may be a reflection: `gem_lite.rgbd.camera_check` says what is wrong then."""
    rows = _matrix(value, 4, name)
    rotation = np.array(rows)[:3, :3]
    if rows[3] != (0.0, 0.0, 0.0, 1.0) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise ValueError(f"{name} must be a rotation and a position, with the last row 0 0 0 1, got {value}")
    return rows
