"""Four tasks on the table of another simulator: what lies there, what counts, and that an expert wins."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from shapely import affinity

pytest.importorskip("foreign_world")

from experiments.foreign_tasks import bodies, families, playing
from experiments.foreign_tasks.__main__ import APP
from experiments.foreign_tasks.families import FAMILIES
from experiments.foreign_tasks.table import TaskTable
from gem_lite import clip, tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.cli import base
from gem_lite.evaluation import results
from gem_lite.foundations import colors
from gem_lite.language import parse
from gem_lite.policies.choosing import Choice
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.world import World

pytestmark = pytest.mark.release

PLACED = [name for name in FAMILIES if name != "separating-piles"]


class Layout(TaskTable):
    """A table on which nothing moves: its model is made and checked, not simulated."""

    def load(self, model, things):
        self.model = model


def laid(family, index, split="val"):
    task = playing.make(family, split)
    table = Layout()
    table.begin(task, playing.SEEDS[split][index])
    return task, table.model


@pytest.mark.parametrize("family", FAMILIES)
def test_sentences_are_read_and_name_seen_colors(family):
    for index in range(3):
        task, _ = laid(family, index)
        assert set(task.named_colors) <= set(colors.SEEN)
        for goal in task.goals:
            queries = parse(goal.sentence)
            assert any(color in f"{queries.pick} {queries.place}" for color in task.named_colors)
            assert queries.push == (family == "separating-piles")


def test_validation_and_test_episodes_differ():
    assert not set(playing.SEEDS["val"]) & set(playing.SEEDS["test"])
    first, second, again = (laid("assembling-kits", 0, split)[0] for split in ("val", "test", "val"))
    sentences = [[goal.sentence for goal in task.goals] for task in (first, second, again)]
    assert sentences[0] == sentences[2] != sentences[1]


def test_sizes_are_others_than_ours():
    for index in range(4):
        _, model = laid("stack-block-pyramid", index)
        sides = {2 * model.geom_size[model.body(f"thing{number}").geomadr[0]][0] for number in range(6)}
        (side,) = sides
        assert 0.049 < abs(side / shapes.BLOCK_SIZE - 1) < 0.101


def test_pieces_have_proportions_of_their_own():
    rng = np.random.default_rng(0)
    outlines = [bodies.piece_outline(name, rng) for name in shapes.UNSEEN_SHAPES for _ in range(20)]
    sides = np.array([np.subtract(outline.bounds[2:], outline.bounds[:2]) for outline in outlines])
    assert sides.max() <= bodies.SIZE * bodies.STRETCH[1] + 1e-9 and np.ptp(sides[:, 0] / sides[:, 1]) > 0.5
    for outline in outlines:
        assert outline.is_valid and np.allclose(np.add(outline.bounds[:2], outline.bounds[2:]), 0, atol=1e-9)
        grasp = bodies.grasp(outline)
        assert outline.contains(bodies.Point(grasp.x, grasp.y))


def test_the_symmetry_of_an_outline_is_that_of_its_form():
    hexagon = bodies.polygon(6)
    ring = bodies.polygon(48).difference(bodies.polygon(48, (0.4,)))
    assert bodies.symmetry(ring) == 0 and bodies.symmetry(hexagon) == pytest.approx(math.pi / 3)
    for outline in (ring, hexagon):
        assert bodies.symmetry(affinity.scale(outline, 1.25, 0.8)) == pytest.approx(math.pi)
    assert bodies.symmetry(bodies.heart()) == bodies.symmetry(bodies.letter("E", bodies.FONTS[0])) == 2 * math.pi


@pytest.mark.parametrize("family", PLACED)
def test_the_expert_wins_an_episode(family):
    with TaskTable() as table:
        task = playing.make(family, "val")
        episode = playing.play(table, task, "val", 0, playing.by_expert)
    assert episode.reward == pytest.approx(1) and episode.steps == len(task.goals)


@pytest.mark.parametrize("family", PLACED)
def test_a_thing_at_a_wrong_place_earns_nothing(family):
    task = playing.make(family, "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        right = task.expert(table).action
        assert table.act(PickPlace(right.pick, right.place @ Pose2(0.015, 0.0))) and task.score(table) == 0
        assert not table.act(PickPlace(Pose2(0.26, -0.49), right.place)) and task.score(table) == 0


def test_a_piece_with_a_wrong_turn_earns_nothing():
    task = playing.make("assembling-kits", "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        right = task.expert(table).action
        hole = task.goals[0].targets[0]
        turned = Pose2(hole.x, hole.y, math.pi / 2) @ Pose2(-hole.x, -hole.y) @ right.place
        assert table.act(PickPlace(right.pick, turned)) and task.score(table) == 0


def test_a_push_into_the_named_square_scores_and_one_away_from_it_does_not():
    task = playing.make("separating-piles", "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        before = task.score(table)
        push = task.expert(table).action
        table.act(Push(push.start, Pose2(2 * push.start.x - push.end.x, 2 * push.start.y - push.end.y)))
        assert task.score(table) <= before
        table.act(task.expert(table).action)
        assert task.score(table) > before + 0.1


class ExpertByChoice:
    """Stands for a policy: its choice is an expert's action, on the height map that a policy would see."""

    def __init__(self, table, task):
        self.table = table
        self.task = task

    def decide(self, observation, sentence, empty_picks):
        assert sentence == self.task.instruction
        return choice_of(observation, self.task.expert(self.table).action)


def choice_of(observation, action):
    """A choice of an action, with the same logits everywhere."""
    heightmap = fuse_views(observation.views, Workspace())
    logits = np.zeros((1, *Workspace().shape))
    return Choice("", None, heightmap, logits, logits, (0, 0, 0), (0, 0, 0), action)


@pytest.mark.parametrize("family", ["stack-block-pyramid", "separating-piles"])
def test_what_a_policy_chooses_is_done(family):
    task = playing.make(family, "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        before = task.score(table)
        assert playing.by_policy(ExpertByChoice(table, task), table, task, ()) == ()
        assert task.score(table) > before


def test_a_pick_that_holds_nothing_is_remembered_until_one_holds():
    task = playing.make("stack-block-pyramid", "val")
    bare = Pose2(0.26, -0.49)
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        expert = ExpertByChoice(table, task)
        missed = PickPlace(bare, task.expert(table).action.place)
        blind = SimpleNamespace(decide=lambda observation, *_: choice_of(observation, missed))
        assert playing.by_policy(blind, table, task, ()) == (bare,)
        assert playing.by_policy(blind, table, task, (bare,)) == (bare, bare)
        assert playing.by_policy(expert, table, task, (bare,)) == ()


def test_an_expert_without_an_act_does_nothing():
    task = SimpleNamespace(expert=lambda table: None)
    assert playing.by_expert(None, task, ()) == ()


def test_a_policy_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(families.StackBlockPyramid, "max_steps", 1)
    words = ["measure", str(clip.DATA / "gem-multi.safetensors"), "stack-block-pyramid", "--episodes", "1"]
    assert base.run(APP, [*words, "--split", "val", "--out", str(tmp_path / "rows.jsonl")]) == 0
    (row,) = results.read_rows(tmp_path / "rows.jsonl")
    assert (row["task"], row["world"], row["split"]) == ("foreign-stack-block-pyramid", "MuJoCo", "val")
    assert row["method"] == "gem-multi" and row["actions"] == 1 and row["mean"] in (0, pytest.approx(16.7, abs=0.1))
    assert "foreign-stack-block-pyramid" in capsys.readouterr().out


def test_an_ending_gives_a_policy_other_rules_of_acting():
    checkpoint = clip.DATA / "gem-multi.safetensors"
    policy = playing.load(checkpoint, ["with-bracketing", "with-place-peak"])
    assert policy.name == "gem-with-place-peak-with-bracketing-multi"
    assert policy.source.config.more_exposures == (1.4, 2.0) and policy.config.place_lead == 0.2
    with pytest.raises(ValueError, match="differ from the policy's in"):
        playing.load(checkpoint, ["without-steerable-kernel"])


@pytest.mark.parametrize(("beside", "held"), [(0.003, True), (0.008, False)])
def test_the_cup_holds_what_is_below_its_rim(beside, held):
    task = playing.make("stack-block-pyramid", "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        block, half = table.pose(task.goals[0].bodies[0])
        pick = block @ Pose2(half + beside, 0.0)
        assert table.act(PickPlace(pick, pick)) == held


def test_its_fonts_are_in_no_demonstration():
    demonstrated = {font for name in looks.names() for font in looks.style(name).fonts}
    assert demonstrated.isdisjoint(family for family, _ in bodies.FONTS)


def forms(goals):
    """The sentences of goals, without the names of colours and shapes and the words for the place of a hole."""
    names = "|".join(sorted((*shapes.SEEN_SHAPES, *shapes.UNSEEN_SHAPES), key=len, reverse=True))
    of_colors = "|".join(colors.RGB)
    without = [re.sub(rf"\b({of_colors})\b", "COLOR", re.sub(names, "SHAPE", goal.sentence)) for goal in goals]
    return {re.sub(r"\b(left|right|top|bottom|middle) (?=SHAPE hole)", "", sentence) for sentence in without}


@pytest.mark.parametrize("family", FAMILIES)
def test_its_sentences_are_those_of_the_library(family):
    (name,) = (name for name in tasks.PAPER if name.startswith(family) and name.endswith("-seen-colors"))
    ours = tasks.make(name, "val")
    with World() as world:
        world.begin(ours, 0)
    task, _ = laid(family, 0)
    assert forms(task.goals) == forms(ours.goals)
    assert len(task.goals) == len(ours.goals)
