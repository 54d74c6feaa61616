"""The fused, top-down height map. It is made from camera views alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse

from gem_lite.rgbd.camera import View
from gem_lite.se2 import Workspace

LOWEST = -0.02
"""Lower points (metres) are no part of the table."""
TABLE_ERROR = 0.02
"""The bare table is seen at most this far (metres) from z = 0: poses of cameras are some millimetres off."""
FILLED = 0.0125
"""A cell that no camera saw copies the nearest seen one if that is at most this far (metres), from centre to centre."""
SAME_SURFACE = 0.008
"""A point belongs to a surface if it is at most this far (metres) above or below it."""
SUPPORT = 0.1
"""A surface holds at least this share of its cell's points, and two of them if there are four."""


@dataclass(frozen=True)
class HeightMap:
    """The table from above: ``rgb`` (H, W, 3) uint8, ``height`` (H, W) float32 metres.

    Row 0 lies at ``workspace.y_max``; see `gem_lite.se2` for the conventions. ``seen`` (H, W) bool marks the cells that
    a camera measured. The others hold values for the networks' sake (`SortedPoints.filled`): no policy picks or places
    there.
    """

    workspace: Workspace
    rgb: np.ndarray
    height: np.ndarray
    seen: np.ndarray

    def __post_init__(self) -> None:
        shape = self.workspace.shape
        if self.rgb.shape != (*shape, 3) or self.rgb.dtype != np.uint8:
            raise ValueError(f"rgb must be uint8 {(*shape, 3)}, got {self.rgb.dtype} {self.rgb.shape}")
        if self.height.shape != shape or self.height.dtype != np.float32:
            raise ValueError(f"height must be float32 {shape}, got {self.height.dtype} {self.height.shape}")
        if self.seen.shape != shape or self.seen.dtype != bool:
            raise ValueError(f"seen must be bool {shape}, got {self.seen.dtype} {self.seen.shape}")

    @property
    def near_table(self) -> np.ndarray:
        """(H, W) bool: the seen cells at most `TABLE_ERROR` from z = 0, where the table is."""
        return self.seen & (np.abs(self.height) <= TABLE_ERROR)


@dataclass(frozen=True)
class SortedPoints:
    """The point cloud of all views, sorted into the cells of a height map.

    Attributes:
        workspace: the area and the cells of the height map.
        kept: for each view n (H_n, W_n) bool: which of its pixels show a point inside the workspace.
        cell: (P,) the flat index of the cell of each such point.
        on_top: (P,) bool: whether the point lies on the top surface of its cell.
        seen: (H, W) bool: the cells with a point.
        height: (H, W) float32, the height map in metres.
    """

    workspace: Workspace
    kept: tuple[np.ndarray, ...]
    cell: np.ndarray
    on_top: np.ndarray
    seen: np.ndarray
    height: np.ndarray

    def filled(self, image: np.ndarray) -> np.ndarray:
        """A map (H, W) or (H, W, C) with values in the cells that no camera saw, see `fill`."""
        return fill(image, self.seen, self.workspace)

    def project(self, labels: Sequence[np.ndarray]) -> np.ndarray:
        """Average per-pixel labels of the views over each cell's top surface.

        Args:
            labels: for each view (H_n, W_n) or (H_n, W_n, C).

        Returns:
            The label map (H, W) or (H, W, C) float32, `filled`.
        """
        values = np.concatenate([label[kept] for label, kept in zip(labels, self.kept, strict=True)])[self.on_top]
        cells = self.cell[self.on_top]
        size = int(np.prod(self.workspace.shape))
        columns = values.reshape(len(values), -1).T
        mean = np.stack([_means(cells, column, size) for column in columns], axis=-1).astype(np.float32)
        return self.filled(mean.reshape(*self.workspace.shape, *values.shape[1:]))

    def shares(self, groups: Sequence[np.ndarray], count: int) -> sparse.csr_array:
        """The share of groups of pixels in each cell's average. Built once, it replaces `project` for many labels.

        If all pixels of a group have the same label, ``shares @ labels`` is the flat map that `project` fills.

        Args:
            groups: for each view (H_n, W_n) int, the group of each pixel.
            count: the number of all groups.

        Returns:
            (H * W, count) float32. The rows of unseen cells are empty.
        """
        group = np.concatenate([group[kept] for group, kept in zip(groups, self.kept, strict=True)])[self.on_top]
        cells = self.cell[self.on_top]
        size = int(np.prod(self.workspace.shape))
        points = np.bincount(cells, minlength=size)
        weights = (1 / np.maximum(points, 1)).astype(np.float32)[cells]
        return sparse.csr_array((weights, (cells, group)), shape=(size, count))  # It adds equal entries.


def fill(image: np.ndarray, seen: np.ndarray, workspace: Workspace) -> np.ndarray:
    """Values for the cells of a map (H, W) or (H, W, C) that no camera saw, which a convolution reads like all others.

    A hole between seen cells copies the nearest one, up to `FILLED` from it. Beyond, nothing is known: there is the
    bare table, which is what most seen cells show, so their median. What stands on the table does not grow into the
    unseen.
    """
    if seen.all() or not seen.any():
        return image
    cells, nearest = ndimage.distance_transform_edt(~seen, return_indices=True)
    filled = image[tuple(nearest)]
    filled[cells * workspace.pixel > FILLED + 1e-9] = np.median(image[seen], axis=0)
    return filled


def sort_points(views: Sequence[View], workspace: Workspace) -> SortedPoints:
    """Sort the pixels of all views into the cells of ``workspace``, and find the top surface of each cell.

    Raises:
        ValueError: there is no view, or no view has a point inside the workspace.
    """
    if not views:
        raise ValueError("views is empty: a height map needs at least one RGB-D view")
    kept = []
    points = []
    for view in views:
        xyz = view.points()
        inside = is_inside(xyz, view, workspace)
        kept.append(inside)
        points.append(xyz[inside])
    x, y, z = np.concatenate(points).T
    if not len(z):
        raise ValueError(f"no camera sees a point inside the workspace: {_where_points_lie(views)}")
    cell = workspace.cells(x, y)
    size = int(np.prod(workspace.shape))
    on_top = _on_top(cell, z, size)
    level = _means(cell[on_top], z[on_top], size)
    seen = (np.bincount(cell, minlength=size) > 0).reshape(workspace.shape)
    height = np.maximum(level, 0).reshape(workspace.shape).astype(np.float32)
    return SortedPoints(workspace, tuple(kept), cell, on_top, seen, fill(height, seen, workspace))


def is_inside(points: np.ndarray, view: View, workspace: Workspace) -> np.ndarray:
    """Which pixels of a view (H, W) were measured inside the workspace; ``points`` are the view's, (H, W, 3)."""
    x, y, z = np.moveaxis(points, -1, 0)
    return workspace.contains(x, y) & (z > LOWEST) & (z < workspace.z_max) & (view.depth > 0)  # 0: not measured


def _on_top(cell: np.ndarray, z: np.ndarray, size: int) -> np.ndarray:
    """(P,) bool: the points of each cell's highest surface.

    The highest point alone is no surface: noise would lift the whole table, and a pixel between two surfaces would make
    a spike. What too few points support (`SUPPORT`) is passed over. The mean of what is left is the surface's height.
    """
    points = np.bincount(cell, minlength=size)
    needed = np.maximum(SUPPORT * points, np.where(points < 4, 1, 2))
    left = np.ones(len(z), bool)
    highest_surface = None
    while True:
        top = np.full(size, -np.inf, np.float32)
        np.maximum.at(top, cell[left], z[left])
        surface = left & (z >= top[cell] - SAME_SURFACE)
        count = np.bincount(cell[surface], minlength=size)
        if highest_surface is None:
            highest_surface = surface
        unsupported = surface & (count < needed)[cell]
        if not unsupported.any():
            break
        left &= ~unsupported
    surface |= highest_surface & (count == 0)[cell]  # Where nothing is supported, the highest is the best guess.
    return np.abs(z - _means(cell[surface], z[surface], size)[cell]) <= SAME_SURFACE


def _means(cell: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    """(size,) the mean of the values (P,) in each cell; 0 where there are none."""
    return np.bincount(cell, values, size) / np.maximum(np.bincount(cell, minlength=size), 1)


def _where_points_lie(views: Sequence[View]) -> str:
    """The middle nine tenths of all measured points along each axis, in words."""
    measured = np.concatenate([view.points()[view.depth > 0] for view in views])
    if not len(measured):
        return "no pixel has a depth"
    low, high = np.percentile(measured, (5, 95), axis=0)
    ranges = [f"{axis} {a:.2f} to {b:.2f} m" for axis, a, b in zip("xyz", low, high, strict=True)]
    return f"most points lie at {', '.join(ranges)}; gem-lite check-cameras may find the reason"


def fuse_views(views: Sequence[View], workspace: Workspace, points: SortedPoints | None = None) -> HeightMap:
    """Fuse RGB-D views into one orthographic height map (Sec. 3, "top-down reconstruction").

    Args:
        views: RGB-D views of the table.
        workspace: the area to cover, and the cell size.
        points: the result of `sort_points` for the same arguments, if the caller already has it.
    """
    if points is None:
        points = sort_points(views, workspace)
    rgb = points.project([view.rgb for view in views])
    return HeightMap(workspace, np.round(rgb).astype(np.uint8), points.height, points.seen)
