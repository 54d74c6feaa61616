"""Peaks of maps from other sources, on scenes with known things."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.other_eyes import acts, peaks, pictures, proposals, scenes
from gem_lite import tasks
from gem_lite.evaluation import results
from gem_lite.maps import regions
from gem_lite.planning import naming
from gem_lite.rgbd.heightmap import fuse_views


def test_a_peak_of_many_cells_counts_by_the_share_on_the_thing():
    cells = np.zeros((10, 10), bool)
    cells[2:4, 2:4] = True
    semantic = np.zeros((10, 10), np.float32)
    assert peaks.share_on(semantic, cells) == 0, "a map that is 0 everywhere points at nothing"
    semantic[5, 5] = 0.9
    assert peaks.share_on(semantic, cells) == 0
    semantic[4, 4] = 1.0
    assert peaks.share_on(semantic, cells) == 1, "a cell beside the thing counts"
    semantic[7, 7:9] = 1.0
    assert peaks.share_on(semantic, cells) == pytest.approx(1 / 3)


@pytest.mark.parametrize(("kind", "roles"), [(scenes.BOWLS, ("pick", "place")), (scenes.TOUCHING, ("pick",))])
def test_a_questions_cells_show_the_named_colour(kind, roles):
    with scenes.world_of(kind) as world:
        scene = scenes.look(world, kind, "val", 1)
        again = scenes.look(world, kind, "val", 1)
    assert tuple(question.role for question in scene.questions) == roles
    workspace = scenes.configuration(kind).workspace
    table = fuse_views(scene.views, workspace).rgb.astype(int)
    for question, same in zip(scene.questions, again.questions, strict=True):
        assert question.phrase == same.phrase and np.array_equal(question.cells, same.cells)
        assert 20 < question.cells.sum() < question.cells.size / 10
        on_thing = np.median(table[question.cells], axis=0)
        assert np.abs(on_thing - np.median(table.reshape(-1, 3), axis=0)).max() > 40


def test_the_touching_blocks_touch():
    task = scenes.make(scenes.TOUCHING, "test")
    with scenes.world_of(scenes.TOUCHING) as world:
        world.reset(task, tasks.episode_seed("test", 0))
        one, other, alone = (world.pose(body)[0] for body in world.bodies)
    between = one.inverse() @ other
    assert np.hypot(between.x, between.y) == pytest.approx(scenes.BETWEEN_MIDDLES, abs=0.001)
    assert np.hypot(one.x - alone.x, one.y - alone.y) > 0.04


def test_peaks_are_filed_and_a_region_of_two_blocks_is_half_right(tmp_path):
    path = tmp_path / "rows.jsonl"
    rows = peaks.measure(("multi-view", "regions"), (scenes.TOUCHING,), "test", 2, "", None, path)
    assert results.read_rows(path) == rows
    whole, regions = rows
    assert (whole["method"], regions["method"]) == ("multi-view", "regions")
    assert whole["config_hash"] != regions["config_hash"] and whole["clip_fingerprint"] == regions["clip_fingerprint"]
    assert whole["mean"] > regions["mean"]
    shares = [*regions["rewards"].values()]
    assert all(0.3 < share < 0.75 or share == 0 for share in shares) and max(shares) > 0.3
    assert "touching-blocks" in peaks.described(rows)


def test_a_detector_that_no_source_reads_is_refused(tmp_path):
    with pytest.raises(ValueError, match="detector must be left out, because none of multi-view reads it, got 'some'"):
        peaks.measure(("multi-view",), (scenes.TOUCHING,), "val", 1, "some", None, tmp_path / "rows.jsonl")


def test_pictures_are_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "SHOWN", {scenes.TOUCHING: ""})
    (path,) = pictures.draw(tmp_path / "new", 0, ("regions",), "", None)
    assert path.stat().st_size > 2000


@pytest.mark.parametrize(
    ("name", "expected"), [("regions", 2), ("regions-that-rise", 1), ("regions-of-whole-things", 1)]
)
def test_the_ways_to_propose_regions_differ_in_a_flat_part(name, expected, monkeypatch):
    """A handle that rises, and a flat blade that touches it."""
    source = peaks.make_source(name, scenes.TOUCHING, "", None)
    handle, blade = np.zeros((2, *source.config.workspace.shape), bool)
    handle[10:20, 10:14], blade[21:30, 10:14] = True, True
    for module in (regions, proposals, naming.things):
        monkeypatch.setattr(module, "things", lambda heightmap: ([handle.copy()], [blade]))
    proposed = source.propose(None)
    assert len(proposed) == expected
    assert np.any(proposed, axis=0)[25, 12] == (name != "regions-that-rise")


def test_a_pick_on_the_named_thing_is_right():
    with scenes.world_of(scenes.BOWLS) as world:
        scene = scenes.look(world, scenes.BOWLS, "val", 0)
    inside = tuple(np.argwhere(scene.questions[0].cells)[0])
    table = fuse_views(scene.views, scenes.configuration(scenes.BOWLS).workspace)

    def policy(cell):
        source = peaks.make_source("regions", scenes.BOWLS, "", None)
        chosen = SimpleNamespace(pick_cell=(0, *cell), heightmap=table, pick_map=table.height)
        return SimpleNamespace(config=source.config, decide=lambda observation, queries: chosen)

    right, wrong = policy(inside), policy((0, 0))
    panels, rights = acts.row_of(scene, [right, wrong])
    assert rights == [True, False]
    titles = [title for title, *_ in panels]
    assert titles[0].startswith(f'"{scene.questions[0].phrase}"')
    assert titles[1:] == ["regions\npick: right", "regions\npick: wrong"]
