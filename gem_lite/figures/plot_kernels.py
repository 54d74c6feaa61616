"""Drawings of kernels, of signals on the circle, and of equivariance errors."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.figure import Figure

from gem_lite.figures.plots import PICK_COLOR, bare
from gem_lite.se2 import rotation_matrix

SIGNED = "RdBu_r"
"""Kernels have both signs: red is positive, blue negative, white 0."""


def show_kernels(rows: Sequence[Sequence[tuple[str, torch.Tensor]]], suptitle: str = "", width: float = 1.45) -> Figure:
    """Rows of titled kernels (h, h). The kernels of a row share one scale, symmetric about 0."""
    columns = max(map(len, rows))
    fig, axes = plt.subplots(
        len(rows), columns, figsize=(width * columns, (width + 0.3) * len(rows) + 0.3), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for ax in axes.flat:
        ax.axis("off")
    for row_axes, row in zip(axes, rows, strict=True):
        top = max(float(kernel.abs().max()) for _, kernel in row)
        for ax, (title, kernel) in zip(row_axes, row, strict=False):
            ax.axis("on")
            bare(ax, title).imshow(kernel, cmap=SIGNED, vmin=-top, vmax=top)
    fig.suptitle(suptitle, fontsize=10)
    return fig


def show_signals(x: np.ndarray, panels: Sequence[tuple[str, dict[str, np.ndarray]]], xlabel: str) -> Figure:
    """Panels of named curves over x; the first curve of each is drawn as dots."""
    fig, axes = plt.subplots(
        1, len(panels), figsize=(3.9 * len(panels), 3.0), sharey=True, squeeze=False, layout="constrained"
    )
    for ax, (title, curves) in zip(axes[0], panels, strict=True):
        for i, (name, values) in enumerate(curves.items()):
            ax.plot(x, values, "o" if i == 0 else "-", ms=3, lw=1.5, color=f"C{i}", label=name)
        ax.set_title(title, fontsize=9)
        ax.set(xlabel=xlabel)
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    return fig


def show_errors(panels: Sequence[tuple[str, dict[str, np.ndarray]]]) -> Figure:
    """For each panel, named errors (n,) over the angle of each g_j, on one logarithmic scale for all panels."""
    fig, axes = plt.subplots(
        1, len(panels), figsize=(4.3 * len(panels), 3.3), sharey=True, squeeze=False, layout="constrained"
    )
    for ax, (title, curves) in zip(axes[0], panels, strict=True):
        for i, (name, errors) in enumerate(curves.items()):
            degrees = 360 * np.arange(len(errors)) / len(errors)
            # Exact zeros (often the identity's) are drawn at the axis.
            ax.semilogy(degrees, np.maximum(errors, 1e-17), "os^Dv"[i % 5] + "-", ms=4, lw=1, label=name)
        ax.set_title(title, fontsize=9)
        ax.set(xlabel="the turn g (degrees)", xticks=[0, 90, 180, 270, 360], ylim=(5e-18, 5))
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    axes[0, 0].set_ylabel("relative error inside the disc")
    return fig


def show_picks(panels: Sequence[tuple[str, np.ndarray, tuple[float, float, float]]], length: float = 7) -> Figure:
    """Height pictures (H, W), each with a pick (row, col, angle in radians): a dot, and a line along the angle."""
    fig, axes = plt.subplots(1, len(panels), figsize=(2.1 * len(panels), 2.5), squeeze=False, layout="constrained")
    for ax, (title, picture, (row, col, angle)) in zip(axes[0], panels, strict=True):
        bare(ax, title).imshow(picture, cmap="gray", vmin=0)
        drow, dcol = rotation_matrix(angle) @ np.array([0, length])
        ax.plot([col, col + dcol], [row, row + drow], color=PICK_COLOR, lw=2)
        ax.plot(col, row, "o", color=PICK_COLOR, ms=5)
    return fig


def show_table_of_errors(errors: np.ndarray, title: str, xlabel: str, ylabel: str) -> Figure:
    """Errors (n, n) over two independent turns, as logarithms to base 10."""
    fig, ax = plt.subplots(figsize=(4.6, 3.8), layout="constrained")
    logs = np.log10(np.maximum(errors, 1e-17))
    image = ax.imshow(logs, cmap="viridis", vmin=-8, vmax=0)
    quarters = range(0, len(errors), max(1, len(errors) // 4))
    degrees = [f"{360 * j / len(errors):.0f}°" for j in quarters]
    ax.set_xticks(quarters, degrees)
    ax.set_yticks(quarters, degrees)
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.set_title(title, fontsize=9)
    fig.colorbar(image, ax=ax, label="log10 of the relative error")
    return fig
