"""Cross-entropy over all pixels and angles, from Fourier coefficients: the logits are never stored all at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from gem_lite.steerable.correlation import sampling_matrix

PIXELS = 1024
"""The pixels in one block: its logits at all angles fit into a core's cache."""
LOWEST = -40.0
"""Lower differences of logits are raised to this value. Their exponentials are too small to change a sum in single
precision, and arithmetic with numbers that nearly underflow is ten times slower."""


def sampled_cross_entropy(
    response: torch.Tensor, angles: torch.Tensor, cells: Sequence[tuple[list[int], int, int]]
) -> torch.Tensor:
    """Mean cross-entropy of ``sample(response, angles)``, a distribution over pixels and angles.

    The logits of a `lite` step are 7 MB, and their cross-entropy reads and writes them ten times. Here, they are made
    for one block of pixels at a time, and once more for the gradient.

    Args:
        response: C_k for k >= 0, (B, K + 1, H, W) complex.
        angles: (R,) radians.
        cells: for each member of the batch, its label: equally right angle bins, and a pixel (row, col).

    Returns:
        A number.
    """
    width = response.shape[-1]
    basis = sampling_matrix(response.shape[1], angles).to(response.real)  # (R, 2(K+1))
    right = torch.stack([basis[bins].mean(dim=0) for bins, _, _ in cells])  # (B, 2(K+1)): a mean logit is linear
    pixels = [row * width + col for _, row, col in cells]
    return _SampledCrossEntropy.apply(response, basis, right, pixels).mean()


class _SampledCrossEntropy(torch.autograd.Function):
    """log sum exp of all logits, minus the mean of the right logits; (B,)."""

    @staticmethod
    def forward(
        ctx: Any, response: torch.Tensor, basis: torch.Tensor, right: torch.Tensor, pixels: Sequence[int]  # noqa: ANN401
    ) -> torch.Tensor:  # fmt: skip
        flat = torch.view_as_real(response.resolve_conj()).flatten(2, 3)  # (B, K+1, H*W, 2)
        totals = []
        right_logits = []
        for number, pixel in enumerate(pixels):
            sums = []
            for block in flat[number].split(PIXELS, dim=1):
                logits = basis @ _columns(block)  # (R, pixels)
                highest = logits.max()
                exponentials = (logits - highest).clamp_(min=LOWEST).exp_()
                sums.append(highest + exponentials.sum().log())
            totals.append(torch.stack(sums).logsumexp(dim=0))
            right_logits.append(right[number] @ _columns(flat[number, :, pixel : pixel + 1])[:, 0])
        total = torch.stack(totals)
        ctx.save_for_backward(response, basis, right, total)
        ctx.pixels = pixels
        return total - torch.stack(right_logits)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(
        ctx: Any,  # noqa: ANN401 (torch gives it no type that knows its tensors)
        grad: torch.Tensor,
    ) -> tuple[torch.Tensor, None, None, None]:
        response, basis, right, total = ctx.saved_tensors
        flat = torch.view_as_real(response.resolve_conj()).flatten(2, 3)
        result = torch.empty_like(flat)
        for number, pixel in enumerate(ctx.pixels):
            for block, target in zip(
                flat[number].split(PIXELS, dim=1), result[number].split(PIXELS, dim=1), strict=True
            ):
                logits = basis @ _columns(block)
                probabilities = (logits - total[number]).clamp_(min=LOWEST).exp_().mul_(grad[number])
                real, imaginary = (basis.T @ probabilities).chunk(2)
                target[..., 0] = real
                target[..., 1] = imaginary
            real, imaginary = (grad[number] * right[number]).chunk(2)
            result[number, :, pixel] -= torch.stack([real, imaginary], dim=-1)
        return torch.view_as_complex(result.unflatten(2, response.shape[-2:])), None, None, None


def _columns(block: torch.Tensor) -> torch.Tensor:
    """(K+1, pixels, 2) to (2(K+1), pixels): the real parts, then the imaginary parts."""
    return torch.cat([block[..., 0], block[..., 1]])
