"""One policy over several tables (A.12): stitch their action maps, split the answer.

The policy learned on one table. Its networks are convolutions and its kernels come from words or a crop, so
the same kernel is correlated with the features of every table at once; one argmax over all of them says
which table, which pixel and which angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from gem_lite.language import Queries
from gem_lite.policies import gem
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.gem import ActionModule
from gem_lite.policies.samples import Inputs, collate
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
    module: ActionModule, inputs: Inputs, role: Literal["pick", "place"], kernel: torch.Tensor
) -> torch.Tensor:
    """Logits (N, R, H, W) of one kernel against the features of N tables.

    Args:
        inputs: of N tables.
        role: which of the two queries' maps and words.
        kernel: (1, C, h, h).
    """
    # One table after the other: a batch of convolutions rounds otherwise, and is no faster on a CPU.
    features = [
        module.features(rgbd[None], semantic[None], words[None])
        for rgbd, semantic, words in zip(inputs.rgbd, inputs.maps[role], inputs.words[role], strict=True)
    ]
    return module.score(torch.cat(features), kernel)


@dataclass(frozen=True)
class MobileChoice:
    """One pick and one place over N tables, and what they were read from.

    ``pick_logits`` and ``place_logits`` are (N, R, H, W). ``pick`` is in the frame of table ``pick_table``;
    ``place`` in that of table ``place_table``, its yaw the gripper's there.
    """

    instruction: str
    queries: Queries
    heightmaps: tuple[HeightMap, ...]
    inputs: Inputs
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_table: int
    pick: Pose2
    place_table: int
    place: Pose2


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
def choose(policy: gem.Policy, observations: Sequence[Observation], instruction: str | Queries) -> MobileChoice:
    """What to pick from which table, and where to place it on which. The policy's networks compute where they are.

    Raises:
        ValueError: a policy that cannot (`check_policy`); no observation; the parser refuses the instruction.
    """
    check_policy(policy)
    if not observations:
        raise ValueError("observations is empty: there must be one for each table")
    queries = policy.read(instruction)
    scenes = [policy.embed(observation.views) for observation in observations]
    several = [policy.inputs(scene, queries) for scene in scenes]
    inputs = collate(several, policy.device)
    policy.eval()
    workspace = policy.config.workspace
    bins = angle_bins(policy.config.angles)

    pick_logits = score_tables(policy.pick, inputs, "pick", policy.pick.kernel(inputs.words["pick"][:1]))
    semantic = inputs.maps["pick"][:, 0]
    candidates = gem.near_peak(semantic, torch.ones_like(semantic, dtype=torch.bool), policy.config)
    pick_table, (angle, *pixel) = _best(pick_logits.masked_fill(~candidates[:, None], -torch.inf))
    pick = Pose2(*workspace.to_world(*pixel), bins[angle])
    held = collate([several[pick_table]], policy.device)
    kernel = policy.place.kernel(policy.place_crop(held, torch.tensor([pixel])))
    place_logits = score_tables(policy.place, inputs, "place", kernel)
    place_table, (angle, *pixel) = _best(place_logits)
    # Δ turns the picture of the one table's crop into the picture of the other table.
    place = Pose2(*workspace.to_world(*pixel), pick.yaw + bins[angle])
    return MobileChoice(
        str(instruction), queries, tuple(scene.heightmap for scene in scenes), collate(several),
        pick_logits.numpy(force=True), place_logits.numpy(force=True), pick_table, pick, place_table, place,
    )  # fmt: skip


def _best(logits: torch.Tensor) -> tuple[int, tuple[int, int, int]]:
    """The table and its cell (angle, row, column) with the largest of the logits (N, R, H, W)."""
    panorama = stitch(logits).cpu()
    angle, row, column = np.unravel_index(int(panorama.argmax()), panorama.shape)
    return split((int(angle), int(row), int(column)), logits.shape[-1])
