"""Drawings of the lesson on several tables: stitched maps, localisation, success against pose error."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import torch
from drawings.plot_shared import action_map, draw_zoom
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from summaries import Score

from gem_lite.drawing.plots import MAP_COLORS, OUTLINE, PICK_COLOR, PLACE_COLOR, SAFE_COLORS, bare, draw_gripper
from gem_lite.policies.choosing import TablesChoice, stitch
from gem_lite.rgbd.camera import View, camera_looking_at
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.mobile_world import MobileWorld
from gem_lite.simulation.rendering import render


def photograph(world: MobileWorld) -> np.ndarray:
    """(H, W, 3) uint8: a picture of tables and robot from outside."""
    middles = [table @ Pose2(world.workspace.x_max, 0.0) for table in world.tables]
    x, y = np.mean([(middle.x, middle.y) for middle in middles], axis=0)
    distance = 1.2 + max(np.hypot(middle.x - x, middle.y - y) for middle in middles)
    position = (x - distance, y + 0.85 * distance, 0.65 * distance)
    camera = camera_looking_at("outside", position, (x, y - 0.22 * distance, -0.45))
    return render(world.client, camera, world.light)[0].rgb


def draw_seams(ax: Axes, count: int, width: int) -> None:
    """A white line between neighbouring tables of a stitched picture."""
    for seam in range(1, count):
        ax.axvline(seam * width - 0.5, color="white", lw=1.5)


def show_stitched(choice: TablesChoice, clip_name: str) -> Figure:
    """The tables and the stitched action maps of pick and place: one scale, one best action over all tables.

    Each action map has the surroundings of its best cell once more, enlarged.
    """
    workspace = choice.heightmaps[0].workspace
    count = len(choice.heightmaps)
    width = workspace.shape[1]
    fig, (axes, bars) = plt.subplots(
        2, 5, figsize=(2.1 * count * 2 + 3.5, 3.6), height_ratios=(20, 1), layout="constrained", dpi=80
    )
    bars[0].axis("off")
    bare(axes[0], "from above").imshow(np.hstack([heightmap.rgb for heightmap in choice.heightmaps]))
    roles = (
        ("pick", choice.queries.pick, choice.pick_logits, choice.pick_table, choice.pick, PICK_COLOR),
        ("place", choice.queries.place, choice.place_logits, choice.place_table, choice.place, PLACE_COLOR),
    )
    for number, (role, query, logits, table, pose, color) in enumerate(roles):
        shifted = Pose2(pose.x + table * width * workspace.pixel, pose.y, pose.yaw)
        draw_gripper(axes[0], shifted, workspace, color)
        semantic_image = bare(axes[1 + 2 * number], f"semantic map\n{query}").imshow(
            np.hstack(choice.inputs.maps[role][:, 0].numpy()), cmap=MAP_COLORS, vmin=0, vmax=1, interpolation="nearest"
        )
        stitched = action_map(stitch(torch.from_numpy(logits)).numpy())
        ax = bare(axes[2 + 2 * number], f"{role}: stitched action map")
        action_image = ax.imshow(stitched, cmap="viridis", interpolation="nearest")
        row, col = workspace.to_pixel(shifted.x, shifted.y)
        ax.plot(col, row, "o", ms=11, mfc="none", mec=color, mew=1.5)
        # The enlarged part stands in the corner that is farthest from the best cell.
        left, bottom = (0.03 if far else 0.52 for far in (col > count * width / 2, row < workspace.shape[0] / 2))
        draw_zoom(ax, stitched, row, col, (left, bottom, 0.45, 0.45))
        fig.colorbar(
            semantic_image, bars[1 + 2 * number], orientation="horizontal", label="0: typical cell, 1: typical match"
        )
        fig.colorbar(action_image, bars[2 + 2 * number], orientation="horizontal", label="logit - best logit")
    for ax in axes:
        draw_seams(ax, count, width)
        ax.set(xlim=(-0.5, count * width - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
    fig.suptitle(f'"{choice.instruction}"   (maps by {clip_name})', fontsize=10)
    return fig


def show_localisation(view: View, corners: np.ndarray, away: np.ndarray, workspace: Workspace, tag: Pose2) -> Figure:
    """The body camera's picture with a tag's corners (4, 2), and the error ``away`` (H, W) of each point (mm)."""
    fig, axes = plt.subplots(1, 2, figsize=(8.4, 3.8), width_ratios=(2, 1), layout="constrained")
    bare(axes[0], "body camera; the tag's corners as found").imshow(view.rgb)
    axes[0].plot(*np.concatenate([corners, corners[:1]]).T, color="#00e5ff", lw=1.5)
    for number, (x, y) in enumerate(corners + 0.3 * (corners - corners.mean(axis=0))):  # beside the corner
        axes[0].text(
            x, y, str(number), color="#e69f00", fontsize=11, fontweight="bold", ha="center", va="center",
            path_effects=OUTLINE,
        )  # fmt: skip
    extent = (workspace.x_min, workspace.x_max, workspace.y_min, workspace.y_max)
    error_image = axes[1].imshow(away, cmap="magma", extent=extent, vmin=0)
    axes[1].plot(tag.x, tag.y, "s", ms=9, mfc="white", mec="black", mew=3)
    axes[1].text(tag.x, tag.y + 0.06, "tag", ha="center")
    axes[1].set(xlabel="x (m)", ylabel="y (m)", xlim=(workspace.x_min, tag.x + 0.08))
    axes[1].set_title("error of each point of the table", fontsize=9)
    fig.colorbar(error_image, ax=axes[1], label="mm off")
    return fig


def _draw_scores(ax: Axes, at: np.ndarray, scores: Sequence[Score], style: str, label: str = "") -> None:
    """Means with 95 % intervals over ``at``."""
    means = np.array([score.mean for score in scores])
    ends = np.array([score.interval for score in scores]).T
    reach = np.clip([means - ends[0], ends[1] - means], 0, None)
    ax.errorbar(at, means, reach, fmt=style, ms=5, capsize=3, label=label or None)
    ax.set(ylim=(-3, 103))
    ax.grid(alpha=0.3)


def show_error_curves(
    curves: dict[str, dict[str, dict[float, Score]]], robot: dict[str, Score], title: str = ""
) -> Figure:  # fmt: skip
    """Success against the error of the tables' poses: a panel for each kind of error, a line for each task.

    Args:
        curves: label of the error to task to its size to score.
        robot: the scores, by task, of a robot whose error is not known; they have a narrow panel.
    """
    widths = [4.4] * len(curves) + [1.6]
    fig, axes = plt.subplots(
        1, len(widths), figsize=(sum(widths), 3.6), width_ratios=widths, sharey=True, layout="constrained"
    )
    for ax, (label, lines) in zip(axes, curves.items(), strict=False):
        for name, scores in lines.items():
            sizes = sorted(scores)
            _draw_scores(ax, np.array(sizes), [scores[size] for size in sizes], "o-", name)
        ax.set(xlabel=label)
    for number, score in enumerate(robot.values()):
        _draw_scores(axes[-1], np.array([number]), [score], "s")
    axes[-1].set(xticks=range(len(robot)), xlim=(-0.7, len(robot) - 0.3), xlabel="error not known")
    axes[-1].set_xticklabels(robot, fontsize=8)
    axes[-1].set_title("the paper's Spot", fontsize=9)
    axes[0].set_ylabel("success (0-100)")
    axes[0].legend(fontsize=8)
    fig.suptitle(title, fontsize=10)
    return fig


def draw_wrong_pose(
    heightmap: HeightMap, pick: Pose2, axis: str, centimetres: int, outcome: tuple[Pose2, str],
    curves: dict[str, dict[str, dict[float, Score]]],
) -> Figure:  # fmt: skip
    """A frame of a moving picture: where the tool comes down with a wrong pose, and the first of ``curves``.

    Args:
        pick: the pick that the policy chose, in the table's frame.
        axis: the direction of the error in words.
        centimetres: the size of the error.
        outcome: the error, and what became of the act in a word.
        curves: as in `show_error_curves`.
    """
    error, word = outcome
    workspace = heightmap.workspace
    fig, axes = plt.subplots(1, 2, figsize=(7.0, 3.0), width_ratios=(1, 1.6), layout="constrained")
    bare(axes[0], f"{centimetres} cm {axis} the table: {word}").imshow(heightmap.rgb)
    row, col = workspace.to_pixel(pick.x, pick.y)
    axes[0].text(workspace.shape[1] + 1, row, "beyond the map", rotation=90, va="center")
    draw_gripper(axes[0], Pose2(pick.x + error.x, pick.y + error.y, pick.yaw), workspace, PICK_COLOR)
    reach = 0.12 / workspace.pixel
    axes[0].set(xlim=(col - reach, col + reach), ylim=(row + reach, row - reach))
    label, lines = next(iter(curves.items()))
    for name, scores in lines.items():
        sizes = sorted(scores)
        _draw_scores(axes[1], np.array(sizes), [scores[size] for size in sizes], "o-", name)
    largest = max(max(scores) for scores in lines.values())
    if centimetres <= largest:
        axes[1].axvline(centimetres, color="black", lw=1.5, ls="--")
    axes[1].set(xlabel=label, ylabel="success (0-100)", xlim=(-0.2, largest + 0.2))
    axes[1].set_title("stored: random directions", fontsize=9)
    axes[1].legend(fontsize=8, loc="lower left")
    return fig


def show_points(points: np.ndarray, rgb: np.ndarray, frames: dict[str, Pose2]) -> Figure:
    """A still picture of a coloured point cloud (N, 3), (N, 3) uint8, with a frame at each named pose."""
    fig = plt.figure(figsize=(8, 5.6), layout="constrained")
    ax = fig.add_subplot(projection="3d", computed_zorder=False)
    ax.scatter(*points.T, c=rgb / 255, s=1.2, depthshade=False, rasterized=True)
    for name, pose in frames.items():
        origin = np.array([pose.x, pose.y, 0.12])
        for turn, color in ((0, SAFE_COLORS[5]), (np.pi / 2, SAFE_COLORS[4])):
            arrow = 0.08 * np.array([np.cos(pose.yaw + turn), np.sin(pose.yaw + turn), 0])
            ax.plot(*np.stack([origin, origin + arrow]).T, color=color, lw=2.5, zorder=3)
        ax.plot(*np.stack([origin, [pose.x, pose.y, 0.0]]).T, color=SAFE_COLORS[0], lw=2.5, zorder=2)
        ax.text(pose.x, pose.y, 0.19, name, zorder=4, color="white", bbox={"color": "black", "pad": 1.5})
    ax.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", zlim=(0, 0.25), zticks=[0, 0.1, 0.2])
    ax.set_box_aspect((0.5, 1.0, 0.25))
    ax.view_init(elev=40, azim=-30)
    return fig
