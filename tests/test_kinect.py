"""The worlds of erring cameras: an Azure Kinect on top, two D455 at the sides, another lamp in each episode."""

import dataclasses
import itertools

import numpy as np
import pybullet as p
import pytest
from tiers import for_a_release

from gem_lite import demonstrations, tasks
from gem_lite.evaluation import actors, collecting, evaluate
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.sensor_errors import AZURE, AZURE_HARD
from gem_lite.se2 import Workspace
from gem_lite.simulation import looks
from gem_lite.simulation.looks import HOME, KINECT, KINECT_HARD, Look
from gem_lite.simulation.mobile_world import MobileWorld, side_by_side
from gem_lite.simulation.rendering import LampRange, Light, cameras_around, render
from gem_lite.simulation.world import World

TASK = "put-block-in-bowl-seen-colors"
PERFECT = dataclasses.replace(KINECT, name="perfect", sensors=())


def begun(world, index=0):
    """The observation at the beginning of an episode."""
    (observation,) = world.reset(tasks.make(TASK, "val"), tasks.episode_seed("val", index))
    return observation


def same(first, second):
    """Whether two observations are equal to the last bit."""
    pairs = list(zip(first.views, second.views, strict=True))
    return all(
        a.camera == b.camera and np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth) for a, b in pairs
    )


@pytest.fixture(scope="module")
def kinect():
    with World(style=KINECT) as world:
        yield world


def test_the_cameras_show_the_whole_table_and_no_tool_on_it():
    with World(style=PERFECT) as world, World() as home:
        views, at_home = begun(world).views, begun(home).views
        assert [(view.camera.name, view.camera.size) for view in views] == [
            ("top", (576, 640)), ("left", (480, 848)), ("right", (480, 848)),
        ]  # fmt: skip
        heightmap, expected = (fuse_views(part, Workspace()) for part in (views, at_home))
        assert heightmap.seen.mean() > 0.995, "but for what lies behind things"
        assert (abs(heightmap.height - expected.height) < 0.005).mean() > 0.95
        border = np.ones(Workspace().shape, bool)
        border[1:-1, 1:-1] = False
        assert fuse_views(views[:1], Workspace()).seen[border].mean() > 0.97, "even at the border"
        # The wide pictures show the parked tool in a corner; the table does not.
        p.resetBasePositionAndOrientation(world.effector.id, (0, 0, -5), (0, 0, 0, 1), physicsClientId=world.client)
        without_tool = fuse_views(world.observe()[0].views, Workspace())
        assert np.array_equal(without_tool.rgb, heightmap.rgb) and (without_tool.height == heightmap.height).all()


def test_cameras_stand_farther_from_a_longer_table():
    top, left, _ = cameras_around(Workspace(x_min=0.2, x_max=0.8, y_min=-0.75, y_max=0.75), KINECT.cameras)
    assert top.position == pytest.approx((0.5, 0.0, 1.35)) and left.position[2] == pytest.approx(0.75 * 1.5)


@pytest.mark.release
def test_an_episode_is_the_same_from_its_seed_and_no_other():
    with World(style=KINECT_HARD) as world, World(style=KINECT_HARD) as fresh:
        first, other, again = begun(world, 0), begun(world, 1), begun(world, 0)
        light = world.light
        assert same(first, again) and same(first, begun(fresh, 0)) and not same(first, other)
        assert same(first, world.observe()[0]), "looking twice changes nothing"
        begun(world, 1)
        assert world.light != light and light.shadow
        cameras = [view.camera for view in other.views]
        world.step(world.task.expert(world).action)
        later = world.observe()[0]
        assert [view.camera for view in later.views] == cameras, "an episode keeps its units"
        for before, after in zip(other.views, later.views, strict=True):
            edge = (slice(0, 40), slice(300, 340))  # The floor beside the table: nothing moves there.
            assert not np.array_equal(before.rgb[edge], after.rgb[edge]), "noise is new in each frame"


def test_errors_are_of_what_is_seen_and_not_of_what_is_true():
    laid_out = []
    for style in (HOME, KINECT, KINECT_HARD):
        with World(style=style) as world:
            begun(world, 2)
            laid_out.append((world.task.instruction, [world.placement(body)[0].tolist() for body in world.bodies]))
    assert laid_out[0] == laid_out[1] == laid_out[2]


@pytest.mark.parametrize("name", for_a_release(["kinect", "kinect-hard"], lambda name: name == "kinect"))
def test_the_fused_table_is_as_far_off_as_calibrated_cameras_make_it(name):
    # Millimetres: the medians of the table's height, which is the highest point of each cell.
    medians = []
    with World(style=looks.style(name)) as world:
        for index in range(4):
            heightmap = fuse_views(begun(world, index).views, Workspace())
            assert heightmap.seen.mean() > {"kinect": 0.99, "kinect-hard": 0.95}[name]
            medians.append(1000 * float(np.median(heightmap.height)))
    low, high = {"kinect": (2, 15), "kinect-hard": (5, 35)}[name]
    assert low < np.mean(medians) < high


@pytest.mark.release
def test_the_darkest_lamp_leaves_nearly_all_of_the_table_to_every_depth_camera():
    too_dark = []
    corners = itertools.product((-1.0, 1.0), repeat=2)
    with World(style=PERFECT) as world:
        begun(world)
        for x, y in corners:
            lean = KINECT_HARD.lamp.lean
            world.light = Light((0.3 + lean * x * 0.5**0.5, 0.2 + lean * y * 0.5**0.5, 1.0), shadow=True)
            for view in world.observe()[0].views:
                points = view.points()
                gray = view.rgb.mean(axis=-1)[Workspace().contains(points[..., 0], points[..., 1])]
                too_dark.append(float((gray < AZURE_HARD.blind_below).mean()))
    assert len(too_dark) == 12 and max(too_dark) < 0.06 and np.median(too_dark) < 0.001


@pytest.mark.release
def test_a_demonstration_is_what_a_policy_would_see_and_loads_equal(tmp_path):
    (loaded,) = collecting.collect(TASK, 1, tmp_path / "kinect", world="kinect")
    assert loaded.world == "kinect" and sum(step.reward for step in loaded.steps) > 0.99
    with World(style=KINECT) as world:
        played = collecting.roll_out(world, TASK, "train", loaded.seed)
        seen = demonstrations.quantized(world.reset(tasks.make(TASK), loaded.seed)[0])
    assert len(loaded.steps) == len(played.steps) and same(loaded.steps[0].observation, seen)
    for a, b in zip(loaded.steps, played.steps, strict=True):
        assert same(a.observation, b.observation) and dataclasses.replace(a, observation=None) == dataclasses.replace(
            b, observation=None
        )


def test_the_expert_solves_episodes(kinect):
    assert evaluate.run_episode(kinect, actors.expert, TASK, "val", 0).reward > 0.99


def test_a_lamp_that_differs_lights_the_stored_floor_too():
    style = Look("lamps", lamp=LampRange(lean=0.5, strength=0.5))
    with World(style=style) as world:
        for index in (0, 1):
            for view in begun(world, index).views:
                whole, _ = render(world.client, view.camera, world.light)
                assert (view.rgb == whole.rgb).all() and (view.depth == whole.depth).all()
        assert world.light != style.light


@pytest.mark.release
def test_each_of_several_tables_has_cameras_of_its_own():
    task = tasks.make("object-sorting-seen", "val")
    with MobileWorld(side_by_side(2), style=KINECT) as world:
        first, second = world.reset(task, tasks.episode_seed("val", 0))
        again = world.observe()
    assert same(first, again[0]) and same(second, again[1])
    for one, other in zip(first.views, second.views, strict=True):
        assert one.camera.name == other.camera.name and one.camera.pose != other.camera.pose


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Look("bad", sensors=(AZURE,)), r"^sensors must be none, or one for each of 3 cameras, got 1$"),
        (lambda: LampRange(lean=-1.0), r"^lean must be a finite number of at least 0, got -1.0$"),
        (lambda: LampRange(strength=float("nan")), r"^strength must be a finite number of at least 0, got nan$"),
    ],
)
def test_worlds_that_cannot_be_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
