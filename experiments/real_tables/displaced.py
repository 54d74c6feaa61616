"""What does it cost that erring cameras show everything some millimetres beside its place?

In `real-table-kinect` each camera stands a little beside the pose that the robot believes. So the whole picture of the
table is displaced, and no policy can see by how much. Here the expert, which makes no other error, acts as far beside
the true poses as the cameras show them. What it loses, a policy that trusts its cameras loses, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.evaluation import results
from gem_lite.evaluation.rollout import Actor, Observations, rollout
from gem_lite.evaluation.statistics import mean_and_interval
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import looks
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.world import World
from gem_lite.tasks import real_table

PERFECT, ERRING = "real-table", "real-table-kinect"
IDENTITY = ("kind", "task")


def displacement(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """By how many rows and columns a grey picture (H, W) must be moved to look like another, by phase correlation."""
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    (columns, rows), _ = cv2.phaseCorrelate(before.astype(np.float32), after.astype(np.float32), window)
    return rows, columns


def seen_displacement(task_name: str, index: int) -> tuple[float, float]:
    """How far (m, along x and y) the cameras of `ERRING` show one test episode's first scene beside its place."""
    pictures = []
    for world_name in (PERFECT, ERRING):
        task = tasks.make(task_name, "test")
        with World(style=looks.style(world_name)) as world:
            (observation,) = world.reset(task, tasks.episode_seed("test", index))
        pictures.append(cv2.cvtColor(fuse_views(observation.views, task.workspace).rgb, cv2.COLOR_RGB2GRAY))
    return in_world(displacement(*pictures), task.workspace)


def in_world(cells: tuple[float, float], workspace: Workspace) -> tuple[float, float]:
    """A displacement in rows and columns as one along x and y (m)."""
    start = np.array(workspace.to_world(0, 0))
    one_row = np.array(workspace.to_world(1, 0)) - start
    one_column = np.array(workspace.to_world(0, 1)) - start
    x, y = cells[0] * one_row + cells[1] * one_column
    return float(x), float(y)


def displaced_expert(x: float, y: float) -> Actor:
    """The expert, whose picks and places lie ``x`` and ``y`` (m) beside the true ones."""

    def actor(environment: Environment, _: Observations, __: Sequence[Pose2] = ()) -> PickPlace | None:
        expert = environment.task.expert(environment)
        if expert is None:
            return None
        action = expert.action
        return replace(action, pick=Pose2(x, y) @ action.pick, place=Pose2(x, y) @ action.place)

    return actor


def measure_task(task_name: str, episodes: int) -> dict:
    """The row of a task: how far everything is displaced, and the displaced expert's rewards in the perfect world."""
    lengths, rewards = [], []
    for index in tqdm(range(episodes), task_name, unit="episode"):
        x, y = seen_displacement(task_name, index)
        task = tasks.make(task_name, "test")
        with World(style=looks.style(PERFECT)) as world:
            turns = list(rollout(world, task, tasks.episode_seed("test", index), displaced_expert(x, y)))
        lengths.append(1000 * float(np.hypot(x, y)))
        rewards.append(sum(turn.result.reward for turn in turns))
    mean, ci95 = mean_and_interval(rewards)
    return {
        "kind": "displaced-expert", "task": task_name, "world": PERFECT, "cameras": ERRING, "split": "test",
        "episodes": episodes, "mean": mean, "ci95": ci95, "rewards": np.round(rewards, 4).tolist(),
        "displaced_mm": np.round(lengths, 2).tolist(), "pixel_mm": round(1000 * real_table.PIXEL, 4),
        "date": datetime.now(UTC).date().isoformat(),
    }  # fmt: skip


def measure(task_names: Sequence[str], episodes: int, path: Path) -> list[dict]:
    """`measure_task` for several tasks; each row is filed in ``path``.

    Raises:
        ValueError: ``episodes`` below 1, a task that is none of the real tables, or ``path`` holds a row over more
            episodes.
        OSError: ``path`` cannot be written.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    for name in task_names:
        if name not in tasks.REAL_TABLE:
            raise ValueError(f"tasks must be of {', '.join(tasks.REAL_TABLE)}, got {name!r}")
    rows = []
    for name in task_names:
        rows.append(measure_task(name, episodes))
        results.file_rows(rows[-1:], path, IDENTITY)
    return rows


def described(rows: list[dict]) -> str:
    """A line for each task: how far the cameras displace it, and what is left of the expert's reward."""
    lines = [f"{'task':38}{'displaced (mm): median, 90 %':>30}{'the expert':>14}"]
    for row in rows:
        median, most = np.percentile(row["displaced_mm"], (50, 90))
        low, high = row["ci95"]
        lines.append(f"{row['task']:38}{median:24.1f}{most:6.1f}{row['mean']:14.1f} [{low:.1f}, {high:.1f}]")
    return "\n".join(lines)
