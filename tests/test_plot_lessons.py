"""The drawings of the learning lessons and of lesson 10: what is drawn where, and that every panel is there."""

import io
import json

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from drawings import (
    pictures,
    plot_many_tasks,
    plot_networks,
    plot_other_eyes,
    plot_overview,
    plot_panels,
    plot_pick,
    plot_picture_prompts,
    plot_place,
    plot_results,
)
from drawings.plot_panels import Panel
from matplotlib.colors import to_rgba
from PIL import Image
from summaries import Score

from gem_lite import clip
from gem_lite.actions import PickPlace, Push
from gem_lite.maps.patches import PatchEmbeddings, PatchGrid
from gem_lite.policies.inputs import RGBD, Sample
from gem_lite.rgbd.camera import View, camera_looking_at
from gem_lite.se2 import Pose2, Workspace
from gem_lite.steerable import disc

W = Workspace()
POSE, OTHER = Pose2(*W.to_world(40, 20), 0.3), Pose2(*W.to_world(80, 60), 0.0)
PICTURE = np.zeros((*W.shape, 3), np.uint8)
LOGITS = np.random.default_rng(0).random((36, *W.shape)).astype(np.float32)
INSIDE = disc(17).numpy() > 0


@pytest.fixture(autouse=True)
def close():
    yield
    plt.close("all")


def sample(rgbd, pick_map):
    return Sample(
        rgbd=rgbd, maps={"pick": pick_map}, pick=(40.0, 20.0), place=(80.0, 40.0), pick_yaw=0.3, delta=0.0,
        pick_symmetry=0.0, place_symmetry=0.0,
    )  # fmt: skip


def test_samples_show_picture_map_and_label():
    rgbd = torch.zeros(RGBD, *W.shape)
    rgbd[0, 5, 7] = 0.5
    samples = [sample(rgbd, torch.full((1, *W.shape), value)) for value in (0.2, 0.8)]
    upper, lower = np.array(plot_pick.show_samples(samples, W).axes[:4]).reshape(2, 2)
    assert [ax.images[0].get_array().shape for ax in upper] == [(*W.shape, 3)] * 2
    assert [float(ax.images[0].get_array()[0, 0]) for ax in lower] == pytest.approx([0.2, 0.8])
    for ax in (*upper, *lower):
        x, y = ax.lines[0].get_xydata().mean(axis=0)  # the cross's long arm lies about the label's pixel
        assert (y, x) == pytest.approx((40, 20), abs=0.01)
    axes = plot_results.show_samples(samples, ["one", "two"]).axes
    assert [ax.get_title() for ax in axes if ax.get_title()] == ["one", "two"]
    assert np.allclose(axes[0].images[0].get_array()[5, 7], [0.7, 0.2, 0.2])
    assert np.allclose(axes[-1].images[0].get_array(), 0.8)
    assert axes[0].lines[0].get_xydata().tolist() == [[20, 40]]


def test_a_crop_shows_each_colour_in_its_own_colour():
    crop = torch.zeros(5, 17, 17)
    crop[0] = 0.5  # red above the table's grey
    shown = [ax.images[0].get_array() for ax in plot_place.show_crop(crop).axes[:5]]
    for channel in range(3):
        others = [c for c in range(3) if c != channel]
        assert not np.any(shown[channel][..., others]) and np.all(shown[channel][..., channel] > 0)
    assert shown[0].max() > shown[1].max() == shown[2].max()
    assert shown[3].shape == shown[4].shape == (17, 17)


def test_losses_are_smoothed_and_have_a_colour_for_each_method():
    lines = plot_pick.show_loss(list(range(40)), {"floor": 1.5}, window=20).axes[0].lines
    mean = next(line for line in lines if "mean" in str(line.get_label()))
    assert mean.get_ydata()[0] == pytest.approx(9.5) and mean.get_xdata()[0] == 19
    fig = plot_results.show_losses({"gem": np.ones((60, 2)), "cliport": 2 * np.ones((60, 2))}, (1.0, 1.5), window=10)
    lines = {line.get_label(): line for line in fig.axes[0].lines}
    assert len(lines["gem"].get_ydata()) == 51 and np.allclose(lines["cliport"].get_ydata(), 2)
    assert lines["gem"].get_color() != lines["cliport"].get_color()


def test_yaws_are_folded_by_the_symmetry_and_deltas_stay_beside_the_diagonal():
    fig = plot_pick.show_yaws(np.radians([10.0, 200.0]), {"one": np.radians([190.0, 20.0])}, np.pi)
    assert np.allclose(fig.axes[0].lines[1].get_xydata(), [[10, 10], [20, 20]])
    right, predicted = np.radians([10.0, 178.0, -90.0]), np.radians([15.0, -177.0, 90.0])
    ax = plot_place.show_deltas([("one", right, predicted)], [0.0]).axes[0]
    drawn = next(line for line in ax.lines if line.get_marker() == "o")
    assert np.allclose(drawn.get_xdata(), [10, 178, -90])
    assert np.allclose(np.abs(drawn.get_ydata() - drawn.get_xdata()), [5, 5, 180])


def test_choices_mark_the_pick_in_scene_and_map():
    ring = plot_pick.show_choices([("a", PICTURE, LOGITS, POSE)], W).axes[1].lines[-1]
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
    labels = [text.get_text() for text in fig.legends[0].get_texts()]
    assert labels == ["allowed cells", "without the rule", "with the rule"]


def test_cells_are_dots_in_the_given_order():
    low, middle, high = (
        Score(np.zeros((1, 4)), mean, (mean - 5, mean + 5), 100.0, (0, 1, 2, 3)) for mean in (30, 60, 90)
    )
    ax = plot_results.show_dots({"seen": {"whole": high, "less": middle}, "unseen": {"whole": low}}).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["whole", "less"]
    assert [drawn.lines[0].get_xdata().tolist() for drawn in ax.containers] == [[90, 60], [30]]
    assert ax.containers[0].lines[2][0].get_segments()[1][:, 0].tolist() == [55, 65]
    assert ax.get_ylim()[0] > ax.get_ylim()[1], "the first name must be the upper one"


def test_a_picture_has_its_text_and_its_figure_is_closed():
    figure, _ = plt.subplots()
    picture = pictures.described(figure, "an empty diagram")
    assert picture._repr_png_()[1] == {"alt": "an empty diagram"}
    assert not plt.fignum_exists(figure.number)
    with pytest.raises(ValueError, match="text must say what to see"):
        pictures.described(plt.figure(), " ")


def test_a_stored_picture_has_few_colors_and_keeps_rare_ones():
    rng = np.random.default_rng(0)
    gray = rng.integers(0, 256, (200, 300, 1), dtype=np.uint8)
    picture = np.repeat(gray, 3, axis=2)
    blocks = {"pink": (255, 105, 180), "purple": (128, 0, 160), "green": (0, 158, 115)}
    for number, color in enumerate(blocks.values()):
        picture[10:16, 20 * number : 20 * number + 6] = color
    picture[100:110, :256] = plt.get_cmap("viridis")(np.arange(256), bytes=True)[None, :, :3]
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG")
    stored = Image.open(io.BytesIO(pictures.with_palette(content.getvalue())))
    assert stored.mode == "P" and len(stored.getcolors()) <= pictures.FIGURE_COLORS
    errors = np.abs(np.asarray(stored.convert("RGB")).astype(int) - picture).max(axis=2)
    for number, name in enumerate(blocks):
        assert errors[10:16, 20 * number : 20 * number + 6].max() < 20, f"a small {name} block keeps its color"
    assert errors[100:110, :256].max() < 20, "a color bar stays smooth"


def test_a_moving_picture_keeps_its_frames_and_comes_with_the_place_of_its_slider(monkeypatch):
    frames = [np.full((20, 30, 3), value, np.uint8) for value in (0, 90, 255)]
    picture = pictures.animated(frames, "it becomes bright", seconds=0.2)
    film = Image.open(io.BytesIO(picture.image.data))
    assert (film.n_frames, film.size, film.info["duration"]) == (3, (30, 20), 200)
    shown = []
    for number in range(3):
        film.seek(number)
        shown.append(int(np.asarray(film.convert("RGB")).mean()))
    assert shown == [0, 90, 255]
    displayed = []
    monkeypatch.setattr(pictures, "display", displayed.append)
    picture._ipython_display_()
    image, slider = displayed
    assert image._repr_png_()[1] == {"alt": "it becomes bright"}
    assert 'class="gem-slider"' in slider.data and "ImageDecoder" in slider.data
    with pytest.raises(ValueError, match="two or more pictures of one size, got 2"):
        pictures.animated([np.zeros((4, 4, 3), np.uint8), np.zeros((5, 4, 3), np.uint8)], "two sizes")


# Lesson 10


def test_panels_have_a_title_a_sentence_and_an_action():
    acting = Panel("bowls", "put the red block in the yellow bowl on the left", PICTURE, PickPlace(POSE, OTHER), "one")
    pushing = Panel("piles", "push it", PICTURE, Push(POSE, OTHER))
    fig = plot_panels.show_panels([acting, pushing, Panel("bare", "nothing", PICTURE)], W, columns=2)
    first, second, third, empty = fig.axes
    assert first.get_title().startswith('bowls\n"put the red block') and first.get_xlabel() == "one"
    assert first.get_title().count("\n") == second.get_title().count("\n"), "pictures must stand in a row"
    row, col = (float(values.mean()) for values in reversed(first.lines[0].get_data()))
    assert (row, col) == pytest.approx((40, 20), abs=0.01)
    arrows = [text for text in second.texts if text.arrow_patch is not None]
    assert all(arrow.xy == pytest.approx((60, 80), abs=0.01) for arrow in arrows) and arrows
    assert len(third.lines) == 0 and third.images and not empty.images


def test_shares_stand_in_a_row_for_each_task_around_the_equal_share():
    shares = {"one list": np.array([0.2, 0.8]), "even": np.array([0.49, 0.51])}
    ax = plot_many_tasks.show_shares(["a", "b"], shares, bound=0.02).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["a", "b"]
    assert [line.get_xdata().tolist() for line in ax.lines] == [[20, 80], [49, 51]]
    band = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert (band.x0, band.x1) == pytest.approx((48, 52))
    assert ax.get_ylim()[0] > ax.get_ylim()[1], "the first task must be the upper one"


def test_kernels_of_a_channel_share_a_scale_and_the_outside_is_bare():
    kernels = np.ones((3, 2, 17, 17)) * np.array([1.0, -2.0, 4.0])[:, None, None, None]
    kernels[:, 1] *= 10
    fig = plot_many_tasks.show_phrase_kernels(["a", "b", "c"], kernels, INSIDE)
    drawn = [ax for ax in fig.axes if ax.images and ax.get_label() != "<colorbar>"]
    assert [ax.images[0].get_clim() for ax in drawn] == [(-4, 4)] * 3 + [(-40, 40)] * 3
    assert np.array_equal(np.ma.getmaskarray(drawn[0].images[0].get_array()), ~INSIDE)
    ax = plot_many_tasks.show_cosines(["a", "b"], np.array([[1.0, -0.5], [-0.5, 1.0]]), "title").axes[0]
    assert [text.get_text() for text in ax.texts] == ["1.00", "-0.50", "-0.50", "1.00"]


def test_success_has_a_panel_for_each_level_and_a_line_through_the_means_of_each_method():
    rows = [
        {"method": method, "task": "first", "demos": demos, "mean": mean, "ci95": [mean - 5, mean + 5]}
        for method, demos, mean in (("gem", 6, 60.0), ("gem", 6, 70.0), ("gem", 60, 90.0), ("vima-like", 60, 20.0))
    ]
    fig = plot_picture_prompts.show_success(rows, {"first": "one", "second": "two"})
    first, second = fig.axes
    assert [first.get_title(), second.get_title()] == ["one", "two"]
    assert [tick.get_text() for tick in first.get_xticklabels()] == ["6", "60"]
    lines = [line.get_xydata().tolist() for line in first.lines if line.get_linestyle() == "-"]
    assert lines == [[[6, 65], [60, 90]], [[60, 20]]]
    assert [text.get_text() for text in fig.legends[0].get_texts()] == ["GEM", "rival after VIMA"]


def test_what_is_asked_for_has_a_box_a_cross_and_its_picture_in_one_colour():
    box = np.array([0.25, 0.5, 0.1, 0.2])
    panels = [
        plot_picture_prompts.Panel("table", PICTURE, "C1", box, prompt=PICTURE[:9, :9]),
        plot_picture_prompts.Panel("map", np.zeros(PICTURE.shape[:2]), "C2", peak=(7, 5)),
    ]
    table, semantic = plot_picture_prompts.show_maps("title", panels).axes[:2]
    assert [ax.get_title() for ax in (table, semantic)] == ["table", "map"]
    (corner,) = table.child_axes
    assert table.patches[0].get_edgecolor() == corner.spines["left"].get_edgecolor() == to_rgba("C1")
    assert semantic.lines[0].get_xydata().tolist() == [[5, 7]] and semantic.lines[0].get_color() == "C2"
    assert not table.lines and not semantic.patches and not semantic.child_axes


def test_weights_stand_on_their_things_and_a_cross_on_the_weighted_mean():
    boxes = np.array([[0.25, 0.5, 0.1, 0.2], [0.75, 0.5, 0.1, 0.2]])
    panels = [
        plot_picture_prompts.Weights("things", np.array([0.9, 0.1]), np.array([0.3, 0.5]), 0, "C0"),
        plot_picture_prompts.Weights("places", np.ones((3, 2)), boxes[1, :2], 1, "C1"),
    ]
    things, places = plot_picture_prompts.show_places(PICTURE, boxes, panels).axes
    for ax, colors in ((things, ["C0", "0.6"]), (places, ["0.6", "C1"])):
        assert [box.get_edgecolor() for box in ax.patches] == [to_rgba(color) for color in colors]
    assert [text.get_text() for text in things.texts] == ["0.90", "0.10"]
    height, width = PICTURE.shape[:2]
    assert things.lines[0].get_xydata().tolist() == [[0.5 * width, 0.3 * height]]
    corner, of_box = things.patches[0].get_xy(), boxes[0] * [height, width, height, width]
    assert corner == pytest.approx((of_box[1] - of_box[3] / 2 - 0.5, of_box[0] - of_box[2] / 2 - 0.5))
    assert float(places.images[0].get_array().max()) == 1


def test_success_by_map_source_has_a_mark_and_an_interval_for_each_task():
    success = {
        "patches": {"bowls": (100.0, 93.0, 100.0), "parts": (86.0, 60.0, 92.0)},
        "regions": {"bowls": (90.0, 80.0, 96.0), "parts": (30.0, 10.0, 55.0)},
    }
    figure = plot_other_eyes.show_success(success)
    ax = figure.axes[0]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["bowls", "parts"]
    for (marks, _, (bars,)), of_tasks in zip(ax.containers, success.values(), strict=True):
        assert marks.get_ydata().tolist() == [mean for mean, _, _ in of_tasks.values()]
        ends = [(line[:, 1].min(), line[:, 1].max()) for line in bars.get_segments()]
        assert ends == [pytest.approx(interval[1:]) for interval in of_tasks.values()]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(success)


def test_the_towers_show_the_embedded_clips_own_sizes():
    config = json.loads((clip.EMBEDDED / "config.json").read_text())
    text, image, sizes = config["text_config"], config["vision_config"], plot_networks.EMBEDDED
    assert (sizes.vocabulary, sizes.longest) == (text["vocab_size"], text["max_position_embeddings"])
    assert (sizes.text_layers, sizes.text_heads) == (text["num_hidden_layers"], text["num_attention_heads"])
    assert (sizes.text_width, sizes.dim) == (text["hidden_size"], config["projection_dim"])
    assert (sizes.pixels, sizes.image_width) == (image["image_size"], image["hidden_sizes"][-1])
    assert (len(image["depths"]), sum(image["depths"])) == (4, 5)
    # Each stage but the first halves the resolution, as does the first convolution, whose size is rounded up.
    assert sizes.features == (image["hidden_sizes"][-1], 3, 3)
    drawn = [
        text.get_text() for text in plot_networks.show_towers("red", ["<bos>", "Ġred"], PICTURE, 0.5).axes[0].texts
    ]
    assert {"(2, 128)", "(n, 512)", "(256, 3, 3)", "(50, 768)", "1,557 tokens"} <= set(drawn)


def test_the_pick_module_says_the_shapes_of_its_arrows():
    names = ("height", "raw map", "A", "M", "A ⊗ M")
    drawn_maps = {name: np.random.default_rng(1).random(W.shape) for name in names}
    drawn_maps |= {"colour": PICTURE, "kernel": np.ones((17, 17)), "scores": LOGITS}
    ax = plot_networks.show_pick_module(drawn_maps, 146, (16, 24, 32, 48)).axes[0]
    texts = {text.get_text() for text in ax.texts}
    assert {"(4, 160, 80)", "words (146,)", "(3, 17, 17)", "(36, 160, 80)"} <= texts


def test_the_stages_ring_the_best_pixel():
    axes = plot_pick.show_stages([("M", LOGITS[0])], [("kernel", np.ones((17, 17)))], LOGITS, W).axes
    ring = next(line for ax in axes for line in ax.lines if line.get_marker() == "o")
    _, row, col = np.unravel_index(LOGITS.argmax(), LOGITS.shape)
    assert (ring.get_xdata()[0], ring.get_ydata()[0]) == pytest.approx((col, row), abs=1e-6)


def test_the_semantic_module_says_the_shapes_of_its_arrows_and_writes_every_phrase():
    camera = camera_looking_at("front", (1.2, 0.0, 0.7), (0.5, 0.0, 0.0))
    view = View(camera, np.full((*camera.size, 3), 90, np.uint8), np.ones(camera.size, np.float32))
    grid = PatchGrid(camera.size, 20, 10)
    count = [len(starts) for starts in grid.starts()]
    side = PatchEmbeddings(grid, torch.zeros(*count, 8))
    top = PatchEmbeddings(PatchGrid(W.shape, 20, 5), torch.zeros(29, 13, 8))
    drawn_maps = {name: np.ones(W.shape) for name in ("text", "image", "blend")} | {"colour": PICTURE}
    crops = [(name, PICTURE[:20, :20]) for name in ("gizmo", "mug", "hat", "fork")]
    view_maps = [np.ones(camera.size)] * 3
    figure = plot_overview.show_semantic_module([view] * 3, [side] * 3, view_maps, drawn_maps, crops, "gizmo", top, W)
    texts = " ".join(text.get_text() for text in figure.axes[0].texts)
    expected = (f"({count[0]}, {count[1]}, 8)", "(29, 13, 8)", "(160, 80, 3)", "(1, 8)", "(4, 8)", "20 pixels")
    assert all(shape in texts for shape in expected)
    assert all(f'"{name}"' in texts for name, _ in crops)


def test_generalization_frames_demonstrations_and_tests_in_two_colours():
    panels = [Panel(f"panel {i}", "say", PICTURE, PickPlace(POSE, OTHER), f"note {i}") for i in range(3)]
    axes = plot_overview.show_generalization([("new colours", panels), ("new shapes", panels)], W).axes
    frames = [to_rgba(ax.spines["left"].get_edgecolor()) for ax in axes]
    yellow, green = map(to_rgba, (plot_overview.DEMONSTRATED, plot_overview.TESTED))
    assert frames == [yellow, green, green] * 2
    assert [ax.get_xlabel() for ax in axes] == [f"note {i}" for i in range(3)] * 2
