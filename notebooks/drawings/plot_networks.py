"""Networks as diagrams: boxes for what is computed, arrows with the shapes of what is passed on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from drawings.boxes import FIXED, LEARNED, Point, arrow, box, canvas, inset, legend, line, sign
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gem_lite.drawing.plots import OUTLINE, PICK_COLOR, PLACE_COLOR

OURS, THEIRS = "#0072b2", "#b34700"
"""Sizes of the embedded CLIP (blue), and of OpenAI's ViT-B/32 (dark orange)."""


@dataclass(frozen=True)
class ClipSizes:
    """The sizes of a CLIP that `show_towers` writes.

    Attributes:
        vocabulary: how many tokens the tokenizer has.
        longest: how many tokens a text may have.
        text_layers, text_heads, text_width: of the transformer of the texts.
        pixels: the side of a picture.
        image_tower: what the image tower does, in one or two lines.
        features: the shape of what it makes.
        pooled: how one vector is made of them.
        image_width: how many numbers this vector has.
        dim: how many numbers an embedding has.
    """

    vocabulary: int
    longest: int
    text_layers: int
    text_heads: int
    text_width: int
    pixels: int
    image_tower: str
    features: tuple[int, ...]
    pooled: str
    image_width: int
    dim: int


VIT_B_32 = ClipSizes(
    49408, 77, 12, 8, 512, 224, "49 squares of 32 x 32 pixels,\nand a class token; transformer,\n12 layers, 12 heads",
    (50, 768), "the class token", 768, 512,
)  # fmt: skip
"""OpenAI's *clip-vit-base-patch32* (https://arxiv.org/abs/2103.00020)."""


EMBEDDED = ClipSizes(
    1557, 32, 2, 4, 128, 40, "convolutions: 7 x 7, then five\nresidual blocks in four stages",
    (256, 3, 3), "mean over 3 x 3 places", 256, 128,
)  # fmt: skip
"""The embedded CLIP (data/clip-tabletop/config.json)."""


def show_towers(phrase: str, tokens: Sequence[str], picture: np.ndarray, cosine: float) -> Figure:
    """CLIP's two towers, with the shapes that each arrow carries: above in `EMBEDDED`, below in `VIT_B_32`.

    Args:
        tokens: of the phrase, in the embedded CLIP.
        picture: (H, W, 3) uint8.
        cosine: of phrase and picture.
    """
    ours = EMBEDDED
    theirs = VIT_B_32
    count = len(tokens)
    fig, ax = canvas(13.6, 6.0)
    ax.text(0.1, 5.75, "text tower", fontsize=11, fontweight="bold", va="center")
    ax.text(0.1, 2.65, "image tower", fontsize=11, fontweight="bold", va="center")

    box(ax, (0.1, 4.1), 1.3, 0.8, f'"{phrase}"', "white")
    arrow(ax, (1.4, 4.5), (2.5, 4.5), "tokenizer")
    _sizes(ax, (1.95, 4.4), f"{ours.vocabulary:,} tokens", f"{theirs.vocabulary:,} tokens")
    for i, token in enumerate(tokens):
        box(ax, (2.5, 4.5 + 0.36 * (count / 2 - i - 1)), 1.0, 0.32, token.replace("Ġ", "␣"), "white")
    _two_sizes(ax, (3.5, 4.5), (4.5, 4.5), f"({count},)", "(n,)")
    box(ax, (4.5, 4.05), 1.6, 0.9, "look up a vector for\neach token, and one\nfor its position", FIXED)
    _two_sizes(ax, (6.1, 4.5), (7.1, 4.5), f"({count}, {ours.text_width})", f"(n, {theirs.text_width})")
    box(ax, (7.1, 3.85), 1.9, 1.3, "", FIXED)
    ax.text(8.05, 4.85, "transformer", fontsize=8, ha="center", va="center")
    ax.text(8.05, 4.5, _layers(ours), fontsize=8, ha="center", va="center", color=OURS)
    ax.text(8.05, 4.15, _layers(theirs), fontsize=8, ha="center", va="center", color=THEIRS)
    _two_sizes(ax, (9.0, 4.5), (10.0, 4.5), f"({count}, {ours.text_width})", f"(n, {theirs.text_width})")
    box(ax, (10.0, 4.05), 1.2, 0.9, "take the last\none, <eos>;\nlinear layer", FIXED)
    _two_sizes(ax, (11.2, 4.5), (12.2, 4.5), f"({ours.dim},)", f"({theirs.dim},)")
    box(ax, (12.2, 4.2), 1.1, 0.6, "length 1: $\\mathcal{E}_\\ell$", FIXED)

    inset(ax, picture, (0.75, 1.4), 1.3, "one patch")
    _two_sizes(
        ax, (1.4, 1.4), (2.7, 1.4), f"(3, {ours.pixels}, {ours.pixels})", f"(3, {theirs.pixels}, {theirs.pixels})"
    )
    box(ax, (2.7, 0.65), 3.4, 1.5, "", FIXED)
    ax.text(4.4, 1.83, ours.image_tower, fontsize=8, ha="center", va="center", color=OURS)
    ax.text(4.4, 1.07, theirs.image_tower, fontsize=8, ha="center", va="center", color=THEIRS)
    _two_sizes(ax, (6.1, 1.4), (7.1, 1.4), str(ours.features), str(theirs.features))
    box(ax, (7.1, 0.95), 1.9, 0.9, "", FIXED)
    ax.text(8.05, 1.58, ours.pooled, fontsize=8, ha="center", va="center", color=OURS)
    ax.text(8.05, 1.22, theirs.pooled, fontsize=8, ha="center", va="center", color=THEIRS)
    _two_sizes(ax, (9.0, 1.4), (10.0, 1.4), f"({ours.image_width},)", f"({theirs.image_width},)")
    box(ax, (10.0, 1.1), 1.2, 0.6, "linear layer", FIXED)
    _two_sizes(ax, (11.2, 1.4), (12.2, 1.4), f"({ours.dim},)", f"({theirs.dim},)")
    box(ax, (12.2, 1.1), 1.1, 0.6, "length 1: $\\mathcal{E}^{patch}$", FIXED)

    arrow(ax, (12.75, 4.2), (12.75, 3.35))
    arrow(ax, (12.75, 1.7), (12.75, 2.55))
    box(ax, (11.95, 2.55), 1.6, 0.8, f"cosine: multiply\nand add\n{cosine:.2f}", "white")
    ax.text(0.1, 0.15, "blue: the embedded CLIP", fontsize=9, color=OURS, va="center")
    ax.text(2.3, 0.15, "orange: OpenAI's ViT-B/32, with n of at most 77 tokens", fontsize=9, color=THEIRS, va="center")
    return fig


def _layers(sizes: ClipSizes) -> str:
    return f"{sizes.text_layers} layers, {sizes.text_heads} heads"


def _sizes(ax: Axes, middle: Point, ours: str, theirs: str) -> None:
    """Two sizes below a point."""
    ax.text(*middle, ours, fontsize=8, ha="center", va="top", color=OURS)
    ax.text(middle[0], middle[1] - 0.19, theirs, fontsize=8, ha="center", va="top", color=THEIRS)


def _two_sizes(ax: Axes, start: Point, end: Point, ours: str, theirs: str) -> None:
    """An arrow with the shape in both CLIPs: the embedded one's above, the other one's below."""
    arrow(ax, start, end)
    x = (start[0] + end[0]) / 2
    ax.text(x, start[1] + 0.07, ours, fontsize=8, ha="center", va="bottom", color=OURS)
    ax.text(x, start[1] - 0.07, theirs, fontsize=8, ha="center", va="top", color=THEIRS)


def show_pick_module(maps: dict[str, np.ndarray], words: int, widths: Sequence[int]) -> Figure:
    """GEM's pick after Figure 3 of the paper: three branches, with the shape of what each arrow carries.

    Args:
        maps: "colour" (H, W, 3); "height", "raw map", "M", "A", "A ⊗ M" (H, W), one channel of each; "kernel" (h, h);
            "scores" (R, H, W).
        words: how many numbers a phrase has.
        widths: channels of the U-Net's levels, from the picture to the bottleneck.
    """
    rows, cols = maps["height"].shape
    side = maps["kernel"].shape[0]
    picture, kernel = f"{rows}, {cols}", f"{side}, {side}"
    fig, ax = canvas(13.3, 7.7)
    titles = ("encoder A: a U-Net", "semantic extractor: the gate M", "kernel of the phrase")
    for title, y in zip(titles, (7.52, 4.75, 2.15), strict=True):
        ax.text(2.05, y, title, fontsize=11, fontweight="bold", va="center")

    inset(ax, maps["colour"], (0.6, 6.1), 1.6, "o: colour")
    inset(ax, maps["height"], (1.5, 6.1), 1.6, "o: height")
    arrow(ax, (1.95, 6.1), (2.95, 6.1), f"(4, {picture})")
    neck = _u_net(ax, (3.0, 6.1), 4.0, widths, (rows, cols))
    arrow(ax, (6.9, 6.1), (8.05, 6.1), f"(3, {picture})")
    inset(ax, maps["A"], (8.5, 6.1), 1.6, "A", signed=True)

    inset(ax, maps["raw map"], (0.6, 3.4), 1.6, "raw map (Eq. 1-4)")
    arrow(ax, (1.05, 3.2), (5.4, 3.2), f"(1, {picture})", at=0.3)
    line(ax, (1.5, 5.3), (1.5, 3.8))
    arrow(ax, (1.5, 3.8), (5.4, 3.8), f"height (1, {picture})", at=0.22)
    refiner = (
        "refiner $f_\\theta$ (Eq. 4):\ntwo 3 x 3 convolutions\non the height; one linear\nlayer a pixel joins both"
    )
    box(ax, (5.4, 2.8), 1.7, 1.35, refiner, LEARNED)
    arrow(ax, (7.1, 3.4), (8.05, 3.4), f"(3, {picture})")
    inset(ax, maps["M"], (8.5, 3.4), 1.6, "M", signed=True)

    box(ax, (0.15, 0.75), 1.6, 0.9, "phrase: CLIP's\ntext embedding,\nlocation words", FIXED)
    arrow(ax, (1.75, 1.2), (5.4, 1.2), f"words ({words},)", at=0.3)
    arrow(ax, (neck[0], 1.2), neck)
    generator = f"words and place in\neach of {side} x {side} cells;\na smaller U-Net"
    box(ax, (5.4, 0.75), 1.7, 0.9, generator, LEARNED)
    arrow(ax, (7.1, 1.2), (8.05, 1.2), f"(3, {kernel})")
    inset(ax, maps["kernel"], (8.5, 1.2), 0.9, "κ", signed=True)
    arrow(ax, (8.95, 1.2), (9.4, 1.2))
    box(ax, (9.4, 0.75), 1.4, 0.9, "turn it 180 times;\nFourier transform\nover the turns", FIXED)

    _join(ax, maps, (6.1, 4.75, 3.55, 6.1), 10.8, ("o", PICK_COLOR))
    ax.text(12.5, 7.4, "pick: $(u, v, \\theta)$", fontsize=10, ha="center", va="center")
    legend(ax, (0.15, 0.15))
    return fig


def show_place_module(maps: dict[str, np.ndarray], words: int, widths: Sequence[int], channels: int) -> Figure:
    """GEM's place after Figure A3 of the paper: as the pick, but its kernel is made of the crop at the pick.

    Args:
        maps: "colour" (H, W, 3); "height", "raw map", "M", "A", "A ⊗ M" (H, W), one channel of each; "crop" (h, h, 3),
            its colours; "kernel" (h, h); "scores" (R, H, W).
        words: how many numbers a phrase has.
        widths: channels of the U-Net's levels, from the picture to the bottleneck.
        channels: of the generator's inner layers, regular fields of C_8.
    """
    rows, cols = maps["height"].shape
    side = maps["kernel"].shape[0]
    picture, kernel = f"{rows}, {cols}", f"{side}, {side}"
    fig, ax = canvas(13.3, 8.0)
    titles = (
        "encoder A: a U-Net",
        "semantic extractor: the gate M",
        "kernel of the crop: four layers of e2cnn, which turn with the crop",
    )
    for title, y in zip(titles, (7.82, 4.6, 2.2), strict=True):
        ax.text(2.05, y, title, fontsize=11, fontweight="bold", va="center")

    inset(ax, maps["colour"], (0.6, 6.45), 1.6, "o: colour")
    inset(ax, maps["height"], (1.5, 6.45), 1.6, "o: height")
    arrow(ax, (1.95, 6.45), (2.95, 6.45), f"(4, {picture})")
    neck = _u_net(ax, (3.0, 6.45), 4.0, widths, (rows, cols))
    arrow(ax, (6.9, 6.45), (8.05, 6.45), f"(3, {picture})")
    inset(ax, maps["A"], (8.5, 6.45), 1.6, "A", signed=True)
    box(ax, (0.15, 4.85), 1.9, 0.6, "place phrase: CLIP's\nembedding, location words", FIXED)
    line(ax, (2.05, 5.15), (neck[0], 5.15))
    arrow(ax, (neck[0], 5.15), neck)
    ax.text(2.5, 5.21, f"words ({words},)", fontsize=8, ha="center", va="bottom")

    inset(ax, maps["raw map"], (0.6, 3.4), 1.6, "raw map (Eq. 1-4)")
    arrow(ax, (1.05, 3.2), (5.4, 3.2), f"(1, {picture})", at=0.3)
    line(ax, (1.5, 5.65), (1.5, 5.45))
    line(ax, (1.5, 4.85), (1.5, 3.8))
    arrow(ax, (1.5, 3.8), (5.4, 3.8), f"height (1, {picture})", at=0.22)
    box(ax, (5.4, 2.9), 1.7, 1.15, "refiner $f_\\theta$ (Eq. 4),\nas in the pick", LEARNED)
    arrow(ax, (7.1, 3.4), (8.05, 3.4), f"(3, {picture})")
    inset(ax, maps["M"], (8.5, 3.4), 1.6, "M", signed=True)

    inset(ax, maps["crop"], (0.7, 1.2), 1.1, "c: crop at the pick")
    layers = ("5 trivial\n→ regular", "regular\n→ regular", "regular\n→ regular", "regular\n→ 3 trivial")
    start, passed = 1.25, f"(5, {kernel})"
    for layer in layers:
        arrow(ax, (start, 1.2), (start + 0.78, 1.2), passed)
        box(ax, (start + 0.78, 0.85), 0.8, 0.7, layer, LEARNED)
        start, passed = start + 1.58, f"({channels}, {kernel})"
    arrow(ax, (start, 1.2), (8.3, 1.2), f"(3, {kernel})")
    inset(ax, maps["kernel"], (8.75, 1.2), 0.9, "ψ(c)", signed=True)
    arrow(ax, (9.2, 1.2), (9.5, 1.2))
    box(ax, (9.5, 0.75), 1.4, 0.9, "lift: turn it 180 times;\nFourier transform\nover the turns", FIXED)

    _join(ax, maps, (6.45, 4.95, 3.75, 6.4), 10.9, ("s", PLACE_COLOR))
    ax.text(12.5, 7.7, "place: $(u, v, \\Delta)$", fontsize=10, ha="center", va="center")
    legend(ax, (0.15, 0.15))
    return fig


def _join(
    ax: Axes, maps: dict[str, np.ndarray], heights: tuple[float, float, float, float], kernel_end: float,
    mark: tuple[str, str],
) -> None:  # fmt: skip
    """What pick and place share: A and M are multiplied, correlated with the kernel, and read at all angles.

    Args:
        maps: as for `show_pick_module`.
        heights: of A, of the product, of the lower edge of the last box, and of the score in the drawing.
        kernel_end: where the box of the kernel's transform ends.
        mark: the marker and the colour of the best pixel.
    """
    encoder, product, last, score = heights
    angles, rows, cols = maps["scores"].shape
    side, picture = maps["kernel"].shape[0], f"{rows}, {cols}"
    line(ax, (8.95, encoder), (9.5, encoder))
    arrow(ax, (9.5, encoder), (9.5, product + 0.25))
    line(ax, (8.95, 3.4), (9.5, 3.4))
    arrow(ax, (9.5, 3.4), (9.5, product - 0.25))
    sign(ax, (9.5, product), "⊗")
    arrow(ax, (9.75, product), (10.1, product))
    inset(ax, maps["A ⊗ M"], (10.52, product), 1.6, "φ = A ⊗ M", signed=True)
    ax.text(10.52, product - 0.87, f"(3, {picture})", fontsize=8, ha="center", va="top")
    line(ax, (10.94, product), (11.5, product))
    arrow(ax, (11.5, product), (11.5, 3.35))
    sign(ax, (11.5, 3.1), "★")
    line(ax, (kernel_end, 1.2), (11.5, 1.2))
    arrow(ax, (11.5, 1.2), (11.5, 2.85))
    ax.text(11.58, 1.9, f"$c_0$ ... $c_8$\n(9, 3, {side}, {side})", fontsize=8, va="center")
    line(ax, (11.75, 3.1), (12.5, 3.1))
    arrow(ax, (12.5, 3.1), (12.5, last))
    ax.text(11.9, 3.0, f"$C_0$ ... $C_8$\n(9, {picture})", fontsize=8, va="top")
    box(ax, (11.8, last), 1.4, 0.9, f"inverse transform,\nread at {angles} angles;\none softmax", FIXED)
    arrow(ax, (12.5, last + 0.9), (12.5, score - 1.0))
    ax.text(12.57, last + 1.22, f"({angles}, {picture})", fontsize=8, va="center")
    best_angle = maps["scores"].max(axis=0)
    inset(ax, best_angle, (12.5, score), 1.9, "score, best angle")
    row, col = np.unravel_index(int(best_angle.argmax()), best_angle.shape)
    at = (12.5 + (col + 0.5 - cols / 2) * 1.9 / rows, score - (row + 0.5 - rows / 2) * 1.9 / rows)
    ax.plot(*at, mark[0], ms=13, mfc="none", mec=mark[1], mew=1.6, path_effects=OUTLINE)


def _u_net(ax: Axes, start: Point, length: float, widths: Sequence[int], shape: tuple[int, int]) -> Point:
    """A U-Net, a bar for each residual block, between ``start`` and ``length`` further right.

    Returns:
        The lower end of its bottleneck, where the words enter.
    """
    x, y = start
    channels = [*widths, widths[-1], *reversed(widths[:-1]), widths[0]]
    count = len(channels)
    step = length / count
    for i, channel in enumerate(channels):
        level = min(i, count - 1 - i)
        height = 1.9 * 0.72**level
        left = x + i * step + 0.12 * step
        ax.add_patch(Rectangle((left, y - height / 2), 0.5 * step, height, fc=LEARNED, ec="0.3", lw=1))
        middle = left + 0.25 * step
        ax.text(middle, y, str(channel), fontsize=8, ha="center", va="center")
        if i < count // 2:
            size = f"{shape[0] // 2**level} x\n{shape[1] // 2**level}"
            ax.text(middle, y - height / 2 - 0.05, size, fontsize=7, ha="center", va="top", color="0.3")
            mirror = x + length - (middle - x) - 0.26 * step
            top = y + height / 2
            above = y + 1.23 - 0.07 * level
            line(ax, (middle, top), (middle, above), (mirror, above), (mirror, top))
    return x + length / 2 - 0.13 * step, y - 1.9 * 0.72 ** (count // 2) / 2
