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
from gem_lite.policies.gem_config import GemConfig
from gem_lite.se2 import Pose2


def with_patches(width: float) -> GemConfig:
    """`PICTURES_ALONE` with patches of another width (m). Each is a quarter of it, in whole cells, from the next."""
    stride = round(width / 4 / PICTURES_ALONE.pixel) * PICTURES_ALONE.pixel
    return replace(PICTURES_ALONE, top_patch=width, top_stride=stride)


def measure(scenes: int, widths: Sequence[float], clip: Clip) -> dict[float, tuple[float, float]]:
    """How often the peaks of the maps of pick and place lie near the thing that the picture shows, by patch width.

    The scenes are those of the training level: no number is chosen on things that the other levels hold back.

    Args:
        widths: of the patches (m).

    Raises:
        ValueError: ``scenes`` is below 1, or a width is below four cells.
    """
    if scenes < 1:
        raise ValueError(f"scenes must be at least 1, got {scenes}")
    least = 4 * PICTURES_ALONE.pixel
    if any(width < least for width in widths):
        raise ValueError(f"widths must be at least {least} m, four cells, got {tuple(widths)}")
    task_name = TASK_NAMES[0]
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


def described(shares: dict[float, tuple[float, float]]) -> str:
    """A line for each width."""
    return "\n".join(
        f"patches of {1000 * width:.0f} mm: pick {100 * pick:.0f} %, place {100 * place:.0f} %"
        for width, (pick, place) in shares.items()
    )
