"""Marks in a camera's picture: what Python checks of them. tests/browser/mark_pixels.py clicks in a real browser."""

import numpy as np
import pytest
import traitlets

from gem_lite.drawing.mark_pixels import MarkPixels
from gem_lite.rgbd import png


def picture():
    return np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)


def test_the_script_gets_the_picture_and_its_size():
    rgb = picture()
    widget = MarkPixels(rgb, 4)
    np.testing.assert_array_equal(png.decode(widget.picture, 3, np.uint8, "picture"), rgb)
    assert (widget.size, widget.count, widget.pixels) == ([48, 64], 4, [])


def test_the_numbers_are_those_that_set_up_takes_once_all_points_are_marked():
    widget = MarkPixels(picture())
    for pixels, marked in (([], 0), ([[3, 4]], 1)):
        widget.set_state({"pixels": pixels})
        with pytest.raises(ValueError, match=f"^{marked} of 2 points are marked"):
            _ = widget.numbers
    widget.set_state({"pixels": [[3, 4], [63, 47]]})
    assert widget.numbers == "3 4 63 47"


@pytest.mark.parametrize(
    ("pixels", "sentence"),
    [([pixel], "within 64 x 48") for pixel in ([64, 0], [0, 48], [-1, 0], [1.5, 2], [1], [True, 1], "12", None)]
    + [([[0, 0], [1, 1], [2, 2]], "there are 2 points to mark, got 3")],
)
def test_a_point_is_a_whole_pixel_of_the_picture(pixels, sentence):
    widget = MarkPixels(picture())
    widget.pixels = [[1, 2]]
    with pytest.raises(traitlets.TraitError, match=sentence):
        widget.pixels = pixels
    assert widget.pixels == [[1, 2]]


@pytest.mark.parametrize(
    ("rgb", "count", "sentence"),
    [
        (np.zeros((4, 4), np.uint8), 2, r"rgb must be \(H, W, 3\) uint8, got \(4, 4\)"),
        (np.zeros((4, 4, 3)), 2, "got .* float64"),
        (np.zeros((4, 4, 3), np.uint8), 0, "count must be 1 or more, got 0"),
    ],
)
def test_what_cannot_be_marked_is_refused(rgb, count, sentence):
    with pytest.raises(ValueError, match=sentence):
        MarkPixels(rgb, count)


def test_a_stored_copy_says_what_to_do():
    bundle, _ = MarkPixels(picture())._repr_mimebundle_()
    assert "live notebook" in bundle["text/plain"]
