"""The drawings of the learning lessons: what is drawn where, and that every panel is there."""

import io

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from drawings import pictures, plot_pick, plot_place, plot_results
from failures import Failure
from PIL import Image
from summaries import Score

from gem_lite.actions import PickPlace
from gem_lite.policies.choosing import Choice
from gem_lite.policies.inputs import RGBD, Sample
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace

W = Workspace()
POSE = Pose2(*W.to_world(40, 20), 0.3)


@pytest.fixture(autouse=True)
def close():
    yield
    plt.close("all")


def cells(*means):
    return [Score(np.zeros((1, 4)), mean, (mean - 5, mean + 5), 100.0, (0, 1, 2, 3)) for mean in means]


def sample(pick_map):
    semantic = torch.full((1, *W.shape), pick_map)
    return Sample(
        rgbd=torch.zeros(RGBD, *W.shape), maps={"pick": semantic}, pick=(40.0, 20.0), place=(80.0, 40.0),
        pick_yaw=0.3, delta=0.0, pick_symmetry=0.0, place_symmetry=0.0,
    )  # fmt: skip


def test_samples_show_picture_map_and_label():
    fig = plot_pick.show_samples([sample(0.2), sample(0.8)], W)
    upper, lower = np.array(fig.axes[:4]).reshape(2, 2)
    assert [ax.images[0].get_array().shape for ax in upper] == [(*W.shape, 3)] * 2
    assert [float(ax.images[0].get_array()[0, 0]) for ax in lower] == pytest.approx([0.2, 0.8])
    for ax in (*upper, *lower):
        x, y = ax.lines[0].get_xydata().mean(axis=0)  # the cross's long arm lies about the label's pixel
        assert (y, x) == pytest.approx((40, 20), abs=0.01)


def test_a_crop_shows_each_colour_in_its_own_colour():
    crop = torch.zeros(5, 17, 17)
    crop[0] = 0.5  # red above the table's grey
    shown = [ax.images[0].get_array() for ax in plot_place.show_crop(crop).axes[:5]]
    for channel in range(3):
        others = [c for c in range(3) if c != channel]
        assert not np.any(shown[channel][..., others]) and np.all(shown[channel][..., channel] > 0)
    assert shown[0].max() > shown[1].max() == shown[2].max()
    assert shown[3].shape == shown[4].shape == (17, 17)


def test_stages_keep_pictures_and_maps_apart():
    fig = plot_pick.show_stages([("colour", np.zeros((4, 4, 3))), ("map", np.eye(4)), ("score", np.eye(4))])
    panels = [ax for ax in fig.axes if ax.get_title()]
    assert [ax.get_title() for ax in panels] == ["colour", "map", "score"]
    assert panels[1].images[0].get_clim() == (-1.0, 1.0) and panels[2].images[0].get_cmap().name == "viridis"


def test_loss_shows_its_levels_and_a_running_mean():
    fig = plot_pick.show_loss(list(range(40)), {"floor": 1.5}, window=20)
    mean = next(line for line in fig.axes[0].lines if "mean" in str(line.get_label()))
    assert mean.get_ydata()[0] == pytest.approx(9.5) and mean.get_xdata()[0] == 19


def test_yaws_are_folded_by_the_symmetry():
    fig = plot_pick.show_yaws(np.radians([10.0, 200.0]), {"one": np.radians([190.0, 20.0])}, np.pi)
    drawn = fig.axes[0].lines[1]
    assert np.allclose(drawn.get_xdata(), [10, 20]) and np.allclose(drawn.get_ydata(), [10, 20])


def test_choices_mark_the_pick_in_scene_and_map():
    logits = np.zeros((36, *W.shape), np.float32)
    fig = plot_pick.show_choices([("a", np.zeros((*W.shape, 3)), logits, POSE)], W)
    ring = fig.axes[1].lines[-1]
    assert (ring.get_xdata()[0], ring.get_ydata()[0]) == pytest.approx((20, 40), abs=0.5)


def test_the_rule_is_outlined_and_both_picks_are_in_sight():
    semantic, allowed = np.zeros(W.shape), np.zeros(W.shape, bool)
    allowed[35:45, 15:25] = True
    other = Pose2(POSE.x - 0.2, POSE.y, 0.0)
    fig = plot_pick.show_peak_rule([("a", np.zeros((*W.shape, 3)), semantic, allowed, other, POSE)], W)
    above, below = fig.axes[:2]
    assert len(below.collections) == 1, "the outline"
    for ax in (above, below):
        for pose in (other, POSE):
            row, col = W.to_pixel(pose.x, pose.y)
            assert ax.get_xlim()[0] < col < ax.get_xlim()[1] and ax.get_ylim()[1] < row < ax.get_ylim()[0]
    labels = [text.get_text() for text in below.get_legend().get_texts()]
    assert labels == ["allowed cells", "without the rule", "with the rule"]


def test_losses_are_smoothed_and_have_a_colour_for_each_method():
    fig = plot_results.show_losses({"gem": np.ones((60, 2)), "cliport": 2 * np.ones((60, 2))}, (1.0, 1.5), window=10)
    lines = {line.get_label(): line for line in fig.axes[0].lines}
    assert len(lines["gem"].get_ydata()) == 51 and np.allclose(lines["cliport"].get_ydata(), 2)
    assert lines["gem"].get_color() != lines["cliport"].get_color()


def test_samples_show_recoloured_picture_and_true_map():
    rgbd, semantic = torch.zeros(RGBD, *W.shape), torch.zeros(1, *W.shape)
    rgbd[0, 5, 7], semantic[0, 5, 7] = 0.5, 1.0
    sample = Sample(
        rgbd=rgbd, maps={"pick": semantic}, pick=(5, 7), place=(9, 9), pick_yaw=0.0, delta=0.0, pick_symmetry=0.0,
        place_symmetry=0.0,
    )  # fmt: skip
    fig = plot_results.show_samples([sample] * 2, ["one", "two"])
    assert [ax.get_title() for ax in fig.axes if ax.get_title()] == ["one", "two"]
    pictures = [ax.images[0].get_array() for ax in fig.axes]
    assert np.allclose(pictures[0][5, 7], [0.7, 0.2, 0.2]) and pictures[-1][5, 7] == 1
    assert fig.axes[0].lines[0].get_xydata().tolist() == [[7, 5]]


def test_cells_are_dots_in_the_given_order():
    low, middle, high = cells(30, 60, 90)
    fig = plot_results.show_dots({"seen": {"whole": high, "less": middle}, "unseen": {"whole": low}})
    ax = fig.axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["whole", "less"]
    means = [drawn.lines[0].get_xdata().tolist() for drawn in ax.containers]
    assert means == [[90, 60], [30]]
    assert ax.containers[0].lines[2][0].get_segments()[1][:, 0].tolist() == [55, 65]
    assert ax.get_ylim()[0] > ax.get_ylim()[1], "the first name must be the upper one"


def test_failures_show_scene_maps_and_reason():
    heightmap = HeightMap(W, np.zeros((*W.shape, 3), np.uint8), np.zeros(W.shape, np.float32), np.ones(W.shape, bool))
    logits = np.zeros((36, *W.shape), np.float32)
    choice = Choice("put it there", None, heightmap, logits, logits, (0, 0, 0), (0, 0, 0), PickPlace(POSE, POSE))
    fig = plot_results.show_failures([("one", Failure(3, 1, choice, "grasped nothing"))] * 5, columns=4)
    shown = [ax for ax in fig.axes if ax.images]
    assert len(shown) == 15 and "grasped nothing" in fig.subfigs[0].get_supxlabel()


def test_deltas_stay_beside_the_diagonal_across_180_degrees():
    right, predicted = np.radians([10.0, 178.0, -90.0]), np.radians([15.0, -177.0, 90.0])
    ax = plot_place.show_deltas([("one", right, predicted)], [0.0]).axes[0]
    drawn = next(line for line in ax.lines if line.get_marker() == "o")
    assert np.allclose(drawn.get_xdata(), [10, 178, -90])
    assert np.allclose(np.abs(drawn.get_ydata() - drawn.get_xdata()), [5, 5, 180])


def test_actions_and_closeups_show_every_panel():
    heightmap = HeightMap(W, np.zeros((*W.shape, 3), np.uint8), np.zeros(W.shape, np.float32), np.ones(W.shape, bool))
    logits = np.random.default_rng(0).random((36, *W.shape)).astype(np.float32)
    shown = plot_place.ActionColumn("one", heightmap, PickPlace(POSE, POSE), logits)
    fig = plot_place.show_actions([shown] * 3)
    assert sum(bool(ax.images) for ax in fig.axes) >= 6 and [ax.get_title() for ax in fig.axes[:3]] == ["one"] * 3
    fig = plot_place.show_closeups([plot_place.CloseUp("two", heightmap, POSE, POSE)] * 2)
    assert [ax.get_title() for ax in fig.axes[:2]] == ["two"] * 2 and sum(bool(ax.images) for ax in fig.axes) >= 4


def test_a_picture_has_its_text_and_its_figure_is_closed():
    figure, _ = plt.subplots()
    picture = pictures.described(figure, "an empty diagram")
    assert picture._repr_png_()[1] == {"alt": "an empty diagram"}
    assert not plt.fignum_exists(figure.number)
    with pytest.raises(ValueError, match="text must say what to see"):
        pictures.described(plt.figure(), " ")


def test_a_moving_picture_keeps_its_frames():
    frames = [np.full((20, 30, 3), value, np.uint8) for value in (0, 90, 255)]
    picture = pictures.animated(frames, "it becomes bright", seconds=0.2)
    film = Image.open(io.BytesIO(picture.image.data))
    assert (film.n_frames, film.size, film.info["duration"]) == (3, (30, 20), 200)
    shown = []
    for number in range(3):
        film.seek(number)
        shown.append(int(np.asarray(film.convert("RGB")).mean()))
    assert shown == [0, 90, 255]


def test_a_moving_picture_comes_with_the_place_of_its_slider(monkeypatch):
    shown = []
    monkeypatch.setattr(pictures, "display", shown.append)
    pictures.animated([np.zeros((4, 4, 3), np.uint8)] * 2, "two frames")._ipython_display_()
    image, slider = shown
    assert image._repr_png_()[1] == {"alt": "two frames"}
    assert 'class="gem-slider"' in slider.data and "ImageDecoder" in slider.data


def test_frames_of_one_size_are_needed():
    with pytest.raises(ValueError, match="two or more pictures of one size, got 2"):
        pictures.animated([np.zeros((4, 4, 3), np.uint8), np.zeros((5, 4, 3), np.uint8)], "two sizes")
