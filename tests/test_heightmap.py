"""Cameras and the fused height map."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from gem_lite.foundations import colors
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import FILLED, fill, fuse_views, sort_points
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.rendering import CAMERAS, render
from gem_lite.simulation.world import World

POSE = Pose2(0.48, 0.13, 0.6)
WORKSPACE = Workspace()


@pytest.fixture(scope="module")
def scene(world, stage):
    """(pose of a red block, its views, and which pixels of each view show the block)."""
    (block,), _ = stage(partial(shapes.add_block, color=colors.rgba("red"), pose=POSE))
    pictures = [render(world.client, camera, segmentation=True) for camera in CAMERAS]
    return world.pose(block)[0], [view for view, _ in pictures], [ids == block.id for _, ids in pictures]


@pytest.fixture(scope="module")
def fused(scene):
    return fuse_views(scene[1], WORKSPACE)


def block_cells(pose, inset=0.0):
    """(H, W) bool: cells whose centre lies at least ``inset`` metres inside the block's square."""
    rows, cols = np.indices(WORKSPACE.shape)
    x, y = WORKSPACE.to_world(rows, cols)
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    ahead, left = c * (x - pose.x) + s * (y - pose.y), -s * (x - pose.x) + c * (y - pose.y)
    return np.maximum(abs(ahead), abs(left)) <= shapes.BLOCK_SIZE / 2 - inset


@pytest.mark.parametrize("index", range(3), ids=[camera.name for camera in CAMERAS])
def test_each_camera_projects_the_block_back_to_where_it_lies(scene, index):
    pose, views, masks = scene
    points = views[index].points()[masks[index]]
    assert len(points) > 200
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    local = (points[:, :2] - [pose.x, pose.y]) @ np.array([[c, -s], [s, c]])
    # Nothing sticks out of the cube, and its whole top was seen.
    assert abs(local).max() < shapes.BLOCK_SIZE / 2 + 0.003
    top = local[points[:, 2] > shapes.BLOCK_SIZE - 0.003]
    assert np.percentile(top, 99, axis=0) == pytest.approx([0.02, 0.02], abs=0.003)
    assert np.percentile(top, 1, axis=0) == pytest.approx([-0.02, -0.02], abs=0.003)
    assert points[:, 2].max() == pytest.approx(shapes.BLOCK_SIZE, abs=0.002)
    # The table is at height zero.
    x, y, z = np.moveaxis(views[index].points(), -1, 0)
    table = (x > 0.3) & (x < 0.7) & (abs(y) < 0.45) & ~masks[index] & (np.hypot(x - POSE.x, y - POSE.y) > 0.05)
    assert table.sum() > 10_000
    assert abs(z[table]).max() < 0.003


def test_height_and_colour_of_block_and_table(scene, fused):
    pose = scene[0]
    assert fused.height.shape == WORKSPACE.shape == (160, 80)
    np.testing.assert_allclose(fused.height[block_cells(pose, inset=0.002)], 0.04, atol=0.002)
    np.testing.assert_allclose(fused.height[~block_cells(pose, inset=-0.01)], 0.0, atol=0.003)
    red, green, blue = np.moveaxis(fused.rgb.astype(int), -1, 0)
    assert (red - np.maximum(green, blue))[block_cells(pose, inset=0.004)].min() > 60
    assert (red - np.minimum(green, blue))[~block_cells(pose, inset=-0.012)].max() < 20


def test_small_holes_are_closed_and_the_rest_of_the_unseen_is_the_table():
    seen = np.zeros(WORKSPACE.shape, bool)
    seen[:, :40] = True
    seen[100, 20] = False
    block = np.zeros(WORKSPACE.shape, np.float32)
    block[95:105, 15:40] = 0.04  # up to the edge of what is seen
    filled = fill(np.where(seen, block, np.float32(np.nan)), seen, WORKSPACE)
    assert filled[100, 20] == np.float32(0.04)
    reach = round(FILLED / WORKSPACE.pixel)
    assert (filled[95:105, 40 : 40 + reach] == np.float32(0.04)).all()
    assert (filled[:, 40 + reach :] == 0).all(), "a block does not grow into the unseen"
    colors = np.dstack([block, block + 1, block + 2])
    np.testing.assert_array_equal(fill(colors, seen, WORKSPACE)[0, 79], [0, 1, 2])


def test_three_views_see_more_than_any_one_in_any_order(scene, fused):
    alone = [fuse_views([view], WORKSPACE) for view in scene[1]]
    assert fused.seen.sum() > max(single.seen.sum() for single in alone) and fused.seen.mean() > 0.98
    other = fuse_views(scene[1][::-1], WORKSPACE)
    assert np.array_equal(other.height, fused.height) and np.array_equal(other.seen, fused.seen)


def test_noise_does_not_lift_the_table_and_single_points_make_no_spikes(scene, fused):
    rng = np.random.default_rng(0)
    noisy, spiked = [], []
    for view in scene[1]:
        noise = rng.normal(0, 0.003, view.depth.shape).astype(np.float32)
        noisy.append(dataclasses.replace(view, depth=view.depth + noise))
        nearer = np.where(rng.random(view.depth.shape) < 0.002, np.float32(0.06), np.float32(0))
        spiked.append(dataclasses.replace(view, depth=view.depth - nearer))
    table = fused.seen & (fused.height < 0.001)
    highest = np.full(WORKSPACE.shape, -np.inf)
    for view in noisy:
        x, y, z = view.points()[WORKSPACE.contains(*np.moveaxis(view.points(), -1, 0)[:2])].T
        np.maximum.at(highest.ravel(), WORKSPACE.cells(x, y), z)
    lifted = fuse_views(noisy, WORKSPACE).height
    assert np.median(highest[table]) > 0.004 and np.median(lifted[table]) < 0.001
    spikes = [
        np.mean(abs(fuse_views(views, WORKSPACE).height - fused.height)[table] > 0.01) for views in (spiked, spiked[:1])
    ]
    assert spikes[0] < 0.001 and spikes[1] < 0.002


def test_labels_land_where_the_block_is(scene):
    pose, views, masks = scene
    labels = sort_points(views, WORKSPACE).project([mask.astype(np.float32) for mask in masks])
    assert labels.shape == WORKSPACE.shape
    assert labels[block_cells(pose, inset=0.004)].min() > 0.9
    assert labels[~block_cells(pose, inset=-0.012)].max() == 0.0
    with pytest.raises(ValueError, match="zip"):
        sort_points(views, WORKSPACE).project(masks[:2])
    with pytest.raises(ValueError, match="views is empty"):
        fuse_views([], WORKSPACE)


def test_a_bowl_is_open(stage):
    row, col = 100, 30
    pose = Pose2(*WORKSPACE.to_world(row, col))
    _, observation = stage(partial(shapes.add_bowl, color=colors.rgba("green"), pose=pose, movable=False))
    height = fuse_views(observation.views, WORKSPACE).height
    assert height[row, col] == pytest.approx(0.01, abs=0.004)  # the floor of the bowl
    rim = round((shapes.BOWL.rim - shapes.BOWL.wall / 2) / WORKSPACE.pixel)
    for side in (height[row - rim, col], height[row + rim, col], height[row, col - rim], height[row, col + rim]):
        assert side == pytest.approx(shapes.BOWL.height, abs=0.004)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rgb": np.zeros((480, 640, 4), np.uint8)}, "rgb of camera 'front'"),
        ({"rgb": np.zeros((480, 640, 3), np.float32)}, "rgb of camera 'front'"),
        ({"depth": np.zeros((640, 480), np.float32)}, "depth of camera 'front'"),
        ({"depth": np.zeros((480, 640), np.float64)}, "depth of camera 'front'"),
        ({"rgb": np.zeros((80, 160, 3), np.uint8)}, "^rgb must be"),
        ({"rgb": np.zeros((160, 80, 3), np.float32)}, "^rgb must be"),
        ({"height": np.zeros((160, 81), np.float32)}, "^height must be"),
        ({"height": np.zeros((160, 80), np.float64)}, "^height must be"),
        ({"seen": np.ones((160, 81), bool)}, "^seen must be"),
    ],
)
def test_a_wrong_picture_or_height_map_is_named(fused, change, message):
    good = View(CAMERAS[0], np.zeros((480, 640, 3), np.uint8), np.ones((480, 640), np.float32))
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(good if "camera" in message else fused, **change)


@pytest.mark.parametrize("camera", CAMERAS, ids=[camera.name for camera in CAMERAS])
def test_points_and_pictures_share_one_camera(camera):
    """A block's top centre from one camera alone, over 15 poses: at most 0.2 mm off on the mean, on each axis."""
    rng = np.random.default_rng(0)
    errors = []
    with World() as world:
        for _ in range(15):
            world.clear()
            pose = Pose2(rng.uniform(0.3, 0.7), rng.uniform(-0.45, 0.45), rng.uniform(-np.pi, np.pi))
            shapes.add_block(world.client, (1, 0, 0, 1), pose)
            view, _ = render(world.client, camera)
            top = np.abs(view.points()[..., 2] - shapes.BLOCK_SIZE) < 0.0004  # the sides begin below
            points = view.points()[top].astype(float)
            # A pixel stands for as much of a plane as its depth cubed: so each part of the top counts alike.
            weight = view.depth[top].astype(float) ** 3
            centre = (points * weight[:, None]).sum(axis=0) / weight.sum()
            errors.append(centre - (pose.x, pose.y, shapes.BLOCK_SIZE))
    assert np.abs(np.mean(errors, axis=0)).max() < 0.0002


def test_points_and_matrix_are_inverse_and_an_off_centre_camera_is_rendered_as_its_matrix_says():
    view = View(CAMERAS[1], np.zeros((480, 640, 3), np.uint8), np.full((480, 640), 1.3, np.float32))
    in_camera = (view.points()[100, 250].astype(float) - view.camera.position) @ view.camera.rotation
    x, y, depth = view.camera.matrix @ in_camera
    assert depth == pytest.approx(1.3, abs=1e-5)
    assert (x / depth, y / depth) == pytest.approx((250.5, 100.5), abs=1e-3)
    front = CAMERAS[0]
    (focal, _, x), (_, _, y), last = front.intrinsics
    off = dataclasses.replace(front, intrinsics=((focal, 0.0, x + 40), (0.0, focal, y - 25), last))
    with World() as world:
        world.clear()
        shapes.add_block(world.client, (1, 0, 0, 1), Pose2(0.5, 0.1))
        red = [render(world.client, camera)[0].rgb[..., 0] > 150 for camera in (front, off)]
    moved = np.zeros_like(red[0])
    moved[:-25, 40:] = red[0][25:, :-40]
    assert red[0].sum() > 100
    assert (moved != red[1]).sum() <= 4  # rounding at the block's outline
