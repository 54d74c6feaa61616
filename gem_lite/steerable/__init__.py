"""Steerable kernels: lift to an orbit, Fourier transform over rotations, correlate, sample (A.1.2, A.8).

A kernel psi (C, h, h), h odd, is turned counter-clockwise by theta_i = 2 pi i / n, which gives its orbit
Psi_i(x) = psi(g_i^-1 x). The Fourier transform over i, ::

    c_k = 1/n sum_i Psi_i exp(-i k theta_i),    |k| <= K < n/2,

is what features are correlated with, so the response is a signal on the circle above every pixel, ::

    R_theta(v) = sum_k C_k(v) exp(i k theta),   C_k(v) = sum_w F(v + w) c_k(w),

which can be sampled at any angle. Psi is real, so ``c_-k`` is the conjugate of ``c_k`` and only k >= 0 is kept.

**What is exact, what is not.** A kernel's pixels are read as samples of a function on the disc of radius
R = (h + 1) / 2, written in polar harmonics f(r) exp(i m phi) with f a Bessel function (the modes of a
round drum), up to the highest frequency, pi a pixel, that pixels carry in *every* direction. Turning a
harmonic by theta multiplies it by exp(-i m theta): exact, for any angle, and nothing is resampled. So no
rotated kernel is ever made: one fixed linear map takes pixels to coefficients c_k, and it is kept between calls. The
part of a kernel beyond that band (a quarter of white noise on the disc, and the corners of its square) has no exact
rotation. It is left out, by least squares. After that, the only approximation is the cut at K, which the
caller chooses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from scipy.special import jn_zeros, jv

from gem_lite.steerable.correlation import correlate


def disc(size: int) -> torch.Tensor:
    """(size, size) bool: the pixels less than (size + 1) / 2 from the centre, where the `harmonics` are 0."""
    offset = torch.arange(size) - (size - 1) / 2
    return torch.hypot(offset[:, None], offset[None, :]) < (size + 1) / 2 - 1e-9


def harmonics(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The polar harmonics of a ``size`` x ``size`` kernel: orders m (D,), analysis and synthesis (D, size^2).

    Pixels @ analysis.T are a kernel's coefficients, coefficients @ synthesis its pixels; complex128.
    """
    radius = (size + 1) / 2
    offset = np.arange(size) - (size - 1) / 2
    x, y = np.meshgrid(offset, -offset)  # rows point down
    phi = np.arctan2(y, x).ravel()
    inside = disc(size).numpy().ravel()
    distances, ring = np.unique(np.hypot(x, y), return_inverse=True)
    orders: list[int] = []
    functions: list[np.ndarray] = []
    for m in range(size * size):
        wavenumbers = jn_zeros(m, size) / radius  # more than the band holds: zeros of J_m are about pi apart
        wavenumbers = wavenumbers[wavenumbers <= math.pi, None]
        if not len(wavenumbers):
            break
        radial = jv(m, wavenumbers * distances) / abs(jv(m + 1, wavenumbers * radius)) / radius
        waves = inside * radial[:, ring.ravel()] * np.exp(1j * m * phi)  # (J, size^2)
        for order, values in {-m: waves.conj(), m: waves}.items():
            orders += len(values) * [order]
            functions.append(values)
    order_of = np.array(orders)
    synthesis = np.concatenate(functions)
    # Least squares over the pixels. Quarter turns map pixels to pixels, so orders that differ by no
    # multiple of 4 are orthogonal, and each of the four classes is solved alone.
    analysis = np.zeros_like(synthesis)
    for quarter in range(4):
        chosen = order_of % 4 == quarter
        if chosen.any():
            basis = synthesis[chosen]
            analysis[chosen] = np.linalg.solve(basis.conj() @ basis.T, basis.conj())
    return order_of, analysis, synthesis


@lru_cache(maxsize=16)
@torch.inference_mode(False)  # so that training can use tensors that a decision cached
def _lift_map(
    size: int, rotations: int, frequency: int, dtype: torch.dtype, device: torch.device
) -> tuple[torch.Tensor, torch.Tensor]:
    """The harmonics that contribute to each k = 0..K: analysis and synthesis (K + 1, J, size^2), padded with 0.

    A harmonic of order m turns by exp(-i m theta), so over n rotations it contributes to k = -m modulo n.
    """
    orders, analysis, synthesis = harmonics(size)
    contributing = [np.flatnonzero((-orders) % rotations == k) for k in range(frequency + 1)]
    parts = np.zeros((2, frequency + 1, max(map(len, contributing)), size * size), dtype=complex)
    for k, chosen in enumerate(contributing):
        parts[0, k, : len(chosen)] = analysis[chosen]
        parts[1, k, : len(chosen)] = synthesis[chosen]
    return tuple(torch.from_numpy(parts).to(device, dtype))


@dataclass(frozen=True)
class SteerableKernel:
    """A lifted kernel by its Fourier coefficients: (B, K + 1, C, h, h) complex, irrep-type (A.9.3)."""

    coefficients: torch.Tensor

    @classmethod
    def lift(cls, kernel: torch.Tensor, rotations: int, frequency: int) -> SteerableKernel:
        """The Fourier transform of a kernel's orbit, by one linear map that does not make the orbit.

        Args:
            kernel: (B, C, h, h), h odd.
            rotations: n, how many turns the orbit stands for. The cost does not depend on it.
            frequency: K, below n / 2.

        Raises:
            ValueError: the kernel or the frequency is not as above.
        """
        batch, channels, size, _ = check_kernel(kernel)
        check_frequency(frequency, rotations)
        analysis, synthesis = _lift_map(size, rotations, frequency, kernel.dtype.to_complex(), kernel.device)
        pixels = kernel.reshape(batch * channels, -1).to(analysis.dtype)
        weights = analysis.flatten(0, 1) @ pixels.T  # ((K+1)*J, B*C)
        weights = weights.view(frequency + 1, -1, batch * channels)
        coefficients = weights.transpose(1, 2) @ synthesis  # (K+1, B*C, h*h)
        return cls(coefficients.view(-1, batch, channels, size, size).transpose(0, 1))

    def turned(self, angle: float) -> SteerableKernel:
        """The lift of the kernel turned by ``angle``: c_k times exp(i k angle). No pixel is resampled."""
        k = torch.arange(self.coefficients.shape[1]).to(self.coefficients)
        return SteerableKernel(self.coefficients * torch.exp(1j * k * angle)[None, :, None, None, None])

    def correlate(self, features: torch.Tensor) -> torch.Tensor:
        """Cross-correlate features (B, C, H, W) with every coefficient: C_k (B, K + 1, H, W) complex.

        One kernel (a batch of 1) serves any number of features. The coefficients are not conjugated; at the
        border the features are taken as 0.

        Raises:
            ValueError: batch or channels are not the kernel's.
        """
        return torch.complex(*self.correlate_parts(features).chunk(2, dim=1))

    def correlate_parts(self, features: torch.Tensor) -> torch.Tensor:
        """As `correlate`, (B, 2(K + 1), H, W) real: the real parts, then the imaginary parts."""
        return correlate(features, torch.cat([self.coefficients.real, self.coefficients.imag], dim=1))


def check_kernel(kernel: torch.Tensor) -> torch.Size:
    """The shape of kernels. Raises ValueError if it is not (B, C, h, h) with odd h."""
    if kernel.ndim != 4 or kernel.shape[-1] != kernel.shape[-2] or kernel.shape[-1] % 2 == 0:
        raise ValueError(f"kernel must be (B, C, h, h) with odd h, got {tuple(kernel.shape)}")
    return kernel.shape


def check_frequency(frequency: int, rotations: int) -> None:
    """Raises ValueError for a frequency that so few rotations do not have."""
    if not 0 <= frequency < rotations / 2:
        raise ValueError(f"frequency must be in [0, {rotations}/2) for {rotations} rotations, got {frequency}")
