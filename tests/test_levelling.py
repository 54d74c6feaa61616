"""A flat table corrects two tilts and the height of a pose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gem_lite import clip
from gem_lite.rgbd import planes
from gem_lite.rgbd.camera import as_pose
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.levelling import levelled
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
    ("scene", "degrees", "metres"),
    [("workbench", 1, 0), ("kitchen", -1.5, 0.01), ("desk", 0, 0.02), ("nursery", 6, 0.04), ("desk", 10, 0)],
)
def test_a_tilt_and_a_height_are_corrected(scene, degrees, metres):
    right = Observation.load(SCENES / scene)
    wrong = moved(right, degrees, metres)
    corrected = levelled(wrong)
    off = [np.abs(heights(seen) - heights(right)).mean() for seen in (wrong, corrected)]
    assert off[1] < 0.002 and off[1] < 0.7 * off[0], f"the height map is off by {off} m"


def test_right_poses_stay_and_pictures_are_not_touched():
    right = Observation.load(SCENES / "workshop")
    for before, after in zip(right.views, levelled(right).views, strict=True):
        assert np.allclose(before.camera.pose, after.camera.pose, atol=2e-3)
        assert after.rgb is before.rgb and after.depth is before.depth


def test_a_view_without_a_table_is_refused_with_what_it_shows():
    right = Observation.load(SCENES / "workshop")
    with pytest.raises(ValueError, match=r"camera 'left' .* tilted by 0 degrees and 500 mm from z = 0; .*250 mm"):
        levelled(moved(right, 0.0, 0.5))
    with pytest.raises(ValueError, match=r"camera 'left' shows no table near z = 0; .* tilted by 2\d degrees"):
        levelled(moved(right, 25.0, 0.0))
    blind = Observation(tuple(replace(view, depth=np.zeros_like(view.depth)) for view in right.views))
    with pytest.raises(ValueError, match=r"camera 'overhead' .* the planes that it shows: none at all"):
        levelled(blind)


def test_planes_are_found_among_things_the_largest_first():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (4000, 3))
    points[:, 2] = 0.02 * points[:, 0] - 0.01 * points[:, 1] + 0.005 + rng.normal(0, 0.002, 4000)
    points[:800, 2] += 0.05  # a smaller flat thing on the table
    points[800:1000, 2] += rng.uniform(0, 0.3, 200)
    table, thing = planes.find_planes(points, np.array([0.0, 0.0, 1.0]), count=2)
    normal = np.array([-0.02, 0.01, 1.0]) / np.linalg.norm([-0.02, 0.01, 1.0])
    assert planes.tilt(table.normal, normal) < 0.06 and abs(table.height(np.array([0, 0, 0.005]))) < 5e-4
    assert 0.74 < table.share < 0.78 and table.bend < 0.1, "0.75, and a few of the scattered points"
    assert abs(table.height(points[:800]).mean() - 0.05) < 1e-3 and 0.19 < thing.share < 0.23
    below = planes.find_planes(points, np.array([0.0, 0.0, -1.0]), count=1)[0]
    assert np.allclose(below.normal, -table.normal, atol=1e-3), "normals point to the camera"


def test_rays_meet_a_plane_or_not():
    plane = planes.Plane(np.array([0.0, 0.0, 1.0]), 0.0, 1.0, 0.0)
    met = plane.met_by(np.array([0.0, 0.0, 1.0]), np.array([[0.5, 0, -1.0], [0, 0, 1.0], [1.0, 0, 0]]))
    assert np.allclose(met[0], (0.5, 0, 0)) and np.isnan(met[1:]).all()
