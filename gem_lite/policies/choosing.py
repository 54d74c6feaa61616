"""From logits to an act: the cells that the rules allow, the best of them over all tables, and what was chosen.

Gates are rules of ours. The networks weigh a map against their other inputs, and may prefer an object on which the map
is low. With a gate the map chooses the object; the networks choose among the cells that are left. GEM's picks keep to
them, and so do its places beside things ("left of the bowl"); a rival can do so, too (`transporter.Rival`).

Stitch and split (A.12): a policy that learned on one table chooses over several. Its networks are convolutions, and its
kernels come from words or a crop, so the same kernel can be correlated with the features of every table. One argmax
over all action maps then gives the table, the pixel and the angle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy import ndimage

from gem_lite.actions import Action, PickPlace, Push
from gem_lite.config import Config
from gem_lite.language import Queries, Query, Spot, is_relation
from gem_lite.maps import relations
from gem_lite.policies.gem_config import LITE, GemConfig
from gem_lite.policies.inputs import BARE_HEIGHT, Inputs
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2

THING = 0.3
"""The map of a named thing is at most this far below its highest value, all over the thing."""

PLACE_REACH = 2.4
"""A place may lie this many times as far from its map's peak as a pick: 3 cm on CLIPort's table. If a thing is held
beside its middle, the right place is beside the middle of a hole."""
APART = 3
"""Picks that are compared with each other are at least this far (cells) apart."""
EXACTLY = replace(LITE, peak_radius=0.0)
"""The rule of a gate that leaves no cell but those of its map's highest value."""


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
    """A `Choice` over N tables, with the inputs that led to it; the logits are (N, R, H, W).

    ``pick`` is in the frame of table ``pick_table``, ``place`` in that of ``place_table``; its yaw is the gripper's.
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


@dataclass(frozen=True)
class ScoredAct:
    """A pick, its best place, and the logits (N, R, H, W) of all its places.

    Attributes:
        log_probability: of both together, by the product rule (A.1.6).
    """

    log_probability: float
    pick_table: int
    pick_cell: tuple[int, int, int]
    place_table: int
    place_cell: tuple[int, int, int]
    place_logits: torch.Tensor


@dataclass(frozen=True)
class Gate:
    """A semantic map and the heights (m) below it, (H, W), for `near_peak`. No network reads them.

    Attributes:
        lead: the gate is open, for all cells, if the map is not higher by this much near its peak than elsewhere.
    """

    semantic: torch.Tensor
    height: torch.Tensor
    config: GemConfig
    lead: float = 0.0


def place_gate(semantic: torch.Tensor, height: torch.Tensor) -> Gate:
    """The gate for a place beside things, or for a spot: exactly the cells where its map (H, W) is above 0.

    No network can learn a relation, since training turns the pictures. So no policy acts without this gate.
    """
    return Gate(torch.where(semantic > 0, semantic.max(), -torch.inf), height, EXACTLY)


def with_spot(
    gates: Sequence[Mapping[str, Gate]], place: Query, heightmaps: Sequence[HeightMap]
) -> Sequence[Mapping[str, Gate]]:  # fmt: skip
    """The gates of several tables, with those of a place that is a spot: it leaves cells on its own table alone.

    A spot needs no semantic map, so that every policy can place there.
    """
    if not isinstance(place, Spot):
        return gates
    changed = []
    for number, (of_table, heightmap) in enumerate(zip(gates, heightmaps, strict=True)):
        semantic = torch.from_numpy(relations.spot_map(place, heightmap)) * (number == place.table)
        changed.append({**of_table, "place": place_gate(semantic, torch.from_numpy(heightmap.height))})
    return changed


def check_place(name: str, queries: Queries, gates: Sequence[Mapping[str, Gate]]) -> None:
    """Check that the gates of one or several tables leave a place, if the place is a relation to things or a spot.

    Args:
        name: of the policy.

    Raises:
        ValueError: there is no gate, so that the policy would place anywhere; or no place is free or seen.
    """
    place = queries.place
    if not isinstance(place, Spot) and not is_relation(place):
        return
    maps = [of_table["place"].semantic for of_table in gates if "place" in of_table]
    if not maps:
        raise ValueError(f"{name} has no map of a place {str(place)!r}: ask a gem policy with a semantic map")
    if not any(bool((semantic > 0).any()) for semantic in maps):
        raise relations.NoFreePlaceError(relations.no_free_place(place))


def near_peak(
    semantic: torch.Tensor, height: torch.Tensor, allowed: torch.Tensor, config: GemConfig
) -> torch.Tensor:  # fmt: skip
    """The allowed cells close to where a semantic map is near its highest allowed value, or on the same thing.

    "Near" is at most ``config.peak_margin`` below it. The same thing is what is connected with these cells, rises
    `BARE_HEIGHT` above z = 0, and has a map at most `THING` below the highest value: the map of a rope is not equally
    high everywhere. "Close" is within ``config.peak_radius``, from centre to centre of cells.

    Args:
        semantic: (..., H, W); one highest value is taken over all of it.
        height: (..., H, W), metres.
        allowed: (..., H, W) bool, at least one of them.

    Returns:
        (..., H, W) bool. Without a margin, all of ``allowed``.
    """
    if config.peak_margin is None:
        return allowed
    highest = float(semantic[allowed].max())
    near = (semantic >= highest - config.peak_margin) & allowed
    thing = near | ((semantic >= highest - THING) & (height > BARE_HEIGHT))
    masks = torch.stack([near, thing], dim=-3)  # (..., 2, H, W)
    tables = masks.reshape(-1, *masks.shape[-3:]).numpy(force=True)
    close = [within(connected(*of_table), config.peak_radius / config.pixel) for of_table in tables]
    return torch.from_numpy(np.stack(close)).view_as(allowed).to(allowed.device) & allowed


def connected(seeds: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """The regions of ``cells`` (H, W) bool that hold one of the ``seeds``; corners connect, too."""
    regions, _ = ndimage.label(cells, np.ones((3, 3)))
    return np.isin(regions, np.unique(regions[seeds]))


def within(cells: np.ndarray, distance: float) -> np.ndarray:
    """(H, W) bool: what is at most ``distance`` (cells) from one of the ``cells``, from centre to centre."""
    if not cells.any():
        return cells
    return ndimage.distance_transform_edt(~cells) <= distance + 1e-6


def untried(empty_picks: Sequence[Pose2], config: Config, allowed: torch.Tensor) -> torch.Tensor:
    """The ``allowed`` cells (..., H, W) whose centre is at least ``config.empty_radius`` from each of ``empty_picks``.

    All allowed cells, if there is no such cell: then everything was tried, and the policy begins again.
    """
    workspace = config.workspace
    rows, cols = np.indices(workspace.shape)
    x, y = workspace.to_world(rows, cols)
    far = np.ones(workspace.shape, bool)
    for pose in empty_picks:
        far &= np.hypot(x - pose.x, y - pose.y) >= config.empty_radius
    left = allowed & torch.from_numpy(far)
    return left if left.any() else allowed


def gated(gates: Sequence[Mapping[str, Gate]], role: str, allowed: torch.Tensor) -> torch.Tensor:
    """The ``allowed`` cells (N, H, W) that the gates of N tables leave for a role; all of them without such gates.

    The highest value of a map is the highest on all tables.
    """
    of_role = [gates_of_table[role] for gates_of_table in gates if role in gates_of_table]
    if not of_role:
        return allowed
    semantic, height = (torch.stack(maps) for maps in ([g.semantic for g in of_role], [g.height for g in of_role]))
    near = near_peak(semantic, height, allowed, of_role[0].config)
    elsewhere = semantic[allowed & ~near]
    if len(elsewhere) and semantic[near].max() - elsewhere.max() < of_role[0].lead:
        return allowed
    return near


def unmoved(shape: Sequence[int], pick: tuple[int, int], push: bool) -> torch.Tensor:
    """(R, H, W) bool, of ``shape``: the places that change nothing after a pick at the pixel ``pick`` (row, col).

    A thing that is put back where it was and not turned; for a push, its start.
    """
    here = torch.zeros(tuple(shape), dtype=torch.bool)
    here[slice(None) if push else 0, pick[0], pick[1]] = True
    return here


def stitch(maps: torch.Tensor) -> torch.Tensor:
    """The action maps (N, R, H, W) of N tables as one of (R, H, N W), side by side (Fig. A12, step 2)."""
    return maps.permute(1, 2, 0, 3).flatten(2)


def split(cell: tuple[int, int, int], width: int) -> tuple[int, tuple[int, int, int]]:
    """A stitched map's (angle, row, column) as the table's number and its own (angle, row, column)."""
    angle, row, column = cell
    return column // width, (angle, row, column % width)


def best_cell(logits: torch.Tensor, allowed: torch.Tensor) -> tuple[int, tuple[int, int, int]]:
    """The table and its (angle, row, column) with the largest of the logits (N, R, H, W) that are ``allowed``.

    Args:
        allowed: bool, of a shape that broadcasts to that of ``logits``.
    """
    panorama = stitch(logits.masked_fill(~allowed, -torch.inf))
    angle, row, column = np.unravel_index(int(panorama.argmax()), panorama.shape)
    return split((int(angle), int(row), int(column)), logits.shape[-1])


def best_cells(logits: torch.Tensor, allowed: torch.Tensor, count: int) -> list[tuple[int, tuple[int, int, int]]]:
    """As `best_cell`, the ``count`` best ones, at least `APART` from each other on one table.

    There are fewer if no other cell is allowed. Neighbours of a chosen cell are left out: they are the same pick.
    """
    left = allowed.expand(logits.shape).clone()
    rows, columns = torch.meshgrid(*map(torch.arange, logits.shape[-2:]), indexing="ij")
    found: list[tuple[int, tuple[int, int, int]]] = []
    while len(found) < count and left.any():
        table, cell = best_cell(logits, left)
        found.append((table, cell))
        left[table] &= torch.hypot(rows - float(cell[1]), columns - float(cell[2])) >= APART
    return found


def log_probability(
    logits: torch.Tensor, allowed: torch.Tensor, table: int, cell: tuple[int, int, int]
) -> float:  # fmt: skip
    """The log-probability of a table's cell: the softmax of the logits (N, R, H, W) over all that is ``allowed``."""
    kept = logits.masked_fill(~allowed, -torch.inf)
    return float(kept[(table, *cell)] - kept.flatten().logsumexp(dim=0))
