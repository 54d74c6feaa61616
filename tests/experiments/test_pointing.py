import dataclasses
import itertools
import pickle

import numpy as np
import pointing
import pytest
from pointing import Pointing, lay_out, point
from shapely.geometry import Point

from experiments.pointing import measure
from experiments.pointing.__main__ import APP
from gem_lite import tasks
from gem_lite.cli import base
from gem_lite.evaluation import calibrating, results
from gem_lite.foundations import colors
from gem_lite.maps import crop_memory
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes

pytestmark = pytest.mark.release

SEED = tasks.episode_seed("val", 900_000)


@pytest.fixture(scope="module")
def scenes(world):
    """A scene of each kind that no result is made of."""
    return {kind: lay_out(kind, world, SEED) for kind in pointing.KINDS}


def peak_at(x, y):
    """A map (H, W) with a 3 x 3 plateau around the cell at (x, y)."""
    semantic = np.zeros(LITE.workspace.shape, np.float32)
    row, col = LITE.workspace.nearest_cell(x, y)
    semantic[row - 1 : row + 2, col - 1 : col + 2] = 1.0
    return semantic


@pytest.mark.parametrize("kind", pointing.KINDS)
def test_a_seed_makes_one_scene(world, scenes, kind):
    again, other = lay_out(kind, world, SEED), lay_out(kind, world, SEED + 1)
    assert (again.questions, again.poses) == (scenes[kind].questions, scenes[kind].poses)
    assert np.array_equal(again.views[0].rgb, scenes[kind].views[0].rgb)
    assert other.poses != again.poses
    with pytest.raises(ValueError, match="kind must be one of bowls, shapes, got 'cups'"):
        lay_out("cups", world, 0)


def test_pieces_differ_in_colour_or_shape_and_two_are_asked_for(world, scenes):
    # Ten of 140 pairs drawn without care would meet in about one scene of four.
    for scene in [scenes["shapes"], *(pointing.lay_out_shapes(world, SEED + i) for i in range(2, 8))]:
        assert len(scene.names) == len(set(scene.names.values())) == pointing.PIECES
        assert {name.split()[0] for name in scene.names.values()} <= set(colors.UNSEEN)
        assert len(set(scene.questions)) == pointing.QUESTIONS
        assert all(len(scene.poses_of(name)) == 1 and phrase == name for phrase, name in scene.questions)


def test_right_bowls_and_blocks_are_all_of_the_named_colour(world):
    counts = set()
    for seed in range(SEED, SEED + 4):
        scene = pointing.lay_out_bowls(world, seed)
        (pick, block), (place, bowl) = scene.questions
        assert (pick, place) == (f"{block}s", bowl)
        assert world.task.instruction == f"put the {pick} in a {place}"
        # The task fixes the named bowls and no others, and allows one step a block and one more.
        fixed = [world.pose(body)[0] for body in world.bodies if not body.movable]
        assert scene.poses_of(bowl) == fixed
        assert len(scene.poses_of(block)) == world.task.max_steps - 1
        assert len(scene.names) == len(world.bodies)
        counts.add(len(fixed))
    assert len(counts) > 1


@pytest.mark.parametrize("kind", pointing.KINDS)
def test_masks_lie_where_the_bodies_are(scenes, kind):
    # Tells a mirrored, turned, shifted or half-a-cell wrong mask.
    scene, offsets = scenes[kind], []
    for body, pose in scene.poses.items():
        name = scene.names[body].split(" ", 1)[1]
        middle = shapes.outline(name).centroid if kind == "shapes" else Point(0, 0)
        at = pose @ Pose2(middle.x, middle.y)
        offsets.append(np.argwhere(scene.above == body).mean(axis=0) - LITE.workspace.to_pixel(at.x, at.y))
    assert np.abs(offsets).max() < 0.4
    assert np.abs(np.mean(offsets, axis=0)).max() < 0.15


def test_bowls_have_no_hole_from_above_and_a_peak_at_a_right_body_hits_it_whichever_it_is(scenes):
    scene = scenes["bowls"]
    for body in (body for body, name in scene.names.items() if name.endswith("bowl")):
        area = (scene.above == body).sum() * (1000 * LITE.pixel) ** 2
        assert area == pytest.approx(np.pi * 58**2, rel=0.05)
    for question in scene.questions:
        for pose in scene.poses_of(question[1]):
            found = point(peak_at(pose.x, pose.y), "fused", scene, question)
            assert found.near and found.exact and found.shown == question[1]
            assert found.distance <= LITE.pixel / np.sqrt(2)
            assert (found.row, found.col) == pytest.approx(LITE.workspace.nearest_cell(pose.x, pose.y), abs=1e-4)


def test_a_peak_on_the_table_misses_and_one_on_another_body_names_it(scenes):
    scene = scenes["bowls"]
    question = scene.questions[0]
    x, y = LITE.workspace.to_world(*np.indices(LITE.workspace.shape))
    free = np.min([np.hypot(x - pose.x, y - pose.y) for pose in scene.poses.values()], axis=0)
    free[[0, -1]] = free[:, [0, -1]] = 0  # so that the plateau fits
    cell = np.unravel_index(free.argmax(), free.shape)
    missed = point(peak_at(x[cell], y[cell]), "fused", scene, question)
    other, name = next((body, name) for body, name in scene.names.items() if name != question[1])
    wrong = point(peak_at(scene.poses[other].x, scene.poses[other].y), "fused", scene, question)
    for found, shown in ((missed, "table"), (wrong, name)):
        assert (found.near, found.exact, found.shown) == (False, False, shown)
    assert missed.distance >= free.max() - 1e-9
    assert dataclasses.replace(missed, distance=pointing.RADIUS).near
    assert not dataclasses.replace(missed, distance=pointing.RADIUS + 1e-6).near


def test_the_truth_reaches_no_map(scenes, model):
    scene = scenes["bowls"]
    true = measure.play_scene(scene, model, None)
    turned = dict(zip(scene.poses, [*list(scene.poses.values())[1:], next(iter(scene.poses.values()))], strict=True))
    false = measure.play_scene(dataclasses.replace(scene, poses=turned, above=np.zeros_like(scene.above)), model, None)
    assert [(p.row, p.col) for p in true] == [(p.row, p.col) for p in false]
    assert [p.distance for p in true] != [p.distance for p in false]
    assert not any(p.exact for p in false)


def test_every_map_answers_and_without_a_crop_there_is_no_image_map(scenes, model):
    scene = scenes["shapes"]
    (known, _), (unknown, _) = scene.questions
    body = next(body for body, name in scene.names.items() if name == known)
    crop = crop_memory.cut(fuse_views(scene.views, LITE.workspace), scene.poses[body], LITE.top_patch)
    found = measure.play_scene(scene, model, CropMemory([CropEntry(known, crop, "t", 0)], model))
    assert [p.map for p in found if p.phrase == known] == list(measure.MAPS)
    assert [p.map for p in found if p.phrase == unknown] == [name for name in measure.MAPS if name != "image"]
    fused, _, _, _, blended = ((p.row, p.col) for p in found if p.phrase == unknown)
    assert fused == blended
    rows = {row["map"]: row for row in measure.result_rows("shapes", found, {})}
    assert (rows["image"]["phrases"], rows["image"]["without_crop"]) == (1, 1)
    assert (rows["fused"]["phrases"], rows["fused"]["without_crop"]) == (2, 0)
    assert rows["fused"]["missed"] == [[p.seed, p.phrase] for p in found if p.map == "fused" and not p.near]


def test_what_a_process_is_sent_makes_it_play_as_this_one_does(world, model, monkeypatch):
    def run_jobs(run, jobs, *_):
        return [outcome for job in pickle.loads(pickle.dumps(jobs)) for outcome in run(job)]

    monkeypatch.setattr(measure.workers, "run_jobs", run_jobs)
    seeds = measure.scene_seeds(1)
    crops = [CropEntry("blue hexagon", np.full((20, 20, 3), 90, np.uint8), "t", 0)]
    memory = CropMemory(crops, model)
    here = measure.play_scene(lay_out("shapes", world, seeds[0]), model, memory)
    there = measure.play("shapes", 1, memory)
    for one, other in zip(there, here, strict=True):  # Sums of floats may differ in their last digits.
        assert (one.row, one.col, one.distance) == pytest.approx((other.row, other.col, other.distance), abs=1e-5)
        assert dataclasses.replace(one, row=other.row, col=other.col, distance=other.distance) == other


def test_rates_of_known_outcomes():
    def rate(outcomes):
        found = [Pointing(seed, str(i), "fused", 0, 0, 0, "", hit) for i, (seed, hit) in enumerate(outcomes)]
        return measure.rate(found, lambda p: p.exact)

    perfect = rate([(seed, True) for seed in range(100)])
    assert (perfect["mean"], perfect["ci95"]) == (100.0, [96.4, 100.0])
    assert perfect["by_scene"] == {str(seed): 1.0 for seed in range(100)}
    # A scene counts once, however many of its phrases are left: (1 + 0 + 1/2) / 3.
    assert rate([(0, True), (1, False), (2, True), (2, False)])["mean"] == 50.0
    assert rate([(0, True), (0, True), (0, True), (1, False)])["mean"] == 50.0
    # Queries of one scene that hit or miss together make the interval wider than as many scenes would.
    together = rate([(seed, seed % 2 == 0) for seed in range(20) for _ in range(10)])["ci95"]
    apart = rate([(seed, seed % 2 == 0) for seed in range(200)])["ci95"]
    assert together[1] - together[0] > 2 * (apart[1] - apart[0])
    assert rate([]) is None


def test_rows_replace_those_of_the_same_clip_alone(tmp_path):
    path = tmp_path / "pointing.jsonl"

    def rows_of(fingerprint, hit, seeds=(3, 4)):
        found = [Pointing(s, "red block", m, 0, 0, 0.5 - 0.5 * hit, "", hit) for s in seeds for m in measure.MAPS]
        facts = {"world": "home", "clip": "tiny", "clip_fingerprint": fingerprint, "config": "lite"}
        return measure.result_rows("bowls", found, facts | {"config_hash": LITE.digest, "crops": 2})

    for fingerprint, hit in (("a", False), ("b", False), ("a", True)):
        results.file_rows(rows_of(fingerprint, hit), path, measure.IDENTITY)
    rows = results.read_rows(path)
    assert len(rows) == 2 * len(measure.MAPS)
    for row in rows:
        share = float(row["clip_fingerprint"] == "a")
        assert row["exact"]["mean"] == row["within_20mm"]["mean"] == 100 * share
        assert row["exact"]["by_scene"] == {"3": share, "4": share}
        assert (row["kind"], row["scenes"], row["scene_count"], row["seeds"]) == ("pointing", "bowls", 2, [3, 4])
    with pytest.raises(ValueError, match=r"holds a row over 2 episodes \(kind pointing, scenes bowls, map fused"):
        results.file_rows(rows_of("a", True, seeds=(3,)), path, measure.IDENTITY)


def test_scenes_are_in_no_evaluation_and_no_calibration():
    seeds = set(measure.scene_seeds(1000))
    assert len(seeds) == 1000
    assert not seeds & {tasks.episode_seed("val", index) for index in range(calibrating.SCENES)}
    rows = results.stored_rows()
    longest = max(row["episodes"] for row in rows)  # a subset holds fewer episodes than were run
    for split, start in {(row["split"], row["start"]) for row in rows}:
        first = tasks.episode_seed(split, start)
        assert not seeds & set(range(first, first + longest))


def test_crops_are_of_training_scenes_in_seen_colours_or_of_what_demonstrations_named(demo_set, model, monkeypatch):
    monkeypatch.setattr(measure, "TRAINING_SCENES", 1)
    entries = measure.demonstrated_crops("shapes", model).entries
    assert len(entries) == pointing.PIECES
    assert {entry.phrase.split()[0] for entry in entries} <= set(colors.SEEN)
    assert {entry.image.shape for entry in entries} == {(round(LITE.top_patch / LITE.pixel),) * 2 + (3,)}
    # Each shows a piece: something brighter than the table, and no two are alike.
    assert min(entry.image.max() for entry in entries) > 2 * max(colors.TABLE)
    assert all(not np.array_equal(a.image, b.image) for a, b in itertools.combinations(entries, 2))
    folder, demos = demo_set
    monkeypatch.setattr(measure, "DEMONSTRATIONS", folder)
    entries = measure.demonstrated_crops("bowls", model).entries
    phrases = [phrase for demo in demos for step in demo.steps for phrase in (step.phrases.pick, step.phrases.place)]
    assert {entry.phrase for entry in entries} == set(phrases) and len(entries) == len(phrases)


def test_the_command_measures_scenes_and_a_task(jobs_here, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert base.run(APP, ["--scenes", "1", "--kind", "shapes"]) == 0
    printed = capsys.readouterr().out
    assert "shapes, fused: near " in printed and "the rows are in runs/results/pointing.jsonl" in printed
    assert base.run(APP, ["--scenes", "1", "--task", "packing-shapes-seen", "--out", "rows.jsonl"]) == 0
    assert "the map points at the named piece of packing-shapes-seen: " in capsys.readouterr().out
    assert [row["method"] for row in results.read_rows(tmp_path / "rows.jsonl")] == [measure.METHOD]


def test_a_packing_scene_is_the_evaluation_episode_and_asks_for_its_piece(world):
    for index in range(3):
        scene = measure.lay_out_packing(world, "packing-shapes-unseen", index)
        assert scene.seed == tasks.episode_seed("test", index)
        (phrase, wanted) = scene.questions[0]
        assert wanted.lower().endswith(phrase) and len(scene.poses_of(wanted)) == 1
        assert world.task.instruction.lower() == f"pack the {phrase} in the brown box"


def test_packing_rows_count_maps_that_point_at_the_piece(model, monkeypatch, tmp_path):
    found = measure.play_packing("packing-shapes-seen", 2, model)
    assert [episode.index for episode in found] == [0, 1] and {e.reward for e in found} <= {0.0, 1.0}
    # A map that is highest on the bare corner of the table is right in no episode.
    corner = np.zeros(LITE.workspace.shape, np.float32)
    corner[:2, :2] = 1
    monkeypatch.setattr(measure.semantic_map, "text_conditioned_map", lambda *_: corner)
    assert sum(e.reward for e in measure.play_packing("packing-shapes-seen", 2, model)) == 0
