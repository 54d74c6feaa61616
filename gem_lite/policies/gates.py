"""Rules of ours for acting: a semantic map says which thing is meant, the networks say where on it.

The networks weigh a map against their other inputs, and may prefer an object on which the map is low. With these rules
the map chooses the object; the networks choose among the cells that are left. GEM's picks keep to them. Rivals can do
so, too: `RivalGates`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy import ndimage

from gem_lite.clip import Clip
from gem_lite.config import Config
from gem_lite.language import Queries, Query
from gem_lite.maps import location_words, sources
from gem_lite.maps.query_maps import MapConfig, query_maps
from gem_lite.policies.inputs import BARE_HEIGHT
from gem_lite.rgbd.camera import View
from gem_lite.se2 import Pose2

THING = 0.3
"""The map of a named thing is at most this far below its highest value, all over the thing."""


@dataclass(frozen=True)
class Gate:
    """A semantic map and the heights (m) below it, (H, W), for `near_peak`. No network reads them."""

    semantic: torch.Tensor
    height: torch.Tensor
    config: MapConfig


def near_peak(
    semantic: torch.Tensor, height: torch.Tensor, allowed: torch.Tensor, config: MapConfig
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


def untried(empty_picks: Sequence[Pose2], config: Config) -> torch.Tensor:
    """(H, W) bool: cells whose centre is at least ``config.empty_radius`` from each of ``empty_picks``.

    All cells, if there is no such cell: then everything was tried, and the policy begins again.
    """
    workspace = config.workspace
    rows, cols = np.indices(workspace.shape)
    x, y = workspace.to_world(rows, cols)
    far = np.ones(workspace.shape, bool)
    for pose in empty_picks:
        far &= np.hypot(x - pose.x, y - pose.y) >= config.empty_radius
    return torch.from_numpy(far if far.any() else np.ones_like(far))


def gated(gates: Sequence[Mapping[str, Gate]], role: str, allowed: torch.Tensor) -> torch.Tensor:
    """The ``allowed`` cells (N, H, W) that the gates of N tables leave for a role; all of them without such gates.

    The highest value of a map is the highest on all tables.
    """
    of_role = [gates_of_table[role] for gates_of_table in gates if role in gates_of_table]
    if not of_role:
        return allowed
    semantic, height = (torch.stack(maps) for maps in ([g.semantic for g in of_role], [g.height for g in of_role]))
    return near_peak(semantic, height, allowed, of_role[0].config)


def unmoved(shape: Sequence[int], pick: tuple[int, int], push: bool) -> torch.Tensor:
    """(R, H, W) bool, of ``shape``: the places that change nothing after a pick at the pixel ``pick`` (row, col).

    A thing that is put back where it was and not turned; for a push, its start.
    """
    here = torch.zeros(tuple(shape), dtype=torch.bool)
    here[slice(None) if push else 0, pick[0], pick[1]] = True
    return here


class RivalGates:
    """Gates for a method without semantic maps: the text-conditioned maps of GEM, with their words "left" and "and".

    A pick is gated by the pick's map. A place is gated if its phrase has a location word, since GEM's place reads such
    a word from its map.
    """

    def __init__(self, clip: Clip, config: MapConfig) -> None:
        self.config = config
        self.source = sources.SOURCES.find(config.semantic_map)(clip, config)

    def gates(self, views: Sequence[View], queries: Queries) -> dict[str, Gate]:
        """The gates by role, "pick" and "place"; a push has none for its start."""
        scene = self.source.embed(views)
        height = torch.from_numpy(scene.heightmap.height)

        def gate(query: Query) -> Gate:
            fused = query_maps(self.source, scene, query, self.config).fused
            return Gate(torch.from_numpy(fused), height, self.config)

        gates = {} if queries.push else {"pick": gate(queries.pick)}
        if isinstance(queries.place, str) and location_words.location_word(queries.place):
            gates["place"] = gate(queries.place)
        return gates
