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
    parts: torch.Tensor, angles: torch.Tensor, cells: Sequence[tuple[list[int], int, int]]
) -> torch.Tensor:
    """Mean cross-entropy of ``sample_parts(parts, angles)``, a distribution over pixels and angles.

    The logits of a `lite` step are 7 MB, and their cross-entropy reads and writes them ten times. Here, they are made
    for a few columns of pixels at a time, and once more for the gradient.

    Args:
        parts: the real parts, then the imaginary parts of C_k for k >= 0, (B, 2(K + 1), H, W).
        angles: (R,) radians.
        cells: for each member of the batch, its label: equally right angle bins, and a pixel (row, col).

    Returns:
        A number.
    """
    basis = sampling_matrix(parts.shape[1] // 2, angles).to(parts)  # (R, 2(K+1))
    right = torch.stack([basis[bins].mean(dim=0) for bins, _, _ in cells])  # (B, 2(K+1)): a mean logit is linear
    pixels = [(row, col) for _, row, col in cells]
    return _SampledCrossEntropy.apply(parts, basis, right, pixels).mean()


class _SampledCrossEntropy(torch.autograd.Function):
    """log sum exp of all logits, minus the mean of the right logits; (B,)."""

    @staticmethod
    def forward(
        ctx: Any, parts: torch.Tensor, basis: torch.Tensor, right: torch.Tensor,  # noqa: ANN401
        pixels: Sequence[tuple[int, int]],
    ) -> torch.Tensor:  # fmt: skip
        totals = []
        right_logits = []
        for member, target, (row, col) in zip(parts, right, pixels, strict=True):
            sums = []
            for columns in _blocks(member):
                logits = basis @ columns  # (columns, R, H)
                highest = logits.max()
                exponentials = logits.sub_(highest).clamp_(min=LOWEST).exp_()
                sums.append(highest + exponentials.sum().log())
            totals.append(torch.stack(sums).logsumexp(dim=0))
            right_logits.append(target @ member[:, row, col])
        total = torch.stack(totals)
        ctx.save_for_backward(parts, basis, right, total)
        ctx.pixels = pixels
        return total - torch.stack(right_logits)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(
        ctx: Any,  # noqa: ANN401 (torch gives it no type that knows its tensors)
        grad: torch.Tensor,
    ) -> tuple[torch.Tensor, None, None, None]:
        parts, basis, right, total = ctx.saved_tensors
        result = parts.new_empty(parts.mT.shape).mT  # in memory, a column's pixels are neighbours, as in `correlate`
        for number, (row, col) in enumerate(ctx.pixels):
            for columns, target in zip(_blocks(parts[number]), _blocks(result[number]), strict=True):
                logits = basis @ columns
                probabilities = logits.sub_(total[number]).clamp_(min=LOWEST).exp_().mul_(grad[number])
                torch.matmul(basis.T, probabilities, out=target)
            result[number, :, row, col] -= grad[number] * right[number]
        return result, None, None, None


def _blocks(parts: torch.Tensor) -> Sequence[torch.Tensor]:
    """A member (2(K+1), H, W) in blocks of about `PIXELS` pixels, each (columns, 2(K+1), H)."""
    return parts.movedim(2, 0).split(max(1, PIXELS // parts.shape[1]))
