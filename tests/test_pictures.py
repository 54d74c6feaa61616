"""Pictures of known things at known poses: every sign between world, picture, kernel and tool must agree.

Each test fails if a single one of them is flipped.
"""

import math
from functools import partial

import numpy as np
import orbits
import pytest
import shapely
import torch

from gem_lite import steerable
from gem_lite.actions import PickPlace
from gem_lite.foundations import colors
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import ImageMotion, Pose2, Workspace, angle_bins, rotate_image, rotation_matrix, wrap
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.effectors import planar

HIGH = 0.01
"""What is higher than this (m) is no table."""
W = Workspace()
ROTATIONS, FREQUENCY, HALF = 72, 20, 16
"""Angles in a turn (5 degrees apart), the highest frequency kept, and the template's half size (33 x 33)."""
CORNER = Pose2(-0.03, -0.03)
"""Where the arms of the L meet, in its own frame: the origin lies in its open notch."""


def mask_of(observation, workspace=W):
    return fuse_views(observation.views, workspace).height > HIGH


def window(mask, row, col, half):
    return mask[row - half : row + half + 1, col - half : col + half + 1]


def footprint(outline, half, pixel):
    """(2 half + 1,)*2 bool: the cells that an outline touches; rows grow with -y, columns with +x."""
    x, y = np.meshgrid(np.arange(-half, half + 1) * pixel, -np.arange(-half, half + 1) * pixel)
    cells = shapely.box(x - pixel / 2, y - pixel / 2, x + pixel / 2, y + pixel / 2)
    # Slanted cameras cannot look into the eye of the letter, so it counts as filled.
    return shapely.intersects(shapely.Polygon(outline.exterior), cells)


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


@pytest.fixture(scope="module")
def letter_r(stage):
    """The views of a letter R that lies upright, and its position."""
    x, y = W.to_world(60, 50)
    build = partial(
        shapes.add_mesh, mesh=shapes.piece_mesh("letter R shape"), color=colors.rgba("red"), pose=Pose2(x, y)
    )
    return stage(build)[1], (x, y)


@pytest.mark.parametrize("pixel", [0.00625, 0.003125])
def test_letter_r_reads_as_r_and_not_as_its_turns_and_mirror_images(letter_r, pixel):
    observation, position = letter_r
    workspace, half = Workspace(pixel=pixel), round(0.045 / pixel)
    row, col = workspace.nearest_cell(*position)
    # The letter's centre may lie between cells: shift the outline by what is left.
    x, y = workspace.to_world(row, col)
    outline = shapely.affinity.translate(shapes.letter_outline("R"), position[0] - x, position[1] - y)
    seen, expected = window(mask_of(observation, workspace), row, col, half), footprint(outline, half, pixel)
    turns = [np.rot90(picture, k) for picture in (expected, expected[:, ::-1]) for k in range(4)]
    upright, *others = [iou(seen, turn) for turn in turns]
    assert upright > 0.85
    assert max(others) < upright - 0.12


def test_letter_r_has_its_stem_on_the_left_and_its_legs_below(letter_r):
    # Needs no outline, so a mirrored font would not pass either.
    observation, position = letter_r
    mask = window(mask_of(observation), *W.nearest_cell(*position), 7)
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    letter = mask[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    assert letter[:, :2].all()
    assert not letter[:, -2:].all()
    assert not letter[-1].all() and letter[-1, [0, -2]].all()  # a gap between the two feet


def l_block(pose):
    return partial(shapes.add_l_block, color=colors.rgba("blue"), pose=pose)


@pytest.fixture(scope="module")
def l_mask(stage):
    """(33, 33) bool: the L at yaw 0 as the height map shows it."""
    _, observation = stage(l_block(Pose2(*W.to_world(60, 36))))
    return window(mask_of(observation), 60, 36, HALF)


@pytest.fixture(scope="module")
def l_kernel(l_mask):
    """The template as a lifted kernel; without its mean, so that surplus area counts against."""
    kernel = torch.from_numpy(l_mask.astype(np.float32))[None, None]
    return steerable.SteerableKernel.lift(kernel - kernel.mean(), ROTATIONS, FREQUENCY)


def find_l(mask, kernel):
    """(row, col, yaw) at which the template fits best."""
    features = torch.from_numpy(mask.astype(np.float32))[None, None]
    angles = angle_bins(ROTATIONS)
    response = orbits.sample(kernel.correlate(features), torch.from_numpy(angles).float())[0]
    index, row, col = np.unravel_index(int(response.argmax()), response.shape)
    return row, col, angles[index]


@pytest.mark.parametrize("degrees", [0, 30, 145])
def test_kernel_finds_the_l_at_its_pixel_and_at_plus_its_yaw(stage, l_kernel, degrees):
    yaw = math.radians(degrees)
    _, observation = stage(l_block(Pose2(*W.to_world(95, 47), yaw)))
    row, col, angle = find_l(mask_of(observation), l_kernel)
    assert abs(row - 95) <= 1 and abs(col - 47) <= 1
    assert math.degrees(abs(wrap(angle - yaw))) <= 5.1


@pytest.mark.parametrize("degrees", [30, -60])
def test_the_world_turns_as_the_picture_turns(stage, l_mask, degrees):
    yaw, row, col = math.radians(degrees), 95, 47
    pose = Pose2(*W.to_world(row, col), yaw)
    corner = pose @ CORNER
    _, observation = stage(l_block(pose))
    mask = mask_of(observation)

    # rotation_matrix takes the corner's pixel offset at yaw 0 to where the world has it now.
    offset = rotation_matrix(yaw) @ [-CORNER.y / W.pixel, CORNER.x / W.pixel]
    assert W.to_pixel(corner.x, corner.y) == pytest.approx((row + offset[0], col + offset[1]), abs=1e-6)
    assert mask[W.nearest_cell(corner.x, corner.y)]
    notch = pose @ Pose2(0.02, 0.02)
    assert not mask[W.nearest_cell(notch.x, notch.y)]

    # rotate_image turns the template into what the cameras see, and not into its opposite.
    template = torch.from_numpy(l_mask.astype(np.float32))[None, None]
    turned = {sign: rotate_image(template, torch.tensor([sign * yaw]))[0, 0].numpy() > 0.5 for sign in (1, -1)}
    seen = window(mask, row, col, HALF)
    assert iou(seen, turned[1]) > 0.8
    assert iou(seen, turned[-1]) < 0.65


@pytest.mark.parametrize(("degrees", "shift"), [(90, (-20, 8)), (-30, (15, -6))])
def test_image_motion_of_the_map_is_a_motion_of_the_block(stage, l_kernel, degrees, shift):
    yaw, row, col = math.radians(20), 85, 42
    _, observation = stage(l_block(Pose2(*W.to_world(row, col), yaw)))
    motion = ImageMotion(math.radians(degrees), shift)
    image = torch.from_numpy(mask_of(observation).astype(np.float32))[None, None]
    moved = motion.warp(image)[0, 0].numpy() > 0.5
    found = find_l(moved, l_kernel)
    assert found[:2] == pytest.approx(motion.move((row, col), W.shape), abs=1.1)
    assert math.degrees(abs(wrap(found[2] - yaw - motion.angle))) <= 5.1


@pytest.mark.parametrize(("degrees", "turn"), [(30, -60), (-60, 150)])
def test_tool_turns_the_l_by_delta(world, stage, l_kernel, degrees, turn):
    delta = math.radians(turn)
    (body,), _ = stage(l_block(Pose2(0.42, 0.1, math.radians(degrees))))
    before = world.pose(body)[0]
    # The grasp's own yaw is not the block's: only the difference of the tool's yaws may matter.
    pick = before @ Pose2(CORNER.x, CORNER.y, 0.3)
    place = Pose2(0.55, -0.15, wrap(pick.yaw + delta))
    tool_yaws = []
    tool = world.effector.id
    step = world.step(PickPlace(pick, place), watch=lambda _: tool_yaws.append(planar(world.client, tool).yaw))
    after, expected = world.pose(body)[0], place @ pick.inverse() @ before

    assert step.grasped
    assert math.degrees(abs(wrap(tool_yaws[0] - pick.yaw))) < 1
    assert math.degrees(abs(wrap(after.yaw - before.yaw - delta))) < 1.5
    assert (after.x, after.y) == pytest.approx((expected.x, expected.y), abs=0.003)

    row, col, angle = find_l(mask_of(step.observations[0]), l_kernel)
    assert (row, col) == pytest.approx(W.to_pixel(after.x, after.y), abs=1.1)
    assert math.degrees(abs(wrap(angle - before.yaw - delta))) <= 6


def test_twenty_different_pieces_are_solid_and_of_one_size():
    names = shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES
    assert len(set(names)) == 20
    for name in names:
        mesh = shapes.piece_mesh(name)
        assert mesh.is_watertight and mesh.volume > 0
        assert mesh.extents[2] == pytest.approx(shapes.PIECE_HEIGHT)
        assert mesh.bounds[0][2] == pytest.approx(0)
        assert 0.045 < max(mesh.extents[:2]) < 0.08
    assert not shapes.outline("ring").contains(shapely.Point(0, 0))
    with pytest.raises(ValueError, match=r"'banana'.*letter R shape.*hexagon"):
        shapes.outline("banana")
