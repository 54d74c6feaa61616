"""A flat table corrects two tilts and the height of a pose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gem_lite import clip
from gem_lite.rgbd.camera import as_pose
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.levelling import levelled, plane
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Workspace

SCENES = clip.DATA / "foreign-scenes"
WORKSPACE = Workspace()


def moved(observation, degrees, metres):
    """The observation with the pose of its second view turned about its sideways axis, and lifted."""
    views = list(observation.views)
    camera = views[1].camera
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    pose = as_pose(camera.rotation @ turn, camera.position + np.array([0, 0, metres]))
    views[1] = replace(views[1], camera=replace(camera, pose=pose))
    return Observation(tuple(views))


def heights(observation):
    return fuse_views(observation.views, WORKSPACE).height


@pytest.mark.parametrize(
    ("scene", "degrees", "metres"), [("workbench", 1, 0), ("kitchen", -1.5, 0.01), ("desk", 0, 0.02)]
)
def test_a_tilt_and_a_height_are_corrected(scene, degrees, metres):
    right = Observation.load(SCENES / scene)
    wrong = moved(right, degrees, metres)
    corrected = levelled(wrong, WORKSPACE)
    off = [np.abs(heights(seen) - heights(right)).mean() for seen in (wrong, corrected)]
    assert off[1] < 0.002 and off[1] < 0.7 * off[0], f"the height map is off by {off} m"


def test_right_poses_stay_and_pictures_are_not_touched():
    right = Observation.load(SCENES / "workshop")
    for before, after in zip(right.views, levelled(right, WORKSPACE).views, strict=True):
        assert np.allclose(before.camera.pose, after.camera.pose, atol=2e-3)
        assert after.rgb is before.rgb and after.depth is before.depth
    far = moved(right, 0.0, 0.5)
    assert levelled(far, WORKSPACE).views[1] is far.views[1], "a view without a table"


def test_a_plane_is_found_among_things():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (4000, 3))
    points[:, 2] = 0.02 * points[:, 0] - 0.01 * points[:, 1] + 0.005 + rng.normal(0, 0.002, 4000)
    points[:800, 2] += 0.05  # things on the table
    assert np.allclose(plane(points), (0.02, -0.01, 0.005), atol=6e-4)
