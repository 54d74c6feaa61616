"""The equations of A.8 and A.9, checked by running them: every function returns one error per group element.

Entry j of a result belongs to g_j in C_n, the counter-clockwise turn by theta_j = 2 pi j / n. An error is
relative, ``|difference| / |reference|`` in the Euclidean norm, inside the disc that every rotation keeps: the
corners of a square leave and enter as it turns. How a picture is turned is an argument, since on a grid
of pixels there are several ways, and only quarter turns are exact in all of them: `by_pixels` (quarter turns
exact, others interpolated), or `by_harmonics` (exact at any angle for band-limited pictures).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from orbits import fourier, orbit, turn

from gem_lite.se2 import angle_bins, rotate_image
from gem_lite.steerable import disc

Turn = Callable[[torch.Tensor, float], torch.Tensor]
"""T_g of Eq. 7 on a scalar picture: (B, C, S, S) and radians to the same shape, turned counter-clockwise."""
Generate = Callable[[torch.Tensor], torch.Tensor]
"""A kernel generator: crop (1, C', h, h) to kernel (1, C, h, h)."""
Respond = Callable[[torch.Tensor], torch.Tensor]
"""A pick's scores: features (1, C, S, S) to logits (1, n, S, S), one channel for each g_i."""
RespondToCrop = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
"""A place's scores: features (1, C, S, S) and crop (1, C', h, h) to logits (1, n, S, S)."""


def by_pixels(picture: torch.Tensor, angle: float, mode: str = "bicubic") -> torch.Tensor:
    """Turn a picture (B, C, S, S): multiples of 90 degrees by moving pixels, others by interpolation."""
    quarters = _quarters(angle)
    if quarters is not None:
        return torch.rot90(picture, quarters, dims=(-2, -1))
    return rotate_image(picture, torch.tensor([angle]), mode=mode)


def by_harmonics(picture: torch.Tensor, angle: float) -> torch.Tensor:
    """Turn a picture (B, C, S, S), S odd: its band-limited part, without interpolation; see `orbits.turn`."""
    quarters = _quarters(angle)
    if quarters is not None:
        return torch.rot90(picture, quarters, dims=(-2, -1))
    return turn(picture, torch.tensor([angle], dtype=picture.dtype))[:, 0]


def _quarters(angle: float) -> int | None:
    """How many quarter turns ``angle`` is, None if it is no multiple of one."""
    count = round(angle / (math.pi / 2))
    return count if math.isclose(angle, count * math.pi / 2, abs_tol=1e-9) else None


def regular(stack: torch.Tensor, j: int) -> torch.Tensor:
    """rho_reg(g_j) of A.8.1 on channels in dimension 1 of (B, n, ...): (x_0, x_1, ...) moves on by j places."""
    return stack.roll(j, dims=1)


def irreducible(coefficients: torch.Tensor, angle: float) -> torch.Tensor:
    """rho_irrep(g) on Fourier coefficients in dimension 1 of (B, K + 1, ...): c_k times exp(-i k angle).

    It is what `regular` becomes after a Fourier transform: a shift is a phase.
    """
    k = torch.arange(coefficients.shape[1]).to(coefficients)
    return coefficients * torch.exp(-1j * k * angle).view(1, -1, *(1,) * (coefficients.ndim - 2))


def relative_error(actual: torch.Tensor, expected: torch.Tensor) -> float:
    """``|actual - expected| / |expected|`` inside the disc of the last two dimensions (S, S)."""
    mask = disc(expected.shape[-1]).to(expected.device)
    difference = (actual - expected).detach()[..., mask]
    reference = expected.detach()[..., mask]
    return float(torch.linalg.vector_norm(difference) / torch.linalg.vector_norm(reference))


def steerability_errors(stack: torch.Tensor, turn_by: Turn = by_pixels) -> np.ndarray:
    """Eq. 8 with trivial input: Psi(g x) = rho_reg(g) Psi(x), for a stack (1, n, C, h, h).

    Psi(g x), read at turned positions, is the picture of Psi turned by the inverse of g.
    """
    return _errors(stack.shape[1], lambda j, angle: (turn_by(stack[0], -angle)[None], regular(stack, j)))


def lemma_1_errors(stack: torch.Tensor, turn_by: Turn = by_pixels) -> np.ndarray:
    """Lemma 1: T_g Psi = rho_reg(g^-1) Psi, for a stack (1, n, C, h, h)."""
    return _errors(stack.shape[1], lambda j, angle: (turn_by(stack[0], angle)[None], regular(stack, -j)))


def lemma_2_errors(
    kernel: torch.Tensor, features: torch.Tensor, rotations: int, turn_by: Turn = by_pixels
) -> np.ndarray:
    """Lemma 2, Eq. 13: T_g (K ⋆ f) = (T_g K) ⋆ (T_g f), for a kernel (1, C, h, h) and features (1, C, S, S)."""

    def correlate(k: torch.Tensor, f: torch.Tensor) -> torch.Tensor:
        return F.conv2d(f, k, padding=k.shape[-1] // 2)  # torch's convolution is a cross-correlation

    plain = correlate(kernel, features)
    return _errors(
        rotations,
        lambda _, angle: (correlate(turn_by(kernel, angle), turn_by(features, angle)), turn_by(plain, angle)),
    )


def lift_errors(kernel: torch.Tensor, rotations: int, turn_by: Turn = by_pixels) -> np.ndarray:
    """A.9.3: L(T_g psi) = rho_reg(g^-1) L(psi), the lift of a turned kernel (1, C, h, h) is a shifted stack."""
    stack = orbit(kernel, rotations)
    return _errors(rotations, lambda j, angle: (orbit(turn_by(kernel, angle), rotations), regular(stack, -j)))


def irrep_errors(kernel: torch.Tensor, rotations: int, frequency: int, turn_by: Turn = by_pixels) -> np.ndarray:
    """A.9.3, after the Fourier transform: c(g x) = rho_irrep(g) c(x), a multiplication and no permutation."""
    coefficients = fourier(orbit(kernel, rotations), frequency)

    def pair(_: int, angle: float) -> tuple[torch.Tensor, torch.Tensor]:
        read_at_turned = torch.complex(turn_by(coefficients[0].real, -angle), turn_by(coefficients[0].imag, -angle))
        return read_at_turned[None], irreducible(coefficients, angle)

    return _errors(rotations, pair)


def proposition_1_errors(
    respond: Respond, features: torch.Tensor, rotations: int, turn_by: Turn = by_pixels
) -> np.ndarray:
    """Proposition 1: kappa ⋆ T_g phi = T_g [rho_out(g) kappa ⋆ phi], the whole scene turns.

    The scores move with the scene, and above every pixel they shift by g: so does the best angle.
    """
    plain = respond(features)
    return _errors(rotations, lambda j, angle: (respond(turn_by(features, angle)), turn_by(regular(plain, j), angle)))


def local_errors(
    respond: Respond,
    background: torch.Tensor,
    item: torch.Tensor,
    start: tuple[int, int],
    goal: tuple[int, int],
    rotations: int,
    turn_by: Turn = by_pixels,
) -> np.ndarray:
    """Eq. 5: one object moves by g in SE(2) while the others stay, and its scores move with it.

    Args:
        respond: scores, see `Respond`; the scene need not be square here.
        background: (1, C, H, W), everything that stays.
        item: (1, C, s, s), the object that moves, s odd, added to the background.
        start, goal: pixels (row, col) of its centre before and after.
        rotations: n.
    """
    size = item.shape[-1]

    def scores(picture: torch.Tensor, centre: tuple[int, int]) -> torch.Tensor:
        rows, cols = (slice(c - size // 2, c + size // 2 + 1) for c in centre)
        scene = background.clone()
        scene[..., rows, cols] += picture
        return respond(scene)[..., rows, cols]

    plain = scores(item, start)
    return _errors(rotations, lambda j, angle: (scores(turn_by(item, angle), goal), turn_by(regular(plain, j), angle)))


def generator_errors(generate: Generate, crop: torch.Tensor, rotations: int, turn_by: Turn = by_pixels) -> np.ndarray:
    """psi(T_g c) = T_g psi(c) (Fig. A3): a turned crop (1, C', h, h) gives the turned kernel."""
    plain = generate(crop)
    return _errors(rotations, lambda _, angle: (generate(turn_by(crop, angle)), turn_by(plain, angle)))


def bi_equivariance_errors(
    respond: RespondToCrop, features: torch.Tensor, crop: torch.Tensor, rotations: int, turn_by: Turn = by_pixels
) -> np.ndarray:
    """Eq. 6: turning the goal by g_1 and the picked object by g_2 turns the place by g_1 and Delta by g_1 g_2^-1.

    Returns:
        (n, n): row j1 is g_1, column j2 is g_2.
    """
    plain = respond(features, crop)

    def row(j1: int, first: float) -> np.ndarray:
        return _errors(
            rotations,
            lambda j2, second: (
                respond(turn_by(features, first), turn_by(crop, second)),
                turn_by(regular(plain, j1 - j2), first),
            ),
        )

    return np.stack([row(j, angle) for j, angle in enumerate(angle_bins(rotations).tolist())])


def _errors(rotations: int, pair: Callable[[int, float], tuple[torch.Tensor, torch.Tensor]]) -> np.ndarray:
    """For every g_j, the error of the actual against the expected tensor of ``pair(j, theta_j)``."""
    with torch.no_grad():
        return np.array([relative_error(*pair(j, angle)) for j, angle in enumerate(angle_bins(rotations).tolist())])
