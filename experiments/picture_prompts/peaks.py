"""Which patches should a prompt's picture be compared with? Peaks of image-conditioned maps on validation scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from experiments.picture_prompts.measuring import PICTURES_ALONE
from experiments.picture_prompts.register_tasks import TASK_NAMES
from experiments.picture_prompts.segmented_world import SegmentedWorld
from experiments.picture_prompts.visual_manipulation import NEAR
from gem_lite import tasks
from gem_lite.clip import Clip
from gem_lite.policies.gem import Gem
from gem_lite.se2 import Pose2

WIDTHS = (0.075, 0.1, 0.125, 0.15, 0.2)
"""Sides of the patches (m); each stands a quarter of its side, in whole cells, from the next."""


def with_patches(width: float) -> Gem.Config:
    """`PICTURES_ALONE` with patches of another width."""
    stride = round(width / 4 / PICTURES_ALONE.pixel) * PICTURES_ALONE.pixel
    return replace(PICTURES_ALONE, top_patch=width, top_stride=stride)


def measure(task_name: str, scenes: int, widths: Sequence[float], clip: Clip) -> dict[float, tuple[float, float]]:
    """How often the peaks of the maps of pick and place lie near the thing that the picture shows, by patch width."""
    policies = {width: Gem(with_patches(width), clip) for width in widths}
    right: dict[float, list[list[bool]]] = {width: [] for width in widths}
    with SegmentedWorld() as world:
        for index in tqdm(range(scenes), task_name, unit="scene"):
            task = tasks.make(task_name, "val")
            (observation,) = world.reset(task, tasks.episode_seed("val", index))
            poses = [world.pose(body)[0] for body in world.bodies]
            for width, policy in policies.items():
                scene = policy.embed(observation.views)
                maps = [policy.maps(scene, picture).fused for picture in task.instruction.pictures]
                peaks = [_peak(policy, semantic) for semantic in maps]
                right[width].append([_is_nearest(peak, poses, number) for number, peak in enumerate(peaks)])
    return {width: tuple(np.mean(shares, axis=0).tolist()) for width, shares in right.items()}


def _peak(policy: Gem, semantic: np.ndarray) -> Pose2:
    row, col = np.unravel_index(semantic.argmax(), semantic.shape)
    return Pose2(*policy.config.workspace.to_world(row, col))


def _is_nearest(peak: Pose2, poses: Sequence[Pose2], number: int) -> bool:
    """Whether a peak is near a thing, and nearer to it than to the two others."""
    distances = [np.hypot(peak.x - pose.x, peak.y - pose.y) for pose in poses]
    return distances[number] < NEAR and distances[number] == min(distances)


def described(shares: dict[str, dict[float, tuple[float, float]]]) -> str:
    """A line for each level and width."""
    return "\n".join(
        f"{task_name}, patches of {1000 * width:.0f} mm: pick {100 * pick:.0f} %, place {100 * place:.0f} %"
        for task_name, of_widths in shares.items()
        for width, (pick, place) in of_widths.items()
    )


def measure_levels(scenes: int, widths: Sequence[float], clip: Clip) -> dict[str, dict[float, tuple[float, float]]]:
    """`measure` for each level. Raises ValueError if ``scenes`` is below 1, or a patch is no whole cell wide."""
    if scenes < 1:
        raise ValueError(f"scenes must be at least 1, got {scenes}")
    return {task_name: measure(task_name, scenes, widths or WIDTHS, clip) for task_name in TASK_NAMES}
