"""What a policy decided, and the logits from which it did: on one table, and over several."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gem_lite.actions import Action, PickPlace, Push
from gem_lite.language import Queries
from gem_lite.policies.inputs import Inputs
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2


@dataclass(frozen=True)
class Choice:
    """A decision, and the logits from which it was made.

    ``pick_logits`` and ``place_logits`` are (R, H, W). ``pick_cell`` and ``place_cell`` are (angle, row, col) of the
    best logit among the allowed ones (`Policy.choose_over`).
    """

    instruction: str
    queries: Queries
    heightmap: HeightMap
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_cell: tuple[int, int, int]
    place_cell: tuple[int, int, int]
    action: Action


@dataclass(frozen=True)
class TablesChoice:
    """One pick and one place over N tables, or one push, and the inputs and logits that led to them.

    ``pick_logits`` and ``place_logits`` are (N, R, H, W). ``pick_cell`` and ``place_cell`` are (angle, row, col) of the
    best logit among the allowed ones. ``pick`` is in the frame of table ``pick_table``. ``place`` is in the frame of
    table ``place_table``; its yaw is the gripper's.
    """

    instruction: str
    queries: Queries
    heightmaps: tuple[HeightMap, ...]
    inputs: Inputs
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_table: int
    pick_cell: tuple[int, int, int]
    pick: Pose2
    place_table: int
    place_cell: tuple[int, int, int]
    place: Pose2

    @property
    def action(self) -> Action:
        """The action to do."""
        if self.queries.push:
            return Push(self.pick, self.place, self.pick_table)
        return PickPlace(self.pick, self.place, self.pick_table, self.place_table)

    def first(self) -> Choice:
        """The choice on the first table, if there is no other."""
        return Choice(
            self.instruction, self.queries, self.heightmaps[0], self.pick_logits[0], self.place_logits[0],
            self.pick_cell, self.place_cell, self.action,
        )  # fmt: skip
