import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gem_lite import se2
from gem_lite.actions import PickPlace
from gem_lite.se2 import ImageMotion, Pose2, Workspace, rotate_image, rotation_matrix, wrap

QUARTER = math.pi / 2


def blob(shape, pixel):
    """(1, 1, H, W): a soft spot, whose centroid survives interpolation better than a single pixel's."""
    rows, cols = np.indices(shape)
    spot = np.exp(-((rows - pixel[0]) ** 2 + (cols - pixel[1]) ** 2) / 2)
    return torch.from_numpy(spot.astype(np.float32))[None, None]


def centroid(image):
    weight = image[0, 0].numpy()
    rows, cols = np.indices(weight.shape)
    return (rows * weight).sum() / weight.sum(), (cols * weight).sum() / weight.sum()


def same_pose(a, b):
    return (a.x, a.y, wrap(a.yaw - b.yaw)) == pytest.approx((b.x, b.y, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0, 0), (1, 1), (math.pi, -math.pi), (-math.pi, -math.pi), (3 * QUARTER, -QUARTER), (-5 * QUARTER, -QUARTER)],
)
def test_wrap_table(angle, expected):
    assert wrap(angle) == pytest.approx(expected)


def test_poses_turn_counter_clockwise_and_compose_in_the_frame_of_the_left():
    assert same_pose(Pose2(0, 0, QUARTER) @ Pose2(1, 0, 0.2), Pose2(0, 1, QUARTER + 0.2))
    a, b = Pose2(0.3, -0.2, 0.7), Pose2(-0.1, 0.5, -2.0)
    x, y = Rotation.from_euler("z", a.yaw).as_matrix()[:2, :2] @ [b.x, b.y] + [a.x, a.y]
    assert same_pose(a @ b, Pose2(x, y, -1.3))
    np.testing.assert_allclose(Rotation.from_quat(se2.quaternion(QUARTER)).apply([1, 0, 0]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(rotation_matrix(QUARTER) @ [0, 1], [-1, 0], atol=1e-12)  # right to up
    np.testing.assert_allclose(np.degrees(se2.angle_bins(36)), np.arange(0, 360, 10))


@pytest.mark.parametrize(("pick", "place", "delta"), [(0.25, 1, 0.75), (1, 0.25, -0.75), (3, -3, 2 * math.pi - 6)])
def test_delta_is_place_minus_pick_the_short_way(pick, place, delta):
    assert PickPlace(Pose2(0.4, 0.1, pick), Pose2(0.6, -0.3, place)).delta == pytest.approx(delta)


def test_cell_centres_are_whole_numbers_rows_grow_with_minus_y_and_columns_with_x():
    w = Workspace()
    assert w.shape == (160, 80) and Workspace(pixel=0.003125).shape == (320, 160)
    half = w.pixel / 2
    assert w.to_pixel(w.x_min + half, w.y_max - half) == pytest.approx((0, 0))
    assert w.to_pixel(w.x_max - half, w.y_min + half) == pytest.approx((159, 79))
    assert w.to_world(0, 0) == pytest.approx((w.x_min + half, w.y_max - half))
    row, col = w.to_pixel(0.5, 0.1)
    assert w.to_pixel(0.5 + w.pixel, 0.1 - w.pixel) == pytest.approx((row + 1, col + 1))


def test_nearest_cell_of_every_contained_edge_is_on_the_map():
    w = Workspace()
    edges = {
        (w.x_min, w.y_max): (0, 0),
        (0.303, float(np.nextafter(w.y_min, 0))): (159, 8),
        (float(np.nextafter(w.x_max, 0)), 0.0): (80, 79),
    }
    for (x, y), cell in edges.items():
        assert w.contains(x, y)
        assert w.nearest_cell(x, y) == cell
    assert not w.contains(0.3, w.y_min) and not w.contains(w.x_max, 0.0)
    assert w.contains(0.26, 0.0) and not w.contains(0.26, 0.0, margin=0.02)
    for x, y in ((0.2, 0.0), (0.8, 0.0), (0.5, 0.6), (0.5, -0.6), (math.nan, 0.0)):
        with pytest.raises(ValueError, match="outside the workspace"):
            w.nearest_cell(x, y)


def test_one_image_by_many_angles_is_each_angle_alone():
    image = torch.rand(1, 2, 9, 9, generator=torch.Generator().manual_seed(0))
    angles = torch.tensor([0.0, 0.3, -1.2])
    stack = rotate_image(image, angles)
    assert stack.shape == (3, 2, 9, 9)
    torch.testing.assert_close(stack[0], image[0], atol=1e-6, rtol=0)
    for turned, angle in zip(stack, angles, strict=True):
        torch.testing.assert_close(turned[None], rotate_image(image, angle[None]))


@pytest.mark.parametrize("degrees", [90, 30, -45])
def test_a_narrow_map_turns_in_pixels(degrees):
    # In normalised coordinates a 41 x 21 map would be sheared: the spot would land elsewhere.
    shape, offset = (41, 21), np.array([2.0, 6.0])
    centre = (np.array(shape) - 1) / 2
    turned = rotate_image(blob(shape, centre + offset), torch.tensor([math.radians(degrees)]))
    expected = centre + rotation_matrix(math.radians(degrees)) @ offset
    assert centroid(turned) == pytest.approx(tuple(expected), abs=0.05)


def test_a_picture_turns_up_from_the_right_and_shifts_by_rows_then_columns():
    # Hand-made: no other function of se2 says where the pixel should land.
    image = torch.zeros(1, 1, 41, 21)
    image[0, 0, 20, 16] = 1.0
    for shift, landed in (((0.0, 0.0), (14, 10)), ((2, -3), (16, 7))):
        turned = rotate_image(image, torch.tensor([QUARTER]), shift=shift)
        assert turned[0, 0, *landed] == pytest.approx(1.0, abs=1e-4)
        assert turned.sum() == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(("degrees", "shift"), [(0, (3, -2)), (90, (0, 0)), (35, (-4, 2.5)), (-120, (2, 1))])
def test_image_motion_moves_pixels_as_it_warps_images(degrees, shift):
    shape, pixel = (40, 31), (16.0, 19.0)
    motion = ImageMotion(math.radians(degrees), shift)
    assert centroid(motion.warp(blob(shape, pixel))) == pytest.approx(motion.move(pixel, shape), abs=0.05)


def test_angle_off_counts_to_the_nearest_equivalent_angle():
    assert se2.angle_off(np.radians(100), np.pi / 2) == pytest.approx(np.radians(10))
    assert se2.angle_off(np.radians(-170), np.pi) == pytest.approx(np.radians(10))
    assert se2.angle_off(np.radians(-170), 2 * np.pi) == pytest.approx(np.radians(170))
    assert se2.angle_off(1.0, 0.0) == 0.0
