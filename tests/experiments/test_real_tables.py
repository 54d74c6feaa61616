"""Kernels of an object's two parts, and maps that look for a colour: what is counted, filed and drawn."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
import torch
from small import SMALL

from experiments.real_tables import color_bias, displaced, kernels, pictures
from experiments.real_tables.color_bias import Setting
from gem_lite import clip, tasks
from gem_lite.evaluation import results
from gem_lite.evaluation.rollout import rollout
from gem_lite.policies import checkpoints
from gem_lite.policies.gem import Gem
from gem_lite.policies.transporter import TransporterLan
from gem_lite.simulation import looks
from gem_lite.simulation.world import World
from gem_lite.tasks import real_table

FACTS = {"task": "a + b", "demos": 5, "seed": 0, "demonstrations_world": "real-table"}


def test_rows_of_kernels_hold_both_cosines_and_those_of_random_weights(model, tmp_path, monkeypatch):
    monkeypatch.setattr(kernels, "UNTRAINED", 1)
    path = tmp_path / "policy.safetensors"
    policy = Gem(SMALL, model, seed=7)
    checkpoints.save_policy(policy, path, FACTS)
    rows = kernels.measure(path, kernels.load(path, model))
    assert [row["object"] for row in rows] == list(kernels.SEEN) and rows[0]["parts"] == ["brim", "handle"]
    words = ["mug brim", "mug handle"]
    brim, handle = kernels.pick_kernels(policy, words).flatten(1)
    raw = torch.nn.functional.cosine_similarity(brim, handle, dim=0)
    assert rows[0]["cosine"] == pytest.approx(float(raw), abs=1e-3)
    mean = kernels.pick_kernels(policy, kernels.PHRASES).mean(dim=0).flatten()
    centred = torch.nn.functional.cosine_similarity(brim - mean, handle - mean, dim=0)
    assert rows[0]["centred_cosine"] == pytest.approx(float(centred), abs=1e-3)
    assert rows[0]["untrained_cosine"][0] > 0.99, "what all kernels share hides the rest"
    kernels.file(rows, tmp_path / "rows.jsonl")
    kernels.file(rows, tmp_path / "rows.jsonl")
    assert results.read_rows(tmp_path / "rows.jsonl") == rows
    pictures.draw_kernels(policy, tmp_path / "kernels.png")
    assert (tmp_path / "kernels.png").stat().st_size > 10_000


def test_the_table_counts_objects_below_the_bar():
    numbers = {"untrained_cosine": [1.0, 0.8], "untrained_centred_cosine": [0.1, 0.95]}
    rows = [
        {"object": name, "parts": ["a", "b"], "cosine": cosine, "centred_cosine": 0.89, **numbers}
        for name, cosine in (("mug", 0.91), ("axe", 0.2))
    ]
    *_, raw, centred = kernels.described(rows).splitlines()
    assert raw == "below 0.9, as they are: 1 of 2 objects; random weights: 0, 2"
    assert centred == "below 0.9, their mean subtracted: 2 of 2 objects; random weights: 2, 0"


def test_a_rival_without_such_kernels_is_refused(model, monkeypatch):
    rival = TransporterLan(TransporterLan.Config(), model)
    monkeypatch.setattr(checkpoints, "load_policy", lambda *_: rival)
    with pytest.raises(ValueError, match="must hold a policy of GEM, whose kernels words make, got transporter-lan"):
        kernels.load("a.safetensors", model)


@pytest.fixture(scope="module")
def scenes(model):
    """One layout with a bright and a dark screwdriver."""
    config = color_bias.configuration()
    with World(style=looks.style(color_bias.WORLD)) as world:
        bright = color_bias.demonstrated(world, Setting("yellow", 1.0, 0), config)
        return [
            color_bias.look(world, Setting("yellow", brightness, 0), bright, model, config)
            for brightness in (1.0, 0.25)
        ]


def test_only_the_screwdrivers_brightness_changes(scenes):
    bright, dark = (scene.embedding.heightmap for scene in scenes)
    assert np.array_equal(scenes[0].on_screwdriver, scenes[1].on_screwdriver)
    assert scenes[0].on_screwdriver.sum() > 50 and scenes[0].on_block.sum() > 80
    assert np.array_equal(bright.rgb[scenes[0].on_block], dark.rgb[scenes[0].on_block])
    lightness = [table.rgb[scenes[0].on_screwdriver].mean() for table in (bright, dark)]
    assert lightness[1] < 0.7 * lightness[0]


def test_every_map_is_there_and_blends_are_of_eq_4(scenes):
    maps = scenes[1].maps
    assert len(maps) == 2 + len(color_bias.SIDES) * len(color_bias.SHOWN) * (1 + len(color_bias.WEIGHTS))
    assert set(color_bias.PICTURED) <= set(maps)
    blend = 0.8 * maps["words"] + 0.2 * maps["dark crop of 30 mm"]
    assert np.allclose(maps["0.8 words + 0.2 dark crop of 30 mm"], blend, atol=1e-6)
    assert not np.allclose(maps["dark crop of 30 mm"], maps["bright crop of 30 mm"])


def test_the_highest_thing_counts_and_the_bare_table_does_not(scenes):
    scene = scenes[0]
    semantic = np.where(scene.on_block, 0.5, 0).astype(np.float32)
    bare = np.argwhere(~scene.on_things)[0]
    semantic[tuple(bare)] = 1
    staged = dataclasses.replace(scene, maps={"words": semantic})
    assert staged.outcome(semantic) == "elsewhere"
    assert staged.outcome(staged.of_things("words")) == "block"
    assert staged.bias == pytest.approx(0.5)
    staged = dataclasses.replace(scene, maps={"words": 1.0 * scene.on_screwdriver})
    assert staged.outcome(staged.of_things("words")) == "screwdriver"


def test_a_row_counts_by_colour_and_its_mean_is_over_layouts(model):
    outcomes = {Setting(color, 0.5, index): "screwdriver" for color in color_bias.NAMED_COLORS for index in range(2)}
    outcomes[Setting("red", 0.5, 1)] = "block"
    peaks = Counter(screwdriver=7, elsewhere=1)
    row = color_bias.row_of("words", 0.5, outcomes, peaks, model, color_bias.configuration())
    assert row["on"]["red"] == [1, 1, 0] and row["on"]["blue"] == [2, 0, 0] and row["peak_on"] == [7, 0, 1]
    assert (row["rewards"], row["mean"], row["episodes"]) == ({"0": 1.0, "1": 0.75}, 87.5, 2)
    rows = [{**row, "brightness": brightness} for brightness in color_bias.BRIGHTNESSES]
    lines = color_bias.described(rows).splitlines()
    assert lines[2].split() == ["words", *["7/1/0"] * len(color_bias.BRIGHTNESSES)]


def test_stored_rows_cover_every_brightness_once():
    rows = results.read_rows(clip.DATA / "real-tables" / "color-bias.jsonl")
    of_words = {row["brightness"]: row for row in rows if row["method"] == "words"}
    assert tuple(of_words) == color_bias.BRIGHTNESSES
    scenes = len(color_bias.NAMED_COLORS) * of_words[1.0]["episodes"]
    assert all(np.sum(list(row["on"].values())) == scenes == sum(row["peak_on"]) for row in rows)


def test_a_displacement_is_found_and_points_along_the_table():
    rng = np.random.default_rng(0)
    picture = np.kron(rng.uniform(0, 255, (16, 16)), np.ones((8, 8)))
    rows, columns = displaced.displacement(picture, np.roll(picture, (3, -2), (0, 1)))
    assert (rows, columns) == (pytest.approx(3, abs=0.2), pytest.approx(-2, abs=0.2))
    x, y = displaced.in_world((3, -2), real_table.WORKSPACE)
    before, after = real_table.WORKSPACE.to_world(40, 40), real_table.WORKSPACE.to_world(43, 38)
    assert (x, y) == pytest.approx(np.subtract(after, before))


def test_an_expert_that_acts_beside_the_true_pose_loses():
    task = tasks.make("arrange-letter-to-word-seen", "test")
    with World(style=looks.style(displaced.PERFECT)) as world:
        seed = tasks.episode_seed("test", 0)
        rewards = [
            sum(turn.result.reward for turn in rollout(world, task, seed, displaced.displaced_expert(0.0, y)))
            for y in (0.0, 0.03)
        ]
    assert rewards == [pytest.approx(1), 0]


def test_only_tasks_of_the_real_tables_are_displaced(tmp_path):
    with pytest.raises(ValueError, match=r"tasks must be of .*, got 'bars-in-box'"):
        displaced.measure(["bars-in-box"], 1, tmp_path / "rows.jsonl")
