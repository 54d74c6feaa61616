"""Kernels turned one by one, the Fourier transform of their orbit, and where their response is largest.

The library makes no orbit: `SteerableKernel.lift` gets the coefficients of an orbit from a kernel by one linear map.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch

from gem_lite.se2 import angle_bins
from gem_lite.steerable import check_frequency, check_kernel, harmonics
from gem_lite.steerable.correlation import sample_parts, sampling_matrix

ROUNDING = 1e-5
"""A sum of float32 numbers is wrong by less than this share of the sum of their sizes."""


@lru_cache(maxsize=6)
@torch.inference_mode(False)  # so that training can use tensors that a decision cached
def _turning(size: int, dtype: torch.dtype, device: torch.device) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """`harmonics` as tensors, the orders real and the rest complex."""
    orders, analysis, synthesis = (torch.from_numpy(part).to(device) for part in harmonics(size))
    return orders.to(dtype.to_real()), analysis.to(dtype), synthesis.to(dtype)


def turn(kernel: torch.Tensor, angles: torch.Tensor) -> torch.Tensor:
    """Turn kernels counter-clockwise about their centre, exactly within the band (T_g of Eq. 7, rho = 1).

    Args:
        kernel: (B, C, h, h), h odd.
        angles: (n,) radians.

    Returns:
        (B, n, C, h, h), zero outside `disc`.
    """
    size = check_kernel(kernel)[-1]
    orders, analysis, synthesis = _turning(size, kernel.dtype.to_complex(), kernel.device)
    coefficients = kernel.flatten(2).to(analysis.dtype) @ analysis.T  # (B, C, D)
    phases = torch.exp(-1j * orders * angles.to(orders)[:, None])  # (n, D)
    turned = (coefficients[:, None] * phases[:, None]) @ synthesis  # (B, n, C, h*h)
    return turned.real.unflatten(-1, (size, size))


def band_limited(kernel: torch.Tensor) -> torch.Tensor:
    """The part of a kernel (B, C, h, h) that can be turned: its least-squares fit by polar harmonics."""
    return turn(kernel, torch.zeros(1, device=kernel.device))[:, 0]


def orbit(kernel: torch.Tensor, rotations: int) -> torch.Tensor:
    """Turn a kernel by every g_i in C_n (Sec. A.8.4): the lift L(psi) of A.9.3, made explicitly.

    Args:
        kernel: (B, C, h, h), h odd.
        rotations: n.

    Returns:
        (B, n, C, h, h); entry i is turned counter-clockwise by 2 pi i / n.
    """
    return turn(kernel, torch.from_numpy(angle_bins(rotations)).to(kernel.device))


def fourier(stack: torch.Tensor, frequency: int) -> torch.Tensor:
    """Fourier coefficients of an orbit over its rotation axis, c_k for k = 0..frequency.

    Args:
        stack: (B, n, C, h, h), see `orbit`.
        frequency: the largest k, below n / 2.

    Returns:
        (B, frequency + 1, C, h, h) complex.
    """
    check_frequency(frequency, stack.shape[1])
    return torch.fft.fft(stack, dim=1, norm="forward")[:, : frequency + 1]


def sample(response: torch.Tensor, angles: torch.Tensor) -> torch.Tensor:
    """The values (B, R, H, W) of a response (B, K + 1, H, W) complex at angles (R,), see `sample_parts`."""
    return sample_parts(torch.cat([response.real, response.imag], dim=1), angles)


def peak(response: torch.Tensor, angles: torch.Tensor) -> tuple[int, int, int]:
    """The largest of all samples, as (angle, row, col). Pixels where it cannot be are not sampled.

    At every pixel the signal is at most ``C_0 + 2 sum of |C_k|``. So only pixels whose bound reaches the best value
    so far are sampled. The result is that of ``sample(...).argmax()``. Where all waves have their crest at one angle,
    the signal reaches its bound, and rounding may lift it above.

    Args:
        response: (K + 1, H, W) complex, of one scene.
        angles: (R,) radians.
    """
    terms, _, width = response.shape
    flat = response.flatten(1)  # (K+1, H*W)
    size = flat.abs()
    bound = flat[0].real + 2 * size[1:].sum(dim=0) + ROUNDING * size.sum(dim=0)
    basis = sampling_matrix(terms, angles).to(bound)

    def best(pixels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        chosen = flat[:, pixels]
        values, indices = (basis @ torch.cat([chosen.real, chosen.imag])).max(dim=0)
        largest = values.argmax()
        return values[largest], indices[largest], pixels[largest]

    winner = best(bound.topk(min(64, len(bound))).indices)
    for pixels in (bound >= winner[0]).nonzero()[:, 0].split(2048):
        winner = max(winner, best(pixels), key=lambda triple: float(triple[0]))
    _, angle, pixel = winner
    return int(angle), *divmod(int(pixel), width)


def best_angle(response: torch.Tensor) -> torch.Tensor:
    """The angle at which sum over k of C_k exp(i k theta) is largest; it need not be an angle bin.

    The best of 16 (K + 1) samples is refined by Newton's method. A constant signal gives 0.

    Args:
        response: (..., K + 1) complex, the coefficients above one or more pixels.

    Returns:
        (...) radians in [0, 2 pi).
    """
    terms = response.shape[-1]
    k = torch.arange(terms).to(response.real)
    coarse = 2 * math.pi * torch.arange(16 * terms, device=response.device).to(response.real) / (16 * terms)
    values = torch.cat([response.real, response.imag], dim=-1) @ sampling_matrix(terms, coarse).T  # (..., 16(K+1))
    angle = coarse[values.argmax(dim=-1)]
    for _ in range(4):
        wave = response * torch.exp(1j * k * angle[..., None])
        slope = -(k * wave.imag).sum(dim=-1)
        curvature = -(k**2 * wave.real).sum(dim=-1)
        step = torch.where(curvature < 0, -slope / curvature, 0.0)
        angle = angle + step.clamp(-math.pi / (16 * terms), math.pi / (16 * terms))
    return angle % (2 * math.pi)
