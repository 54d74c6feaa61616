"""Goals: when a body is where it belongs, and the task that follows from goals alone."""

import dataclasses
import math

import pytest
from tabletop import block, bowl, teleport

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.foundations.registry import Registry
from gem_lite.se2 import Pose2
from gem_lite.tasks import Task, goals
from gem_lite.tasks import registry as task_registry
from gem_lite.tasks.goals import FULL_TURN, Goal, PoseMetric, ZoneMetric

SPOTS = (Pose2(0.4, 0.2, 0.3), Pose2(0.4, -0.2, 0.3))
PLACES = (Pose2(0.6, 0.1, 1.0), Pose2(0.6, -0.1, 1.0))


@pytest.mark.parametrize(
    ("offset", "degrees", "metric", "reached"),
    [
        (0.009, 0, PoseMetric(0.01), True),
        (0.011, 0, PoseMetric(0.01), False),
        (0.0, 77, PoseMetric(0.01), True),  # its yaw is not scored
        (0.0, 77, PoseMetric(0.01, math.pi / 2), True),
        (0.0, 70, PoseMetric(0.01, math.pi / 2), False),
        (0.0, 90, PoseMetric(0.01, FULL_TURN), False),
        (0.0, 0, PoseMetric(0.01, height=0.02), True),
        (0.0, 0, PoseMetric(0.01, height=0.06), False),
        (0.05, 45, ZoneMetric((0.12, 0.12), 0.05), True),
        (0.07, 0, ZoneMetric((0.12, 0.12), 0.05), False),
        (0.055, 0, ZoneMetric((0.12, 0.1), 0.05), True),
        (0.055, 0, ZoneMetric((0.1, 0.12), 0.05), False),
        (0.0, 0, ZoneMetric((0.12, 0.12), 0.01), False),
    ],
)
def test_a_metric_scores_position_yaw_and_height(blind, stage, offset, degrees, metric, reached):
    (body, at_place), _ = stage(block(SPOTS[0]), bowl(PLACES[0]))  # a target is a pose or a body
    assert metric.share(blind, body, at_place) == 0
    teleport(blind, body, PLACES[0] @ Pose2(offset, 0, math.radians(degrees)))
    assert metric.share(blind, body, PLACES[0]) == metric.share(blind, body, at_place) == reached


def test_the_farthest_body_goes_to_its_nearest_free_target(blind, stage):
    bodies, _ = stage(block(SPOTS[0]), block(Pose2(0.3, -0.4)))
    goal = Goal("put them there", tuple(bodies), PLACES, PoseMetric(0.03))
    assert goal.done(blind) == 0.0 and goal.placed(blind) == set()
    assert goal.next_move(blind) == (bodies[1], PLACES[1])
    teleport(blind, bodies[1], PLACES[0])
    assert goal.done(blind) == 0.5 and goal.placed(blind) == {bodies[1].id}
    assert goal.next_move(blind) == (bodies[0], PLACES[1])  # the nearer one is taken
    # Where no target is free, all serve.
    only = dataclasses.replace(goal, targets=PLACES[:1])
    assert only.next_move(blind) == (bodies[0], PLACES[0])
    teleport(blind, bodies[0], PLACES[0])  # two at one target count both
    assert goal.done(blind) == 1.0
    with pytest.raises(ValueError, match="is reached: no body is left"):
        goal.next_move(blind)


@pytest.mark.parametrize(("symmetry", "turn"), [(0.0, 0.0), (math.pi / 2, 0.7), (math.pi, -1.5), (FULL_TURN, 3.0)])
def test_a_body_is_turned_as_little_as_its_symmetry_allows(blind, stage, symmetry, turn):
    (body,), _ = stage(block(SPOTS[0]))
    belongs = Pose2(0.6, 0.1, SPOTS[0].yaw + turn + 3 * (symmetry % FULL_TURN))
    goal = Goal("put it there", (body,), (belongs,), PoseMetric(0.01, symmetry), grasp=Pose2(0.01, 0.0))
    action = goals.pick_and_place(blind, goal).action
    assert math.remainder(action.delta - turn, FULL_TURN) == pytest.approx(0, abs=1e-4)
    moved = blind.pose(body)[0] @ goal.grasp
    assert (action.pick.x, action.pick.y) == pytest.approx((moved.x, moved.y))
    # Where no yaw is wrong, the grasped point itself goes to the target's middle.
    at = belongs if symmetry == 0 else Pose2(belongs.x, belongs.y, SPOTS[0].yaw + turn) @ goal.grasp
    assert (action.place.x, action.place.y) == pytest.approx((at.x, at.y), abs=1e-5)


class Parking(Task):
    """Two blocks to two places, one sentence after the other; the second is worth three times as much."""

    max_steps = 4

    def lay_out(self, environment, rng, seed):
        self.blocks = [environment.add(block(pose)(environment.client)) for pose in SPOTS]
        return [
            Goal(f"park block {i}", (body,), (place,), PoseMetric(0.02), share, grasp_symmetry=math.pi / 2)
            for i, (body, place, share) in enumerate(zip(self.blocks, PLACES, (1.0, 3.0), strict=True))
        ]


def test_sentence_score_expert_and_placed_follow_from_goals(blind):
    task = Parking()
    assert task.instruction == ""
    blind.reset(task, 0)
    first, second = task.blocks
    assert (task.instruction, task.score(blind), task.placed(blind)) == ("park block 0", 0.0, set())
    step = blind.step(task.expert(blind).action)
    assert (step.reward, step.done, task.instruction) == (0.25, False, "park block 1")
    assert task.placed(blind) == {first.id}
    # A goal that is reached counts for good, wherever its body goes.
    teleport(blind, first, Pose2(0.3, 0.4))
    assert task.score(blind) == 0.25
    missed = blind.step(PickPlace(SPOTS[1], Pose2(0.3, -0.4)))
    assert (missed.reward, task.instruction) == (0.0, "park block 1")
    last = blind.step(task.expert(blind).action)
    assert (last.reward, last.done, task.instruction) == (0.75, True, "park block 1")
    assert task.expert(blind) is None and task.placed(blind) == {first.id, second.id}
    blind.reset(task, 0)
    assert (task.instruction, task.score(blind)) == ("park block 0", 0.0)


@dataclasses.dataclass(frozen=True)
class AlmostThere:
    """A metric that gives every body the same share."""

    value: float
    symmetry: float = 0.0

    def share(self, environment, body, target):
        return self.value


@pytest.mark.parametrize(("weight", "share", "reached"), [(1.0, 0.97, False), (1.0, 0.991, True), (0.2, 0.97, True)])
def test_a_goal_is_reached_if_less_than_a_hundredth_of_the_task_is_missing(blind, weight, share, reached):
    class Almost(Parking):
        def lay_out(self, environment, rng, seed):
            first, second = super().lay_out(environment, rng, seed)
            first = dataclasses.replace(first, metric=AlmostThere(share), share=weight)
            return [first, dataclasses.replace(second, share=1 - weight)]

    task = Almost()
    blind.reset(task, 0)
    task.advance(blind)
    assert task.instruction == ("park block 1" if reached else "park block 0")
    assert task.score(blind) == pytest.approx(weight if reached else weight * share)


def test_a_body_that_a_later_goal_moves_again_is_not_placed(blind):
    class Back(Parking):
        def lay_out(self, environment, rng, seed):
            there, _ = super().lay_out(environment, rng, seed)
            return [there, Goal("and back", there.bodies, (SPOTS[0],), PoseMetric(0.02))]

    task = Back()
    blind.reset(task, 0)
    blind.step(task.expert(blind).action)
    assert task.instruction == "and back" and task.placed(blind) == set()


def test_variants_have_names_arguments_and_one_family(monkeypatch):
    monkeypatch.setattr(task_registry, "TASKS", Registry("task"))

    @tasks.register("parking", {"easy": {}, "hard": {"unseen": True}})
    class Registered(Parking):
        pass

    assert tasks.names() == tasks.variants("parking") == ("parking-easy", "parking-hard")
    assert tasks.family("parking-hard") == "parking"
    made = tasks.make("parking-hard", "test")
    assert isinstance(made, Registered) and made.unseen
    assert not tasks.make("parking-hard", "train").unseen and not tasks.make("parking-easy", "test").unseen
    with pytest.raises(ValueError, match="no task is named 'parking'; the nearest names: parking-"):
        tasks.make("parking")


def test_episodes_of_two_new_colours_are_a_subset(world):
    task = tasks.make("put-block-in-bowl-unseen-colors", "test")
    for named, subsets in ((("pink", "white"), 1), (("pink", "red"), 0), (("red", "blue"), 0)):
        task.named_colors = named
        assert len(task.subsets()) == subsets
    assert tasks.make("object-sorting-seen").subsets() == ()
