"""``gem-lite set-up``: the poses of cameras, from what is in their pictures."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from gem_lite.cli.base import make_app
from gem_lite.cli.own_table import draw
from gem_lite.foundations.files import write_atomically, writing

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from gem_lite.rgbd.observation import RawView
    from gem_lite.rgbd.planes import Plane
    from gem_lite.rgbd.table_pose import TablePose
    from gem_lite.se2 import Pose2

    Pixels = np.ndarray | Sequence[tuple[float, float]]

ABOUT = """Find the poses of cameras by the table in their pictures.

The folder holds cameras.json with its pictures; its cameras need no poses.
The table's plane gives the height and two tilts of a pose. Each command has
another way to say where the table's frame lies on that plane. Pixels are
whole numbers, as viewers of pictures show them: x to the right and y down
from the first pixel, which is 0 0. With a distortion in cameras.json, they
are those of the picture without it (MarkPixels shows it). The pose goes into
cameras.json, and a picture shows what it means."""
BORDER = 60
"""So many points along each side of the rectangle are drawn."""

Folder = Annotated[Path, Parameter(help="folder with cameras.json and its pictures")]
Numbers = Annotated[list[float], Parameter(help="x y of each pixel")]


@Parameter(name="*")
@dataclass(frozen=True)
class Options:
    """What every way to a pose has."""

    camera: Annotated[str | None, Parameter(help="name of the camera, if there are several")] = None
    out: Annotated[
        Path | None, Parameter(help="folder for the picture (without it: runs/set-up/<name of the folder>)")
    ] = None


@Parameter(name="*")
@dataclass(frozen=True)
class PlacedOptions(Options):
    """What the ways have that say where one thing lies."""

    at: Annotated[
        tuple[float, float, float],
        Parameter(help="X Y (m) and yaw (degrees) on the table of what is clicked or printed"),
    ] = (0.5, 0.0, 0.0)

    @property
    def pose(self) -> Pose2:
        """Where on the table it is."""
        from gem_lite.se2 import Pose2

        return Pose2(self.at[0], self.at[1], math.radians(self.at[2]))


def clicks(folder: Folder, pixels: Numbers, /, *, options: PlacedOptions = PlacedOptions()) -> None:
    """Two pixels: the point of the table that lies at --at, and a point in the direction of +x from it.

    Click points of the bare table that are far from each other.

    Examples:
      gem-lite set-up clicks my-scene 320 240 560 240
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    middle, right = pairs(pixels, 2)
    plane = likeliest(view, [middle, right])
    found = table_pose.from_clicks(plane, middle, right, view.intrinsics, options.pose)
    finish(folder, view, found, options, [middle, right])


def propose(folder: Folder, /, *, options: PlacedOptions = PlacedOptions()) -> None:
    """No pixel: the point in the middle of the picture lies at --at, and the picture's right is +x.

    Examples:
      gem-lite set-up propose my-scene
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    size = (view.rgb.shape[0], view.rgb.shape[1])
    finish(folder, view, table_pose.from_picture(likeliest(view), view.intrinsics, size, options.pose), options)


def corners(folder: Folder, pixels: Numbers, /, *, options: PlacedOptions = PlacedOptions()) -> None:
    """Four pixels: the corners of a rectangle whose middle lies at --at. Its sides are measured.

    The order is that of a map: lower left, lower right, upper right, upper left.
    A sheet of A4 must have 0.297 m x 0.210 m: otherwise depth or intrinsics are wrong.

    Examples:
      gem-lite set-up corners my-scene 100 400 500 410 430 180 160 175
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    four = pairs(pixels, 4)
    found = table_pose.from_rectangle(likeliest(view, four), four, view.intrinsics, options.pose)
    sides = [math.dist(found.points[number], found.points[number + 1]) for number in (0, 1)]
    print(f"the rectangle is {sides[0]:.3f} m along its lower side and {sides[1]:.3f} m along the other")
    finish(folder, view, found, options, four)


def points(
    folder: Folder, numbers: Annotated[list[float], Parameter(help="x y X Y of each point")], /, *,
    options: Options = Options(),
) -> None:  # fmt: skip
    """Two or more pixels x y, each with its place X Y on the table in metres.

    Examples:
      gem-lite set-up points my-scene 320 240 0.5 0.0  560 240 0.7 0.0
    """
    if len(numbers) < 8 or len(numbers) % 4:
        raise ValueError(f"points must be x y X Y for two points or more, got {len(numbers)} numbers")
    rows = [numbers[start : start + 4] for start in range(0, len(numbers), 4)]
    pixels = pairs([number for row in rows for number in row[:2]], len(rows))
    from_known(folder, chosen(folder, options.camera), pixels, [row[2:] for row in rows], options)


def tag(folder: Folder, number: int, side: float, /, *, options: PlacedOptions = PlacedOptions()) -> None:
    """An AprilTag 36h11 that lies flat on the table: its middle is at --at, its upper edge points to +y at yaw 0.

    Args:
        number: of the tag
        side: of its black square (m)

    Examples:
      gem-lite set-up tag my-scene 0 0.14
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    from_known(folder, view, *table_pose.tag_points(view.rgb, number, side, options.pose), options)


def board(
    folder: Folder, columns: int, rows: int, square: float, marker: float, /, *,
    options: PlacedOptions = PlacedOptions(),
) -> None:  # fmt: skip
    """A ChArUco board with tags 36h11 that lies flat on the table: its lower left corner is at --at.

    Args:
        columns: squares along its lower edge
        rows: squares along the other edge
        square: side of a square (m)
        marker: side of a tag (m)

    Examples:
      gem-lite set-up board my-scene 5 7 0.04 0.03
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    known = table_pose.board_points(view.rgb, (columns, rows), square, marker, options.pose)
    from_known(folder, view, *known, options)


def robot(
    folder: Folder, /, *,
    height: Annotated[float | None, Parameter(help="about the table's z in the base's frame (m)")] = None,
) -> None:  # fmt: skip
    """For poses that are known in the frame of a robot's base: finds the table's height and tilt there.

    The table is the largest level plane or, with --height, the nearest to it.
    The poses become those in the table's frame, whose origin lies above or
    below the base's. cameras.json keeps base_from_table, with which `look`
    says the actions in the base's frame.

    Examples:
      gem-lite set-up robot my-scene
    """
    import numpy as np

    from gem_lite.rgbd import planes, table_pose
    from gem_lite.rgbd.camera import measured_points
    from gem_lite.rgbd.observation import read_raw

    refuse_base(folder)
    views = read_raw(folder)
    for view in views:
        refuse(view)
    poses = [np.array(view.view().camera.pose) for view in views]
    clouds = [
        measured_points(view.depth, view.intrinsics) @ pose[:3, :3].T + pose[:3, 3]
        for view, pose in zip(views, poses, strict=True)
    ]
    level = table_pose.level_planes(clouds, [pose[:3, 3] for pose in poses])
    heights = [float(table_pose.base_from_table(plane)[2, 3]) for plane in level]
    number = 0 if height is None else min(range(len(level)), key=lambda n: abs(heights[n] - height))
    for other, z in enumerate(heights):
        which = "the table is" if other == number else "another level plane is"
        tilted = f"tilted by {planes.tilt(level[other].normal):.1f} degrees"
        share = f"it holds {100 * level[other].share:.0f} % of what is measured"
        print(f"{which} at z = {z:.3f} m in the base's frame, {tilted}; {share}")
    base = table_pose.base_from_table(level[number])
    turned = {view.name: np.linalg.inv(base) @ pose for view, pose in zip(views, poses, strict=True)}
    write(folder, turned, base)


APP = make_app(
    "set-up", ABOUT, clicks, propose, corners, points, tag, board, robot,
    help_epilogue="Example:\n  gem-lite set-up clicks my-scene 320 240 560 240",
)  # fmt: skip


def chosen(folder: Path, name: str | None) -> RawView:
    """The camera of a folder with a name, or its only one. Raises ValueError if it cannot be set up."""
    from gem_lite.rgbd.observation import read_raw

    refuse_base(folder)
    views = read_raw(folder, posed=False)
    fitting = [view for view in views if name in (None, view.name)]
    if len(fitting) != 1:
        names = ", ".join(view.name for view in views)
        raise ValueError(f"--camera must be one of {names}" + ("" if name is None else f", got {name}"))
    refuse(fitting[0])
    return fitting[0]


def refuse(view: RawView) -> None:
    """Raises ValueError if a view has a mistake that no pose can mend."""
    from gem_lite.rgbd.camera_check import implausible_intrinsics

    reason = view.misfit or implausible_intrinsics(view)
    if reason:
        raise ValueError(f"camera {view.name!r}: {reason}")


def refuse_base(folder: Path) -> None:
    """Raises ValueError if a folder's poses were made from those in a robot's frame."""
    from gem_lite.rgbd.observation import CAMERAS_FILE, robot_base

    if (folder / CAMERAS_FILE).exists() and robot_base(folder) is not None:
        raise ValueError(
            f"{folder / CAMERAS_FILE} has base_from_table, which belongs to its poses: remove it if you gave other "
            "poses in the base's frame, or want another frame of the table"
        )


def pairs(numbers: list[float], count: int) -> list[tuple[float, float]]:
    """The middles of pixels, from the upper left edge. Raises ValueError if there are more or fewer numbers."""
    if len(numbers) != 2 * count:
        raise ValueError(f"pixels must be x and y of {count} points, got {len(numbers)} numbers")
    return [(x + 0.5, y + 0.5) for x, y in zip(numbers[::2], numbers[1::2], strict=True)]


def likeliest(view: RawView, clicked: Pixels = ()) -> Plane:
    """The plane that is most likely the table. Prints how sure that is."""
    from gem_lite.rgbd import planes, table_pose

    table, *others = table_pose.table_planes(view.depth, view.intrinsics, clicked)
    downwards = 90 - planes.tilt(table.normal, (0, 0, -1))
    print(
        f"{view.name}: {table.offset:.3f} m above the table, looking {downwards:.0f} degrees down; the table holds "
        f"{100 * table.share:.0f} % of what is measured; planes through its halves differ by {table.bend:.2f} degrees"
    )
    for other in others:
        turned = planes.tilt(table.normal, other.normal)
        print(
            f"  another plane is {other.offset:.2f} m from the camera and tilted by {turned:.0f} degrees against the "
            f"table; it holds {100 * other.share:.0f} %"
        )
    if others and not len(clicked):
        print("  if another one is the table, say so by clicks on it: gem-lite set-up clicks")
    return table


def from_known(folder: Path, view: RawView, pixels: Pixels, places: Pixels, options: Options) -> None:
    """Finish with points of the table whose places are known."""
    import numpy as np

    from gem_lite.rgbd import table_pose

    plane = likeliest(view, pixels)
    found = table_pose.pose_from_points(plane, np.array(pixels), np.array(places), view.intrinsics)
    finish(folder, view, found, options, pixels)


def finish(folder: Path, view: RawView, found: TablePose, options: Options, pixels: Pixels = ()) -> None:
    """Say how well a pose is known, draw it, and write it."""
    import numpy as np

    from gem_lite.rgbd.seen import seen_of_table

    found.refuse_if_wrong()
    if len(found.residuals) > 2:
        off = 1000 * found.residuals
        print(f"the points lie {off.mean():.1f} mm from their places on average, {off.max():.1f} mm at most")
    pixel = f"a pixel is {1000 * found.pixel:.1f} mm long there"
    print(f"{pixel}; if a point is wrong by a pixel, the table turns by {found.turn:.2f} degrees")
    posed = replace(view, pose=found.pose)
    rectangle = seen_of_table(posed.view())
    if rectangle is not None:
        x_min, x_max, y_min, y_max = rectangle
        print(
            f"the camera sees the table from x {x_min:.2f} to {x_max:.2f} m and y {y_min:.2f} to {y_max:.2f} m; "
            "check-cameras, look and train take another part of it as --rectangle"
        )
    draw({view.name: show(posed, pixels)}, options.out, folder, "set-up")
    write(folder, {view.name: np.array(found.pose)})


def show(posed: RawView, pixels: Pixels) -> Figure:
    """Draw the shipped policies' rectangle, if it is seen, and the axes into a camera's picture."""
    import numpy as np

    from gem_lite.drawing import plot_own_table
    from gem_lite.rgbd.heightmap import fuse_views
    from gem_lite.se2 import Workspace

    view, workspace = posed.view(), Workspace()
    x_min, x_max, y_min, y_max = workspace.limits
    ends = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max], [x_min, y_min]])
    border = np.concatenate([np.linspace(a, b, BORDER) for a, b in itertools.pairwise(ends)])
    middle = ends[:4].mean(axis=0)
    axes = middle + np.array([[0, 0], [0.1, 0], [0, 0.1]])

    def to_pixels(places: np.ndarray) -> np.ndarray:
        points = np.column_stack([places, np.zeros(len(places))])
        local = (points - view.camera.position) @ view.camera.rotation
        ahead = np.where(local[:, 2:] > view.camera.near, local[:, 2:], np.nan)  # nothing of what is behind it
        return (local @ view.camera.matrix.T)[:, :2] / ahead

    try:
        heightmap = fuse_views([view], workspace)
    except ValueError:
        print("the camera sees nothing of the shipped policies' rectangle, x 0.25 to 0.75 m and y -0.5 to 0.5 m")
        heightmap = None
    return plot_own_table.show_set_up(view.rgb, to_pixels(border), to_pixels(axes), heightmap, pixels)


def write(folder: Path, poses: dict[str, np.ndarray], base: np.ndarray | None = None) -> None:
    """Write the poses of cameras into a folder's cameras.json; everything else in it stays.

    Raises:
        OSError: the file cannot be written, or another process writes into the folder.
    """
    from gem_lite.rgbd.observation import CAMERAS_FILE

    file = folder / CAMERAS_FILE
    with writing(folder):
        content = json.loads(file.read_bytes())
        for entry in content["cameras"]:
            if entry["name"] in poses:
                entry["pose"] = poses[entry["name"]].tolist()
        if base is not None:
            content["base_from_table"] = base.tolist()
        write_atomically(file, json.dumps(content, indent=1).encode())
    print(f"wrote the pose of {', '.join(poses)} into {file}")
