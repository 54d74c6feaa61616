"""One policy over several tables (A.12): stitch their action maps, and split the best cell.

The policy learned on one table. Its networks are convolutions, and its kernels come from words or a crop. So the same
kernel can be correlated with the features of every table. One argmax over all tables gives the table, the pixel and
the angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from gem_lite.actions import Action, PickPlace, Push
from gem_lite.language import Queries
from gem_lite.policies import gem
from gem_lite.policies.base import PickPlacePolicy, acting
from gem_lite.policies.gates import near_peak, unmoved
from gem_lite.policies.gem import ActionModule
from gem_lite.policies.samples import HEIGHT_SCALE, Inputs, collate
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
        role: whose maps and words to use.
        kernel: (1, C, h, h).
    """
    # One table after the other: a batch of convolutions is rounded differently, and is no faster on a CPU.
    features = [
        module.features(rgbd[None], semantic[None], words[None])
        for rgbd, semantic, words in zip(inputs.rgbd, inputs.maps[role], inputs.words[role], strict=True)
    ]
    return module.score(torch.cat(features), kernel)


@dataclass(frozen=True)
class MobileChoice:
    """One pick and one place over N tables, or one push, and the inputs and logits that led to them.

    ``pick_logits`` and ``place_logits`` are (N, R, H, W). ``pick`` is in the frame of table ``pick_table``. ``place``
    is in the frame of table ``place_table``; its yaw is the gripper's.
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

    @property
    def action(self) -> Action:
        """The action to do."""
        if self.queries.push:
            return Push(self.pick, self.place, self.pick_table)
        return PickPlace(self.pick, self.place, self.pick_table, self.place_table)


def check_policy(policy: PickPlacePolicy) -> gem.Policy:
    """The policy, if it can choose over several tables.

    Raises:
        ValueError: it is no GEM policy: it has no kernel to correlate with every table's features.
    """
    if not isinstance(policy, gem.Policy):
        raise ValueError(
            f"policy must be a gem policy or one of its ablations to choose over several tables, got {policy.name}: "
            "it makes no kernel that is scored against the features of every table"
        )
    return policy


@torch.inference_mode()
def choose(policy: gem.Policy, observations: Sequence[Observation], instruction: str | Queries) -> MobileChoice:
    """The best pick over all tables, then the best place for it over all tables; a push stays on its table.

    Raises:
        ValueError: `check_policy` refuses the policy, there is no observation, or the parser refuses the instruction.
    """
    check_policy(policy)
    if not observations:
        raise ValueError("observations is empty: there must be one for each table")
    queries = policy.read(instruction)
    scenes = [policy.embed(observation.views) for observation in observations]
    table_inputs = [policy.inputs(scene, queries) for scene in scenes]
    inputs = collate(table_inputs, policy.device)
    workspace = policy.config.workspace
    bins = angle_bins(policy.config.angles)
    with acting(policy):
        pick_logits = score_tables(policy.pick, inputs, "pick", policy.pick.kernel(inputs.words["pick"][:1]))
        pick_table, (pick_angle, *pick_pixel) = _best(pick_logits, _pick_cells(policy, inputs, queries)[:, None])
        pick_inputs = collate([table_inputs[pick_table]], policy.device)
        kernel = policy.place.kernel(policy.place_crop(pick_inputs, torch.tensor([pick_pixel])))
        place_logits = score_tables(policy.place, inputs, "place", kernel)
    allowed = torch.ones(place_logits.shape, dtype=torch.bool)
    allowed[pick_table] = ~unmoved(place_logits.shape[1:], (pick_pixel[0], pick_pixel[1]), queries.push)
    if queries.push:  # A blade does not leave its table.
        allowed[torch.arange(len(allowed)) != pick_table] = False
    place_table, (place_angle, *place_pixel) = _best(place_logits, allowed)
    pick = Pose2(*workspace.to_world(*pick_pixel), bins[pick_angle])
    # Δ turns the crop's picture, from the pick's table, into the picture of the place's table.
    place = Pose2(*workspace.to_world(*place_pixel), pick.yaw + bins[place_angle])
    return MobileChoice(
        str(instruction), queries, tuple(scene.heightmap for scene in scenes), collate(table_inputs),
        pick_logits.numpy(force=True), place_logits.numpy(force=True), pick_table, pick, place_table, place,
    )  # fmt: skip


def _pick_cells(policy: gem.Policy, inputs: Inputs, queries: Queries) -> torch.Tensor:
    """(N, H, W) bool: where a pick is allowed, near the peak of all tables' maps; a push may start anywhere."""
    semantic = inputs.maps["pick"][:, 0]
    everywhere = torch.ones_like(semantic, dtype=torch.bool)
    if queries.push:
        return everywhere
    return near_peak(semantic, HEIGHT_SCALE * inputs.rgbd[:, 3], everywhere, policy.config)


def _best(logits: torch.Tensor, allowed: torch.Tensor) -> tuple[int, tuple[int, int, int]]:
    """The table and its cell (angle, row, column) with the largest of the allowed logits (N, R, H, W)."""
    panorama = stitch(logits.masked_fill(~allowed.to(logits.device), -torch.inf)).cpu()
    angle, row, column = np.unravel_index(int(panorama.argmax()), panorama.shape)
    return split((int(angle), int(row), int(column)), logits.shape[-1])
