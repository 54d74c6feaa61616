"""``gem-lite set-up``: the poses of cameras, from what is in their pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from gem_lite.cli.base import make_app
from gem_lite.foundations.files import write_atomically

if TYPE_CHECKING:
    import numpy as np

    from gem_lite.rgbd.observation import RawView
    from gem_lite.rgbd.planes import Plane
    from gem_lite.rgbd.table_pose import TablePose
    from gem_lite.se2 import Pose2

ABOUT = """Find the poses of cameras by the table in their pictures.

The folder holds cameras.json with its pictures; its cameras need no poses.
The table's plane gives the height and two tilts of a pose. Each command has
another way to say where the table's frame lies on that plane. Pixels count
from the picture's upper left corner. The pose goes into cameras.json, and a
picture shows what it means."""

Folder = Annotated[Path, Parameter(help="folder with cameras.json and its pictures")]
Numbers = Annotated[list[float], Parameter(help="x y of each pixel")]


@Parameter(name="*")
@dataclass(frozen=True)
class Options:
    """What every way to a pose has."""

    camera: Annotated[str | None, Parameter(help="name of the camera, if there are several")] = None
    at: Annotated[
        tuple[float, float, float],
        Parameter(help="X Y (m) and yaw (degrees) on the table of what is clicked or printed"),
    ] = (0.5, 0.0, 0.0)
    out: Annotated[
        Path | None, Parameter(help="file for the picture (without it: runs/set-up/<folder>-<camera>.png)")
    ] = None

    @property
    def pose(self) -> Pose2:
        """Where on the table it is."""
        from gem_lite.se2 import Pose2

        return Pose2(self.at[0], self.at[1], math.radians(self.at[2]))


DEFAULT = Options()


def propose(folder: Folder, /, *, options: Options = DEFAULT) -> None:
    """Without a click: the table below the picture's middle lies at --at, and the picture's right is +x.

    Examples:
      gem-lite set-up propose data/foreign-scenes/desk --camera left
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    plane = likeliest(view)
    finish(folder, view, table_pose.from_picture(plane, view.intrinsics, view.rgb.shape[:2], options.pose), options)


def clicks(folder: Folder, pixels: Numbers, /, *, options: Options = DEFAULT) -> None:
    """Two pixels: the point of the table that lies at --at, and a point in the direction of +x from it.

    Examples:
      gem-lite set-up clicks data/foreign-scenes/desk 320 200 250 170 --camera left
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    middle, right = pairs(pixels, 2)
    plane = likeliest(view, [middle, right])
    found = table_pose.from_clicks(plane, middle, right, view.intrinsics, options.pose)
    finish(folder, view, found, options, [middle, right])


def corners(folder: Folder, pixels: Numbers, /, *, options: Options = DEFAULT) -> None:
    """Four pixels: the corners of a rectangle whose middle lies at --at. Its sides are measured.

    The order is that of a map: lower left, lower right, upper right, upper left.

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


def points(folder: Folder, numbers: Annotated[list[float], Parameter(help="x y X Y of each point")], /, *,
           options: Options = DEFAULT) -> None:  # fmt: skip
    """Two or more pixels x y, each with its place X Y on the table in metres.

    Examples:
      gem-lite set-up points my-scene 320 200 0.5 0.0  250 170 0.7 0.0
    """
    import numpy as np

    from gem_lite.rgbd import table_pose

    if len(numbers) < 8 or len(numbers) % 4:
        raise ValueError(f"points must be x y X Y for two points or more, got {len(numbers)} numbers")
    view = chosen(folder, options.camera)
    known = np.array(numbers).reshape(-1, 4)
    plane = likeliest(view, known[:, :2])
    found = table_pose.pose_from_points(plane, known[:, :2], known[:, 2:], view.intrinsics)
    finish(folder, view, found, options, known[:, :2])


def tag(folder: Folder, number: int, side: float, /, *, options: Options = DEFAULT) -> None:
    """An AprilTag 36h11 that lies flat on the table: its middle is at --at, its upper edge points to +y at yaw 0.

    Args:
        number: of the tag
        side: of its black square (m)

    Examples:
      gem-lite set-up tag my-scene 0 0.14
    """
    from gem_lite.rgbd import table_pose

    view = chosen(folder, options.camera)
    pixels, places = table_pose.tag_points(view.rgb, number, side, options.pose)
    plane = likeliest(view, pixels)
    finish(folder, view, table_pose.pose_from_points(plane, pixels, places, view.intrinsics), options, pixels)


def board(folder: Folder, columns: int, rows: int, square: float, marker: float, /, *,
          options: Options = DEFAULT) -> None:  # fmt: skip
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
    pixels, places = table_pose.board_points(view.rgb, (columns, rows), square, marker, options.pose)
    plane = likeliest(view, pixels)
    finish(folder, view, table_pose.pose_from_points(plane, pixels, places, view.intrinsics), options, pixels)


def robot(folder: Folder, /) -> None:
    """For poses that are known in the frame of a robot's base: finds the table's height and tilt there.

    The poses become those in the table's frame, whose origin lies below the
    base's. cameras.json keeps base_from_table, with which `look` says the
    actions in the base's frame.

    Examples:
      gem-lite set-up robot my-scene
    """
    import numpy as np

    from gem_lite.rgbd import planes, table_pose
    from gem_lite.rgbd.observation import read_raw, robot_base

    if robot_base(folder) is not None:
        raise ValueError(f"{folder} has base_from_table already: its poses are those in the table's frame")
    views = read_raw(folder)
    poses = [np.array(view.pose) for view in views]
    clouds = [
        table_pose.measured_points(view.depth, view.intrinsics) @ pose[:3, :3].T + pose[:3, 3]
        for view, pose in zip(views, poses, strict=True)
    ]
    base, table = table_pose.base_from_table(clouds, [pose[:3, 3] for pose in poses])
    print(
        f"the table lies at z = {base[2, 3]:.3f} m below the base's origin, tilted by {planes.tilt(table.normal):.1f} "
        f"degrees; it holds {100 * table.share:.0f} % of what is measured"
    )
    turned = {view.name: np.linalg.inv(base) @ pose for view, pose in zip(views, poses, strict=True)}
    write(folder, turned, base)


APP = make_app("set-up", ABOUT, propose, clicks, corners, points, tag, board, robot)


def chosen(folder: Path, name: str | None) -> RawView:
    """The camera of a folder with a name, or its only one. Raises ValueError if there is none."""
    from gem_lite.rgbd.observation import read_raw

    views = read_raw(folder, posed=False)
    fitting = [view for view in views if name in (None, view.name)]
    if len(fitting) != 1:
        raise ValueError(f"--camera must be one of {', '.join(view.name for view in views)}, got {name}")
    if fitting[0].misfit:
        raise ValueError(f"camera {fitting[0].name!r}: {fitting[0].misfit}")
    return fitting[0]


def pairs(numbers: list[float], count: int) -> list[tuple[float, float]]:
    """Pixels from their numbers in a row. Raises ValueError if there are more or fewer."""
    if len(numbers) != 2 * count:
        raise ValueError(f"pixels must be x and y of {count} points, got {len(numbers)} numbers")
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def likeliest(view: RawView, clicked: Sequence[tuple[float, float]] | np.ndarray = ()) -> Plane:
    """The plane that is most likely the table. Prints how sure that is."""
    from gem_lite.rgbd import planes, table_pose

    table, *others = table_pose.table_planes(view.depth, view.intrinsics, clicked)
    downwards = 90 - planes.tilt(table.normal, (0, 0, -1))
    print(
        f"{view.name}: {table.offset:.3f} m above the table, looking {downwards:.0f} degrees down; the table holds "
        f"{100 * table.share:.0f} % of what is measured; planes through its halves differ by {table.bend:.2f} degrees"
    )
    for other in others:
        where = f"{other.offset:.2f} m away, {planes.tilt(table.normal, other.normal):.0f} degrees from it"
        print(f"  another plane, {where}, holds {100 * other.share:.0f} %")
    if others and not len(clicked):
        print("  if another one is the table, say so by a click on it: gem-lite set-up clicks")
    return table


def finish(
    folder: Path, view: RawView, found: TablePose, options: Options,
    pixels: Sequence[tuple[float, float]] | np.ndarray = (),
) -> None:  # fmt: skip
    """Say how well a pose is known, write it, and draw it."""
    import numpy as np

    from gem_lite.drawing import plot_own_table
    from gem_lite.rgbd.heightmap import fuse_views
    from gem_lite.rgbd.seen import seen_of_table
    from gem_lite.se2 import Workspace

    if len(found.residuals) > 2:
        off = 1000 * found.residuals
        print(f"the points lie {off.mean():.1f} mm from their places on average, {off.max():.1f} mm at most")
    pixel = f"a pixel is {1000 * found.pixel:.1f} mm long there"
    print(f"{pixel}; a pixel's error turns the table by {found.turn:.2f} degrees")
    seen_by = replace(view, pose=found.pose).view()
    rectangle = seen_of_table(seen_by)
    workspace = Workspace()
    if rectangle is not None:
        text = " ".join(f"{limit:.2f}" for limit in rectangle)
        print(f"what is seen of the table fits --rectangle {text}")
    write(folder, {view.name: np.array(found.pose)})

    def to_pixels(points: np.ndarray) -> np.ndarray:
        local = (points - seen_by.camera.position) @ seen_by.camera.rotation
        return (local @ seen_by.camera.matrix.T)[:, :2] / local[:, 2:]

    figure = plot_own_table.show_set_up(view.rgb, to_pixels, workspace, fuse_views([seen_by], workspace), pixels)
    file = options.out or Path("runs") / "set-up" / f"{folder.resolve().name}-{view.name}.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
    print(f"wrote {file}")


def write(folder: Path, poses: dict[str, np.ndarray], base: np.ndarray | None = None) -> None:
    """Write the poses of cameras into a folder's cameras.json; everything else in it stays."""
    from gem_lite.rgbd.observation import CAMERAS_FILE

    file = folder / CAMERAS_FILE
    content = json.loads(file.read_text())
    for entry in content["cameras"]:
        if entry["name"] in poses:
            entry["pose"] = poses[entry["name"]].tolist()
    if base is not None:
        content["base_from_table"] = base.tolist()
    write_atomically(file, json.dumps(content, indent=1).encode())
    print(f"wrote the pose of {', '.join(poses)} into {file}")
