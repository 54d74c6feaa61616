"""The networks of Transporter-Lan and CLIPort as boxes, with the measured shape on every arrow."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
from drawings.plot_results import METHOD_COLORS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from gem_lite.drawing.plots import bare

Shapes = Mapping[str, tuple[int, ...]]
"""The shape of the output of each part of a policy without the batch, by its name, such as "pick.down.0"."""
Spot = tuple[float, float]
"""Column and row of a box; row 0 has the full resolution, and each row below half of that above."""
GREY = "0.6"


def show_rivals(transporter: Shapes, cliport: Shapes) -> Figure:
    """Transporter-Lan's pick, CLIPort's pick, and the place, which both make in the same way."""
    fig, axes = plt.subplots(3, 1, figsize=(10.2, 12.4), height_ratios=(5.4, 5.9, 2.2), layout="constrained")
    for ax, title in zip(
        axes,
        (
            "Transporter-Lan: pick",
            "CLIPort: pick",
            "both: place (CLIPort: with the features of CLIP and the words as above)",
        ),
        strict=True,
    ):
        ax.set_title(title, loc="left", fontweight="bold")
        bare(ax, "").spines[:].set_visible(False)
    _draw_transporter(axes[0], transporter)
    _draw_cliport(axes[1], cliport)
    _draw_place(axes[2], transporter)
    fig.supxlabel(
        "on an arrow: channels x rows x columns    filled with colour: learned    grey: of the frozen CLIP    "
        "words: CLIP's embedding of the phrase, frozen",
        fontsize=8,
    )
    return fig


def _draw_transporter(ax: Axes, shapes: Shapes) -> None:
    ax.set(xlim=(-0.6, 5.6), ylim=(4.5, -0.6))
    color = METHOD_COLORS["Transporter-Lan"]
    _draw_unet(ax, shapes, "pick.", color)
    _box(ax, (4.4, 3.5), f"words\n{_size(shapes['words'])}", GREY)
    _arrow(ax, (3.96, 3.55), (2.5, 4.0), f"{_size(shapes['pick.language'])}, at every cell")
    _arrow(ax, (3.96, 3.4), (3.44, 3.1), _size(shapes["pick.language_above.0"]))
    _box(ax, (5.0, 0.0), "scores of\n36 angles")
    _arrow(ax, (3.44, 0.0), (4.56, 0.0), _size(shapes["pick"]))


def _draw_cliport(ax: Axes, shapes: Shapes) -> None:
    ax.set(xlim=(-0.6, 7.0), ylim=(4.5, -1.4))
    color = METHOD_COLORS["CLIPort"]
    _draw_unet(ax, shapes, "pick.network.spatial.", color)
    for level in range(4):
        row = 3.0 - level
        _box(ax, (4.6, row), "block" + (", times\nwords" if level in (1, 2) else ""), color)
        _arrow(ax, (3.44, row), (4.16, row), _size(shapes[f"pick.network.spatial.up.{level}"]))
        if level:
            _arrow(ax, (4.6, row + 0.74), (4.6, row + 0.26), _size(shapes[f"pick.network.lateral.{level - 1}"]))
    features = (("semantics", "last features"), ("inner.0", "inner features"), ("inner.1", "inner features"))
    for level, (part, name) in enumerate(features):
        row = 3.0 - level
        _box(ax, (6.5, row), f"CLIP's {name}\n{_size(shapes[f'level {level}'])}", GREY)
        text = _size(shapes[f"pick.{part}"]) + (",\ntimes words" if level == 0 else "")
        _arrow(ax, (6.06, row), (5.04, row), text)
    _box(ax, (3.8, -1.0), "sum: scores of\n36 angles")
    _arrow(ax, (3.0, -0.26), (3.45, -0.74), _size(shapes["pick.network.spatial.out"]))
    _arrow(ax, (4.6, -0.26), (4.15, -0.74), _size(shapes["pick.network.out"]))


def _draw_place(ax: Axes, shapes: Shapes) -> None:
    ax.set(xlim=(-0.6, 5.6), ylim=(1.5, -0.6))
    color = METHOD_COLORS["Transporter-Lan"]
    _box(ax, (0.0, 0.0), "RGB-D\nfrom above")
    _box(ax, (2.2, 0.0), "key: a network\nas above", color)
    _arrow(ax, (0.44, 0.0), (1.76, 0.0), _size(shapes["rgbd"]))
    _box(ax, (0.0, 1.0), "crop at the pick,\nturned 36 times")
    _box(ax, (2.2, 1.0), "query: another\nnetwork", color)
    queries = shapes["place.kernel"]
    _arrow(ax, (0.44, 1.0), (1.76, 1.0), "36 times " + _size((shapes["rgbd"][0], *queries[-2:])))
    _box(ax, (4.0, 0.5), "correlate")
    _arrow(ax, (2.64, 0.0), (3.56, 0.4), _size(shapes["place.encoder"]))
    _arrow(ax, (2.64, 1.0), (3.56, 0.6), "36 times " + _size(queries))
    _box(ax, (5.15, 0.5), "scores")
    _arrow(ax, (4.44, 0.5), (4.71, 0.5), "")
    ax.text(4.6, 0.12, _size(shapes["place"]), ha="center", fontsize=7.5)


def _draw_unet(ax: Axes, shapes: Shapes, prefix: str, color: str) -> None:
    """A U-Net: down in column 1, the bottleneck in column 2, up in column 3; a skip in each row."""
    _box(ax, (0.0, 0.0), "RGB-D\nfrom above")
    _arrow(ax, (0.44, 0.0), (0.76, 0.0), "")
    ax.text(0.6, -0.35, _size(shapes["rgbd"]), ha="center", fontsize=7.5)
    for row in range(4):
        _box(ax, (1.2, row), "block", color)
        down = shapes[f"{prefix}down.{row}"]
        _arrow(ax, (1.64, row), (2.56, row), _size(down))
        halved = _size((down[0], down[1] // 2, down[2] // 2))
        if row < 3:
            _arrow(ax, (1.2, row + 0.26), (1.2, row + 0.74), f"pool: {halved}")
        else:
            _arrow(ax, (1.4, row + 0.26), (1.66, row + 0.86), f"pool: {halved}")
        _box(ax, (3.0, row), "block", color)
        up = shapes[f"{prefix}up.{3 - row}"]
        if row:
            _arrow(ax, (3.0, row - 0.26), (3.0, row - 0.74), f"enlarge: {up[0]} x {2 * up[1]} x {2 * up[2]}")
    _box(ax, (2.1, 4.0), "bottleneck", color)
    bottom = shapes[f"{prefix}bottleneck"]
    _arrow(ax, (2.54, 3.86), (2.8, 3.26), f"enlarge: {bottom[0]} x {2 * bottom[1]} x {2 * bottom[2]}")


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _box(ax: Axes, spot: Spot, text: str, color: str = "white") -> None:
    """A box with a text in the middle, filled with a pale ``color``."""
    for style in ({"facecolor": color, "alpha": 0.25, "lw": 0}, {"facecolor": "none", "edgecolor": "0.2", "lw": 1.0}):
        corner = spot[0] - 0.42, spot[1] - 0.24
        ax.add_patch(FancyBboxPatch(corner, 0.84, 0.48, "round,pad=0.02,rounding_size=0.06", **style))
    ax.text(*spot, text, ha="center", va="center", fontsize=7.5)


def _arrow(ax: Axes, start: Spot, end: Spot, text: str) -> None:
    """An arrow with a text: above a level one, beside an upright one, and on any other."""
    ax.annotate("", end, start, arrowprops={"arrowstyle": "->", "lw": 1.2})
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    if start[1] == end[1]:
        ax.text(middle[0], middle[1] - 0.06, text, ha="center", va="bottom", fontsize=7.5)
    elif start[0] == end[0]:
        ax.text(middle[0] + 0.05, middle[1], text, va="center", fontsize=7.5)
    else:
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
        ax.text(*middle, text, ha="center", va="center", fontsize=7.5, bbox=box)
