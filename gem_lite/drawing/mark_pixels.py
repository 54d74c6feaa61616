"""A person marks pixels of a camera's picture: the points for ``gem-lite set-up clicks`` and ``corners``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets

from gem_lite.rgbd import png


class MarkPixels(anywidget.AnyWidget):
    """A camera's picture, in which a person marks points with a mouse, a finger or the keys.

    Each click marks a point, and dragging moves a point. A magnifying glass shows the point that was pressed last, and
    arrow keys move this point by a pixel. Run the cell that shows the widget before the cell that reads `numbers`.

    Attributes:
        count: how many points there can be.
        pixels: [x, y] of each point: whole pixels to the right and down from the first one, which is [0, 0].

    Raises:
        traitlets.TraitError: ``pixels`` gets other values than these, or points outside the picture.
    """

    _esm = Path(__file__).with_name("mark_pixels.js")

    picture = traitlets.Bytes().tag(sync=True)
    """A PNG file."""
    size = traitlets.List().tag(sync=True)
    """Height and width of the picture in pixels."""
    count = traitlets.Int().tag(sync=True)
    pixels = traitlets.List().tag(sync=True)

    def __init__(self, rgb: np.ndarray, count: int = 2) -> None:
        """Show a picture.

        Args:
            rgb: (H, W, 3) uint8 RGB.
            count: 2 for ``clicks``, 4 for ``corners``.

        Raises:
            ValueError: the picture has another shape or type, or there is nothing to mark.
        """
        if rgb.ndim != 3 or rgb.shape[2] != 3 or not rgb.size or rgb.dtype != np.uint8:
            raise ValueError(f"rgb must be (H, W, 3) uint8, got {rgb.shape} {rgb.dtype}")
        if count < 1:
            raise ValueError(f"count must be 1 or more, got {count}")
        super().__init__(picture=png.encode(rgb), size=list(rgb.shape[:2]), count=count)

    def __repr__(self) -> str:
        """What a stored copy of a notebook shows in the widget's place."""
        return "a camera's picture: run this cell in a live notebook to mark its pixels"

    @property
    def numbers(self) -> str:
        """The points as ``clicks`` and ``corners`` take them, such as "320 240 560 240".

        Raises:
            ValueError: not all points are marked yet.
        """
        if len(self.pixels) < self.count:
            raise ValueError(f"{len(self.pixels)} of {self.count} points are marked: click the others in the picture")
        return " ".join(str(number) for pixel in self.pixels for number in pixel)

    @traitlets.validate("pixels")
    def _check_pixels(self, proposal: dict[str, Any]) -> list[list[int]]:
        pixels = proposal["value"]
        height, width = self.size
        for pixel in pixels:
            whole = isinstance(pixel, list) and len(pixel) == 2 and all(type(number) is int for number in pixel)
            if not whole or not (0 <= pixel[0] < width and 0 <= pixel[1] < height):
                raise traitlets.TraitError(f"a pixel must be [x, y] within {width} x {height}, got {pixel}")
        if len(pixels) > self.count:
            raise traitlets.TraitError(f"there are {self.count} points to mark, got {len(pixels)}")
        return pixels
