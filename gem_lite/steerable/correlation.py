"""Correlation of features with kernels by FFT, and sampling of its response at any angle (Eq. 4, A.8)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import torch
import torch.nn.functional as F
from scipy.fft import next_fast_len

BLOCK = 2**19
"""The most complex numbers in one block of windows: small enough for a core's cache."""


def correlate(features: torch.Tensor, kernels: torch.Tensor) -> torch.Tensor:
    """Cross-correlate with plain real kernels, which belong to no orbit. The border is that of `SteerableKernel`.

    Args:
        features: (B, C, H, W).
        kernels: (B, N, C, h, h), h odd; or (1, N, C, h, h) for all features.

    Returns:
        (B, N, H, W).

    Raises:
        ValueError: batch or channels are not the kernels'.
    """
    _check_features(features, kernels)
    return _Correlate.apply(features.contiguous(), kernels)


def continued(correlation: Callable[[torch.Tensor], torch.Tensor], features: torch.Tensor, reach: int) -> torch.Tensor:
    """The response (B, N, H, W) of features (B, C, H, W) that go on beyond their border as they are at the border.

    With zeros there, a response at a corner is the sum over a quarter of the kernel. Where all responses inside are
    negative, it is nearer to zero than they are, so that the corner wins.

    Args:
        correlation: from features to responses of the same height and width.
        reach: of the kernel: half of its size (pixels); 0 continues nothing.
    """
    if reach == 0:
        return correlation(features)
    padded = F.pad(features, (reach,) * 4, mode="replicate")
    return correlation(padded)[..., reach:-reach, reach:-reach]


class _Correlate(torch.autograd.Function):
    """R_n(v) = sum_w F(v + w) k_n(w): by Fourier transform along a picture's columns, by plain sums along its rows.

    For each frequency omega along y, R^_n(omega, x) = sum over c and j of k^_n(omega, c, j) F^_c(omega, x + j): a
    product of two small matrices. For small kernels, this is faster than transforms in two dimensions, where a kernel's
    spectrum is as large as the picture.

    The derivatives are written out: torch would keep the matrices of all features until the backward pass, while here
    they are made twice, one block at a time.
    """

    @staticmethod
    def forward(ctx: Any, features: torch.Tensor, kernels: torch.Tensor) -> torch.Tensor:  # noqa: ANN401
        ctx.save_for_backward(features, kernels)
        plan = _Plan(features, kernels)
        matrices = plan.kernel_spectra(kernels)
        spectra = plan.feature_spectra(features)
        response = spectra.new_empty(*spectra.shape[:2], kernels.shape[1], plan.width)
        for member, block in plan.blocks:
            torch.bmm(matrices[member, block], plan.windows(spectra[member, block]), out=response[member, block])
        return torch.fft.irfft(response, plan.period, dim=1)[:, : plan.height].movedim(1, 2)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(
        ctx: Any,  # noqa: ANN401 (torch gives it no type that knows its tensors)
        grad: torch.Tensor,
    ) -> tuple[torch.Tensor | None, torch.Tensor | None]:
        features, kernels = ctx.saved_tensors
        plan = _Plan(features, kernels)
        grads = torch.fft.rfft(grad.movedim(2, 1), plan.period, dim=1).contiguous()  # (B, P', N, W)
        features_grad = plan.features_grad(kernels, grads) if ctx.needs_input_grad[0] else None
        kernels_grad = plan.kernels_grad(features, grads, kernels.shape) if ctx.needs_input_grad[1] else None
        return features_grad, kernels_grad


class _Plan:
    """The transforms of one correlation of features (B, C, H, W) with kernels (B, N, C, h, h).

    The period P is fast for the FFT, and so long that a kernel at one border does not reach the other border.
    P' = P // 2 + 1 frequencies are kept: the others are conjugates, because features and kernels are real.

    Attributes:
        blocks: a member of the batch and consecutive frequencies, so many that their windows fit `BLOCK`.
    """

    def __init__(self, features: torch.Tensor, kernels: torch.Tensor) -> None:
        self.batch, channels, self.height, self.width = features.shape
        self.size = kernels.shape[-1]
        self.half = self.size // 2
        self.period = next_fast_len(self.height + self.half)
        self.frequencies = self.period // 2 + 1
        step = max(1, BLOCK // (channels * self.size * self.width))
        starts = range(0, self.frequencies, step)
        self.blocks = [(member, slice(start, start + step)) for member in range(self.batch) for start in starts]

    def feature_spectra(self, features: torch.Tensor) -> torch.Tensor:
        """(B, P', C, W + 2 (h // 2)): the features' spectra along y, with zeros on both sides."""
        return torch.fft.rfft(F.pad(features, (self.half, self.half)).movedim(2, 1), self.period, dim=1)

    def windows(self, spectra: torch.Tensor) -> torch.Tensor:
        """The matrices (k, C h, W) of k frequencies: the spectra shifted by each lag along x."""
        return spectra.unfold(-1, self.width, 1).flatten(1, 2)

    def kernel_spectra(self, kernels: torch.Tensor) -> torch.Tensor:
        """The matrices (B, P', N, C h): the kernels' spectra along y, conjugated: correlation mirrors a kernel."""
        rows = kernels.movedim(3, 1).flatten(2)  # (B, h, N C h)
        waves = self._waves(kernels)
        spectra = torch.complex(waves.real @ rows, waves.imag @ rows)
        return spectra.unflatten(2, (kernels.shape[1], -1)).expand(self.batch, -1, -1, -1)

    def features_grad(self, kernels: torch.Tensor, grads: torch.Tensor) -> torch.Tensor:
        """The features' gradient from the response's gradient, given by its spectra (B, P', N, W)."""
        matrices = self.kernel_spectra(kernels)
        total = grads.new_zeros(*grads.shape[:2], kernels.shape[2], self.width + 2 * self.half)
        for member, block in self.blocks:
            windows = (matrices[member, block].mH @ grads[member, block]).unflatten(1, (-1, self.size))
            for lag in range(self.size):
                total[member, block, :, lag : lag + self.width] += windows[:, :, lag]
        rows = torch.fft.irfft(total, self.period, dim=1)[:, : self.height]
        return rows[..., self.half : self.half + self.width].movedim(1, 2)

    def kernels_grad(self, features: torch.Tensor, grads: torch.Tensor, shape: torch.Size) -> torch.Tensor:
        """As `features_grad`, the gradient of kernels of a ``shape``."""
        spectra = self.feature_spectra(features)
        products = grads.new_empty(*grads.shape[:2], shape[2] * self.size, shape[1])
        for member, block in self.blocks:
            torch.bmm(self.windows(spectra[member, block]), grads[member, block].mH, out=products[member, block])
        waves = self._waves(features).T / self.period  # (h, P')
        waves[:, 1 : (self.period + 1) // 2] *= 2  # These frequencies stand for their conjugates, too.
        flat = products.flatten(2)
        rows = waves.real @ flat.real - waves.imag @ flat.imag  # (B, h, C h N)
        return rows.unflatten(2, (-1, self.size, shape[1])).permute(0, 4, 2, 1, 3).sum_to_size(shape)

    def _waves(self, like: torch.Tensor) -> torch.Tensor:
        """(P', h): exp(i omega y) for each frequency and each lag along y."""
        lags = torch.arange(-self.half, self.half + 1, device=like.device)
        turns = torch.arange(self.frequencies, device=like.device)[:, None] * lags % self.period
        angles = turns.to(like.dtype) * (2 * math.pi / self.period)
        return torch.polar(torch.ones_like(angles), angles)


def sample_parts(parts: torch.Tensor, angles: torch.Tensor) -> torch.Tensor:
    """Inverse Fourier transform: R_theta = sum over k of C_k exp(i k theta), at any angles.

    Args:
        parts: the response C_k for k >= 0 of `SteerableKernel.correlate_parts`, (B, 2(K + 1), H, W).
        angles: (R,) radians.

    Returns:
        (B, R, H, W).
    """
    basis = sampling_matrix(parts.shape[1] // 2, angles).to(parts)  # (R, 2(K+1))
    return (basis @ parts.flatten(2)).unflatten(2, parts.shape[2:])


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
