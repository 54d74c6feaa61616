"""Worlds by name: what differs between them, and what does not."""

import dataclasses

import numpy as np
import pytest
from tiers import for_a_release

from gem_lite import tasks
from gem_lite.evaluation import actors, evaluate
from gem_lite.policies.inputs import TABLE_GRAY, TABLE_LEVEL, exposure, to_rgbd
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap, fuse_views
from gem_lite.se2 import Workspace
from gem_lite.simulation import environment, looks
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.shapes import PieceForm
from gem_lite.simulation.looks import HOME, OTHER_BOWLS, TRAINING_BOWLS, Look
from gem_lite.simulation.rendering import CAMERAS, LampRange
from gem_lite.simulation.world import World
from gem_lite.tasks import assembling_kits
from gem_lite.tasks.spawn import FreeSpace

BOWL_TASK = "put-block-in-bowl-seen-colors"


@pytest.fixture(scope="module")
def laid_out():
    """Of some worlds: an episode's sentence, the bodies' planar poses, and the cameras' views."""
    found = {}
    for name in ("home", "varied", "white-floor", "shadows", "bright-light"):
        with World(style=looks.style(name)) as world:
            (observation,) = world.reset(tasks.make(BOWL_TASK, "val"), tasks.episode_seed("val", 0))
            poses = np.array([[world.pose(body)[0].x, world.pose(body)[0].y] for body in world.bodies])
            found[name] = (world.task.instruction, poses, observation.views)
    return found


@pytest.mark.parametrize("name", ["white-floor", "shadows", "bright-light"])
def test_another_look_is_the_same_layout(laid_out, name):
    (instruction, poses, views), changed = laid_out["home"], laid_out[name]
    assert changed[0] == instruction and changed[1] == pytest.approx(poses, abs=1e-9)
    difference = changed[2][0].rgb.astype(int) - views[0].rgb
    assert (np.abs(difference).max(axis=-1) > 5).mean() > 0.2


def test_networks_see_the_light_of_the_demonstrations(laid_out):
    medians = {}
    for name, (_, _, views) in laid_out.items():
        heightmap = fuse_views(views, Workspace())
        medians[name] = np.median(heightmap.rgb)
        assert (to_rgbd(heightmap)[:3].median() + TABLE_GRAY) * 255 == pytest.approx(TABLE_LEVEL, abs=0.01)
        if name in ("home", "varied", "white-floor"):
            assert exposure(heightmap) == 1.0
    assert medians["bright-light"] > 1.3 * medians["home"] > 1.3 * medians["shadows"]


@pytest.mark.parametrize("millimetres", [-12, -6, 4, 6, 12])
def test_a_table_that_is_seen_too_high_is_still_the_gray_card(millimetres):
    # With a fixed limit of 5 mm, the factor jumped between 4 and 6 mm: nothing but things was left as bare.
    workspace = Workspace()
    rgb = np.full((*workspace.shape, 3), 70, np.uint8)
    height = np.random.default_rng(0).normal(millimetres / 1000, 0.0005, workspace.shape).astype(np.float32)
    rgb[40:80, 20:50] = 250
    height[40:80, 20:50] += 0.04
    valid = np.ones(workspace.shape, bool)
    assert exposure(HeightMap(workspace, rgb, height, valid)) == pytest.approx(TABLE_LEVEL / 70)
    covered = HeightMap(workspace, rgb, np.full_like(height, 0.05), valid)
    assert exposure(covered) == 1.0, "without a bare cell, colours stay"


def test_shadows_are_cast():
    style = looks.style("shadows")
    lit = Look("lit", light=dataclasses.replace(style.light, shadow=False))
    pictures = []
    for one_style in (style, lit):
        with World(style=one_style) as world:
            task = tasks.make(BOWL_TASK, "val")
            (observation,) = world.reset(task, tasks.episode_seed("val", 3))
            pictures.append(observation.views[0].rgb.astype(int).sum(axis=-1))
    darker = pictures[1] - pictures[0]
    on_the_table = (darker > 12) & (darker < 22)  # the floor below darkens as a whole, by more
    assert 0.001 < on_the_table.mean() < 0.1


def test_tested_containers_were_never_demonstrated():
    assert not set(OTHER_BOWLS) & set(TRAINING_BOWLS)
    assert not set(looks.style("other-containers").box_heights) & set(looks.style("varied").box_heights)
    assert not set(looks.style("other-containers").plates) & set(looks.style("varied").plates)


def test_home_bodies_keep_their_distance_and_touching_ones_do_not():
    def nearest_gap(style):
        gaps = []
        for seed in range(20):
            free = FreeSpace(Workspace(), np.random.default_rng(seed), style)
            poses = [free.take(0.02) for _ in range(6)]
            distance = [np.hypot(a.x - b.x, a.y - b.y) for i, a in enumerate(poses) for b in poses[:i]]
            gaps.append(min(distance) - 0.04)
        return np.array(gaps)

    assert nearest_gap(HOME).min() >= 0.015 - 1e-9
    touching = nearest_gap(looks.style("touching"))
    assert touching.min() >= 0.001 - 1e-9
    assert (touching < 0.0011).mean() > 0.8


def test_blocks_touch_face_to_face_and_others_lie_at_the_edge():
    free = FreeSpace(Workspace(), np.random.default_rng(0), Look("all", touching=1.0))
    first, second = (free.take(0.02 * 2**0.5, 0.02) for _ in range(2))
    off = first.inverse() @ second
    assert sorted([abs(off.x), abs(off.y)]) == pytest.approx([0, 0.041]) and off.yaw == pytest.approx(0)
    free = FreeSpace(Workspace(), np.random.default_rng(0), Look("edge", at_edge=1.0))
    poses = [free.take(0.02) for _ in range(8)]
    w = Workspace()
    border = [min(p.x - w.x_min, w.x_max - p.x, p.y - w.y_min, w.y_max - p.y) for p in poses]
    assert border == pytest.approx([0.02] * 8)


def lies_as_at_home(style):
    """Whether only the look differs: test_another_look_is_the_same_layout."""
    look = {name: getattr(HOME, name) for name in ("name", "floor", "light", "lamp", "cameras", "sensors")}
    return dataclasses.replace(style, **look) == HOME


# "real-table-panda" is "panda" with the cameras of the real tables: test_panda.py.
OTHER_WORLDS = sorted({name for name in looks.names() if not lies_as_at_home(looks.style(name))} - {"real-table-panda"})


WORLD_TASKS = (BOWL_TASK, "stack-block-pyramid-seq-seen-colors", "packing-shapes-seen")


@pytest.mark.parametrize("name", OTHER_WORLDS)
@pytest.mark.parametrize("task_name", for_a_release(WORLD_TASKS, lambda name: "pyramid" in name))
def test_the_expert_solves_every_world(name, task_name, no_pictures):
    with World(style=looks.style(name)) as world:
        assert evaluate.run_episode(world, actors.expert, task_name, "val", 0).reward > 0.99


@pytest.mark.parametrize("task_name", ["assembling-kits-seq-seen-colors", "towers-of-hanoi-seq-seen-colors"])
def test_the_expert_solves_other_proportions(task_name, no_pictures):
    with World(style=looks.style("diverse")) as world:
        assert evaluate.run_episode(world, actors.expert, task_name, "val", 0).reward > 0.99


def test_lamps_tables_and_erring_cameras_differ_from_episode_to_episode(monkeypatch):
    monkeypatch.setattr(environment, "corrupt", lambda seen, units, rng, brightness: None)
    views = (View(CAMERAS[0], np.zeros((480, 640, 3), np.uint8), np.ones((480, 640), np.float32)),) * 3
    shadows, grays, colors, erring = [], [], [], []
    with World(style=looks.style("diverse")) as world:
        for index in range(60):
            world.begin(tasks.make(BOWL_TASK, "train"), tasks.episode_seed("train", index))
            shadows.append(world.light.shadow)
            grays.append(world.gray)
            colors.append(world.light.color)
            erring.append(world.as_measured(views, 0) is None)
    assert 15 < sum(shadows) < 45 and 8 < sum(erring) < 32
    assert min(grays) < 0.8 < 1.5 < max(grays)
    assert np.ptp(colors, axis=0).min() > 0.1 and np.max(colors) <= 1


def test_a_piece_of_another_form_fits_its_hole_and_a_symmetric_one_stays_so():
    free = FreeSpace(Workspace(), np.random.default_rng(0), looks.style("diverse"))
    square, letter = free.piece_form(symmetric=True), free.piece_form(symmetric=False)
    assert square.stretch[0] == square.stretch[1] != 1 and letter.stretch[0] != letter.stretch[1]
    for name, form in (("square", square), ("letter R shape", letter)):
        piece, hole = shapes.piece_mesh(name, form), assembling_kits.hole_mesh(name, form)
        assert piece.extents[:2] == pytest.approx(hole.extents[:2])
        usual = shapes.piece_mesh(name, PieceForm(font=form.font))
        assert piece.extents[:2] == pytest.approx(usual.extents[:2] * form.stretch)
    assert FreeSpace(Workspace(), np.random.default_rng(0)).piece_form(symmetric=False) == PieceForm()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: Look(stretch=(1.1, 0.9)), "stretch must go from a number above 0 to one at least as large"),
        (lambda: Look(grays=(0.0, 1.0)), "grays must go from a number above 0 to one at least as large"),
        (lambda: Look(fonts=()), "fonts must name at least one font"),
        (lambda: Look(erring=1.5), r"erring must be a share in \[0, 1\], got 1.5"),
        (lambda: LampRange(tint=2.0), r"tint must be a share in \[0, 1\], got 2.0"),
    ],
)
def test_looks_that_cannot_be_are_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        wrong()
