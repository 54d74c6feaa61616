"""Marks on the table: what Python checks of them. tests/browser/mark_action.py clicks in a real browser."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
import traitlets

from gem_lite.actions import PickPlace
from gem_lite.drawing.mark_action import MarkAction, show_marked
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace

ACTION = PickPlace(Pose2(0.4, 0.1, 0.5), Pose2(0.6, -0.2, -2.0))
SENTENCE = "put the red block in the blue bowl"


def table(workspace=None):
    workspace = workspace or Workspace()
    rgb = np.random.default_rng(0).integers(0, 255, (*workspace.shape, 3), np.uint8)
    return HeightMap(workspace, rgb, np.zeros(workspace.shape, np.float32), np.ones(workspace.shape, bool))


def press_keep(widget):
    """What the script sends."""
    widget.set_state({"kept": {"pick": widget.pick, "place": widget.place, "sentence": widget.sentence}})


def test_the_script_gets_what_it_needs_for_metres_and_the_colours_row_by_row():
    heightmap = table()
    widget = MarkAction(heightmap, ACTION)
    sent = widget.table
    assert sent == {"rows": 160, "cols": 80, "x_min": 0.25, "y_max": 0.5, "cell": 0.00625, "scale": 4}
    # The centre of cell (30, 10), as toMetres of the script computes it, and as the library does.
    script = (sent["x_min"] + 10.5 * sent["cell"], sent["y_max"] - 30.5 * sent["cell"])
    assert script == pytest.approx(heightmap.workspace.to_world(30, 10))
    rgb = np.frombuffer(widget.rgb, np.uint8).reshape(160, 80, 3)
    np.testing.assert_array_equal(rgb, heightmap.rgb)
    assert widget.action == ACTION
    for length, scale in ((0.6, 6), (5.0, 1)):
        assert MarkAction(table(Workspace.of_length(length))).table["scale"] == scale, "whole pixels for each cell"


def test_a_missing_mark_is_named():
    widget = MarkAction(table())
    with pytest.raises(ValueError, match="the pick is not marked yet"):
        _ = widget.action
    widget.pick = [0.4, 0.1, 0]
    with pytest.raises(ValueError, match="the place is not marked yet"):
        _ = widget.action
    widget.place = [0.6, -0.2, 0]
    assert widget.action == PickPlace(Pose2(0.4, 0.1), Pose2(0.6, -0.2))


@pytest.mark.parametrize(
    ("mark", "sentence"),
    [(mark, "outside the table") for mark in ([0.1, 0, 0], [0.4, 0.6, 0], [0.75, 0, 0], [0.4, -0.5, 0])]
    + [(mark, "place must be") for mark in ([0.4], [0.4, 0.1, math.nan], [0.4, 0.1, None], ["0.4", "0.1", "0"])],
)
def test_a_mark_is_three_numbers_on_the_table(mark, sentence):
    widget = MarkAction(table(), ACTION)
    with pytest.raises(traitlets.TraitError, match=sentence):
        widget.place = mark
    assert widget.action == ACTION


def test_keep_hands_the_action_over_once_and_a_refusal_is_shown():
    kept = []
    widget = MarkAction(table(), ACTION, SENTENCE)
    widget.on_keep(lambda *got: kept.append(got))
    assert not widget.is_kept
    press_keep(widget)
    press_keep(widget)
    assert kept == [(ACTION, SENTENCE)]
    assert widget.is_kept
    widget.place = [0.5, 0, 0]
    assert not widget.is_kept
    press_keep(widget)
    assert kept[1:] == [(PickPlace(ACTION.pick, Pose2(0.5, 0)), SENTENCE)]

    for error in (ValueError("the bowl has no colour"), PermissionError("the folder cannot be written")):

        def refuse(action, sentence, error=error):
            raise error

        refused = MarkAction(table(), ACTION, SENTENCE)
        refused.on_keep(refuse)
        press_keep(refused)
        assert refused.problem == str(error) and not refused.is_kept


def test_a_stored_copy_says_what_to_do_and_a_still_picture_shows_both_marks_and_the_sentence():
    bundle, _ = MarkAction(table())._repr_mimebundle_()
    assert "live notebook" in bundle["text/plain"]
    sentence = r"put the $5 bill beside the $\foo$ bill"
    figure = show_marked(table(), ACTION, sentence)
    figure.canvas.draw()  # No part of a sentence is a formula.
    assert figure.get_suptitle() == f'"{sentence}"'
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["pick", "place"]
    plt.close(figure)
