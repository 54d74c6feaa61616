"""Do the cameras of a table agree? If not, what is probably wrong?

The table is flat and lies at z = 0. So with right cameras every view has points at z = 0 all over the workspace, and
what stands on the table has the same height in all views. `fit` measures both. A mistake that is often made can be
undone: `CORRECTIONS` undo one each. If the cameras do not fit as they are, and do fit with one of these corrections,
the mistake has been found.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gem_lite.rgbd.camera_mistakes import CORRECTIONS, LARGEST_TILT, MILLIMETRES, Cloud, Correction, cloud, depth_factor
from gem_lite.rgbd.levelling import inside, plane
from gem_lite.rgbd.observation import RawView
from gem_lite.se2 import Workspace

CELL = 0.02
"""Side (m) of the cells in which views are compared."""
LEVEL = 0.012
"""A point at most this far (m) from z = 0 lies on the table."""
STANDS = 0.02
"""A higher point (m) belongs to something that stands on the table."""
SAME_HEIGHT = 0.015
"""Two views agree about a cell if their heights differ by less (m)."""
COVERED = 0.3
"""With right cameras, a view sees the table in at least this share of the workspace's cells."""
LEVEL_SHARE = 0.6
"""With right cameras, a view sees the table in at least this share of the cells in which it sees anything."""
COMPARED = 15
"""Two views are compared if both see at least as many cells with something on the table."""
AGREED = 0.5
"""With right cameras, two views agree in at least this share of the cells in which something stands."""
NEAR_TABLE = 0.08
"""A table that is farther (m) from z = 0 is no matter of calibration."""
LITTLE = 0.05
"""A depth that is off by less is a matter of calibration."""
MOST_EXCHANGED = 4
"""Exchanged poses are looked for among at most as many cameras."""
COMBINATIONS = 200
"""At most as many combinations of several views' candidates are tried."""
PLANES = 300
"""Random planes that are tried."""
SHARE_OF_PLANE = 0.15
"""A plane that holds this share of a view's points is large enough to be the table."""


@dataclass(frozen=True)
class Fit:
    """How well cameras fit a table at z = 0.

    Attributes:
        covered: by view, the share of the workspace's cells in which it sees the table.
        level: by view, the share of the cells with any of its points, in which it sees the table.
        pairs: for two views, by their numbers, the share of the cells with something on the table about whose height
            they agree. Views with less than `COMPARED` such cells in common are left out.
    """

    covered: tuple[float, ...]
    level: tuple[float, ...]
    pairs: dict[tuple[int, int], float]

    @property
    def agreed(self) -> float:
        """The agreement of the two views that agree least; 1 if no two are compared."""
        return min(self.pairs.values(), default=1.0)

    @property
    def good(self) -> bool:
        """Whether the cameras are probably right."""
        return not self.wrong and self.agreed >= AGREED

    @property
    def wrong(self) -> tuple[int, ...]:
        """The numbers of the views that do not see the table where it should be."""
        pairs = zip(self.covered, self.level, strict=True)
        return tuple(number for number, (seen, flat) in enumerate(pairs) if seen < COVERED or flat < LEVEL_SHARE)

    @property
    def score(self) -> float:
        """One number in [0, 1], to compare corrections."""
        return min(self.covered) * min(self.level) * self.agreed


@dataclass(frozen=True)
class Finding:
    """A probable mistake: its short name, the cameras that have it, and one sentence for the user."""

    mistake: str
    cameras: tuple[str, ...]
    sentence: str


def fit(clouds: Sequence[Cloud], workspace: Workspace) -> Fit:
    """How well clouds fit a table at z = 0."""
    coarse = replace(workspace, pixel=CELL)
    rows, cols = coarse.shape
    covered = []
    level = []
    heights = []
    for cloud_of_view in clouds:
        points = cloud_of_view.points
        x, y, z = points[inside(points, workspace)].T
        row, col = coarse.to_pixel(x, y)
        row = np.clip(np.floor(row + 0.5).astype(int), 0, rows - 1)
        col = np.clip(np.floor(col + 0.5).astype(int), 0, cols - 1)
        cell = row * cols + col
        on_table = np.zeros(rows * cols, bool)
        on_table[cell[np.abs(z) < LEVEL]] = True
        top = np.full(rows * cols, -np.inf)
        np.maximum.at(top, cell, z)
        covered.append(float(on_table.mean()))
        level.append(float(on_table.sum() / max(np.isfinite(top).sum(), 1)))
        heights.append(top)
    pairs = {}
    for first, second in itertools.combinations(range(len(heights)), 2):
        one, other = heights[first], heights[second]
        both = np.isfinite(one) & np.isfinite(other) & (np.maximum(one, other) > STANDS)
        if both.sum() >= COMPARED:
            pairs[first, second] = float(np.mean(np.abs(one[both] - other[both]) < SAME_HEIGHT))
    return Fit(tuple(covered), tuple(level), pairs)


def corrected(
    clouds: Sequence[Cloud], changing: Sequence[int], correction: Correction, workspace: Workspace
) -> Fit:  # fmt: skip
    """The best fit that a correction of some clouds gives.

    A correction may have several candidates for a view. Those with which the view sees most of the table are combined
    with those of the other views.

    Args:
        changing: the numbers of the clouds to correct.
    """
    choices = []
    for number in changing:
        candidates = list(correction(clouds[number]))
        seen = [fit([candidate], workspace).covered[0] for candidate in candidates]
        highest = max(seen, default=0.0)
        choices.append([c for c, share in zip(candidates, seen, strict=True) if share >= max(COVERED, 0.8 * highest)])
    best = fit(clouds, workspace)
    for combination in itertools.islice(itertools.product(*choices), COMBINATIONS):
        tried = list(clouds)
        for number, candidate in zip(changing, combination, strict=True):
            tried[number] = candidate
        best = max(best, fit(tried, workspace), key=lambda found: found.score)
    return best


def check(views: Sequence[RawView], workspace: Workspace) -> list[Finding]:
    """What is probably wrong with cameras; nothing if they fit the table.

    Either all cameras have a mistake, or those that do not see the table, or a single one.

    Args:
        views: as `gem_lite.rgbd.observation.read_raw` reads them.
        workspace: the part of the table that matters. The table is at z = 0.
    """
    findings = [_sizes(view) for view in views if view.depth.shape != view.rgb.shape[:2]]
    names = tuple(view.name for view in views)
    blind = tuple(view.name for view in views if not (view.depth > 0).any())
    if blind:
        return [*findings, Finding("no depth", blind, "no pixel has a depth: the depth picture is 0 everywhere")]
    clouds = [cloud(view) for view in views]
    as_given = fit(clouds, workspace)
    if as_given.good:
        return findings
    numbers = tuple(range(len(views)))
    wrong = as_given.wrong
    if _exchanged(clouds, workspace):
        sentence = "each camera has a pose, but of another camera: exchange them"
        return [*findings, Finding("poses exchanged", names, sentence)]
    off = {names[number]: _almost_level(clouds[number], workspace) for number in wrong}
    if off and all(off.values()):
        sentence = "calibrate: the table " + ", ".join(f"{text} (seen by {name})" for name, text in off.items())
        return [*findings, Finding("calibration", tuple(off), sentence)]
    suspects = [wrong, numbers] if wrong else [numbers, *((number,) for number in numbers)]
    for changing in dict.fromkeys(suspects):
        fits = {name: corrected(clouds, changing, undo, workspace) for name, (undo, _) in CORRECTIONS.items()}
        name = max(fits, key=lambda key: fits[key].score)
        if fits[name].good:
            concerned = tuple(names[number] for number in changing)
            if name == "depth scale":
                return [*findings, _scale(concerned, [depth_factor(clouds[number]) for number in changing])]
            return [*findings, Finding(name, concerned, CORRECTIONS[name][1])]
    if wrong and all(_has_plane_at_height(clouds[number]) for number in wrong):
        sentence = (
            "the height of the camera and the depth fit the table, and the rotation does not: were its angles given in "
            "degrees where radians are needed, or in another order?"
        )
        return [*findings, Finding("degrees for radians", tuple(names[number] for number in wrong), sentence)]
    return [*findings, _unknown(names, as_given)]


def _almost_level(given: Cloud, workspace: Workspace) -> str:
    """How a plane that is nearly the table differs from z = 0, in words; "" if there is none.

    The plane is that of the points in the workspace that are at most `NEAR_TABLE` from z = 0.
    """
    points = given.points[inside(given.points, workspace)]
    near = points[np.abs(points[:, 2]) < NEAR_TABLE]
    if len(near) < SHARE_OF_PLANE * len(given.points):
        return ""
    slope_x, slope_y, constant = plane(near, (math.inf, 0.04, 0.02, LEVEL))
    tilt = math.degrees(math.atan(math.hypot(slope_x, slope_y)))
    distances = np.abs(near @ (-slope_x, -slope_y, 1.0) - constant)
    if np.mean(distances < LEVEL) < 0.8 or tilt > LARGEST_TILT:
        return ""
    height = constant + slope_x * (workspace.x_min + workspace.x_max) / 2
    height += slope_y * (workspace.y_min + workspace.y_max) / 2
    return f"is tilted by {tilt:.1f} degrees and lies {1000 * height:.0f} mm from z = 0"


def _exchanged(clouds: Sequence[Cloud], workspace: Workspace) -> bool:
    """Whether the cameras fit with their poses in another order."""
    if not 2 <= len(clouds) <= MOST_EXCHANGED:
        return False
    for order in list(itertools.permutations(range(len(clouds))))[1:]:
        tried = [Cloud(given.local, clouds[number].pose) for given, number in zip(clouds, order, strict=True)]
        if fit(tried, workspace).good:
            return True
    return False


def _has_plane_at_height(given: Cloud) -> bool:
    """Whether the points hold a plane that is as far from the camera as the table is, if the position is right.

    Planes through random triples of points are tried (RANSAC).
    """
    rng = np.random.default_rng(0)
    height = given.pose[2, 3]
    for _ in range(PLANES):
        corner, second, third = given.local[rng.choice(len(given.local), 3, replace=False)]
        normal = np.cross(second - corner, third - corner)
        length = np.linalg.norm(normal)
        if length < 1e-9:
            continue
        distances = given.local @ (normal / length)
        distance = float(corner @ (normal / length))
        fits_height = abs(abs(distance) - height) < 0.02 + 0.02 * height
        if fits_height and np.mean(np.abs(distances - distance) < LEVEL) > SHARE_OF_PLANE:
            return True
    return False


def _sizes(view: RawView) -> Finding:
    height, width = view.rgb.shape[:2]
    sentence = (
        f"colour is {width} x {height} and depth {view.depth.shape[1]} x {view.depth.shape[0]} pixels: give the depth "
        "that is aligned to the colour camera"
    )
    return Finding("sizes differ", (view.name,), sentence)


def _scale(names: tuple[str, ...], factors: Sequence[float]) -> Finding:
    sentence = f"depth_scale is wrong: multiply it by about {', '.join(f'{factor:.3g}' for factor in factors)}"
    if all(abs(factor - 1) < LITTLE for factor in factors):
        return Finding("calibration", names, f"calibrate: depth is off by a little, or a camera is tilted ({sentence})")
    thousand = all(abs(abs(math.log(factor)) / math.log(MILLIMETRES) - 1) < 0.02 for factor in factors)
    return Finding("millimetres (depth)" if thousand else "depth scale", names, sentence)


def _unknown(names: Sequence[str], found: Fit) -> Finding:
    if found.wrong:
        seen = ", ".join(f"{names[number]} {100 * found.covered[number]:.0f} %" for number in found.wrong)
        sentence = (
            f"the table (z = 0) is seen in little of the workspace ({seen}), and no single mistake that is known here "
            "explains it: is the table at z = 0, is the workspace right, are there two mistakes?"
        )
        return Finding("table not found", tuple(names[number] for number in found.wrong), sentence)
    bad = [pair for pair, share in found.pairs.items() if share < AGREED]
    alone = [number for number in range(len(names)) if len(bad) > 1 and all(number in pair for pair in bad)]
    if len(alone) == 1:
        sentence = "calibrate: what stands on the table has other places and heights here than in the other views"
        return Finding("views disagree", (names[alone[0]],), sentence)
    pairs = ", ".join(f"{names[first]} and {names[second]}" for first, second in bad)
    sentence = f"calibrate: these do not agree about what stands on the table: {pairs}"
    return Finding("views disagree", tuple(names), sentence)
