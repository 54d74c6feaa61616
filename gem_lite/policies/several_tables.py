"""Stitch and split (A.12): one argmax over the action maps of several tables gives the table, the pixel and the angle.

The policy learned on one table. Its networks are convolutions, and its kernels come from words or a crop. So the same
kernel can be correlated with the features of every table (`Policy.choose_over`).
"""

from __future__ import annotations

import numpy as np
import torch


def stitch(maps: torch.Tensor) -> torch.Tensor:
    """The action maps (N, R, H, W) of N tables as one of (R, H, N W), side by side (Fig. A12, step 2)."""
    return maps.permute(1, 2, 0, 3).flatten(2)


def split(cell: tuple[int, int, int], width: int) -> tuple[int, tuple[int, int, int]]:
    """A stitched map's (angle, row, column) as the table's number and its own (angle, row, column)."""
    angle, row, column = cell
    return column // width, (angle, row, column % width)


def best_cell(logits: torch.Tensor, allowed: torch.Tensor) -> tuple[int, tuple[int, int, int]]:
    """The table and its (angle, row, column) with the largest of the logits (N, R, H, W) that are ``allowed``.

    Args:
        allowed: bool, of a shape that broadcasts to that of ``logits``.
    """
    panorama = stitch(logits.masked_fill(~allowed, -torch.inf))
    angle, row, column = np.unravel_index(int(panorama.argmax()), panorama.shape)
    return split((int(angle), int(row), int(column)), logits.shape[-1])
