"""Steerable kernels: lift to an orbit, Fourier transform over rotations, correlate, sample (A.1.2, A.8).

A kernel psi (C, h, h), h odd, is turned counter-clockwise by theta_i = 2 pi i / n, which gives its orbit
Psi_i(x) = psi(g_i^-1 x). The Fourier transform over i,

    c_k = 1/n sum_i Psi_i exp(-i k theta_i),    |k| <= K < n/2,

is what features are correlated with, so the response is a signal on the circle above every pixel,

    R_theta(v) = sum_k C_k(v) exp(i k theta),   C_k(v) = sum_w F(v + w) c_k(w),

which can be sampled at any angle. Psi is real, so c_-k is the conjugate of c_k and only k >= 0 is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F

from gem_lite.se2 import rotate_image


def radius(size: int) -> torch.Tensor:
    """(size, size): distance of each cell from the kernel's centre, in pixels."""
    offset = torch.arange(size) - (size - 1) / 2
    return torch.hypot(offset[:, None], offset[None, :])


def disc(size: int) -> torch.Tensor:
    """(size, size) bool: the inscribed disc, the only support that every rotation maps to itself."""
    return radius(size) <= (size - 1) / 2 + 1e-6


def orbit(kernel: torch.Tensor, rotations: int) -> torch.Tensor:
    """Turn a kernel by every g_i in C_n (Sec. A.8.4).

    Quarter turns are exact; other angles are interpolated bilinearly.

    Args:
        kernel: (B, C, h, h), h odd.
        rotations: n.

    Returns:
        (B, n, C, h, h), masked to the inscribed disc; entry i is turned counter-clockwise by 2 pi i / n.
    """
    batch, channels, height, width = _check_kernel(kernel)
    kernel = kernel * disc(height).to(kernel)
    angles = 2 * math.pi * torch.arange(rotations, dtype=kernel.dtype, device=kernel.device) / rotations
    turned = rotate_image(kernel.reshape(1, batch * channels, height, width), angles)  # (n, B*C, h, h)
    turned = turned.reshape(rotations, batch, channels, height, width).transpose(0, 1)
    return turned * disc(height).to(kernel)


def fourier(stack: torch.Tensor, frequency: int) -> torch.Tensor:
    """Fourier coefficients of an orbit over its rotation axis, c_k for k = 0..frequency.

    Terms with k > pi r cannot be carried at radius r (in pixels) and are dropped, as is every k > 0 at
    the centre, where a rotation changes nothing.

    Args:
        stack: (B, n, C, h, h), see `orbit`.
        frequency: the largest k, below n / 2.

    Returns:
        (B, frequency + 1, C, h, h) complex.
    """
    rotations, size = stack.shape[1], stack.shape[-1]
    if not 0 <= frequency < rotations / 2:
        raise ValueError(f"frequency must be in [0, {rotations}/2) for {rotations} rotations, got {frequency}")
    angles = 2 * math.pi * torch.arange(rotations, dtype=stack.dtype, device=stack.device) / rotations
    k = torch.arange(frequency + 1, dtype=stack.dtype, device=stack.device)
    phase = -k[:, None] * angles[None, :]  # (K+1, n)
    flat = stack.flatten(2).transpose(1, 2)  # (B, C*h*h, n)
    coefficients = torch.complex(flat @ phase.cos().T, flat @ phase.sin().T) / rotations  # (B, C*h*h, K+1)
    coefficients = coefficients.transpose(1, 2).unflatten(2, stack.shape[2:])
    carried = k[:, None, None] <= math.pi * radius(size).to(stack)  # (K+1, h, h)
    return coefficients * carried[:, None]


@dataclass(frozen=True)
class SteerableKernel:
    """A lifted kernel by its Fourier coefficients: (B, K + 1, C, h, h) complex, irrep-type (A.9.3)."""

    coefficients: torch.Tensor

    @classmethod
    def lift(cls, kernel: torch.Tensor, rotations: int, frequency: int) -> SteerableKernel:
        """Rotate ``kernel`` (B, C, h, h) ``rotations`` times and Fourier transform the orbit."""
        return cls(fourier(orbit(kernel, rotations), frequency))

    def turned(self, angle: float) -> SteerableKernel:
        """The lift of the kernel turned by ``angle``: c_k times exp(i k angle), in no pixel's way."""
        k = torch.arange(self.coefficients.shape[1], device=self.coefficients.device)
        return SteerableKernel(self.coefficients * torch.exp(1j * k * angle)[None, :, None, None, None])

    def correlate(self, features: torch.Tensor) -> torch.Tensor:
        """Cross-correlate features (B, C, H, W) with every coefficient: C_k (B, K + 1, H, W) complex.

        The coefficients are not conjugated; at the border the features are taken as 0.
        """
        batch, terms, channels, size, _ = self.coefficients.shape
        if features.ndim != 4 or features.shape[:2] != (batch, channels):
            raise ValueError(f"features must be ({batch}, {channels}, H, W), got {tuple(features.shape)}")
        real, imaginary = self.coefficients.real, self.coefficients.imag[:, 1:]
        weight = torch.cat([real, imaginary], dim=1).flatten(0, 1)  # (B*(2K+1), C, h, h)
        out = F.conv2d(features.flatten(0, 1)[None], weight, padding=size // 2, groups=batch)
        out = out.view(batch, 2 * terms - 1, *features.shape[-2:])
        return torch.complex(out[:, :terms], torch.cat([torch.zeros_like(out[:, :1]), out[:, terms:]], dim=1))


def sample(response: torch.Tensor, angles: torch.Tensor) -> torch.Tensor:
    """Inverse Fourier transform: R_theta = sum over k of C_k exp(i k theta), at any angles.

    Args:
        response: C_k for k >= 0, (B, K + 1, H, W) complex.
        angles: (R,) radians.

    Returns:
        (B, R, H, W) real.
    """
    batch, terms, height, width = response.shape
    k = torch.arange(terms, dtype=angles.dtype, device=response.device)
    phase = angles.to(response.device)[:, None] * k[None, :]
    double = torch.where(k == 0, 1.0, 2.0)  # k and -k are conjugates
    basis = torch.cat([double * phase.cos(), -double * phase.sin()], dim=1).to(response.real)  # (R, 2(K+1))
    flat = torch.cat([response.real, response.imag], dim=1).flatten(2)  # (B, 2(K+1), H*W)
    return (basis @ flat).view(batch, len(angles), height, width)


def _check_kernel(kernel: torch.Tensor) -> torch.Size:
    if kernel.ndim != 4 or kernel.shape[-1] != kernel.shape[-2] or kernel.shape[-1] % 2 == 0:
        raise ValueError(f"kernel must be (B, C, h, h) with odd h, got {tuple(kernel.shape)}")
    return kernel.shape
