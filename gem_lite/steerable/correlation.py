"""Correlation of features with kernels by FFT, and sampling of its response at any angle (Eq. 4, A.8)."""

from __future__ import annotations

import math
from typing import Any

import torch
from scipy.fft import next_fast_len

BLOCK = 2**18
"""The most complex numbers in one block of kernels' spectra: small enough for a core's cache."""


def correlate(features: torch.Tensor, kernels: torch.Tensor) -> torch.Tensor:
    """Cross-correlate with plain real kernels, which belong to no orbit. The border is that of `SteerableKernel`.

    Two kernels are transformed as the real and the imaginary part of one, which halves the transforms.

    Args:
        features: (B, C, H, W).
        kernels: (B, N, C, h, h), h odd; or (1, N, C, h, h) for all features.

    Returns:
        (B, N, H, W).

    Raises:
        ValueError: batch or channels are not the kernels'.
    """
    _check_features(features, kernels)
    count = kernels.shape[1]
    pairs = torch.cat([kernels, torch.zeros_like(kernels[:, : count % 2])], dim=1)
    response = _Correlate.apply(features.contiguous(), torch.complex(pairs[:, 0::2], pairs[:, 1::2]))
    return torch.stack([response.real, response.imag], dim=2).flatten(1, 2)[:, :count]


def correlate_coefficients(features: torch.Tensor, coefficients: torch.Tensor) -> torch.Tensor:
    """`correlate` with the Fourier coefficients of a lifted kernel, (B, K+1, C, h, h) complex: (B, K+1, H, W)."""
    _check_features(features, coefficients)
    # Contiguous: with channels last, the Fourier transforms of one scene and of two are rounded differently.
    return _Correlate.apply(features.contiguous(), coefficients)


class _Correlate(torch.autograd.Function):
    """C_k(v) = sum_w F(v + w) c_k(w) by FFT: C^_k(omega) = F^(omega) c^_k(-omega).

    The derivatives are written out: torch would keep every kernel's spectrum until the backward pass, while here a
    spectrum is kept for one block of frequencies only. Mirrored kernels have their corner, not their centre, at pixel
    (0, 0), so the results are shifted by h // 2.
    """

    @staticmethod
    def forward(ctx: Any, features: torch.Tensor, coefficients: torch.Tensor) -> torch.Tensor:  # noqa: ANN401
        ctx.save_for_backward(features, coefficients)
        height, width = features.shape[-2:]
        half = coefficients.shape[-1] // 2
        shape = _padded_shape(features, half)
        spectrum = torch.fft.fft2(features, shape)[:, None]  # (B, 1, C, P, Q)
        out = coefficients.new_empty(len(features), coefficients.shape[1], height, width)
        for block in _blocks(features, coefficients, shape):
            product = (spectrum * _mirrored_spectrum(coefficients[:, block], shape)).sum(dim=2)
            out[:, block] = torch.fft.ifft2(product)[..., half : half + height, half : half + width]
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(
        ctx: Any,  # noqa: ANN401 (torch gives it no type that knows its tensors)
        grad: torch.Tensor,
    ) -> tuple[torch.Tensor | None, torch.Tensor | None]:
        features, coefficients = ctx.saved_tensors
        height, width = features.shape[-2:]
        half = coefficients.shape[-1] // 2
        shape = _padded_shape(features, half)
        spectrum = torch.fft.fft2(features, shape).conj()[:, None]
        lags = torch.arange(-half, half + 1, device=features.device)
        features_grad: torch.Tensor | None = None
        coefficients_grad: torch.Tensor | None = None
        if ctx.needs_input_grad[0]:
            total = spectrum.new_zeros(spectrum[:, 0].shape)
        if ctx.needs_input_grad[1]:
            coefficients_grad = torch.empty_like(coefficients)
        for block in _blocks(features, coefficients, shape):
            grads = torch.fft.fft2(grad[:, block], shape)[:, :, None]  # (B, k, 1, P, Q)
            if ctx.needs_input_grad[0]:
                total += (_mirrored_spectrum(coefficients[:, block], shape).conj() * grads).sum(dim=1)
            if coefficients_grad is not None:
                rows = torch.fft.ifft(spectrum * grads, dim=-2)[..., lags, :]
                each = torch.fft.ifft(rows)[..., lags].flip(-2, -1)
                coefficients_grad[:, block] = each.sum_to_size(coefficients[:, block].shape)
        if ctx.needs_input_grad[0]:
            features_grad = torch.fft.ifft2(total).real.roll((half, half), (-2, -1))[..., :height, :width]
        return features_grad, coefficients_grad


def _padded_shape(features: torch.Tensor, half: int) -> tuple[int, int]:
    """A fast size for the FFT at which a kernel at one border does not reach the opposite border."""
    height, width = features.shape[-2:]
    return next_fast_len(height + half), next_fast_len(width + half)


def _blocks(features: torch.Tensor, coefficients: torch.Tensor, shape: tuple[int, int]) -> list[slice]:
    """Consecutive frequencies, so many at once that their spectra fit `BLOCK`."""
    terms = coefficients.shape[1]
    step = max(1, BLOCK // (math.prod(features.shape[:2]) * math.prod(shape)))
    return [slice(start, start + step) for start in range(0, terms, step)]


def _mirrored_spectrum(kernels: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Spectrum of kernels (..., h, h) mirrored in their centre; rows that are all 0 are not transformed."""
    return torch.fft.fft(torch.fft.fft(kernels.flip(-2, -1), shape[1]), shape[0], dim=-2)


def sample(response: torch.Tensor, angles: torch.Tensor) -> torch.Tensor:
    """Inverse Fourier transform: R_theta = sum over k of C_k exp(i k theta), at any angles.

    Args:
        response: C_k for k >= 0, (B, K + 1, H, W) complex.
        angles: (R,) radians.

    Returns:
        (B, R, H, W) real.
    """
    batch, terms, height, width = response.shape
    basis = sampling_matrix(terms, angles).to(response.real)  # (R, 2(K+1))
    flat = torch.cat([response.real, response.imag], dim=1).flatten(2)  # (B, 2(K+1), H*W)
    return (basis @ flat).view(batch, len(angles), height, width)


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


def sampling_matrix(terms: int, angles: torch.Tensor) -> torch.Tensor:
    """The matrix (R, 2(K + 1)) from the real parts, then the imaginary parts of C_k to the values at ``angles``."""
    k = torch.arange(terms, dtype=angles.dtype, device=angles.device)
    phase = angles[:, None] * k
    double = torch.where(k == 0, 1.0, 2.0)  # k and -k are conjugates
    return torch.cat([double * phase.cos(), -double * phase.sin()], dim=1)


def _check_features(features: torch.Tensor, kernels: torch.Tensor) -> None:
    batch, _, channels, _, _ = kernels.shape
    if features.ndim != 4 or features.shape[1] != channels or batch not in (1, len(features)):
        expected = "B" if batch == 1 else batch
        raise ValueError(f"features must be ({expected}, {channels}, H, W), got {tuple(features.shape)}")
