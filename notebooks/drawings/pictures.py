"""Figures as pictures with a text for readers who do not see them, and moving pictures that a stored notebook keeps."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import HTML, Image, display
from matplotlib.figure import Figure
from PIL import Image as Pillow

FIGURE_COLORS = 256
"""A stored figure has so many colours: a third of the size of a file with all of them."""
COLORS = 96
"""How many colours the frames of a moving picture share. Fewer colours make a smaller file."""

SLIDER = Path(__file__).with_name("slider.js")
"""The script that puts a slider below a moving picture, where scripts run."""


@dataclass(frozen=True)
class MovingPicture:
    """A picture that moves by itself. A slider below it chooses a frame in a live notebook and in the book."""

    image: Image

    def _ipython_display_(self) -> None:
        display(self.image)
        # An output of its own: where scripts are stripped, nothing of it is left, and the picture still moves.
        display(HTML(f'<div class="gem-slider"></div>\n<script>\n{SLIDER.read_text()}</script>'))


def described(figure: Figure, text: str) -> Image:
    """A figure as a picture with alternative text. It must be the last expression of its cell. The figure is closed.

    Args:
        text: what to see in the figure, for readers who do not see it.

    Raises:
        ValueError: the text is empty.
    """
    _check(text)
    content = io.BytesIO()
    figure.savefig(content, format="png", bbox_inches="tight")
    plt.close(figure)
    return Image(with_palette(content.getvalue()), format="png", alt=text)


def with_palette(png: bytes) -> bytes:
    """A still PNG with `FIGURE_COLORS` colours, chosen for this picture."""
    picture = Pillow.open(io.BytesIO(png)).convert("RGB")
    # Colours far apart, not the most frequent ones: a small pink block must stay pink, and a colour bar smooth.
    few = picture.quantize(FIGURE_COLORS, Pillow.Quantize.MAXCOVERAGE, kmeans=1, dither=Pillow.Dither.NONE)
    content = io.BytesIO()
    few.save(content, "PNG", optimize=True)
    return content.getvalue()


def frame(figure: Figure, dpi: int = 72) -> np.ndarray:
    """(H, W, 3) uint8: a figure as a frame for `animated`. The figure is closed."""
    figure.set_dpi(dpi)
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]
    plt.close(figure)
    return pixels


def animated(frames: Sequence[np.ndarray], text: str, seconds: float = 0.15) -> MovingPicture:
    """Frames as one moving picture with alternative text: an animated PNG, which every browser plays in a loop.

    It must be the last expression of its cell.

    Args:
        frames: (H, W, 3) uint8 each, all of one size, at least two.
        text: what to see, for readers who do not see it.
        seconds: how long each frame stays.

    Raises:
        ValueError: the text is empty, there are fewer than two frames, or their sizes differ.
    """
    _check(text)
    sizes = {tuple(picture.shape) for picture in frames}
    if len(frames) < 2 or len(sizes) != 1:
        raise ValueError(f"frames must be two or more pictures of one size, got {len(frames)} of the sizes {sizes}")
    # All frames share one palette: what does not move then has the same value in each, and takes no space.
    strip = Pillow.fromarray(np.concatenate(frames)).quantize(
        COLORS, Pillow.Quantize.FASTOCTREE, dither=Pillow.Dither.NONE
    )
    height = frames[0].shape[0]
    pictures = [strip.crop((0, i * height, strip.width, (i + 1) * height)) for i in range(len(frames))]
    content = io.BytesIO()
    pictures[0].save(
        content, "PNG", save_all=True, append_images=pictures[1:], duration=round(1000 * seconds), loop=0, optimize=True
    )
    return MovingPicture(Image(content.getvalue(), format="png", alt=text))


def _check(text: str) -> None:
    if not text.strip():
        raise ValueError("text must say what to see in the picture, got an empty one")
