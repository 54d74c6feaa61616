"""Do the cameras of a table agree? If not, what is probably wrong?

The table is flat and lies at z = 0. So with right cameras every view has points at z = 0 all over the workspace, and
what stands on the table has the same height in all views. `fit` measures both. A mistake that is often made can be
undone: `CORRECTIONS` undo one each. If the cameras do not fit as they are, and do fit with one of these corrections,
the mistake has been found.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.observation import RawView
from gem_lite.se2 import Workspace

PIXELS = 12_000
"""About as many pixels of a view are looked at."""
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
COMPARED = 15
"""Two views are compared if both see at least as many cells with something on the table."""
AGREED = 0.5
"""With right cameras, two views agree in at least this share of the cells in which something stands."""
MILLIMETRES = 1000.0
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
        agreed: the share of the cells with something on the table about whose height two views agree, for the two
            views that agree least. Views with less than `COMPARED` such cells in common are not compared; if there are
            no others, it is 1.
    """

    covered: tuple[float, ...]
    agreed: float

    @property
    def good(self) -> bool:
        """Whether the cameras are probably right."""
        return min(self.covered) >= COVERED and self.agreed >= AGREED

    @property
    def score(self) -> float:
        """One number in [0, 1], to compare corrections."""
        return min(self.covered) * self.agreed


@dataclass(frozen=True)
class Finding:
    """A probable mistake: its short name, the cameras that have it, and one sentence for the user."""

    mistake: str
    cameras: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class Cloud:
    """Some measured pixels of a view as points (N, 3) in the camera's axes, and the camera's pose (4, 4)."""

    local: np.ndarray
    pose: np.ndarray

    @property
    def points(self) -> np.ndarray:
        """(N, 3): in the table's frame (m)."""
        return self.local @ self.pose[:3, :3].T + self.pose[:3, 3]

    def turned(self, axes: np.ndarray) -> Cloud:
        """The camera's axes replaced by ``axes`` (3, 3), which are given in the old ones by columns."""
        pose = self.pose.copy()
        pose[:3, :3] = pose[:3, :3] @ axes
        return Cloud(self.local, pose)


def cloud(view: RawView) -> Cloud:
    """The points of a view. If depth has another size than colour, the intrinsics are scaled to it."""
    height, width = view.depth.shape
    step = max(1, round(math.sqrt(view.depth.size / PIXELS)))
    x, y = np.meshgrid(np.arange(0, width, step) + 0.5, np.arange(0, height, step) + 0.5)
    shares = np.array([view.rgb.shape[1] / width, view.rgb.shape[0] / height])
    pixels = np.stack([x * shares[0], y * shares[1], np.ones_like(x)], axis=-1)
    depth = view.depth[::step, ::step]
    local = pixels @ np.linalg.inv(np.array(view.intrinsics)).T * depth[..., None]
    return Cloud(local[depth > 0], np.array(view.pose))


Correction = Callable[[Cloud], Iterator[Cloud]]
"""From a cloud to the clouds that it may have been before a mistake."""


def inverted_pose(given: Cloud) -> Iterator[Cloud]:
    """The pose was given from the table to the camera."""
    yield Cloud(given.local, np.linalg.inv(given.pose))


def flipped_axes(given: Cloud) -> Iterator[Cloud]:
    """The camera's axes point the other way, such as OpenGL's (y up, z backwards)."""
    for signs in itertools.product((1, -1), repeat=3):
        if signs != (1, 1, 1):
            yield given.turned(np.diag(signs))


def swapped_axes(given: Cloud) -> Iterator[Cloud]:
    """The camera's axes come in another order, and may be flipped, too."""
    for order in itertools.permutations(range(3)):
        if order == (0, 1, 2):
            continue
        for signs in itertools.product((1, -1), repeat=3):
            yield given.turned(np.eye(3)[list(order)] * signs)


def pose_in_millimetres(given: Cloud) -> Iterator[Cloud]:
    """The position was given in millimetres."""
    pose = given.pose.copy()
    pose[:3, 3] /= MILLIMETRES
    yield Cloud(given.local, pose)


def depth_in_millimetres(given: Cloud) -> Iterator[Cloud]:
    """The scale of the depth is a thousand times too large or too small."""
    for factor in (1 / MILLIMETRES, MILLIMETRES):
        yield Cloud(given.local * factor, given.pose)


def depth_along_ray(given: Cloud) -> Iterator[Cloud]:
    """The depth was measured along each pixel's ray instead of along the camera's axis."""
    distances = np.linalg.norm(given.local, axis=1, keepdims=True)
    yield Cloud(given.local * (given.local[:, 2:] / distances), given.pose)


def degrees_for_radians(given: Cloud) -> Iterator[Cloud]:
    """The rotation was made from a rotation vector in degrees that was read as radians.

    A turn by θ became one by 180 θ / π. From it, θ is known up to multiples of a full turn.
    """
    if np.linalg.det(given.pose[:3, :3]) < 0:
        return
    vector = Rotation.from_matrix(given.pose[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 1e-9 else np.array([0.0, 0.0, 1.0])
    for turns in range(-30, 31):
        true = math.radians(angle + 2 * math.pi * turns)
        if abs(true) <= math.pi:
            pose = given.pose.copy()
            pose[:3, :3] = Rotation.from_rotvec(true * axis).as_matrix()
            yield Cloud(given.local, pose)


CORRECTIONS: dict[str, tuple[Correction, str]] = {
    "inverse pose": (inverted_pose, "the pose is inverted: it must lead from the camera's axes to the table's frame"),
    "axes flipped": (
        flipped_axes, "the camera's axes are flipped: x must point to the right, y down and z forward (OpenGL's y "
        "and z point the other way)",
    ),
    "axes swapped": (
        swapped_axes, "the camera's axes come in another order: x must point to the right, y down and z forward",
    ),
    "millimetres (pose)": (pose_in_millimetres, "the position in the pose is in millimetres: it must be in metres"),
    "millimetres (depth)": (depth_in_millimetres, "depth_scale is a thousand times too large or too small"),
    "depth along the ray": (
        depth_along_ray, "depth is the distance along each pixel's ray: it must be that along the camera's axis",
    ),
    "degrees for radians": (
        degrees_for_radians, "the pose's rotation was made from degrees that were read as radians",
    ),
}  # fmt: skip
"""By the name of a mistake: what undoes it, and what it is."""


def fit(clouds: Sequence[Cloud], workspace: Workspace) -> Fit:
    """How well clouds fit a table at z = 0."""
    coarse = replace(workspace, pixel=CELL)
    rows, cols = coarse.shape
    covered = []
    heights = []
    for cloud_of_view in clouds:
        x, y, z = cloud_of_view.points.T
        inside = (x > workspace.x_min) & (x < workspace.x_max) & (y > workspace.y_min) & (y < workspace.y_max)
        row, col = coarse.to_pixel(x[inside], y[inside])
        row = np.clip(np.floor(row + 0.5).astype(int), 0, rows - 1)
        col = np.clip(np.floor(col + 0.5).astype(int), 0, cols - 1)
        cell = row * cols + col
        level = np.zeros(rows * cols, bool)
        level[cell[np.abs(z[inside]) < LEVEL]] = True
        covered.append(float(level.mean()))
        top = np.full(rows * cols, -np.inf)
        np.maximum.at(top, cell, z[inside])
        heights.append(top)
    agreed = 1.0
    for first, second in itertools.combinations(heights, 2):
        both = np.isfinite(first) & np.isfinite(second) & (np.maximum(first, second) > STANDS)
        if both.sum() >= COMPARED:
            agreed = min(agreed, float(np.mean(np.abs(first[both] - second[both]) < SAME_HEIGHT)))
    return Fit(tuple(covered), agreed)


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
    clouds = [cloud(view) for view in views]
    as_given = fit(clouds, workspace)
    if as_given.good:
        return findings
    numbers = tuple(range(len(views)))
    wrong = tuple(number for number, share in enumerate(as_given.covered) if share < COVERED)
    suspects = [numbers, wrong] if wrong else [numbers, *((number,) for number in numbers)]
    for changing in dict.fromkeys(suspects):
        fits = {name: corrected(clouds, changing, undo, workspace) for name, (undo, _) in CORRECTIONS.items()}
        name = max(fits, key=lambda key: fits[key].score)
        if fits[name].good:
            concerned = tuple(names[number] for number in changing)
            return [*findings, Finding(name, concerned, CORRECTIONS[name][1])]
    if wrong and all(_has_plane_at_height(clouds[number]) for number in wrong):
        sentence = (
            "the position and the depth fit the table, and the rotation does not: were its angles given in degrees "
            "where radians are needed, or in another order?"
        )
        return [*findings, Finding("degrees for radians", tuple(names[number] for number in wrong), sentence)]
    return [*findings, _unknown(names, as_given)]


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


def _unknown(names: Sequence[str], found: Fit) -> Finding:
    least = min(range(len(names)), key=found.covered.__getitem__)
    if found.covered[least] < COVERED:
        sentence = (
            f"{names[least]} sees the table (z = 0) in {100 * found.covered[least]:.0f} % of the workspace only; no "
            "mistake that is known here explains it: is the table at z = 0, and is the workspace right?"
        )
        return Finding("table not found", (names[least],), sentence)
    sentence = (
        f"the views agree about {100 * found.agreed:.0f} % of the cells in which something stands: calibrate the "
        "cameras"
    )
    return Finding("views disagree", tuple(names), sentence)
