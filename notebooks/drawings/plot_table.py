"""Drawings of planar motions, of point clouds from any side, and of what a height map keeps of them."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from gem_lite.drawing.plots import OUTLINE, PICK_COLOR, PLACE_COLOR, SAFE_COLORS, bare
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2

POLE = 0.15
"""Height (m) of the marks that stand at a pose in a point cloud."""
THING_COLORS = ListedColormap(["#303030", "#f25555", "white"])
"""The table, a thing on it, and what no camera saw of the thing."""


def _moved(pose: Pose2, points: np.ndarray) -> np.ndarray:
    """Points (N, 2), moved by a pose: from its frame to the table's."""
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    return points @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)


def show_motions(
    panels: Sequence[tuple[str, Sequence[Pose2]]], outline: np.ndarray, centre: Pose2, half: float
) -> Figure:
    """A body before and after each pick and place, with both poses of the gripper, on axes in metres.

    Args:
        panels: title, and the poses of the pick, the place, the body before, its goal, and a distractor. The body is
            drawn after the motion place pick^-1, too.
        outline: (N, 2) metres, the body's outline in its own frame.
        centre, half: each panel shows the square of 2 ``half`` metres about this position.
    """
    fig, axes = plt.subplots(
        1, len(panels), figsize=(2.6 * len(panels), 3.6), sharey=True, squeeze=False, layout="constrained"
    )
    for ax, (title, (pick, place, body, goal, other)) in zip(axes[0], panels, strict=True):
        ax.plot(*_moved(goal, 1.3 * np.concatenate([outline, outline[:1]])).T, ":", color="black", lw=1.4, label="goal")
        ax.add_patch(Circle((other.x, other.y), 0.022, facecolor=SAFE_COLORS[2], edgecolor="black", label="distractor"))
        for pose, gripper, color, line in (
            (body, pick, PICK_COLOR, "-"),
            (place @ pick.inverse() @ body, place, PLACE_COLOR, "--"),
        ):
            ax.fill(*_moved(pose, outline).T, facecolor="0.85", edgecolor="black", ls=line)
            for turn, length in ((0, 0.07), (np.pi / 2, 0.03)):
                arm = length * np.array([np.cos(turn), np.sin(turn)])
                ends = _moved(gripper, np.stack([-arm, arm]))
                ax.plot(*ends.T, color=color, lw=2, path_effects=OUTLINE)
                if turn == 0:
                    name, mark = ("pick", "o") if color == PICK_COLOR else ("place", "s")
                    ax.plot(*ends[1], mark, color=color, mec="black", ms=7, label=name)
        ax.set(xlim=(centre.x - half, centre.x + half), ylim=(centre.y - half, centre.y + half), aspect="equal")
        ax.set_xlabel("x (m)")
        ax.set_title(title, fontsize=9)
        ax.grid(alpha=0.3)
    axes[0, 0].set_ylabel("y (m)")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    return fig


def seen_from(
    points: np.ndarray, rgb: np.ndarray, azimuth: float, elevation: float,
    scale: float = 280.0, size: tuple[int, int] = (300, 330),
) -> np.ndarray:  # fmt: skip
    """A point cloud as an orthographic picture from any side: nearer points hide those behind them.

    Args:
        points: (N, 3) metres. Their middle comes to the picture's middle.
        rgb: (N, 3) uint8.
        azimuth: radians; at -pi / 2 world +x points right.
        elevation: radians; at pi / 2 the eye is straight above, and the picture is the height map's.
        scale: pixels per metre.
        size: (H, W) of the picture.

    Returns:
        (H, W, 3) uint8, white where there is no point.
    """
    sin_a, cos_a, sin_e, cos_e = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
    right = np.array([-sin_a, cos_a, 0.0])
    to_eye = np.array([cos_e * cos_a, cos_e * sin_a, sin_e])
    down = -np.cross(to_eye, right)
    offsets = points - [*(points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2, 0.0]
    order = np.argsort(offsets @ to_eye)
    offsets, colors = offsets[order], rgb[order]
    rows = np.floor(offsets @ down * scale + size[0] / 2).astype(int)
    cols = np.floor(offsets @ right * scale + size[1] / 2).astype(int)
    picture = np.full((*size, 3), 255, np.uint8)
    inside = (rows >= 0) & (rows < size[0]) & (cols >= 0) & (cols < size[1])
    picture[rows[inside], cols[inside]] = colors[inside]  # the nearest point comes last
    return picture


def pose_marks(poses: dict[str, Pose2]) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) and colours (N, 3) uint8 that stand for poses in a cloud: a pole, and an arm along the yaw.

    Args:
        poses: by name; "place" gets the place's colour, every other name the pick's.
    """
    points, colors = [], []
    for name, pose in poses.items():
        steps = np.linspace(0, 1, 120)[:, None]
        foot = np.array([pose.x, pose.y, 0.0])
        top = np.array([pose.x, pose.y, POLE])
        tip = top + 0.09 * np.array([np.cos(pose.yaw), np.sin(pose.yaw), 0])
        line = np.concatenate([foot + steps * (top - foot), top + steps * (tip - top)])
        thick = [line + offset for offset in 0.003 * np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)]
        points.append(np.concatenate(thick))
        color = PLACE_COLOR if name == "place" else PICK_COLOR
        colors.append(np.tile([int(color[i : i + 2], 16) for i in (1, 3, 5)], (len(points[-1]), 1)))
    return np.concatenate(points), np.concatenate(colors).astype(np.uint8)


def show_slice(
    clouds: dict[str, np.ndarray], heightmap: HeightMap, row: int, span: tuple[float, float]
) -> Figure:  # fmt: skip
    """The points of one row of cells from the side, by camera, and the height that each cell gets.

    Args:
        clouds: for each camera (N, 3) metres; only the points of the row are drawn.
        row: the row of the height map.
        span: the part of the row that is drawn, from and to which x (m).
    """
    w = heightmap.workspace
    fig, ax = plt.subplots(figsize=(8.5, 2.9), layout="constrained")
    edges = w.x_min + w.pixel * np.arange(w.shape[1] + 1)
    for i, (name, cloud) in enumerate(clouds.items()):
        cloud = cloud[np.floor(w.to_pixel(cloud[:, 0], cloud[:, 1])[0] + 0.5) == row]
        ax.plot(cloud[:, 0], 1000 * cloud[:, 2], "osD"[i % 3], ms=3.4, alpha=0.6, color=SAFE_COLORS[i], label=name)
    ax.stairs(1000 * heightmap.height[row], edges, color="black", lw=1.4, label="height of the cell")
    ax.set(xlabel="x (m)", ylabel="z (mm)", ylim=(-3, 44))
    ax.set_xticks(edges, minor=True)
    ax.set_xlim(span)
    ax.grid(axis="x", which="minor", alpha=0.25)
    fig.legend(ncols=4, fontsize=8, loc="outside upper center")
    return fig


def show_moved(rows: Sequence[tuple[str, np.ndarray, np.ndarray, str]]) -> Figure:
    """For each kind of picture: the picture (H, W, 3), and beside it the thing brought back (h, w).

    Args:
        rows: name of the picture, the picture, the thing shifted to the middle and turned back (0 table, 1 thing,
            2 unseen), and a text about it.
    """
    widths = [ratio for _, picture, _, _ in rows for ratio in (picture.shape[1] / picture.shape[0], 1)]
    fig, axes = plt.subplots(
        1, 2 * len(rows), figsize=(1.75 * sum(widths), 2.5), width_ratios=widths, layout="constrained"
    )
    for left, right, (name, picture, thing, text) in zip(axes[::2], axes[1::2], rows, strict=True):
        bare(left, name).imshow(picture)
        bare(right, "brought back").imshow(thing, cmap=THING_COLORS, vmin=0, vmax=2)
        right.set_xlabel(text, fontsize=9)
    return fig


def show_cell_size(heightmap: HeightMap, window: tuple[float, float, float, float]) -> Figure:
    """A height map's colours; a part of it, larger; and the map with the cells that no camera saw in white.

    Args:
        window: (x_min, x_max, y_min, y_max) of the part, in metres.
    """
    w = heightmap.workspace
    fig, axes = plt.subplots(1, 3, figsize=(6.6, 3.6), width_ratios=[1, 1.75, 1], layout="constrained")
    extent = (w.x_min, w.x_max, w.y_min, w.y_max)
    x0, x1, y0, y1 = window
    title = f"{heightmap.seen.mean():.1%} seen\n(white: unseen)"
    for ax, name in zip(axes, ("colour", "the part in the frame", title), strict=True):
        bare(ax, name)
    axes[0].imshow(heightmap.rgb, extent=extent, interpolation="nearest")
    axes[0].plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color="white", lw=1.2)
    axes[1].imshow(heightmap.rgb, extent=extent, interpolation="nearest")
    axes[1].set(xlim=(x0, x1), ylim=(y0, y1))
    seen = np.where(heightmap.seen[..., None], heightmap.rgb, 255)
    axes[2].imshow(seen, extent=extent, interpolation="nearest")
    rows, cols = w.shape
    fig.suptitle(f"cells of {1000 * w.pixel:g} mm: {rows} x {cols}", fontsize=10)
    return fig
