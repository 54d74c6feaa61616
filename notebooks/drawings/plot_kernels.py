"""Drawings of kernels, of signals on the circle, and of equivariance errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from gem_lite.drawing.plots import OUTLINE, PICK_COLOR, bare
from gem_lite.se2 import rotation_matrix

SIGNED = "RdBu_r"
"""Kernels have both signs: red is positive, blue negative, white 0."""
LEAST_ERROR = 1e-8
"""The lower edge of `show_errors`."""


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


def show_signals(
    x: np.ndarray, panels: Sequence[tuple[str, dict[str, np.ndarray]]], xlabel: str, ylabel: str = ""
) -> Figure:
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
    axes[0, 0].set_ylabel(ylabel)
    return fig


def show_errors(panels: Sequence[tuple[str, dict[str, np.ndarray]]]) -> Figure:
    """For each panel, named errors (n,) over the angle of each g_j, as dots on one logarithmic scale for all panels.

    Errors below `LEAST_ERROR`, exact zeros among them, are open dots on the lower edge; NaN is left out. The dots of
    several names stand side by side around their angle.
    """
    names = [list(curves) for _, curves in panels]
    fig, axes = plt.subplots(
        1, len(panels), figsize=(4.3 * len(panels), 3.5), sharey=True, squeeze=False, layout="constrained"
    )
    for ax, (title, curves) in zip(axes[0], panels, strict=True):
        for i, (name, values) in enumerate(curves.items()):
            errors = np.asarray(values)
            step = 360 / len(errors)
            degrees = step * (np.arange(len(errors)) + 0.7 * ((i + 0.5) / len(curves) - 0.5))
            small = errors < LEAST_ERROR
            ax.plot(degrees, np.where(small, np.nan, errors), "os^Dv"[i % 5], ms=4.5, color=f"C{i}", label=name)
            if small.any():
                edge = np.full(small.sum(), LEAST_ERROR)
                ax.plot(degrees[small], edge, "os^Dv"[i % 5], ms=4.5, color=f"C{i}", mfc="white", clip_on=False)
        ax.set_title(title, fontsize=9)
        ax.set(xlabel="the turn g (degrees)", xticks=[0, 90, 180, 270, 360], xlim=(-20, 365))
        ax.set(yscale="log", ylim=(LEAST_ERROR, 3), yticks=[LEAST_ERROR, 1e-6, 1e-4, 1e-2, 1])
        ax.set_yticklabels(["below $10^{-8}$", "$10^{-6}$", "$10^{-4}$", "1 %", "100 %"])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
        if names.count(names[0]) < len(names):
            ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    if names.count(names[0]) == len(names):
        columns = min(4, 2 * len(panels))
        fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=columns, fontsize=8)
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


def show_answers(
    scene: np.ndarray,
    rows: Sequence[tuple[str, Sequence[tuple[str, tuple[float, float, float]]]]],
    truth: tuple[float, float, float],
    length: float = 12,
) -> Figure:
    """One scene (H, W) for each answer: named rows of titled picks (row, col, angle in radians).

    A pick is a dot with a line along its angle; a thin dashed white line is the right one, ``truth``.
    """
    columns = len(rows[0][1])
    fig, axes = plt.subplots(len(rows), columns, figsize=(1.6 * columns + 0.3, 1.8 * len(rows)), squeeze=False)
    fig.subplots_adjust(left=0.05, right=0.99, bottom=0.02, top=0.93, wspace=0.06, hspace=0.16)
    for row_axes, (label, answers) in zip(axes, rows, strict=True):
        row_axes[0].set_ylabel(label, fontsize=9)
        for ax, (title, answer) in zip(row_axes, answers, strict=True):
            bare(ax, title).imshow(scene, cmap="gray", vmin=0, vmax=2 * scene.max())
            ax.autoscale(False)
            for (row, col, angle), reach, style in (
                (truth, 2 * length, {"color": "white", "lw": 1.0, "ls": "--"}),
                (answer, length, {"color": PICK_COLOR, "lw": 2.2}),
            ):
                drow, dcol = rotation_matrix(angle) @ np.array([0, reach])
                ax.plot([col, col + dcol], [row, row + drow], **style)
            ax.plot(answer[1], answer[0], "o", color=PICK_COLOR, ms=5)
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


def show_arrow_field(points: np.ndarray, arrows: np.ndarray, angle: float) -> Figure:
    """Arrows (N, 2) at points (N, 2), both (x, y), turned by ``angle``: on the left the points alone, as P_g does.

    On the right the arrows turn as well, as T_g of Eq. 7 does. Grey dots are the points before the turn.
    """
    matrix = rotation_matrix(angle)  # with y upwards the matrix is the same as for (row, col)
    reach = 1.4 * float(np.hypot(*points.T).max())
    fig, axes = plt.subplots(1, 2, figsize=(4.6, 2.7), layout="constrained")
    panels = (("$P_g f$: pixels only", arrows), (r"$T_g^{\rho_1} f$: pixels and channels", arrows @ matrix.T))
    for ax, (title, turned) in zip(axes, panels, strict=True):
        bare(ax, title).set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        ax.plot(*points.T, "o", color="0.8", ms=3)
        _arrows(ax, points @ matrix.T, turned, "C0")
    fig.suptitle(f"turned by {math.degrees(angle):.0f}°", fontsize=10)
    return fig


def show_dials(
    coefficients: np.ndarray, angle: float, kernel: torch.Tensor, pixel: tuple[int, int], signal: np.ndarray
) -> Figure:
    """The dial, the coefficients above one pixel turned by k times its angle, the kernel, and the pixel's signal.

    Args:
        coefficients: (K + 1,) complex, c_k of the pixel; c_1 to c_4 are drawn as arrows, before (grey) and now.
        angle: where the dial points (radians).
        kernel: (h, h), the kernel that the coefficients stand for at this angle.
        pixel: (row, col), marked in the kernel.
        signal: (n,) the pixel's value at every angle. The dot is its value now, from the coefficients.
    """
    room = {"left": 0.01, "right": 0.965, "bottom": 0.25, "top": 0.86, "wspace": 0.1}  # fixed: it is quick for a frame
    fig, axes = plt.subplots(1, 7, figsize=(9.8, 1.9), width_ratios=[1, 1, 1, 1, 1, 1.15, 2], gridspec_kw=room)
    top = float(np.abs(coefficients[1:5]).max())
    names = [r"$c_1\,e^{+i\alpha}$", *(rf"$c_{k}\,e^{{+{k}i\alpha}}$" for k in range(2, 5))]
    hands = [(r"the dial $+\alpha$", 1.0 + 0j, 1)]
    hands += [(name, coefficients[k] / top, k) for k, name in enumerate(names, start=1)]
    for ax, (title, start, speed) in zip(axes, hands, strict=False):
        bare(ax, title).set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal")
        ax.add_patch(Circle((0, 0), abs(start), fill=False, color="0.8"))
        now = start * np.exp(1j * speed * angle)
        for hand, color in ((start, "0.75"), (now, "black" if ax is axes[0] else "C0")):
            _arrows(ax, np.zeros((1, 2)), np.array([[hand.real, hand.imag]]), color, pivot="tail")
    highest = float(kernel.abs().max())
    bare(axes[5], r"kernel, turned $+\alpha$").imshow(kernel, cmap=SIGNED, vmin=-highest, vmax=highest)
    axes[5].plot(*pixel[::-1], "s", mfc="none", mec="black", ms=6)
    axes[6].plot(360 * np.arange(len(signal)) / len(signal), signal, color="0.6")
    waves = (coefficients * np.exp(1j * np.arange(len(coefficients)) * angle)).real
    axes[6].plot(math.degrees(angle), waves[0] + 2 * waves[1:].sum(), "o", color="C0")
    axes[6].set(xlim=(-8, 368), xticks=[0, 90, 180, 270, 360], xlabel=r"$\alpha$ (degrees)")
    axes[6].yaxis.tick_right()
    axes[6].set_title("value of the marked pixel", fontsize=9)
    return fig


def show_reading(
    kernel: torch.Tensor, scene: torch.Tensor, scores: torch.Tensor, signals: dict[tuple[int, int], np.ndarray],
    degrees: float,
) -> Figure:  # fmt: skip
    """A kernel read at an angle, a scene, the scores at this angle, and the scores above some pixels at all angles.

    The curves are shares of the signals' highest value.

    Args:
        kernel: (h, h).
        scene, scores: (S, S). The map of scores is drawn from 60 % of the signals' highest value upwards.
        signals: for each pixel (row, col) the scores (n,) above it. The pixel is marked in the scene.
        degrees: the angle at which kernel and scores are read.
    """
    room = {"left": 0.01, "right": 0.93, "bottom": 0.2, "top": 0.88, "wspace": 0.12}
    fig, axes = plt.subplots(1, 4, figsize=(9.6, 2.6), width_ratios=[0.6, 1, 1, 1.4], gridspec_kw=room)
    highest = float(kernel.abs().max())
    top = max(float(values.max()) for values in signals.values())
    bare(axes[0], f"kernel at {degrees:.0f}°").imshow(kernel, cmap=SIGNED, vmin=-highest, vmax=highest)
    bare(axes[1], "the scene").imshow(scene, cmap=SIGNED, vmin=-highest, vmax=highest)
    bare(axes[2], f"scores at {degrees:.0f}°").imshow(scores, cmap="viridis", vmin=0.6 * top, vmax=top)
    for i, ((row, col), values) in enumerate(signals.items()):
        mark, angles = "os"[i % 2], 360 * np.arange(len(values)) / len(values)
        for ax in axes[1:3]:
            ax.plot(col, row, mark, mfc="none", mec=f"C{i}", ms=15, mew=1.8)
        axes[3].plot([*angles, 360], np.array([*values, values[0]]) / top, color=f"C{i}")
        axes[3].plot(degrees, np.interp(degrees, angles, values) / top, mark, color=f"C{i}")
    axes[3].axvline(degrees, color="0.7", lw=1)
    axes[3].set(xlim=(-8, 368), xticks=[0, 90, 180, 270, 360], xlabel=r"angle $\theta$ (degrees)", ylim=(0, 1.08))
    axes[3].yaxis.tick_right()
    axes[3].yaxis.set_label_position("right")
    axes[3].set_ylabel("share of the highest score", fontsize=9)
    axes[3].set_title("scores above the two marks", fontsize=9)
    return fig


def show_pixel_signal(
    scene: torch.Tensor, pixel: tuple[int, int], before: np.ndarray, now: np.ndarray, degrees: float
) -> Figure:
    """A turned scene (S, S) with one pixel (row, col), and the scores above this pixel at n angles, before and now.

    The best angle now is a dot in the signal, and a line from the pixel in the scene.
    """
    room = {"left": 0.01, "right": 0.98, "bottom": 0.18, "top": 0.9, "wspace": 0.25}
    fig, axes = plt.subplots(1, 2, figsize=(6.6, 2.7), width_ratios=[1, 1.6], gridspec_kw=room)
    highest = float(scene.abs().max())
    bare(axes[0], f"the scene, turned by {degrees:.0f}°").imshow(scene, cmap=SIGNED, vmin=-highest, vmax=highest)
    angles = 360 * np.arange(len(now)) / len(now)
    best = int(now.argmax())
    drow, dcol = rotation_matrix(math.radians(angles[best])) @ np.array([0, 8])
    row, col = pixel
    axes[0].plot([col, col + dcol], [row, row + drow], color=PICK_COLOR, lw=2, path_effects=OUTLINE)
    axes[0].plot(col + dcol, row + drow, "o", color=PICK_COLOR, mec="black", ms=5)
    axes[1].plot(angles, before, color="0.75")
    axes[1].plot(angles, now, color="C0")
    axes[1].plot(angles[best], now[best], "o", color=PICK_COLOR, mec="black")
    axes[1].set(xlabel=r"angle $\theta$ (degrees)", ylabel="score", xticks=[0, 90, 180, 270, 360])
    axes[1].set_title("scores above the pixel (grey: before the turn)", fontsize=9)
    return fig


def show_percent(panels: Sequence[tuple[str, dict[str, np.ndarray]]]) -> Figure:
    """For each panel, named relative errors (n,) over the angle of each g_j, in per cent, on one axis a panel."""
    fig, axes = plt.subplots(1, len(panels), figsize=(3.6 * len(panels), 3.1), squeeze=False, layout="constrained")
    for ax, (title, errors_of) in zip(axes[0], panels, strict=True):
        for i, (name, errors) in enumerate(errors_of.items()):
            # Growing open rings around the first series' dots: equal values stay visible.
            ax.plot(
                360 * np.arange(len(errors)) / len(errors), 100 * errors, "o", color=f"C{i}", ms=4 + 3.5 * i,
                mfc=f"C{i}" if i == 0 else "none", mew=1.3, label=name,
            )  # fmt: skip
        ax.set_title(title, fontsize=9)
        ax.set(xlabel="the turn g (degrees)", xticks=[0, 90, 180, 270, 360])
        ax.set_ylim(bottom=-0.03 * ax.get_ylim()[1])
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2)
    axes[0, 0].set_ylabel("relative error (%)")
    return fig


def _arrows(ax: Axes, points: np.ndarray, arrows: np.ndarray, color: str, pivot: str = "middle") -> None:
    """Arrows (N, 2) at points (N, 2), (x, y), in the units of the axes."""
    ax.quiver(
        *points.T, *arrows.T, color=color, pivot=pivot, angles="xy", scale_units="xy", scale=1, width=0.025,
        headwidth=3.5, headlength=4, headaxislength=3.6,
    )  # fmt: skip
