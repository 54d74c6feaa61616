"""What an environment of one table and one of several have in common."""

import pytest

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.evaluation import actors, evaluate
from gem_lite.se2 import Pose2
from gem_lite.simulation import mobile_world
from gem_lite.simulation.mobile_world import MobileWorld, side_by_side
from gem_lite.simulation.world import World

BOWL = "put-block-in-bowl-seen-colors"


@pytest.fixture(scope="module", params=[0, 1, 2], ids=["World", "one table", "two tables"])
def environment(request):
    tables = request.param
    made = MobileWorld(side_by_side(tables), find=mobile_world.ask_simulator) if tables else World()
    with made:
        yield made


def test_reset_observe_and_step_give_one_observation_a_table(environment):
    task = tasks.make(BOWL, "val")
    observations = environment.reset(task, tasks.episode_seed("val", 0))
    moments = []
    step = environment.step(task.expert(environment).action, moments.append)
    for seen in (observations, environment.observe(), step.observations):
        assert len(seen) == len(environment.tables)
        assert all(len(observation.views) == 3 for observation in seen)
    assert (step.grasped, step.reward > 0, moments) == (True, True, ["picked", "placed"])
    assert len(step.trace) > 20 and environment.effector.held is None


@pytest.mark.parametrize("name", ["object-sorting-unseen", "bars-in-box"])
def test_one_loop_plays_an_episode_in_any_environment(environment, name, monkeypatch):
    monkeypatch.setattr(type(environment), "observe", lambda self: (None,) * len(self.tables))
    assert evaluate.run_episode(environment, actors.expert, name, "val", 1).reward == 1.0


def test_an_action_on_a_table_that_is_not_there_is_refused(environment):
    environment.begin(tasks.make(BOWL, "val"), 0)
    count = len(environment.tables)
    for tables in ((count, 0), (0, count), (-1, 0)):
        with pytest.raises(ValueError, match=rf"_table must be in \[0, {count}\)"):
            environment.step(PickPlace(Pose2(0.5, 0.0), Pose2(0.5, 0.1), *tables))
    assert environment.steps_taken == 0


def test_poses_in_the_world_are_told_by_table(environment):
    environment.begin(tasks.make(BOWL, "val"), 0)
    spot = Pose2(0.4, 0.2, 0.7)
    for number, table in enumerate(environment.tables):
        local, found = environment.on_table(table @ spot)
        assert found == number and (local.x, local.y, local.yaw) == pytest.approx((spot.x, spot.y, spot.yaw))
    assert environment.on_table(Pose2(-3.0, 0.0, 0.1)) == (Pose2(-3.0, 0.0, 0.1), 0)  # beside all tables
