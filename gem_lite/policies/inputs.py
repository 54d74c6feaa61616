"""The networks' inputs for a step and the right answers: inputs, samples, labels and the loss."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from gem_lite.actions import PickPlace, Push, equal_yaws
from gem_lite.config import Config
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.maps.crop_memory import EpisodeKey, numbered
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace
from gem_lite.steerable.loss import LOWEST

HEIGHT_SCALE = 0.05
"""Metres that become 1 in a network's height channel."""
TABLE_GRAY = 0.2
"""About the bare table's colour, in [0, 1]. It is subtracted from a network's colours."""
TABLE_LEVEL = 49
"""The bare table's gray level, in [0, 255], in the light in which demonstrations are collected."""
BARE_HEIGHT = 0.005
"""A cell of the height map that is at most this much (m) above the table shows the bare table."""
RGBD = 4
"""Channels of colour and height."""


def exposure(heightmap: HeightMap) -> float:
    """The factor on all colours that gives the bare table `TABLE_LEVEL`; 1 where no cell is bare.

    A brighter lamp makes table and objects brighter by the same factor. If the table is the same in every scene,
    the table shows how bright the lamp is, like a photographer's gray card. It lies where it is seen: at the median of
    the heights near z = 0.
    """
    low = heightmap.near_table
    if not low.any():
        return 1.0
    bare = heightmap.rgb[heightmap.seen & (heightmap.height < np.median(heightmap.height[low]) + BARE_HEIGHT)]
    return TABLE_LEVEL / max(float(np.median(bare)), 1.0)


def to_rgbd(heightmap: HeightMap) -> torch.Tensor:
    """(4, H, W) float32: colour minus the bare table's, and height in units of 50 mm. The bare table is about 0.

    Colours are corrected to the light of the demonstrations, see `exposure`.
    """
    rgb = exposure(heightmap) * torch.from_numpy(heightmap.rgb).float().permute(2, 0, 1) / 255 - TABLE_GRAY
    height = torch.from_numpy(heightmap.height)[None] / HEIGHT_SCALE
    return torch.cat([rgb, height])


def crop_at(image: torch.Tensor, pixels: torch.Tensor, size: int) -> torch.Tensor:
    """Unrotated squares around pixels: (B, C, H, W) and (B, 2) integers to (B, C, size, size); outside is 0."""
    half = size // 2
    padded = nn.functional.pad(image, (half, half, half, half))
    corners = zip(padded, pixels.tolist(), strict=True)
    return torch.stack([picture[:, row : row + size, col : col + size] for picture, (row, col) in corners])


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """What a method's networks read of one scene. It has no trained part, so training computes it once.

    Batched inputs (`collate`) have one more axis in front of every tensor.

    Attributes:
        rgbd: (4, H, W), of `to_rgbd`.
        maps: semantic maps (1, H, W) by name, if the method has any.
        features: features (D, h, w) by name, if the method has any; they cover the same table with fewer cells.
        words: embeddings (D,) of the queries by name.
    """

    rgbd: torch.Tensor
    maps: dict[str, torch.Tensor] = field(default_factory=dict)
    features: dict[str, torch.Tensor] = field(default_factory=dict)
    words: dict[str, torch.Tensor] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Sample(Inputs):
    """One demonstrated step in the form that training reads.

    Attributes:
        pick, place: pixels (row, col), not rounded.
        pick_yaw: the grasp's yaw (radians); ``delta``: place minus pick yaw.
        pick_symmetry, place_symmetry: turns that change nothing, see `demonstrations.ExpertAction`.
    """

    pick: tuple[float, float]
    place: tuple[float, float]
    pick_yaw: float
    delta: float
    pick_symmetry: float
    place_symmetry: float


PreparedStep = tuple[Sample, ...]
"""A demonstrated step before augmentation. Most methods have one form of it; of several, training draws one
(`Policy.form_chances`)."""


def collate(items: Sequence[Inputs], device: torch.device | str = "cpu") -> Inputs:
    """A batch: every tensor of ``items`` with a leading batch axis. All must have the same names and shapes."""

    def stack(values: Sequence[Any]) -> Any:  # noqa: ANN401 (tensors, or dictionaries of them)
        if isinstance(values[0], dict):
            return {name: stack([value[name] for value in values]) for name in values[0]}
        return torch.stack(list(values)).to(device)

    return Inputs(**{part.name: stack([getattr(inputs, part.name) for inputs in items]) for part in fields(Inputs)})


def numbered_steps(demos: Sequence[Demonstration]) -> Iterator[tuple[EpisodeKey, DemonstrationStep]]:
    """Every step with the key of its episode, one episode at a time: a large set need not fit into memory.

    Raises:
        ValueError: a step has other cameras than the steps before it.
    """
    expected: set[str] = set()
    for key, demonstration in tqdm(numbered(demos), "scenes", len(demos), unit="episode"):
        for step in demonstration.steps:
            cameras = {view.camera.name for view in step.observation.views}
            if not expected:
                expected = cameras
            if cameras != expected:
                raise ValueError(
                    f"demonstration {key[1]} of {key[0]} (seed {demonstration.seed}) has a step with the views of "
                    f"{', '.join(sorted(cameras))}, but the steps before it have the views of "
                    f"{', '.join(sorted(expected))}; leave it out or collect it again"
                )
            yield key, step


def label(step: DemonstrationStep, inputs: Inputs, config: Config) -> Sample:
    """A step's inputs with the expert's action as labels.

    A push is labelled as a pick at its start and a place at its end, with every angle right.

    Raises:
        ValueError: a pose of the action lies outside the configuration's table, or its yaw is not finite.
    """
    action = step.expert.action
    if isinstance(action, Push):
        action = PickPlace(action.start, action.end)
    return Sample(
        **vars(inputs),
        pick=_pixel("pick", action.pick, config.workspace),
        place=_pixel("place", action.place, config.workspace),
        pick_yaw=action.pick.yaw,
        delta=action.delta,
        pick_symmetry=step.expert.pick_symmetry,
        place_symmetry=step.expert.place_symmetry,
    )


def _pixel(name: str, pose: Pose2, workspace: Workspace) -> tuple[float, float]:
    """The pixel (row, col) of a label's pose. Its nearest cell must be one of the map's."""
    pixel = workspace.to_pixel(pose.x, pose.y)
    is_finite = all(math.isfinite(value) for value in (*pixel, pose.yaw))
    if not is_finite or any(not 0 <= round(i) < side for i, side in zip(pixel, workspace.shape, strict=True)):
        raise ValueError(
            f"{name} must have a finite yaw and lie on the table, which is x {workspace.x_min:.3f} to "
            f"{workspace.x_max:.3f} m, y {workspace.y_min:.3f} to {workspace.y_max:.3f} m, got {pose}"
        )
    return pixel


def right_bins(angle: float, symmetry: float, count: int) -> list[int]:
    """The angle bins of a label: the nearest bin of every equivalent angle.

    ``symmetry`` is the smallest turn that changes nothing (radians); 0 means that every angle is right.

    Raises:
        ValueError: ``symmetry`` is neither 0 nor 2 pi divided by a whole number.
    """
    copies = equal_yaws(symmetry)
    if copies == 0:
        return list(range(count))
    equivalents = angle + 2 * math.pi * np.arange(copies) / copies
    return sorted({round(float(a) / (2 * math.pi / count)) % count for a in equivalents})


Cell = tuple[list[int], int, int]
"""A label in logits: the equally right angle bins, and a pixel's row and column."""


def cross_entropy(logits: torch.Tensor, cells: Sequence[Cell]) -> torch.Tensor:
    """Mean cross-entropy of logits (B, R, H, W); each label is a pixel and its equally right angle bins.

    Logits far below the highest one are raised in the sum, for the reason that `steerable.loss.LOWEST` names.
    """
    pairs = zip(logits, cells, strict=True)
    right_logits = torch.stack([scores[bins, row, col].mean() for scores, (bins, row, col) in pairs])
    flat = logits.flatten(1)
    highest = flat.detach().amax(dim=1, keepdim=True)
    totals = highest[:, 0] + (flat - highest).clamp(min=LOWEST).logsumexp(dim=1)
    return (totals - right_logits).mean()
