"""Where the response of a kernel is largest: the best of given angles over all pixels, and the best of all angles."""

from __future__ import annotations

import math

import torch

from gem_lite.steerable.correlation import sampling_matrix


def peak(response: torch.Tensor, angles: torch.Tensor) -> tuple[int, int, int]:
    """The largest of all samples, as (angle, row, col). Pixels where it cannot be are not sampled.

    At every pixel the signal is at most ``C_0 + 2 sum of |C_k|``. So only pixels whose bound reaches the best value
    so far are sampled. The result is that of ``sample(...).argmax()``.

    Args:
        response: (K + 1, H, W) complex, of one scene.
        angles: (R,) radians.
    """
    terms, _, width = response.shape
    flat = response.flatten(1)  # (K+1, H*W)
    bound = flat[0].real + 2 * flat[1:].abs().sum(dim=0)
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
