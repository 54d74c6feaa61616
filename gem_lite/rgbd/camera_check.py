"""Do the cameras of a table agree? If not, what is probably wrong?

The table is flat and lies at z = 0. So with right cameras every view has points at z = 0 all over the workspace, and
what stands on the table has the same height in all views. `fit` measures both. A mistake that is often made can be
undone (`corrections`). If the cameras do not fit as they are, and do fit without one of these mistakes, it has been
found.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gem_lite.rgbd.camera import measured_points
from gem_lite.rgbd.observation import RawView
from gem_lite.rgbd.planes import Plane, find_planes, tilt
from gem_lite.rgbd.seen import as_option, seen_of_table
from gem_lite.se2 import Workspace

POINTS = 12_000
"""About so many points of a view are compared."""
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
LARGEST_TILT = 8.0
"""A smaller turn (degrees) is a matter of calibration."""
WELL_LEVEL = 1.0
"""The pose of a view fits if the table in it is tilted by less (degrees), and lies less than `LEVEL` from z = 0."""
GLIMPSE = 0.05
"""A view whose pose fits must see at least this share of the workspace's cells."""
CALIBRATION = 0.08
"""A table that is seen farther from z = 0 (m) is no matter of calibration."""
PRINCIPAL = (0.2, 0.8)
"""The principal point lies between these shares of the picture's width, and of its height."""
FOCAL = (0.2, 10.0)
"""A focal length is between these multiples of the picture's width."""
MILLIMETRES = 1000.0


@dataclass(frozen=True)
class Cloud:
    """Some measured pixels of a view as points (N, 3) in the camera's axes, and the camera's pose.

    Attributes:
        rotation, position: (3, 3) and (3,), from the camera's axes to the table's frame (m).
    """

    local: np.ndarray
    rotation: np.ndarray
    position: np.ndarray

    @property
    def points(self) -> np.ndarray:
        """(N, 3): in the table's frame (m)."""
        return self.local @ self.rotation.T + self.position


def cloud(view: RawView) -> Cloud:
    """About `POINTS` points of a view. If depth has another size than colour, the intrinsics are scaled to it."""
    height, width = view.depth.shape
    scale = np.diag([width / view.rgb.shape[1], height / view.rgb.shape[0], 1.0])
    pose = np.array(view.pose)
    local = measured_points(view.depth, scale @ np.array(view.intrinsics), POINTS)
    return Cloud(local, pose[:3, :3], pose[:3, 3])


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
    covered = []
    level = []
    heights = []
    for cloud_of_view in clouds:
        x, y, z = cloud_of_view.points.T
        inside = workspace.contains(x, y)
        cell = coarse.cells(x[inside], y[inside])
        z = z[inside]
        top = np.full(math.prod(coarse.shape), -np.inf)
        np.maximum.at(top, cell, z)
        on_table = np.zeros(len(top), bool)
        on_table[cell[np.abs(z) < LEVEL]] = True
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


MISTAKES = {
    "inverse pose": "the pose is inverted: it must lead from the camera's axes to the table's frame",
    "axes flipped": "the camera's axes are flipped: x must point to the right, y down and z forward (OpenGL's y and z "
    "point the other way)",
    "axes swapped": "the camera's axes come in another order: x must point to the right, y down and z forward",
    "millimetres (pose)": "the position in the pose is in millimetres: it must be in metres",
    "depth scale": "depth_scale is wrong",
    "quaternion order": "the rotation was made from a quaternion in another order: is w the first or the last number?",
    "depth along the ray": "depth is the distance along each pixel's ray: it must be that along the camera's axis",
    "degrees for radians": "the pose's rotation was made from degrees that were read as radians",
}
"""Those that `corrections` undoes, by name: what they are."""


def corrections(given: Cloud) -> Iterator[tuple[str, Cloud]]:
    """The clouds that a cloud may have been before a mistake, each with the mistake's name."""
    yield "inverse pose", replace(given, rotation=given.rotation.T, position=-given.rotation.T @ given.position)
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            axes = np.eye(3)[list(order)] * signs
            if not np.array_equal(axes, np.eye(3)):
                mistake = "axes flipped" if order == (0, 1, 2) else "axes swapped"
                yield mistake, replace(given, rotation=given.rotation @ axes)
    yield "millimetres (pose)", replace(given, position=given.position / MILLIMETRES)
    yield "depth scale", replace(given, local=given.local * _depth_factor(given))
    distances = np.linalg.norm(given.local, axis=1, keepdims=True)
    yield "depth along the ray", replace(given, local=given.local * (given.local[:, 2:] / distances))
    if np.linalg.det(given.rotation) < 0:  # a reflection has no quaternion and no angle
        return
    rotation = Rotation.from_matrix(given.rotation)
    for shift in (1, -1):
        reordered = Rotation.from_quat(np.roll(rotation.as_quat(), shift))
        yield "quaternion order", replace(given, rotation=reordered.as_matrix())
    # A turn by θ became one by 180 θ / π. From it, θ is known up to multiples of a full turn.
    vector = rotation.as_rotvec()
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 1e-9 else np.array([0.0, 0.0, 1.0])
    for turns in range(-30, 31):
        true = math.radians(angle + 2 * math.pi * turns)
        changed = abs(true - angle) > math.radians(LARGEST_TILT)
        if abs(true) <= math.pi and changed:
            yield "degrees for radians", replace(given, rotation=Rotation.from_rotvec(true * axis).as_matrix())


def _depth_factor(given: Cloud) -> float:
    """By how much to multiply depth so that most points lie at z = 0; 1 if no factor does."""
    fall = -(given.local @ given.rotation[2])
    height = given.position[2]
    factors = np.log(height / fall[fall > 0]) if height > 0 else np.zeros(0)
    if not len(factors):
        return 1.0
    counts, edges = np.histogram(factors, np.arange(factors.min() - 0.02, factors.max() + 0.04, 0.02))
    highest = int(counts.argmax())
    near = (factors >= edges[highest]) & (factors <= edges[highest + 1])
    return float(np.exp(np.median(factors[near])))


def corrected(clouds: Sequence[Cloud], changing: Sequence[int], mistake: str, workspace: Workspace) -> Fit:
    """The best fit that the correction of a mistake in some clouds gives.

    A correction may have several candidates for a view. Those with which the view sees most of the table are combined
    with those of the other views: at most 200 combinations are tried.

    Args:
        changing: the numbers of the clouds to correct.
    """
    choices = []
    for number in changing:
        candidates = [candidate for name, candidate in corrections(clouds[number]) if name == mistake]
        seen = [fit([candidate], workspace).covered[0] for candidate in candidates]
        enough = max(COVERED, 0.8 * max(seen, default=0.0))
        choices.append([c for c, share in zip(candidates, seen, strict=True) if share >= enough])
    best = fit(clouds, workspace)
    for combination in itertools.islice(itertools.product(*choices), 200):
        tried = list(clouds)
        for number, candidate in zip(changing, combination, strict=True):
            tried[number] = candidate
        best = max(best, fit(tried, workspace), key=lambda found: found.score)
    return best


def check(views: Sequence[RawView], workspace: Workspace) -> list[Finding]:
    """What is probably wrong with cameras; nothing if they fit the table.

    Args:
        views: as `gem_lite.rgbd.observation.read_raw` reads them.
        workspace: the part of the table that matters. The table is at z = 0.
    """
    findings = [Finding("sizes differ", (view.name,), view.misfit) for view in views if view.misfit]
    implausible = [
        Finding("intrinsics", (view.name,), text) for view in views if (text := implausible_intrinsics(view))
    ]
    if implausible:
        return [*findings, *implausible]
    blind = tuple(view.name for view in views if not (view.depth > 0).any())
    if blind:
        return [*findings, Finding("no depth", blind, "no pixel has a depth: the depth picture is 0 everywhere")]
    clouds = [cloud(view) for view in views]
    as_given = fit(clouds, workspace)
    if all(_fits(clouds[number]) for number in as_given.wrong) and as_given.agreed >= AGREED:
        return findings + [_elsewhere(views[n]) for n in as_given.wrong if as_given.covered[n] < GLIMPSE]
    return [*findings, _explain([view.name for view in views], clouds, as_given, workspace)]


def _elsewhere(view: RawView) -> Finding:
    """A camera whose pose fits looks beside the workspace."""
    sentence = f"the pose fits the table, but nearly nothing of the rectangle is seen{rectangle_for(view)}"
    return Finding("rectangle not seen", (view.name,), sentence)


def _explain(names: Sequence[str], clouds: Sequence[Cloud], as_given: Fit, workspace: Workspace) -> Finding:
    """Why clouds do not fit: all cameras have a mistake, or those that do not see the table, or a single one."""
    if _exchanged(clouds, workspace):
        sentence = "each camera has a pose, but of another camera: exchange them"
        return Finding("poses exchanged", tuple(names), sentence)
    wrong = as_given.wrong
    of_wrong = tuple(names[number] for number in wrong)
    off = {names[number]: _almost_level(clouds[number]) for number in wrong}
    if off and all(off.values()):
        sentence = "calibrate: the table " + ", ".join(f"{text} (seen by {name})" for name, text in off.items())
        return Finding("calibration", of_wrong, sentence)
    if len(wrong) == len(names):
        elsewhere = _height_of_table(clouds)
        if elsewhere:
            return Finding("table height", of_wrong, elsewhere)
    numbers = tuple(range(len(names)))
    suspects = [wrong, numbers] if wrong else [numbers, *((number,) for number in numbers)]
    for changing in dict.fromkeys(suspects):
        fits = {name: corrected(clouds, changing, name, workspace) for name in MISTAKES}
        mistake = max(fits, key=lambda key: fits[key].score)
        if fits[mistake].good:
            sentence = MISTAKES[mistake]
            if mistake == "depth scale":
                factors = [_depth_factor(clouds[number]) for number in changing]
                sentence += f": multiply it by about {', '.join(f'{factor:.3g}' for factor in factors)}"
                if all(abs(abs(math.log(factor)) / math.log(MILLIMETRES) - 1) < 0.02 for factor in factors):
                    mistake = "millimetres (depth)"
            return Finding(mistake, tuple(names[number] for number in changing), sentence)
    if wrong and all(_is_turned(clouds[number]) for number in wrong):
        sentence = (
            "the height of the camera and the depth fit the table, and the rotation does not: were its angles given in "
            "degrees where radians are needed, or in another order?"
        )
        return Finding("degrees for radians", of_wrong, sentence)
    if wrong:
        seen = ", ".join(f"{names[number]} {100 * as_given.covered[number]:.0f} %" for number in wrong)
        sentence = (
            f"the table (z = 0) is seen in little of the workspace ({seen}), and no single mistake that is known here "
            "explains it: is the table at z = 0, is the workspace right, are there two mistakes?"
        )
        return Finding("table not found", of_wrong, sentence)
    bad = [pair for pair, share in as_given.pairs.items() if share < AGREED]
    alone = [names[number] for number in numbers if len(bad) > 1 and all(number in pair for pair in bad)]
    if len(alone) == 1:
        sentence = "calibrate: what stands on the table has other places and heights here than in the other views"
        return Finding("views disagree", tuple(alone), sentence)
    pairs = ", ".join(f"{names[first]} and {names[second]}" for first, second in bad)
    sentence = f"calibrate: these do not agree about what stands on the table: {pairs}"
    return Finding("views disagree", tuple(names), sentence)


def rectangle_for(view: RawView) -> str:
    """What to say of a view that sees little of the workspace: the rectangle that it sees, if its pose fits."""
    seen = seen_of_table(view.view()) if not view.misfit and _fits(cloud(view)) else None
    return "" if seen is None else f"; what it sees fits {as_option(seen)}"


def implausible_intrinsics(view: RawView) -> str:
    """Why a view's intrinsics cannot be those of its picture, in words; "" if they can."""
    height, width = view.rgb.shape[:2]
    matrix = np.array(view.intrinsics)
    (low, high), point = PRINCIPAL, matrix[:2, 2]
    size = f"a picture of {width} x {height} pixels"
    if not FOCAL[0] * width <= matrix[0, 0] <= FOCAL[1] * width:
        return f"a focal length of {matrix[0, 0]:.4g} does not belong to {size}: intrinsics are in pixels"
    if not (low * width <= point[0] <= high * width and low * height <= point[1] <= high * height):
        return (
            f"the principal point ({point[0]:.4g}, {point[1]:.4g}) is far from the middle of {size}: are the "
            "intrinsics those of another resolution?"
        )
    return ""


def _table(given: Cloud) -> tuple[Plane, float] | None:
    """The largest plane that is almost level, and its height (m) in the middle of what is seen of it."""
    for plane in find_planes(given.points, given.position):
        if tilt(plane.normal) <= LARGEST_TILT:
            return plane, float(plane.middle(given.points)[2])
    return None


def _fits(given: Cloud) -> bool:
    """Whether a pose fits the table, however little of the workspace its camera sees."""
    table = _table(given)
    right_handed = np.linalg.det(given.rotation) > 0
    return right_handed and table is not None and tilt(table[0].normal) < WELL_LEVEL and abs(table[1]) < LEVEL


def _almost_level(given: Cloud) -> str:
    """How a plane that is nearly the table differs from z = 0, in words; "" if there is none."""
    table = _table(given)
    if table is None or abs(table[1]) > CALIBRATION:
        return ""
    return f"is tilted by {tilt(table[0].normal):.1f} degrees and lies {1000 * table[1]:.0f} mm from z = 0"


def _height_of_table(clouds: Sequence[Cloud]) -> str:
    """Where a table lies that all cameras see level and at one height, in words; "" if they do not."""
    tables = [_table(given) for given in clouds]
    found = [table for table in tables if table is not None and tilt(table[0].normal) < 2 * WELL_LEVEL]
    heights = [height for _, height in found]
    if len(found) < len(clouds) or max(heights) - min(heights) > SAME_HEIGHT:
        return ""
    factor = _depth_factor(clouds[0])
    if len(clouds) == 1 and not 0.5 < factor < 2:
        return ""
    sentence = (
        f"the table is level and lies at z = {np.mean(heights):.3f} m, and must lie at 0: if the poses are those in "
        "the frame of a robot's base, `gem-lite set-up robot` finds the table in it"
    )
    return sentence + (
        f"; otherwise depth_scale is wrong: multiply it by about {factor:.3g}" if len(clouds) == 1 else ""
    )


def _exchanged(clouds: Sequence[Cloud], workspace: Workspace) -> bool:
    """Whether the cameras, at most four, fit with their poses in another order."""
    orders = list(itertools.permutations(clouds))[1:] if len(clouds) <= 4 else []
    tried = ([replace(other, local=one.local) for one, other in zip(clouds, order, strict=True)] for order in orders)
    return any(fit(exchanged, workspace).good for exchanged in tried)


def _is_turned(given: Cloud) -> bool:
    """Whether a plane is as far from the camera as the table is, if the position is right, and is not level."""
    height = given.position[2]
    planes = find_planes(given.points, given.position)
    return any(
        abs(plane.height(given.position) - height) < 0.02 + 0.02 * abs(height) and tilt(plane.normal) > LARGEST_TILT
        for plane in planes
    )
