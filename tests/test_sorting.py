"""object-sorting: its symbols, the CLIP words for them, measuring over several tables, and the drawings."""

import json
import math
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pose_errors
import pytest
import torch
from drawings import plot_mobile
from summaries import Score
from tabletop import distance, lay_out

from gem_lite import clip, tasks
from gem_lite.evaluation import actors, evaluate, results, table_poses
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.table_poses import Condition
from gem_lite.policies.choosing import near_peak
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.inputs import HEIGHT_SCALE
from gem_lite.rgbd import table_pose, tags
from gem_lite.rgbd.camera import camera_looking_at
from gem_lite.se2 import Pose2
from gem_lite.simulation import mobile_world
from gem_lite.simulation.mobile_world import MobileWorld, side_by_side
from gem_lite.tasks import object_sorting

MOBILE = LITE.on_table(1.06)


@pytest.fixture(scope="module")
def world():
    with MobileWorld(side_by_side(2)) as world:
        yield world


@pytest.fixture(scope="module")
def policy():
    return Gem(MOBILE, clip.load(), seed=0)


@pytest.fixture(scope="module")
def seen(world):
    """(observations, sentence): the beginning of an episode."""
    task = tasks.make("object-sorting-seen", "val")
    return world.reset(task, tasks.episode_seed("val", 0)), task.instruction


@pytest.fixture
def begun(world):
    """The world at the same beginning, the base at the first table."""
    lay_out(world, "object-sorting-seen")
    world.drive(0)
    return world


@pytest.fixture(autouse=True)
def close():
    yield
    plt.close("all")


@pytest.mark.parametrize("symbol", object_sorting.SYMBOLS)
def test_symbols_fit_their_paper_and_differ(symbol):
    shape = object_sorting.symbol_outline(symbol)
    x0, y0, x1, y1 = shape.bounds
    assert max(x1 - x0, y1 - y0) == pytest.approx(object_sorting.SYMBOL_SIDE) and shape.is_valid
    assert (x0 + x1, y0 + y1) == pytest.approx((0, 0), abs=1e-9)
    others = [object_sorting.symbol_outline(other) for other in object_sorting.SYMBOLS if other != symbol]
    assert min(shape.symmetric_difference(other).area for other in others) > 0.15 * shape.area
    with pytest.raises(ValueError, match="symbol must be one of recycle, gear"):
        object_sorting.symbol_outline("skull")


def test_a_table_of_another_length_keeps_its_pixels_and_weights(policy):
    assert MOBILE.workspace.shape == LITE.workspace.shape and MOBILE.pixel == pytest.approx(0.006625)
    assert LITE.on_table(1.0) == LITE
    assert MOBILE.workspace.length == pytest.approx(1.06)
    one = Gem(LITE, policy.clip, seed=0)
    assert all(torch.equal(a, b) for a, b in zip(one.pick.parameters(), policy.pick.parameters(), strict=True))


def test_a_camera_looks_where_it_is_told():
    camera = camera_looking_at("one", (1.0, 2.0, 0.5), (0.0, 0.0, 0.0))
    ray = camera.rotation[:, 2]
    assert np.allclose(ray, np.array([-1.0, -2.0, -0.5]) / math.sqrt(5.25))
    assert camera.rotation[2, 0] == pytest.approx(0) and camera.rotation[2, 1] < 0  # level, and down is down
    assert np.linalg.det(camera.rotation) == pytest.approx(1)


@pytest.mark.parametrize("index", [6, 51])  # whose ducks cannot stand
def test_what_cannot_stand_has_fallen_before_anyone_looks(world, index):
    world.begin(tasks.make("object-sorting-seen", "test"), tasks.episode_seed("test", index))
    before = {body: world.pose(body)[0] for body in world.bodies}
    world.wait(2.0)
    assert all(distance(world.pose(body)[0], old) < 0.015 for body, old in before.items())


@pytest.mark.release
def test_every_condition_acts_on_one_choice_from_the_same_start(world, policy, monkeypatch):
    looks, acts = [], []
    observe, step = MobileWorld.observe, MobileWorld.step
    monkeypatch.setattr(MobileWorld, "observe", lambda self: looks.append(observe(self)) or looks[-1])
    monkeypatch.setattr(
        MobileWorld, "step", lambda self, action, **more: acts.append(action) or step(self, action, **more)
    )
    conditions = [Condition("tags"), Condition("truth"), Condition("truth", 0.3)]
    actor = actors.policy_actor(policy)
    found = evaluate.run_conditions(world, actor, "object-sorting-seen", "val", 0, conditions)
    assert len(looks) == 1 and acts == acts[:1] * 3
    assert [(episode.index, episode.condition) for episode in found] == [(0, condition) for condition in conditions]
    assert found[0].reward == found[1].reward or any(episode.error for episode in found)


def test_a_table_not_found_counts_as_a_failure(world, policy, monkeypatch):
    def lost(world, table):
        raise tags.LocalisationError("nowhere")

    monkeypatch.setattr(mobile_world, "localise", lost)
    actor = actors.policy_actor(policy)
    (found,) = evaluate.run_conditions(world, actor, "object-sorting-seen", "val", 0, [Condition("tags")])
    assert (found.reward, found.error) == (0.0, "nowhere")


def test_injected_errors_have_their_size(begun):
    find = Condition("truth", 0.03, math.radians(4)).finder(np.random.default_rng(0))
    middle, sides = Pose2(0.5, 0.0), set()
    for _ in range(8):
        estimate = find(begun, 1) @ middle
        true = begun.true_table(1) @ middle
        assert distance(estimate, true) == pytest.approx(0.03)
        sides.add(round(math.degrees(estimate.yaw - true.yaw)))
    assert sides == {-4, 4}


OFF = Condition("tags", 0.02)


def played(by_tags, off):
    """Episodes with these rewards: found by tags, and with an injected error."""
    return [
        Episode(index, reward, 1, (), condition=condition)
        for condition, rewards in ((Condition("tags"), by_tags), (OFF, off))
        for index, reward in enumerate(rewards)
    ]


def test_a_row_for_each_condition():
    first, second = evaluate.rows_of("gem", "object-sorting-seen", played([1.0, 1.0], [0.0, 1.0]), {})
    assert (first["mean"], second["mean"]) == (100.0, 50.0) and second["shift"] == 0.02
    assert second["rewards"] == {"0": 0.0, "1": 1.0} and first["method"] == "gem"
    assert json.dumps(first)


def test_a_filed_row_is_read_again(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    task, path = "object-sorting-seen", tmp_path / "object-sorting.jsonl"
    found = played([1.0] * 12, [1.0] * 5 + [0.0] * 7)
    facts = {"tables": 2, "world": "home", "split": "test", "start": 0}
    facts |= results.policy_entries(None, LITE) | {"train_cpu_seconds": 9.0}
    results.file_rows(evaluate.rows_of("gem", task, found, facts), path, table_poses.IDENTITY)
    score = pose_errors.score(task, OFF)
    assert score.rewards.tolist() == [[1.0] * 5 + [0.0] * 7] and score.mean == pytest.approx(41.7)
    with pytest.raises(LookupError, match=r"no row with .*poses truth.* There are: .*poses tags, shift 0\.02"):
        pose_errors.score(task, Condition("truth"))
    elsewhere = evaluate.rows_of("gem", "object-sorting-unseen", found, facts | {"world": "shadows"})
    results.file_rows(elsewhere, path, table_poses.IDENTITY)
    with pytest.raises(LookupError, match=r"no row with .*world home"):
        pose_errors.score("object-sorting-unseen", OFF)
    with pytest.raises(ValueError, match=r"holds a row over 12 episodes .*shift 0\.02"):
        short = evaluate.rows_of("gem", task, found[-3:], facts)
        results.file_rows(short, path, table_poses.IDENTITY)


def test_the_pick_lies_near_the_peak_of_all_tables_maps(seen, policy):
    choice = policy.decide_over(*seen)
    semantic = choice.inputs.maps["pick"][:, 0]
    height = HEIGHT_SCALE * choice.inputs.rgbd[:, 3]
    near = near_peak(semantic, height, torch.ones_like(semantic, dtype=torch.bool), MOBILE)
    row, col = (round(i) for i in MOBILE.workspace.to_pixel(choice.pick.x, choice.pick.y))
    assert near[choice.pick_table, row, col] and near.float().mean() < 0.1


def test_stitched_figure_marks_pick_and_place_on_their_tables(seen):
    free = Gem(replace(MOBILE, peak_margin=None), clip.load(), seed=0)
    choice = free.decide_over(*seen)
    fig = plot_mobile.show_stitched(choice, "some CLIP")
    shown = [ax for ax in fig.axes if ax.get_title()]
    assert len(shown) == 5 and all(ax.images[0].get_array().shape[:2] == (160, 160) for ax in shown)
    for ax, table, pose in ((shown[2], choice.pick_table, choice.pick), (shown[4], choice.place_table, choice.place)):
        ring = next(line for line in ax.lines if line.get_marker() == "o")
        row, col = MOBILE.workspace.to_pixel(pose.x, pose.y)
        assert (ring.get_xdata()[0], ring.get_ydata()[0]) == pytest.approx((col + 80 * table, row))
        assert ax.images[0].get_array()[round(row), round(col) + 80 * table] == 0  # the best logit is there


def test_a_tag_on_the_table_gives_the_cameras_pose_and_is_drawn(begun):
    view = begun.look()
    pixels, places = table_pose.tag_points(view.rgb, begun.tags[0], tags.TAG_SIDE, begun.tag)
    plane = table_pose.table_planes(view.depth, view.camera.intrinsics, pixels)[0]
    found = np.array(table_pose.pose_from_points(plane, pixels, places, view.camera.intrinsics).pose)
    table = begun.true_table(0)
    base_from_table = np.eye(4)
    base_from_table[:2, :2] = [[np.cos(table.yaw), -np.sin(table.yaw)], [np.sin(table.yaw), np.cos(table.yaw)]]
    base_from_table[:2, 3] = table.x, table.y
    expected = np.linalg.inv(base_from_table) @ np.array(view.camera.pose)  # heights count from the tables' tops
    assert np.allclose(found[:3, 3], expected[:3, 3], atol=0.01)
    assert np.allclose(found[:3, :3], expected[:3, :3], atol=0.01)
    with pytest.raises(tags.LocalisationError, match="tag 500 is not in the picture"):
        tags.tag_corners(view.rgb, 500)
    away = np.ones(MOBILE.workspace.shape)
    fig = plot_mobile.show_localisation(view, tags.find_tags(view.rgb)[0], away, MOBILE.workspace, begun.tag)
    assert len(fig.axes[0].texts) == 4 and fig.axes[1].images[0].get_array().shape == (160, 80)
    assert plot_mobile.photograph(begun).shape == (480, 640, 3)


def test_curves_are_drawn():
    cells = {size: Score(np.zeros((1, 4)), 90 - size, (80 - size, 95 - size), None, (0, 1, 2, 3)) for size in (0, 2, 4)}
    robot = {"seen": cells[0], "unseen": cells[4]}
    fig = plot_mobile.show_error_curves({"shift (cm)": {"seen": cells}, "turn (°)": {"seen": cells}}, robot)
    assert [ax.get_xlabel() for ax in fig.axes] == ["shift (cm)", "turn (°)", "error not known"]
    assert list(fig.axes[0].containers[0].lines[0].get_ydata()) == [90, 88, 86]
    # The robot's successes are drawn with their intervals, outside the curves.
    assert [drawn.lines[0].get_ydata()[0] for drawn in fig.axes[2].containers] == [90, 86]
    ends = [drawn.lines[2][0].get_segments()[0][:, 1].tolist() for drawn in fig.axes[2].containers]
    assert ends == [[80, 95], [76, 91]]
