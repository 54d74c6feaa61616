"""The erring depth camera is as bad as the sources say, in no other way, and the same each time."""

import dataclasses
import math

import numpy as np
import pytest
from tiers import for_a_release

from gem_lite.rgbd import sensor_errors
from gem_lite.rgbd.camera import Camera, View, camera_looking_at
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.sensor_errors import (
    AZURE,
    AZURE_HARD,
    D455,
    HARD,
    KINDS,
    NOMINAL,
    TIME_OF_FLIGHT,
    SensorErrors,
    corrupt,
    draw_different_units,
    draw_units,
)
from gem_lite.simulation.rendering import AZURE_AND_D455

SIZE = (480, 640)
CAMERA = Camera.pinhole("wall", (0, 0, 0), (0, 0, 0, 1), SIZE)
LAW = CAMERA.focal * NOMINAL.baseline  # pixels times metres
TOP, LEFT, RIGHT = AZURE_AND_D455
DISPARITY = ("disparity_noise", "static_warp", "unit_bias")


def observed(depth, camera=CAMERA, grey=128):
    rgb = np.full((*camera.size, 3), grey, np.uint8)
    return Observation((View(camera, rgb, np.broadcast_to(depth, camera.size).astype(np.float32)),))


def corrupted(observation, errors, seed=0):
    units = draw_units(observation, errors, np.random.default_rng(seed))
    return corrupt(observation, units, np.random.default_rng(seed + 1))


def depth_of(seen, errors, seed=0):
    (view,) = corrupted(seen, errors, seed).views
    return view.depth


def wall(z, errors, seed=0, frames=1, camera=CAMERA):
    """The depth of a flat wall, mean over frames of one unit."""
    seen = observed(z, camera)
    units = draw_units(seen, errors, np.random.default_rng(seed))
    rng = np.random.default_rng(seed + 1)
    return np.mean([corrupt(seen, units, rng).views[0].depth for _ in range(frames)], axis=0, dtype=float)


def plane_rms(depth):
    """Residual (m) of the plane that fits best, in the middle quarter of a picture."""
    part = depth[180:300, 240:400]
    row, col = np.indices(part.shape)
    columns = np.column_stack([row.ravel(), col.ravel(), np.ones(part.size)])
    fit, *_ = np.linalg.lstsq(columns, part.ravel(), rcond=None)
    return float(np.std(part.ravel() - columns @ fit))


def with_fields(*names, of=NOMINAL):
    return SensorErrors(**{name: getattr(of, name) for name in names})


@pytest.mark.parametrize("z", [0.5, 1.0, 1.5])
def test_a_flat_wall_is_as_rough_as_the_stereo_law_says(z):
    errors = with_fields("disparity_noise", "static_warp", "unit_bias", "disparity_step", "depth_step")
    law = z**2 * NOMINAL.disparity_noise / LAW
    rms = np.sqrt(np.mean([plane_rms(wall(z, errors, seed)) ** 2 for seed in range(4)]))
    assert law / 2 < rms < 2 * law


@pytest.mark.parametrize(
    ("errors", "camera", "rough"),
    [(NOMINAL, LEFT, (0.94, 3.8, 8.5)), (D455, LEFT, (0.5, 2.0, 4.5)), (AZURE, TOP, (0.5, 1.0, 1.5))],
    ids=("D435", "D455", "Azure"),
)
def test_a_flat_wall_is_as_rough_as_sources_say_of_each_camera(errors, camera, rough):
    # The sources' numbers (mm) at 0.5, 1 and 1.5 m. Those of time of flight are changes in time, without the warp.
    sizes = with_fields(*DISPARITY, *TIME_OF_FLIGHT, "disparity_step", "depth_step", of=errors)
    sizes = dataclasses.replace(sizes, baseline=errors.baseline, depth_warp=0.0)
    for z, wanted in zip((0.5, 1.0, 1.5), rough, strict=True):
        squares = [plane_rms(wall(z, sizes, seed, camera=camera)) ** 2 for seed in range(3)]
        assert wanted / 2 < 1000 * np.sqrt(np.mean(squares)) < 2 * wanted


@pytest.mark.release
def test_averaging_frames_of_time_of_flight_leaves_the_warp_and_the_bias():
    mean = wall(1.0, AZURE, frames=30, camera=TOP)
    (unit,) = draw_units(observed(1.0, TOP), AZURE, np.random.default_rng(0))
    assert np.std(mean - 1.0 - unit.depth_offset) < 0.0003
    units = [draw_units(observed(1.0, TOP), AZURE, np.random.default_rng(seed))[0] for seed in range(60)]
    offset = math.hypot(AZURE.depth_bias, AZURE.depth_warp)
    assert np.sqrt(np.mean([np.square(unit.depth_offset) for unit in units])) == pytest.approx(offset, rel=0.2)


def test_time_of_flight_has_a_ring_round_things_and_no_shadow_and_is_blind_for_dark_things():
    depth = np.full(TOP.size, 0.9)
    depth[100:300, 200:400] = 0.8
    for errors, widths in ((AZURE, (1, 2)), (AZURE_HARD, (2, 3))):
        sizes = with_fields("fattening", "least_fattening", "mixed", "invalid", "blind_below", of=errors)
        found = depth_of(observed(depth, TOP), sizes)
        for row in range(120, 280, 16):
            left, right = (abs(found[row] - depth[row]) > 1e-5)[:200].sum(), (found[row, 400:] != found[row, 500]).sum()
            assert {left, right} <= set(range(widths[1] + 1)) and left + right > 0
        changed = found[abs(found - depth) > 1e-5]
        assert (changed == 0).mean() == pytest.approx(0.5, abs=0.1)
        assert ((changed == 0) | ((changed > 0.8) & (changed < 0.9))).all()
        assert np.array_equal(found[105:295, 205:395], depth[105:295, 205:395].astype(np.float32))
        for gray in (errors.blind_below - 1, errors.blind_below):
            lost = (depth_of(observed(1.0, TOP, grey=gray), sizes) == 0).mean()
            assert lost == (gray < errors.blind_below)


def test_a_weak_lamp_blinds_no_depth_camera():
    seen = observed(1.0, grey=30)
    for errors in (AZURE_HARD, SensorErrors(dark_dropout=1.0)):
        units = draw_units(seen, errors, np.random.default_rng(0))
        lost = [(corrupt(seen, units, np.random.default_rng(1), lamp).views[0].depth == 0).mean() for lamp in (1, 0.5)]
        assert lost == [1.0, 0.0]
    with pytest.raises(ValueError, match=r"^brightness must be above 0, got 0$"):
        corrupt(seen, units, np.random.default_rng(1), 0)


def test_averaging_frames_leaves_the_warp_and_the_bias():
    errors = with_fields(*DISPARITY)
    mean = LAW / wall(1.0, errors, frames=30)
    (unit,) = draw_units(observed(1.0), errors, np.random.default_rng(0))
    truth = LAW + unit.offset
    assert np.std(mean - truth) < 0.3 * NOMINAL.disparity_noise
    assert np.std(mean) > 0.5 * NOMINAL.static_warp
    single = LAW / wall(1.0, errors) - truth
    assert np.std(single) == pytest.approx(NOMINAL.disparity_noise, rel=0.05)

    noise = wall(1.0, with_fields("disparity_noise"))
    noise = noise - noise.mean()
    neighbours, far = (np.mean(noise[:, n:] * noise[:, :-n]) / np.var(noise) for n in (1, 12))
    assert 0.3 < neighbours < 0.55 and abs(far) < 0.05, "half of the noise is alike in neighbours"


def test_units_err_as_much_as_their_errors_say():
    units = [draw_units(observed(1.0), NOMINAL, np.random.default_rng(seed))[0] for seed in range(60)]
    offset = math.hypot(NOMINAL.static_warp, NOMINAL.unit_bias)
    assert np.sqrt(np.mean([np.square(unit.offset) for unit in units])) == pytest.approx(offset, rel=0.2)
    assert np.std([unit.camera.position for unit in units]) == pytest.approx(NOMINAL.position_error, rel=0.2)
    turned = [math.acos(min(1, (np.trace(unit.camera.rotation) - 1) / 2)) for unit in units]
    assert np.sqrt(np.mean(np.square(turned)) / 3) == pytest.approx(NOMINAL.rotation_error, rel=0.2)


@pytest.mark.parametrize("baseline", [NOMINAL.baseline, D455.baseline])
@pytest.mark.parametrize(("front", "behind"), [(0.5, 0.05), (1.0, 0.2)])
def test_holes_beside_an_edge_are_as_wide_as_the_baseline_makes_them(front, behind, baseline):
    law = CAMERA.focal * baseline
    sizes = SensorErrors(baseline=baseline, occlusion=True)
    depth = np.full(SIZE, front + behind)
    depth[100:300, 200:400] = front
    found = depth_of(observed(depth), sizes)
    width = law * (1 / front - 1 / (front + behind))
    hole = found[200] == 0
    assert abs(hole[100:400].sum() - width) <= 1
    assert hole[200 - math.floor(width) : 200].all() and not hole[200:].any()
    assert abs(hole[:100].sum() - law / (front + behind)) <= 1  # the band at the left border
    assert not (found[50] == 0)[100:].any()
    near = law / sensor_errors.SEARCH  # What is nearer is not seen.
    for z, share in ((0.99 * near, 1.0), (1.01 * near, 0.0)):
        assert (depth_of(observed(z), sizes) == 0)[:, 200:].mean() == share


def table_view(camera):
    """Depth of the plane z = 0."""
    rays = View(camera, np.zeros((*camera.size, 3), np.uint8), np.ones(camera.size, np.float32)).points()
    fall = camera.position[2] - rays[..., 2]
    depth = np.where(fall > 0.05, camera.position[2] / np.maximum(fall, 0.05), 0).astype(np.float32)
    return View(camera, np.full((*camera.size, 3), 128, np.uint8), depth)


TWO_D435 = [
    camera_looking_at(str(number), place, (0.5, 0.0, 0.0))
    for number, place in enumerate(((1.0, 0.0, 0.75), (0.0, 0.5, 0.75)))
]


def disagreement(cameras, errors, seed):
    """RMS distance (m) between where two cameras see the same piece (20 mm) of a table, 1 m away."""
    clean = Observation(tuple(table_view(camera) for camera in cameras))
    units = draw_different_units(clean, errors, np.random.default_rng(seed))
    shifts = []
    for view, bad in zip(clean.views, corrupt(clean, units, np.random.default_rng(seed + 1)).views, strict=True):
        true, found = view.points(), bad.points()
        inside = (bad.depth > 0) & (abs(true[..., 0] - 0.5) < 0.2) & (abs(true[..., 1]) < 0.3)
        cell = ((true[inside][:, :2] - (0.3, -0.3)) // 0.02).astype(int)
        index = cell[:, 0] * 30 + cell[:, 1]
        count = np.bincount(index, minlength=600)
        error = (found - true)[inside]
        sums = [np.bincount(index, weights=error[:, axis], minlength=600) for axis in range(3)]
        shifts.append(np.stack(sums, axis=-1)[:600] / np.maximum(count, 1)[:600, None])
    return float(np.sqrt(np.mean(np.sum((shifts[0] - shifts[1]) ** 2, axis=-1))))


@pytest.mark.parametrize(
    ("cameras", "errors"),
    for_a_release(
        [(TWO_D435, (NOMINAL, NOMINAL)), ((LEFT, RIGHT), (D455, D455)), ((TOP, LEFT), (AZURE, D455))],
        lambda pair: pair[1] != (D455, D455),
    ),
    ids=("D435", "D455", "Azure and D455"),
)
def test_two_cameras_disagree_as_real_ones_do(cameras, errors):
    nominal = np.mean([disagreement(cameras, errors, seed) for seed in range(12)])
    assert 0.005 < nominal < 0.015
    assert disagreement(cameras, (SensorErrors(), SensorErrors()), 0) == 0.0


@pytest.mark.parametrize("kind", [*KINDS, "none"])
def test_a_kind_changes_its_own_part_only(kind):
    seen = observed(np.where(np.indices(SIZE)[1] < 320, 0.7, 1.0))
    (before,), (after,) = seen.views, corrupted(seen, with_fields(*KINDS.get(kind, ()))).views
    assert (after.camera == before.camera) == (kind not in ("rotation", "position"))
    assert np.array_equal(after.rgb, before.rgb) == (kind != "color")
    assert np.array_equal(after.depth, before.depth) == (kind in ("rotation", "position", "color", "none"))


def test_the_same_seeds_give_the_same_pictures_and_an_episode_keeps_its_unit():
    seen = observed(np.where(np.indices(SIZE)[1] < 320, 0.7, 1.0))
    first, second, other = (corrupted(seen, HARD, seed).views[0] for seed in (3, 3, 4))
    assert first.camera == second.camera != other.camera
    assert np.array_equal(first.depth, second.depth) and np.array_equal(first.rgb, second.rgb)
    assert not np.array_equal(first.depth, other.depth) and not np.array_equal(first.rgb, other.rgb)
    units = draw_units(seen, NOMINAL, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    (before,), (after,) = corrupt(seen, units, rng).views, corrupt(seen, units, rng).views
    assert before.camera == after.camera == units[0].camera
    assert not np.array_equal(before.depth, after.depth), "the noise is new in each frame"


def test_larger_errors_are_multiples_with_the_same_seed():
    seen = observed(1.0)
    sizes = {name: getattr(NOMINAL, name) for name in DISPARITY}
    several = (SensorErrors(**{name: factor * size for name, size in sizes.items()}) for factor in (1, 2))
    kinds = [draw_units(seen, errors, np.random.default_rng(5))[0] for errors in several]
    assert np.allclose(2 * kinds[0].offset, kinds[1].offset, atol=1e-6)
    together = draw_units(seen, NOMINAL, np.random.default_rng(5))[0]
    assert np.array_equal(together.offset, kinds[0].offset)


def test_edges_grow_mix_and_get_lost():
    depth = np.full(SIZE, 1.0)
    depth[100:300, 200:400] = 0.8
    grown, lost, mixed = (
        depth_of(observed(depth), SensorErrors(fattening=3, least_fattening=3, **more))
        for more in ({}, {"invalid": 1.0}, {"mixed": 1.0})
    )
    assert (grown[200] < 0.9).sum() == 206 and (grown[:, 300] < 0.9).sum() == 206
    assert (lost[200] == 0).sum() == 6
    between = mixed[200, [197, 198, 199, 400, 401, 402]]
    assert ((between > 0.8) & (between < 1.0)).all() and len(set(between)) == 6
    jittered = depth_of(observed(depth), SensorErrors(lateral_jitter=1.0))  # one surface or the other
    assert np.minimum(abs(jittered - 0.8), abs(jittered - 1.0)).max() < 0.006  # an eighth of a pixel of disparity
    assert 0.05 < (jittered[100:300, 199] < 0.9).mean() < 0.5


def test_dropouts_have_the_shares_that_they_name():
    errors = SensorErrors(dropout=0.02, dark_dropout=0.1, steep_dropout=0.3)
    for seen, share in ((observed(1.0), 0.02), (observed(1.0, grey=20), 0.1), (observed(1.0, grey=60), 0.02)):
        found = np.mean([(depth_of(seen, errors, seed) == 0).mean() for seed in range(4)])
        assert found == pytest.approx(share, rel=0.25)
    across = (np.arange(640) + 0.5 - 320) / 450
    for angle, share in ((60, 0.02), (75, 0.3)):  # a wall that is turned: at the middle, depth 1 m
        depth = 1 / (1 + across * math.tan(math.radians(angle)))
        lost = [(depth_of(observed(depth), errors, seed) == 0)[:, 300:340].mean() for seed in range(4)]
        assert np.mean(lost) == pytest.approx(share, rel=0.5)


def test_depth_comes_in_steps():
    found = depth_of(observed(1.2345), SensorErrors(depth_step=0.001))
    assert np.allclose(found, 1.234, atol=1e-6) or np.allclose(found, 1.235, atol=1e-6)
    found = depth_of(observed(np.linspace(0.9, 1.1, 640)), SensorErrors(disparity_step=1 / 32))
    assert np.allclose(LAW / found * 32, np.round(LAW / found * 32), atol=0.01)


def test_colour_gets_brighter_or_darker_and_noisy():
    seen = observed(1.0)
    errors = with_fields(*KINDS["color"], of=HARD)
    # Green has no error of white balance.
    means = np.array([corrupted(seen, errors, seed).views[0].rgb[..., 1].mean() for seed in range(20)])
    assert means.min() >= 128 / 1.6 - 1 and means.max() <= 128 * 1.6 + 1 and np.ptp(means) > 50
    plain = corrupted(seen, SensorErrors(color_noise=5.0)).views[0].rgb
    assert plain.std() == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"baseline": 0.0}, r"^baseline must be above 0 m, got 0$"),
        ({"disparity_noise": -0.1}, r"^disparity_noise must be a finite number of at least 0, got -0.1$"),
        ({"rotation_error": math.nan}, r"^rotation_error must be a finite number of at least 0, got nan$"),
        ({"dropout": 1.5}, r"^dropout must be a fraction of at most 1, got 1.5$"),
        ({"least_fattening": 2}, r"^fattening must be from least_fattening to 32, got 0$"),
        ({"fattening": 100}, r"^fattening must be from least_fattening to 32, got 100$"),
        ({"mixed": 0.7, "invalid": 0.6}, r"^mixed and invalid must add up to at most 1, got 0.7 and 0.6$"),
    ],
)
def test_errors_that_cannot_be_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        SensorErrors(**fields)


def test_kinds_cover_every_error_once_and_cameras_that_do_not_fit_are_refused():
    names = [name for names in KINDS.values() for name in names]
    assert sorted(names) == sorted(
        {field.name for field in dataclasses.fields(SensorErrors)} - {"baseline", *TIME_OF_FLIGHT}
    )
    units = draw_units(observed(1.0), NOMINAL, np.random.default_rng(0))
    other = observed(1.0, dataclasses.replace(CAMERA, name="ceiling"))
    with pytest.raises(ValueError, match=r"^units must be of the observation's cameras \[\('ceiling'.*got \[\('wall'"):
        corrupt(other, units, np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"^errors must be as many as the observation's cameras, 1, got 2$"):
        draw_different_units(other, (AZURE, D455), np.random.default_rng(0))
