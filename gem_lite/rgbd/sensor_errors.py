"""How real depth cameras err, for clean views of a simulator.

Two kinds: active stereo, like Intel's RealSense D435 and D455, and time of flight, like Microsoft's Azure Kinect.

Draw what belongs to a camera once an episode, and corrupt each observation before a policy sees it::

    units = draw_units(observation, NOMINAL, np.random.default_rng(0))
    seen = corrupt(observation, units, np.random.default_rng(1))

A point at depth z (m) has the disparity d = f B / z (pixels), with the view's own focal length f (pixels) and the
baseline B (m). An error of s pixels is one of z² s / (f B) metres: the stereo law, Intel's D400 tuning guide. Time of
flight measures z itself; its errors are metres, and its "disparity" is only a multiple of 1 / z that finds edges.

Not modelled: glossy and clear things (a view does not know them), light that takes two ways in a corner (time of
flight), the offset of colour from depth, rolling shutters, a clock offset, noise that is alike in successive frames.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtri

from gem_lite.rgbd.camera import Camera, View, as_pose
from gem_lite.rgbd.observation import Observation

SEARCH = 126
"""The largest disparity (pixels) that a D400 finds: what is nearer than f B / 126 has no depth (D400 data sheet)."""
KERNEL = 1.5
"""Blur (standard deviation in pixels) of the half of the noise that is not white: a window of 3 to 5. A guess."""
WARP_SCALE = 50.0
"""Blur (standard deviation in pixels) of the static warp, whose bumps are then about 100 pixels wide. A guess."""
EDGE = 0.5
"""A jump of disparity (pixels) between neighbours is an edge from here on. A guess: 20 mm at 1 m."""
HOLE_SCALE = 3.0
"""Blur (standard deviation in pixels) of the field whose lows are dropouts. A guess."""
DARK = 40
"""Pixels with a lower mean of red, green and blue (0-255) are dark. A guess."""
STEEP = math.radians(70)
"""Surfaces that are seen under a larger angle to their normal (rad) are steep."""
STRONG = 0.5
"""Up to this depth (m) the noise of time of flight does not grow (BlenderProc's fit to Tölgyessy and others 2021)."""


@dataclass(frozen=True)
class SensorErrors:
    """The sizes of a depth camera's errors, all off by default.

    Those in pixels of disparity are of stereo, those of `TIME_OF_FLIGHT` of the other kind; the rest both may have.

    Attributes:
        baseline: B (m) between the two imagers. Colour and depth are those of the left one.
        disparity_noise: standard deviation (pixels), new in each frame. Half its variance is white, half blurred.
        static_warp: standard deviation (pixels) of a smooth field, drawn once.
        unit_bias: standard deviation (pixels) of an offset of all disparities, drawn once.
        ripple: largest error, as a fraction of z, of the wave between whole disparities.
        thermal: largest error of scale, as a fraction of z, drawn once, uniformly.
        lateral_jitter: standard deviation (pixels) of where a pixel looks, in each direction.
        fattening: by how many pixels the foreground grows at most.
        least_fattening: by how many at least. Patches of 8 pixels draw whole numbers between the two.
        mixed, invalid: shares of the pixels into which foreground grew that get a depth between the two surfaces, and
            none. The others get the foreground's.
        occlusion: no depth where the right imager sees nothing: behind edges, in a band at the left, too near.
        dropout: share of all pixels without depth, in blobs.
        dark_dropout, steep_dropout: this share on dark (`DARK`) and on steep (`STEEP`) surfaces, if it is larger.
        disparity_step, depth_step: disparity (pixels) and depth (m) are rounded to multiples of it; 0: not rounded.
        axial_noise: standard deviation (m) of the depth up to `STRONG`, new in each frame, white.
        axial_growth: what is added to it for each metre beyond.
        depth_bias: standard deviation (m) of an offset of all depths, drawn once.
        depth_warp: standard deviation (m) of a smooth field, drawn once.
        blind_below: no depth where the mean of red, green and blue (0-255) is lower.
        position_error: standard deviation (m, each axis) of the position in the pose that the policy is given.
        rotation_error: standard deviation (rad, each axis) of the rotation in this pose.
        color_noise: standard deviation (of 255) of each channel at mid grey.
        exposure: e; colours are multiplied by a factor between 1 / (1 + e) and 1 + e, drawn once, log-uniformly.
        white_balance: largest error of the factors of red and of blue, drawn once, uniformly.
    """

    baseline: float = 0.05
    disparity_noise: float = 0.0
    static_warp: float = 0.0
    unit_bias: float = 0.0
    ripple: float = 0.0
    thermal: float = 0.0
    lateral_jitter: float = 0.0
    fattening: int = 0
    least_fattening: int = 0
    mixed: float = 0.0
    invalid: float = 0.0
    occlusion: bool = False
    dropout: float = 0.0
    dark_dropout: float = 0.0
    steep_dropout: float = 0.0
    disparity_step: float = 0.0
    depth_step: float = 0.0
    axial_noise: float = 0.0
    axial_growth: float = 0.0
    depth_bias: float = 0.0
    depth_warp: float = 0.0
    blind_below: float = 0.0
    position_error: float = 0.0
    rotation_error: float = 0.0
    color_noise: float = 0.0
    exposure: float = 0.0
    white_balance: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{field.name} must be a finite number of at least 0, got {value!r}")
            if field.name in SHARES and value > 1:
                raise ValueError(f"{field.name} must be a fraction of at most 1, got {value!r}")
        if not self.baseline:
            raise ValueError("baseline must be above 0 m, got 0")
        if not self.least_fattening <= self.fattening <= 32:
            raise ValueError(f"fattening must be from least_fattening to 32, got {self.fattening!r}")
        if self.mixed + self.invalid > 1 + 1e-9:
            raise ValueError(f"mixed and invalid must add up to at most 1, got {self.mixed} and {self.invalid}")


SHARES = ("mixed", "invalid", "dropout", "dark_dropout", "steep_dropout", "ripple", "thermal", "white_balance")
KINDS: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "disparity": ("disparity_noise", "static_warp", "unit_bias", "ripple", "thermal"),
    "holes": ("occlusion", "dropout", "dark_dropout", "steep_dropout"),
    "edges": ("lateral_jitter", "fattening", "least_fattening", "mixed", "invalid"),
    "quantisation": ("disparity_step", "depth_step"),
    "rotation": ("rotation_error",),
    "position": ("position_error",),
    "color": ("color_noise", "exposure", "white_balance"),
})  # fmt: skip
"""The attributes that belong to each kind of a stereo camera's errors."""
TIME_OF_FLIGHT = ("axial_noise", "axial_growth", "depth_bias", "depth_warp", "blind_below")
"""The attributes of a time-of-flight camera. With the baseline and those of `KINDS`, they are all."""

NOMINAL = SensorErrors(
    disparity_noise=0.08, static_warp=0.10, unit_bias=0.1, ripple=0.001, thermal=0.002, lateral_jitter=0.5,
    fattening=2, mixed=0.2, invalid=0.3, occlusion=True, dropout=0.02, dark_dropout=0.10, steep_dropout=0.30,
    disparity_step=1 / 32, depth_step=0.001, position_error=0.002, rotation_error=math.radians(0.3),
    color_noise=2.0, exposure=0.15, white_balance=0.04,
)  # fmt: skip
"""A well calibrated D435 in a lab (B = 50 mm), with the focal length of the view that it corrupts.

Noise: Intel's camera lead plans on 0.08 pixels. Warp: what Carfagni and others 2019 and Curto and others 2022 measured
on planes above that noise. Ripple: a fifth of `HARD`'s (Intel's subpixel linearity paper). Jitter: Handa and others
2014. Steps: D400 data sheet. Poses: residuals of hand-eye calibrations, 0.5-3 mm and 0.1-1 degree. Guesses: the bias
(within what users saw), the width of the thermal scale, fattening, what becomes of edges, all dropouts, all of colour.
"""
HARD = SensorErrors(
    disparity_noise=0.2, static_warp=0.2, unit_bias=0.4, ripple=0.005, thermal=0.005, lateral_jitter=1.0,
    fattening=4, least_fattening=1, mixed=0.4, invalid=0.4, occlusion=True, dropout=0.10, dark_dropout=0.30,
    steep_dropout=0.70, disparity_step=1 / 32, depth_step=0.001, position_error=0.005,
    rotation_error=math.radians(1), color_noise=5.0, exposure=0.6, white_balance=0.10,
)  # fmt: skip
"""A camera that should be recalibrated: noise above which Intel advises it, and one user's bias of 19 mm at 1 m.

Ripple: Intel's subpixel linearity paper. Jitter: Halmetschlager-Funek and others 2019. Poses: the upper end of the
published residuals. Guesses: as in `NOMINAL`, without the bias. Half a matching window of 9 pixels bounds fattening;
dropout is near the 11 % that a D415 lost on a white wall (Curto and others 2022).
"""
D455 = replace(NOMINAL, baseline=0.095)
"""`NOMINAL` with the baseline of a D455, 95 mm (its data sheet); Intel advises 848 x 480 pixels, f about 424 pixels."""
D455_HARD = replace(HARD, baseline=0.095)
"""`HARD` with the baseline of a D455."""
AZURE = SensorErrors(
    lateral_jitter=0.25, fattening=2, least_fattening=1, mixed=0.5, invalid=0.5, depth_step=0.001, axial_noise=0.0005,
    axial_growth=0.001, depth_bias=0.004, depth_warp=0.004, blind_below=15, position_error=NOMINAL.position_error,
    rotation_error=NOMINAL.rotation_error, color_noise=NOMINAL.color_noise, exposure=NOMINAL.exposure,
    white_balance=NOMINAL.white_balance,
)  # fmt: skip
"""An Azure Kinect. A ring of 1 or 2 pixels round whatever is nearer is mixed or invalid, half and half.

Noise, jitter, and the gray below which nothing is seen: BlenderProc, after Tölgyessy and others 2021. Step: Microsoft's
SDK. Bias and warp: guesses inside Microsoft's bound (11 mm + 0.1 %) and the 10 mm that users saw. The ring: a guess.
Poses and colour: as in `NOMINAL`.
"""
AZURE_HARD = SensorErrors(
    lateral_jitter=0.5, fattening=3, least_fattening=2, mixed=0.5, invalid=0.5, depth_step=0.001, axial_noise=0.001,
    axial_growth=0.002, depth_bias=0.008, depth_warp=0.008, blind_below=40, position_error=HARD.position_error,
    rotation_error=HARD.rotation_error, color_noise=HARD.color_noise, exposure=HARD.exposure,
    white_balance=HARD.white_balance,
)  # fmt: skip
"""`AZURE` with twice its noise, jitter, bias and warp, a wider ring, and more dark things unseen: guesses."""


@dataclass(frozen=True)
class Unit:
    """One camera of an episode: the sizes of its errors and what was drawn once.

    Attributes:
        errors: the sizes.
        camera: the camera as the policy is given it, with the errors of its pose.
        offset: (H, W) float32 pixels of disparity, bias and warp together.
        scale: factor of all depths.
        depth_offset: (H, W) float32 metres, bias and warp of time of flight together.
        gains: (3,) float32 factors of red, green and blue.
    """

    errors: SensorErrors
    camera: Camera
    offset: np.ndarray
    scale: float
    depth_offset: np.ndarray
    gains: np.ndarray


def draw_units(observation: Observation, errors: SensorErrors, rng: np.random.Generator) -> tuple[Unit, ...]:
    """Draw what stays the same for an episode, for each camera of an observation.

    With the same seed, larger errors are multiples of smaller ones, whichever others are on.
    """
    return draw_different_units(observation, [errors] * len(observation.views), rng)


def draw_different_units(
    observation: Observation, errors: Sequence[SensorErrors], rng: np.random.Generator
) -> tuple[Unit, ...]:  # fmt: skip
    """`draw_units` for cameras of several kinds: ``errors`` are those of each. Raises ValueError for another number."""
    views = observation.views
    if len(errors) != len(views):
        raise ValueError(f"errors must be as many as the observation's cameras, {len(views)}, got {len(errors)}")
    parts = zip(views, errors, rng.spawn(len(views)), strict=True)
    return tuple(_draw_unit(view.camera, one, stream) for view, one, stream in parts)


def _draw_unit(camera: Camera, errors: SensorErrors, rng: np.random.Generator) -> Unit:
    depth, pose, color = rng.spawn(3)
    offset = np.full(camera.size, errors.unit_bias * depth.standard_normal(), np.float32)
    offset += np.float32(errors.static_warp) * _smooth(depth, camera.size, WARP_SCALE)
    scale = float(1 + errors.thermal * depth.uniform(-1, 1))
    depth_offset = np.full(camera.size, errors.depth_bias * depth.standard_normal(), np.float32)
    depth_offset += np.float32(errors.depth_warp) * _smooth(depth, camera.size, WARP_SCALE)
    moved = errors.position_error * pose.standard_normal(3)
    turned = Rotation.from_rotvec(errors.rotation_error * pose.standard_normal(3)).as_matrix()
    if errors.position_error or errors.rotation_error:
        camera = replace(camera, pose=as_pose(camera.rotation @ turned, (camera.position + moved).tolist()))
    exposure = (1 + errors.exposure) ** color.uniform(-1, 1)
    red, blue = 1 + errors.white_balance * color.uniform(-1, 1, 2)
    gains = np.array([red * exposure, exposure, blue * exposure], np.float32)
    return Unit(errors, camera, offset, scale, depth_offset, gains)


def corrupt(
    observation: Observation, units: tuple[Unit, ...], rng: np.random.Generator, brightness: float = 1.0
) -> Observation:  # fmt: skip
    """An observation as erring cameras would give it. Depth is 0 where nothing was measured.

    Args:
        units: from `draw_units`.
        rng: draws what is new in each frame.
        brightness: how strong the lamp is; at 1 a white thing is white. Depth cameras bring their own light: whether a
            thing is dark does not depend on the lamp.

    Raises:
        ValueError: ``units`` are of other cameras, or ``brightness`` is not above 0.
    """
    if not brightness > 0:
        raise ValueError(f"brightness must be above 0, got {brightness}")
    cameras = [(view.camera.name, view.camera.size) for view in observation.views]
    drawn = [(unit.camera.name, unit.camera.size) for unit in units]
    if cameras != drawn:
        raise ValueError(f"units must be of the observation's cameras {cameras}, got {drawn}")
    parts = zip(observation.views, units, rng.spawn(len(units)), strict=True)
    return Observation(tuple(_corrupt(*part, brightness) for part in parts))


def _corrupt(view: View, unit: Unit, rng: np.random.Generator, brightness: float) -> View:
    errors = unit.errors
    noise, edges, holes, color = rng.spawn(4)
    depth = view.depth
    gray = view.rgb.mean(axis=-1) / brightness
    disparity = np.zeros_like(depth)  # pixels; 0 where the view has no depth
    np.divide(view.camera.focal * errors.baseline, depth, out=disparity, where=depth > 0)
    if _errs(errors, "disparity", "edges", "quantisation"):
        depth = _matched(disparity, unit, noise, edges)
    if any(getattr(errors, name) for name in TIME_OF_FLIGHT):
        depth = _timed(depth, gray, unit, noise)
    if _errs(errors, "holes"):
        depth = np.where(_holes(disparity, gray, unit, holes), np.float32(0), depth)
    if errors.depth_step:
        depth = (np.round(depth / errors.depth_step) * errors.depth_step).astype(np.float32)
    return View(unit.camera, _colored(view.rgb, unit, color) if _errs(errors, "color") else view.rgb, depth)


def _errs(errors: SensorErrors, *kinds: str) -> bool:
    return any(getattr(errors, name) for kind in kinds for name in KINDS[kind])


def _matched(disparity: np.ndarray, unit: Unit, noise: np.random.Generator, edges: np.random.Generator) -> np.ndarray:
    """(H, W) float32: depth (m) after the errors of matching."""
    errors = unit.errors
    disparity = _fattened(_jittered(disparity, errors.lateral_jitter, edges), errors, edges)
    valid = disparity > 0
    disparity = disparity + unit.offset
    disparity += np.float32(errors.disparity_noise) * _half_white(noise, disparity.shape)
    if errors.disparity_step:
        disparity = np.round(disparity / errors.disparity_step) * errors.disparity_step
    product = unit.camera.focal * errors.baseline
    valid &= disparity >= product / (2 * unit.camera.far)
    factor = unit.scale + errors.ripple * np.sin(2 * np.pi * disparity)
    return np.where(valid, product * factor / np.where(valid, disparity, 1), 0).astype(np.float32)


def _timed(depth: np.ndarray, gray: np.ndarray, unit: Unit, rng: np.random.Generator) -> np.ndarray:
    """(H, W) float32: depth (m) after the errors of time of flight."""
    errors = unit.errors
    sigma = errors.axial_noise + errors.axial_growth * np.maximum(depth - STRONG, 0)
    noisy = depth + unit.depth_offset + sigma * rng.standard_normal(depth.shape, np.float32)
    valid = (depth > 0) & (noisy > 0) & (gray >= errors.blind_below)
    return np.where(valid, noisy, 0).astype(np.float32)


def _jittered(disparity: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """Each pixel looks ``sigma`` pixels beside itself; across an edge it sees the one surface or the other."""
    row, col = np.indices(disparity.shape, np.float32)
    x, y = (place + np.float32(sigma) * _half_white(rng, disparity.shape) for place in (col, row))
    smooth = cv2.remap(disparity, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    nearest = cv2.remap(disparity, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    return np.where(abs(smooth - nearest) < EDGE / 4, smooth, nearest)


def _fattened(disparity: np.ndarray, errors: SensorErrors, rng: np.random.Generator) -> np.ndarray:
    """The foreground grows over the background, as matching windows make it; part of what it covers gets lost."""
    height, width = disparity.shape
    drawn = rng.integers(errors.least_fattening, errors.fattening + 1, (height // 8 + 1, width // 8 + 1))
    growth = np.kron(drawn, np.ones((8, 8), int))[:height, :width]
    grown = disparity
    for pixels in range(max(errors.least_fattening, 1), errors.fattening + 1):
        window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * pixels + 1, 2 * pixels + 1))
        grown = np.where(growth == pixels, cv2.dilate(disparity, window), grown)
    ring = (grown - disparity > EDGE) & (disparity > 0)
    fate = np.kron(rng.random((height // 2 + 1, width // 2 + 1)), np.ones((2, 2)))[:height, :width]
    between = disparity + rng.random(disparity.shape, np.float32) * (grown - disparity)
    changed = np.select([fate < errors.invalid, fate < errors.invalid + errors.mixed], [np.float32(0), between], grown)
    return np.where(ring, changed, disparity)


def _holes(disparity: np.ndarray, gray: np.ndarray, unit: Unit, rng: np.random.Generator) -> np.ndarray:
    """(H, W) bool: where the camera measures nothing, besides at edges."""
    errors = unit.errors
    share = np.full(disparity.shape, errors.dropout)
    share[gray < DARK] = max(errors.dropout, errors.dark_dropout)
    steep = _incidence(disparity, unit.camera) > STEEP
    share[steep] = np.maximum(share[steep], errors.steep_dropout)
    holes = _smooth(rng, disparity.shape, HOLE_SCALE) < ndtri(share)
    if errors.occlusion:
        holes |= _unseen_by_right(disparity) | (disparity > SEARCH)
    return holes


def _unseen_by_right(disparity: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels whose point the right imager does not see, as something hides it or it is outside.

    A hole on the left of a foreground is f B (1 / z_front - 1 / z_back) pixels wide; the band at the left f B / z.
    What is on a point's right must be so in both pictures: behind a thin pole, holes may be wider than the shadow.
    """
    right = np.arange(disparity.shape[1], dtype=np.float32) + 0.5 - disparity  # (H, W): columns in the right picture
    following = np.where(disparity > 0, right, np.inf)[:, ::-1]
    nearest = np.minimum.accumulate(following, axis=1)[:, ::-1]  # the least of a pixel and of all on its right
    hidden = np.zeros(disparity.shape, bool)
    hidden[:, :-1] = nearest[:, 1:] < right[:, :-1]
    return hidden | (right < 0)


def _incidence(disparity: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W): angle (rad) between the ray of a pixel and the normal of its surface. Disparity is linear on a plane."""
    steps = [np.diff(disparity, axis=axis, append=disparity.take([-1], axis)) for axis in (0, 1)]
    by_row, by_col = (np.where(abs(step) < EDGE, step, 0) for step in steps)
    matrix = camera.matrix
    x = (np.arange(disparity.shape[1]) + 0.5 - matrix[0, 2]) / matrix[0, 0]
    y = ((np.arange(disparity.shape[0]) + 0.5 - matrix[1, 2]) / matrix[1, 1])[:, None]
    across, along = matrix[0, 0] * by_col, matrix[1, 1] * by_row
    normal = np.sqrt(across**2 + along**2 + (disparity - x * across - y * along) ** 2)
    cosine = disparity / np.maximum(normal * np.sqrt(x**2 + y**2 + 1), 1e-12)
    return np.arccos(np.clip(cosine, -1, 1))


def _colored(rgb: np.ndarray, unit: Unit, rng: np.random.Generator) -> np.ndarray:
    """Exposure, white balance, and noise, half of whose variance at mid grey grows with the light."""
    value = rgb * unit.gains
    sigma = unit.errors.color_noise * np.sqrt(0.5 + 0.5 * value / 128)
    value = value + sigma * rng.standard_normal(rgb.shape, np.float32)
    return np.clip(np.round(value), 0, 255).astype(np.uint8)


def _half_white(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """(H, W) float32 of variance 1: half of it is white, half is blurred by `KERNEL`."""
    white = rng.standard_normal(shape, np.float32)
    return (white + _smooth(rng, shape, KERNEL)) * np.float32(math.sqrt(0.5))


def _smooth(rng: np.random.Generator, shape: tuple[int, ...], blur: float) -> np.ndarray:
    """(H, W) float32: normal noise of variance 1, blurred by a Gaussian of ``blur`` pixels."""
    cell = max(1, int(blur // 4))  # a coarser grid is as good for a wide blur, and fast
    margin = math.ceil(3 * blur / cell)
    rows, cols = (math.ceil(length / cell) for length in shape)
    kernel = cv2.getGaussianKernel(2 * margin + 1, blur / cell, cv2.CV_32F)
    noise = rng.standard_normal((rows + 2 * margin, cols + 2 * margin), np.float32)
    field = cv2.sepFilter2D(noise, -1, kernel, kernel)[margin:-margin, margin:-margin] / (kernel**2).sum()
    if cell > 1:
        field = cv2.resize(field, (cols * cell, rows * cell), interpolation=cv2.INTER_CUBIC)
    return field[: shape[0], : shape[1]]
