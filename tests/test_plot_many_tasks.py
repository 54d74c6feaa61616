"""The drawings of lesson 10: what is drawn where, and that every panel is there."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawings import plot_many_tasks, plot_panels
from drawings.plot_many_tasks import Retrieval
from drawings.plot_panels import Panel

from gem_lite.actions import PickPlace, Push
from gem_lite.se2 import Pose2, Workspace
from gem_lite.steerable import disc

W = Workspace()
POSE, OTHER = Pose2(*W.to_world(40, 20), 0.3), Pose2(*W.to_world(80, 60), 0.0)
PICTURE = np.zeros((*W.shape, 3), np.uint8)
INSIDE = disc(17).numpy() > 0


@pytest.fixture(autouse=True)
def close():
    yield
    plt.close("all")


def test_panels_have_a_title_a_sentence_and_an_action():
    acting = Panel("bowls", "put the red block in a bowl", PICTURE, PickPlace(POSE, OTHER), "one")
    pushing = Panel("piles", "push it", PICTURE, Push(POSE, OTHER))
    fig = plot_panels.show_panels([acting, pushing, Panel("bare", "nothing", PICTURE)], W, columns=2)
    first, second, third, empty = fig.axes
    assert first.get_title().startswith('bowls\n"put the red block') and first.get_xlabel() == "one"
    row, col = (float(values.mean()) for values in reversed(first.lines[0].get_data()))
    assert (row, col) == pytest.approx((40, 20), abs=0.01)
    arrows = [text for text in second.texts if text.arrow_patch is not None]
    assert all(arrow.xy == pytest.approx((60, 80), abs=0.01) for arrow in arrows) and arrows
    assert len(third.lines) == 0 and third.images and not empty.images


def test_titles_have_the_same_number_of_lines_so_that_pictures_stand_in_a_row():
    short, long = Panel("a", "go", PICTURE), Panel("b", "put the red block in the yellow bowl on the left", PICTURE)
    titles = [ax.get_title() for ax in plot_panels.show_panels([short, long], W).axes[:2]]
    assert titles[0].count("\n") == titles[1].count("\n")


def test_shares_stand_in_a_row_for_each_task_around_the_equal_share():
    shares = {"one list": np.array([0.2, 0.8]), "even": np.array([0.49, 0.51])}
    ax = plot_many_tasks.show_shares(["a", "b"], shares, bound=0.02).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["a", "b"]
    assert [line.get_xdata().tolist() for line in ax.lines] == [[20, 80], [49, 51]]
    band = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert (band.x0, band.x1) == pytest.approx((48, 52))
    assert ax.get_ylim()[0] > ax.get_ylim()[1], "the first task must be the upper one"


def test_retrievals_say_where_there_is_no_crop():
    crop = np.full((20, 20, 3), 7, np.uint8)
    fig = plot_many_tasks.show_retrievals([Retrieval("spoon", (None, "nearest: fork"), (crop, "of another task"))])
    above, below = fig.axes
    assert [text.get_text() for text in above.texts] == ["no crop"] and not below.texts
    assert below.images[0].get_array().max() == 7 and "another task" in below.get_xlabel()


def test_kernels_of_a_channel_share_a_scale_and_the_outside_is_bare():
    kernels = np.ones((3, 2, 17, 17)) * np.array([1.0, -2.0, 4.0])[:, None, None, None]
    kernels[:, 1] *= 10
    fig = plot_many_tasks.show_phrase_kernels(["a", "b", "c"], kernels, INSIDE)
    drawn = [ax for ax in fig.axes if ax.images and ax.get_label() != "<colorbar>"]
    assert [ax.images[0].get_clim() for ax in drawn] == [(-4, 4)] * 3 + [(-40, 40)] * 3
    assert np.array_equal(np.ma.getmaskarray(drawn[0].images[0].get_array()), ~INSIDE)


def test_cosines_are_written_into_their_cells():
    ax = plot_many_tasks.show_cosines(["a", "b"], np.array([[1.0, -0.5], [-0.5, 1.0]]), "title").axes[0]
    assert [text.get_text() for text in ax.texts] == ["1.00", "-0.50", "-0.50", "1.00"]


def test_pairs_are_apart_by_their_grasp_with_the_levels_wanted():
    cosines, same = np.array([0.9, 1.0, -0.2]), np.array([True, True, False])
    panels = {"words": cosines, "trained": cosines}
    fig = plot_many_tasks.show_pairs(panels, same, levels=(0.8, 0.97), names=["a, b", "c, d", "e, f"])
    assert [ax.get_title() for ax in fig.axes] == ["words", "trained"]
    dots, mean, level, crosses, _, other_level = fig.axes[0].lines
    assert dots.get_xdata().tolist() == [0.9, 1.0] and crosses.get_xdata().tolist() == [-0.2]
    assert mean.get_xdata() == pytest.approx([0.95, 0.95])
    assert (level.get_xdata()[0], other_level.get_xdata()[0]) == (0.97, 0.8)
    written = [(text.get_text(), text.xy[0]) for text in fig.axes[1].texts]
    assert written == [("a, b", 0.9), ("c, d", 1.0), ("e, f", -0.2)] and not fig.axes[0].texts


def test_lent_kernels_show_the_pick_and_the_scores_over_the_yaw():
    scores = np.cos(np.arange(36))
    fig = plot_many_tasks.show_lent_kernels({"own": (POSE, scores), "other": (OTHER, scores)}, PICTURE, POSE, W)
    assert [ax.get_title() for ax in fig.axes[:2]] == ["own", "other"]
    assert fig.axes[0].get_xlim() == pytest.approx((7, 33), abs=0.01)
    assert np.allclose(fig.axes[2].lines[0].get_ydata(), scores - scores.max())


def test_a_moment_of_learning_has_all_kernels_and_marks_its_step():
    curves = {"same": np.array([0.0, 0.5]), "other": np.array([0.6, -0.5])}
    phrases = ["a", "b", "c", "d", "e", "f"]
    fig = plot_many_tasks.draw_learning(phrases, np.zeros((6, 17, 17)) + 1, INSIDE, curves, [0, 10], 1)
    assert [ax.get_title() for ax in fig.axes] == [*phrases, "after 10 steps"]
    marks = [line.get_xydata().tolist() for line in fig.axes[-1].lines if len(line.get_xdata()) == 1]
    assert marks == [[[10, 0.5]], [[10, -0.5]]]
