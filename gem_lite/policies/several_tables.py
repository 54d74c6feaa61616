"""One policy over several tables (A.12): stitch their action maps, split the answer.

The policy learned on one table. Its networks are convolutions and its kernels come from words or a crop, so
the same kernel is correlated with the features of every table at once; one argmax over all of them says
which table, which pixel and which angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from gem_lite import language
from gem_lite.actions import PickPlace
from gem_lite.policies import gem
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.gem import ActionModule
from gem_lite.policies.samples import RGBD, Inputs, collate, crop_at
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins


def stitch(maps: torch.Tensor) -> torch.Tensor:
    """The action maps (N, R, H, W) of N tables as one of (R, H, N W), side by side (Fig. A12, step 2)."""
    return maps.permute(1, 2, 0, 3).flatten(2)


def split(cell: tuple[int, int, int], width: int) -> tuple[int, tuple[int, int, int]]:
    """A stitched map's (angle, row, column) as the table's number and its own (angle, row, column)."""
    angle, row, column = cell
    return column // width, (angle, row, column % width)


def score_tables(
    module: ActionModule, inputs: Inputs, semantic: int, words: torch.Tensor, kernel: torch.Tensor
) -> torch.Tensor:
    """Logits (N, R, H, W) of one kernel against the features of N tables.

    Args:
        inputs: of N tables.
        semantic: the channel of ``inputs.image`` with the phrase's map.
        words: (N, D), the phrase on every table.
        kernel: (1, C, h, h).
    """
    # One table after the other: a batch of convolutions rounds otherwise, and is no faster on a CPU.
    features = [
        module.features(image[None, :RGBD], image[None, semantic : semantic + 1], phrase[None])
        for image, phrase in zip(inputs.image, words, strict=True)
    ]
    return module.score(torch.cat(features), kernel)


@dataclass(frozen=True)
class MobileChoice:
    """One pick and one place over N tables, and what they were read from.

    ``pick_logits`` and ``place_logits`` are (N, R, H, W). ``pick`` is in the frame of table ``pick_table``;
    ``place`` in that of table ``place_table``, its yaw the gripper's there.
    """

    instruction: str
    phrases: language.Phrases
    heightmaps: tuple[HeightMap, ...]
    inputs: Inputs
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_table: int
    pick: Pose2
    place_table: int
    place: Pose2

    @property
    def action(self) -> PickPlace:
        """What to do."""
        return PickPlace(self.pick, self.place, self.pick_table, self.place_table)


def check_policy(policy: PickPlacePolicy) -> gem.Policy:
    """The policy, if it can choose over several tables.

    Raises:
        ValueError: it is no GEM policy, so that it has no kernel to score every table's features with.
    """
    if not isinstance(policy, gem.Policy):
        raise ValueError(
            f"policy must be a gem policy or one of its ablations to choose over several tables, got {policy.name}: "
            "it makes no kernel that is scored against the features of every table"
        )
    return policy


@torch.inference_mode()
def choose(policy: gem.Policy, observations: Sequence[Observation], instruction: str) -> MobileChoice:
    """What to pick from which table, and where to place it on which. The policy's networks compute where they are.

    Raises:
        ValueError: a policy that cannot (`check_policy`); no observation; the instruction is empty or names no pick
            or no place.
    """
    check_policy(policy)
    if not observations:
        raise ValueError("observations is empty: there must be one for each table")
    phrases = policy.read(instruction)
    scenes = [policy.see(observation.views) for observation in observations]
    seen = [policy.inputs(scene, phrases) for scene in scenes]
    inputs = collate(seen, policy.device)
    policy.pick.eval()
    policy.place.eval()
    workspace, bins = policy.config.workspace, angle_bins(policy.config.angles)

    def best(logits: torch.Tensor) -> tuple[int, tuple[int, int, int]]:
        panorama = stitch(logits).cpu()
        cell = tuple(int(i) for i in np.unravel_index(int(panorama.argmax()), panorama.shape))
        return split(cell, workspace.shape[1])

    words = inputs.pick_words
    pick_logits = score_tables(policy.pick, inputs, RGBD, words, policy.pick.kernel(words[:1]))
    semantic = inputs.image[:, RGBD]
    candidates = gem.near_peak(semantic, torch.ones_like(semantic, dtype=torch.bool), policy.config)
    pick_table, (angle, *pixel) = best(pick_logits.masked_fill(~candidates[:, None], -torch.inf))
    pick = Pose2(*workspace.to_world(*pixel), bins[angle])
    held = inputs.image[pick_table : pick_table + 1, : RGBD + 1]
    kernel = policy.place.kernel(crop_at(held, torch.tensor([pixel]), policy.config.crop))
    place_logits = score_tables(policy.place, inputs, RGBD + 1, inputs.place_words, kernel)
    place_table, (angle, *pixel) = best(place_logits)
    # Δ turns the picture of the one table's crop into the picture of the other table.
    place = Pose2(*workspace.to_world(*pixel), pick.yaw + bins[angle])
    return MobileChoice(
        instruction, phrases, tuple(scene.heightmap for scene in scenes), collate(seen), pick_logits.numpy(force=True),
        place_logits.numpy(force=True), pick_table, pick, place_table, place,
    )  # fmt: skip
