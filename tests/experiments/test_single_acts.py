"""Single acts are scored by the true poses: the expert's are right in every part, others are not."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("foreign_world")

from experiments.foreign_table import measuring
from experiments.foreign_tasks import playing, single_acts
from experiments.foreign_tasks.table import TaskTable
from gem_lite import tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.clip import DATA
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import GemConfig
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.world import World
from gem_lite.tasks.goals import target_pose

MEANT = ("thing", "map_peak", "target", "exact")


def score_of(environment, task, action, peak):
    """The score of an action, with a place map whose highest cell is at ``peak``."""
    workspace = Workspace()
    place_map = np.zeros(workspace.shape, np.float32)
    row, column = np.round(workspace.to_pixel(peak.x, peak.y)).astype(int)
    place_map[row, column] = 1.0
    choice = SimpleNamespace(action=action, place_map=place_map, heightmap=SimpleNamespace(workspace=workspace))
    return single_acts.score(environment, task.goals[0], choice)


def scored(environment, task, action, peak):
    """The parts of the score that are right of an action."""
    score = score_of(environment, task, action, peak)
    return [name for name in MEANT if getattr(score, name)]


@pytest.mark.parametrize("family", ["assembling-kits", "stack-block-pyramid", "towers-of-hanoi"])
@pytest.mark.parametrize("foreign", [True, False])
def test_the_experts_act_is_right_and_others_are_not(family, foreign):
    with TaskTable() if foreign else World() as environment:
        if foreign:
            task = playing.make(family, "val")
            environment.begin(task, playing.SEEDS["val"][0])
        else:
            task = tasks.make(single_acts.OUR_TASKS[family], "val")
            environment.begin(task, tasks.episode_seed("val", 0))
        action = task.expert(environment).action
        target = target_pose(environment, task.goals[0].targets[0])
        assert scored(environment, task, action, target) == list(MEANT)
        beside = PickPlace(action.pick, Pose2(action.place.x + 0.02, action.place.y, action.place.yaw))
        assert scored(environment, task, beside, target) == ["thing", "map_peak", "target"]
        wrong = PickPlace(action.pick, Pose2(action.place.x + 0.1, action.place.y, action.place.yaw))
        assert scored(environment, task, wrong, action.pick) == ["thing"]
        for x, at_border in ((Workspace().x_max - 0.02, True), (0.5, False)):
            to_x = PickPlace(action.pick, Pose2(x, 0.0))
            assert score_of(environment, task, to_x, target).border == at_border
        other_thing = PickPlace(action.pick @ Pose2(0.1, 0.0), action.place @ Pose2(0.1, 0.0))
        assert "exact" not in scored(environment, task, other_thing, target)


def test_a_push_is_right_if_it_ends_in_the_named_square():
    task = playing.make("separating-piles", "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        push = task.expert(table).action
        assert scored(table, task, push, push.end) == list(MEANT)
        back = Push(push.start, Pose2(2 * push.start.x - push.end.x, 2 * push.start.y - push.end.y))
        assert scored(table, task, back, push.start) == ["thing"]


def test_two_policies_of_one_name_and_policies_without_maps_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(playing, "load", lambda path, endings: SimpleNamespace(name="cliport"))
    with pytest.raises(ValueError, match=r"a.safetensors must hold a policy of GEM with maps, got cliport"):
        single_acts.with_and_without([tmp_path / "a.safetensors"], [])
    gem = object.__new__(Gem)
    gem.__dict__["config"] = GemConfig()
    monkeypatch.setattr(playing, "load", lambda path, endings: gem)
    with pytest.raises(ValueError, match="different names, got a twice"):
        single_acts.with_and_without([tmp_path / "a.safetensors", tmp_path / "b" / "a.safetensors"], [])
    with pytest.raises(ValueError, match="different names, got a-b twice"):
        single_acts.with_and_without([tmp_path / "a-b.safetensors", tmp_path / "a.safetensors"], ["b"])
    gem.__dict__["config"] = GemConfig(semantic_map="none")
    with pytest.raises(ValueError, match="must hold a policy of GEM with maps"):
        single_acts.with_and_without([tmp_path / "a.safetensors"], [])


@pytest.mark.release
def test_policies_that_look_in_the_same_way_are_asked_about_one_embedding(monkeypatch):
    policies = single_acts.with_and_without([DATA / "gem-multi.safetensors"], ["with-continued-border"])
    assert list(policies) == ["gem-multi", "gem-multi-with-continued-border"]
    plain, continued = policies.values()
    assert (plain.config.continued, continued.config.continued) == (False, True)
    embedded = []
    embed = Gem.embed

    def watched(policy, views):
        embedded.append(policy)
        return embed(policy, views)

    monkeypatch.setattr(Gem, "embed", watched)
    task = playing.make("assembling-kits", "val")
    with TaskTable() as table:
        table.begin(task, playing.SEEDS["val"][0])
        seen = measuring.seen(table)
        both = single_acts.ask([plain, continued], seen, task, table)
        assert embedded == [plain]
        choice = plain.decide(seen, task.instruction)
        assert both[0] == single_acts.score(table, task.goals[0], choice)
        bracketed = single_acts.with_and_without([DATA / "gem-multi.safetensors"], ["with-bracketing"])
        embedded.clear()
        single_acts.ask(list(bracketed.values()), seen, task, table)
        assert len(embedded) == 2, "other exposures"
