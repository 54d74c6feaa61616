"""Several tables: frames, tags and localisation, stitch and split, and acting through an estimate."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from tabletop import distance, layout

from gem_lite import clip, tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.evaluation import actors, evaluate
from gem_lite.evaluation.rollout import rollout
from gem_lite.language import Queries, Spot
from gem_lite.maps import relations
from gem_lite.policies.cliport import ClipPort, GroundedClipPort
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.transporter import TransporterLan
from gem_lite.rgbd import tags
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2, angle_off
from gem_lite.simulation import looks, mobile_world
from gem_lite.simulation.bodies import shapes, tag_plates
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.mobile_world import MobileWorld, RobotBody, side_by_side
from gem_lite.simulation.world import World
from gem_lite.steerable import SteerableKernel
from gem_lite.steerable.correlation import correlate
from gem_lite.tasks import Task, object_sorting
from gem_lite.tasks.goals import Goal, PoseMetric

MOBILE = LITE.on_table(1.06)
SENTENCE = "pick the mug and place into the recycle box"
TABLES = (Pose2(0.0, 0.0), Pose2(2.0, 1.8, 2.1))
"""The second one turned and away, so that no frame can be mistaken for another."""
STILL = RobotBody(odometry=(0.0, 0.0))


class Blocks(Task):
    """One L-block on each table, at the same pose of the table's frame."""

    workspace = MOBILE.workspace
    spot = Pose2(0.42, 0.21, 0.6)
    grasp = spot @ Pose2(-0.03, -0.03)
    """Where the L has its corner: in its middle, it has nothing."""

    def lay_out(self, environment, rng, seed):
        self.blocks = [
            environment.add(shapes.add_l_block(environment.client, (0.8, 0.1, 0.1, 1), table @ self.spot))
            for table in environment.tables
        ]
        nowhere = PoseMetric(distance=0.0)
        return [Goal("put the red block on the table", tuple(self.blocks), environment.tables, nowhere)]


@pytest.fixture(scope="module")
def world():
    with MobileWorld(TABLES) as world:
        yield world


@pytest.fixture(scope="module")
def policy():
    return Gem(MOBILE, clip.load(), seed=0)


@pytest.fixture(scope="module")
def observations():
    with MobileWorld(side_by_side(3)) as world:
        return world.reset(tasks.make("object-sorting-seen", "val"), tasks.episode_seed("val", 0))


def inside(world, block, table):
    """A block's pose in a table's frame."""
    return world.tables[table].inverse() @ world.pose(block)[0]


@pytest.mark.parametrize("real", [False, True])
def test_one_kernel_serves_a_batch_forward_and_backward(real):
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(3, 2, 20, 14, generator=generator, requires_grad=True)
    kernel = torch.randn(1, 2, 5, 5, generator=generator, requires_grad=True)

    def response(kernels):
        if real:
            return correlate(features, kernels[:, None])
        return torch.view_as_real(SteerableKernel.lift(kernels, 24, 3).correlate(features))

    shared, repeated = response(kernel), response(kernel.expand(3, -1, -1, -1))
    assert torch.allclose(shared, repeated, atol=1e-5)
    weight = torch.randn(shared.shape, generator=generator)
    for one, other in zip(
        torch.autograd.grad((shared * weight).sum(), (features, kernel), retain_graph=True),
        torch.autograd.grad((repeated * weight).sum(), (features, kernel)),
        strict=True,
    ):
        assert one.abs().max() > 0.1 and torch.allclose(one, other, atol=1e-4)


def test_stitched_logits_are_those_of_each_table_alone(policy, observations):
    together = policy.decide_over(observations, SENTENCE)
    assert together.pick_logits.shape == (3, MOBILE.angles, *MOBILE.workspace.shape)
    for table, observation in enumerate(observations):
        alone = policy.decide(observation, SENTENCE)
        assert np.abs(together.pick_logits[table] - alone.pick_logits).max() < 1e-5
    # The place kernel comes from the crop at the one pick, so only its own table has the same one alone.
    alone = policy.decide(observations[together.pick_table], SENTENCE)
    assert np.abs(together.place_logits[together.pick_table] - alone.place_logits).max() < 1e-5
    assert np.ptp(together.pick_logits) > 0.01
    # A neighbour changes nothing, nor does the order of the tables.
    other = policy.decide_over(observations[::-1], SENTENCE)
    assert np.abs(together.pick_logits - other.pick_logits[::-1]).max() < 1e-5
    assert np.abs(together.pick_logits[1] - together.pick_logits[2]).max() > 1e-3
    assert (together.pick_table, together.place_table) == (2 - other.pick_table, 2 - other.place_table)
    assert (together.pick, together.place) == (other.pick, other.place)


def scored(monkeypatch, pick, place):
    """Makes policies find these cells: (table, angle, row, col, value) of the pick's and of the place's logits."""

    def logits_of(cells, inputs):
        logits = torch.zeros(len(inputs.rgbd), MOBILE.angles, *MOBILE.workspace.shape)
        for table, angle, row, col, value in cells:
            logits[table, angle, row, col] = value
        return logits

    monkeypatch.setattr(Gem, "score_picks", lambda self, inputs: logits_of(pick, inputs))
    monkeypatch.setattr(Gem, "score_places", lambda self, inputs, table, pixel: logits_of(place, inputs))


def test_the_place_yaw_adds_the_angle_to_the_yaw_of_the_pick(policy, observations, monkeypatch):
    free = Gem(replace(MOBILE, peak_margin=None), policy.clip, seed=0)
    scored(monkeypatch, [(1, 5, 30, 20, 1.0)], [(2, 7, 90, 60, 1.0)])
    choice = free.decide_over(observations, SENTENCE)
    assert (choice.pick_table, choice.place_table) == (1, 2)
    step = math.radians(360 / MOBILE.angles)
    x, y = MOBILE.workspace.to_world(30, 20)
    assert (choice.pick.x, choice.pick.y, choice.pick.yaw) == pytest.approx((x, y, 5 * step))
    x, y = MOBILE.workspace.to_world(90, 60)
    assert (choice.place.x, choice.place.y, choice.place.yaw) == pytest.approx((x, y, 12 * step))
    assert choice.action == PickPlace(choice.pick, choice.place, 1, 2)
    assert choice.action.delta == pytest.approx(7 * step)


def test_nothing_is_put_back_as_it_lay_on_its_own_table(policy, observations, monkeypatch):
    free = Gem(replace(MOBILE, peak_margin=None), policy.clip, seed=0)
    pick = [(1, 5, 30, 20, 1.0)]
    scored(monkeypatch, pick, [(1, 0, 30, 20, 3.0), (0, 3, 90, 60, 1.0)])
    assert free.decide_over(observations, SENTENCE).place_table == 0
    scored(monkeypatch, pick, [(2, 0, 30, 20, 3.0), (0, 3, 90, 60, 1.0)])
    assert free.decide_over(observations, SENTENCE).place_table == 2, "the same cell of another table"


def test_a_spot_is_a_place_on_its_own_table_alone(policy, observations):
    x, y = MOBILE.workspace.to_world(20, 60)
    for table in (0, 2):
        choice = policy.decide_over(observations, Queries("mug", Spot(x, y, table)))
        assert choice.place_table == table
        assert math.hypot(choice.place.x - x, choice.place.y - y) <= relations.SPOT_RADIUS
    with pytest.raises(relations.NoFreePlaceError, match=r"no camera sees the table at \(3.00, 0.00\) m"):
        policy.decide_over(observations, Queries("mug", Spot(3.0, 0.0)))


def test_a_push_stays_on_its_table(policy, observations, monkeypatch):
    scored(monkeypatch, [(1, 5, 30, 20, 1.0)], [(2, 0, 90, 60, 3.0), (1, 0, 30, 20, 2.0), (1, 4, 80, 10, 1.0)])
    choice = policy.decide_over(observations, "push the pile of red blocks into the green square")
    assert isinstance(choice.action, Push) and choice.action.table == 1
    x, y = MOBILE.workspace.to_world(80, 10)
    assert (choice.action.end.x, choice.action.end.y) == pytest.approx((x, y))


def test_tables_that_cannot_be_are_refused(policy, monkeypatch):
    def connect(*_):
        raise AssertionError("nobody could close the simulator after a refusal")

    monkeypatch.setattr(World, "__init__", connect)
    monkeypatch.setattr(Environment, "__init__", connect)
    with pytest.raises(ValueError, match="observations is empty"):
        policy.decide_over([], "pick the mug and place into the gear box")
    with pytest.raises(ValueError, match="tables is empty"):
        MobileWorld(())
    with pytest.raises(ValueError, match=r"tables\[0\] must be the world's frame.*x=1.0"):
        MobileWorld((Pose2(1.0, 0.0), Pose2(0.0, 0.0)))
    with pytest.raises(ValueError, match="number must be in"):
        tag_plates.add_tag(0, 587, Pose2(0, 0))


@pytest.mark.parametrize("method", [ClipPort, GroundedClipPort, TransporterLan])
def test_a_method_that_makes_no_kernel_is_refused_by_name(method, policy, observations):
    rival = method(method.Config().on_table(1.06), policy.clip)
    with pytest.raises(ValueError, match=rf"must be a gem policy .*, got {rival.name}"):
        rival.decide_over(observations, SENTENCE)


@pytest.mark.parametrize("ending", ["with-free-kernels", "without-steerable-kernel", "without-semantic-map"])
def test_ablations_choose_over_several_tables(ending, policy, observations):
    ablation = Gem(MOBILE.ablated(ending), policy.clip)
    choice = ablation.decide_over(observations, SENTENCE)
    assert choice.pick_logits.shape == choice.place_logits.shape == (3, MOBILE.angles, *MOBILE.workspace.shape)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_policy_on_a_gpu_chooses_there(policy, observations):
    here = policy.decide_over(observations, SENTENCE)
    there = Gem(MOBILE, policy.clip, seed=0).to("cuda").decide_over(observations, SENTENCE)
    assert there.inputs.rgbd.device.type == "cpu"
    assert np.abs(here.pick_logits - there.pick_logits).max() < 1e-3


def test_every_table_is_seen_in_its_own_frame(world):
    first, second = (fuse_views(seen.views, MOBILE.workspace) for seen in world.reset(Blocks(), 0))
    row, col = MOBILE.workspace.nearest_cell(Blocks.grasp.x, Blocks.grasp.y)
    for heightmap in (first, second):
        assert heightmap.height[row, col] > 0.03
    same = (first.height > 0.02) == (second.height > 0.02)
    assert same.mean() > 0.998 and (first.height > 0.02).sum() > 100
    with World() as alone:
        reference = fuse_views(alone.reset(Blocks(), 0)[0].views, MOBILE.workspace)
    assert ((first.height > 0.02) == (reference.height > 0.02)).mean() > 0.998


def test_picked_here_placed_there_through_the_estimate(world):
    world.reset(Blocks(), 1)
    block = world.task.blocks[0]
    start, delta = inside(world, block, 0), 0.9
    pick = replace(Blocks.grasp, yaw=0.0)
    place = Pose2(0.6, -0.2, pick.yaw + delta)
    step = world.step(PickPlace(pick, place, 0, 1))
    moved = inside(world, block, 1)
    turned = Pose2(place.x, place.y, delta) @ Pose2(start.x - pick.x, start.y - pick.y, start.yaw)
    assert step.grasped and len(step.trace) > 20
    assert distance(moved, turned) < 0.01
    assert angle_off(moved.yaw - turned.yaw, 2 * math.pi) < math.radians(3)


@pytest.mark.release
def test_an_error_of_the_estimate_moves_the_act(world, monkeypatch):
    def moved(place_table, wrong_tables):
        """How far in y (m) an act means to take the block, and does."""
        world.reset(Blocks(), 2)
        block, start = world.task.blocks[0], inside(world, world.task.blocks[0], 0)

        def find(world, table):
            shifted = mobile_world.disturbed(mobile_world.ask_simulator, Pose2(0.0, 0.015))
            return (shifted if table in wrong_tables else mobile_world.ask_simulator)(world, table)

        place = Pose2(0.5, -0.2, Blocks.grasp.yaw)
        monkeypatch.setattr(world, "find", find)
        world.step(PickPlace(Blocks.grasp, place, 0, place_table))
        return inside(world, block, place_table).y - (start.y + place.y - Blocks.grasp.y)

    assert moved(1, ()) == pytest.approx(0, abs=0.004)
    assert moved(1, (1,)) == pytest.approx(0.015, abs=0.004)
    assert moved(1, (0,)) == pytest.approx(-0.015, abs=0.004)
    # Pick and place are wrong by the same shift on one table: the block moves as it was meant to.
    assert moved(0, (0,)) == pytest.approx(0, abs=0.004)


def errors(world, looks):
    """Metres over a grid of each table, and radians, of ``looks`` localisations."""
    w, away, turned = world.workspace, [], []
    grid = [(x, y) for x in np.linspace(w.x_min, w.x_max, 4) for y in np.linspace(w.y_min, w.y_max, 7)]
    for number in range(looks):
        estimate, true = mobile_world.localise(world, number % 2), world.true_table(number % 2)
        for x, y in grid:
            away.append(distance(estimate @ Pose2(x, y), true @ Pose2(x, y)))
        turned.append(angle_off(estimate.yaw - true.yaw, 2 * math.pi))
    return np.array(away), np.array(turned)


def test_localisation_is_good_over_the_whole_table(world):
    world.reset(Blocks(), 3)
    away, turned = errors(world, 12)
    assert np.median(away) <= 0.004 and np.median(turned) <= math.radians(0.5)
    assert np.percentile(away, 95) <= 0.012


@pytest.mark.release
def test_camera_noise_and_a_wrong_calibration_show():
    with MobileWorld(TABLES, replace(STILL, camera_noise=25.0)) as noisy:
        noisy.reset(Blocks(), 3)
        noisy.drive(0)
        where = noisy.tables[0].inverse() @ noisy.base  # its odometry is exact
        assert (where.x, where.y) == pytest.approx((0.765 + 0.55, 0.0))
        with pytest.raises(IndexError):
            noisy.drive(2)
        one, other = noisy.look().rgb.astype(float), noisy.look().rgb.astype(float)
        assert 15 < (one - other).std() / math.sqrt(2) < 26  # some of it is cut off at 0
        away, _ = errors(noisy, 4)
        assert 0 < np.median(away) < 0.01
    with MobileWorld(TABLES, RobotBody(camera_offset=Pose2(0.02, 0.0))) as off:
        off.reset(Blocks(), 3)
        away, turned = errors(off, 6)
        # The table seems to be 20 mm nearer than it is, along the base's x.
        assert np.median(away) == pytest.approx(0.02, abs=0.003) and np.median(turned) < math.radians(0.5)


def test_a_wrong_tag_is_named_and_nothing_is_done(world):
    world.reset(Blocks(), 4)
    block, world.tags = world.task.blocks[0], (7, 1)
    try:
        before = world.pose(block)
        with pytest.raises(tags.LocalisationError, match="tag 7 is not in the picture, only tag 0"):
            world.step(PickPlace(Pose2(0.42, 0.21), Pose2(0.5, 0.0), 0, 1))
        assert world.effector.held is None
        assert distance(world.pose(block)[0], before[0]) < 1e-4
    finally:
        world.tags = (0, 1)


def test_a_half_hidden_tag_does_not_count(world):
    world.reset(Blocks(), 4)
    at = world.tables[0] @ world.tag @ Pose2(0.0, 0.05)
    shapes.add_box(world.client, (0.16, 0.06, 0.01), (0.3, 0.3, 0.3, 1), at, movable=False)
    with pytest.raises(tags.LocalisationError, match=r"table 0 cannot be localised.*15 cm aside.*no tag at all"):
        mobile_world.localise(world, 0)
    assert mobile_world.localise(world, 1)


def test_a_second_look_from_elsewhere(world, monkeypatch):
    world.reset(Blocks(), 5)
    look, blind = world.look, []

    def first_blind():
        view = look()
        if not blind:
            blind.append(view)
            return replace(view, rgb=np.zeros_like(view.rgb))
        return view

    monkeypatch.setattr(world, "look", first_blind)
    estimate = mobile_world.localise(world, 0)
    assert blind and abs((world.tables[0].inverse() @ world.base).y) > 0.08
    assert distance(estimate, world.true_table(0)) < 0.005


BOWL, PYRAMID = "put-block-in-bowl-seen-colors", "stack-block-pyramid-seq-seen-colors"


@pytest.fixture(scope="module", params=[0, 1, 2], ids=["World", "one table", "two tables"])
def environment(request):
    tables = request.param
    made = MobileWorld(side_by_side(tables), find=mobile_world.ask_simulator) if tables else World()
    with made:
        yield made


@pytest.mark.parametrize(
    ("name", "sentences"), [(BOWL, 1), pytest.param(PYRAMID, 6, marks=pytest.mark.release)]
)  # fmt: skip
def test_a_task_of_one_table_lies_on_the_first_and_goes_on_to_its_end(environment, policy, name, sentences):
    task, count = tasks.make(name, "val"), len(environment.tables)
    seen = environment.reset(task, tasks.episode_seed("val", 0))
    assert len(seen) == count and all(len(observation.views) == 3 for observation in seen)
    high = [(fuse_views(one.views, task.workspace).height > 0.01).sum() for one in seen]
    assert high[0] > 100 and not any(high[1:])
    if sentences == 1 or count != 1:
        turns = list(rollout(environment, task, tasks.episode_seed("val", 0), actors.expert, seen))
        assert turns[-1].result.done and sum(turn.result.reward for turn in turns) == pytest.approx(1)
        assert len({turn.instruction for turn in turns}) == sentences
        assert all(len(turn.result.trace) > 20 for turn in turns) and environment.effector.held is None
    if count == 2:
        on_this_table = Gem(LITE.on_table(task.workspace.length), policy.clip, seed=0)
        logits = on_this_table.decide_over(seen, turns[0].instruction).pick_logits
        assert np.ptp(logits[0]) > 3 * np.ptp(logits[1])  # the second table is bare


@pytest.mark.parametrize("name", ["object-sorting-unseen", "bars-in-box"])
def test_one_loop_plays_an_episode_in_any_environment(environment, name, monkeypatch):
    monkeypatch.setattr(type(environment), "observe", lambda self: (None,) * len(self.tables))
    assert evaluate.run_episode(environment, actors.expert, name, "val", 1).reward == 1.0


def test_poses_in_the_world_are_told_by_table_and_other_tables_are_refused(environment):
    environment.begin(tasks.make(BOWL, "val"), 0)
    spot = Pose2(0.4, 0.2, 0.7)
    for number, table in enumerate(environment.tables):
        local, found = environment.on_table(table @ spot)
        assert found == number and (local.x, local.y, local.yaw) == pytest.approx((spot.x, spot.y, spot.yaw))
    assert environment.on_table(Pose2(-3.0, 0.0, 0.1)) == (Pose2(-3.0, 0.0, 0.1), 0)  # beside all tables
    count = len(environment.tables)
    for tables in ((count, 0), (0, count), (-1, 0)):
        with pytest.raises(ValueError, match=rf"_table must be in \[0, {count}\)"):
            environment.step(PickPlace(Pose2(0.5, 0.0), Pose2(0.5, 0.1), *tables))
    assert environment.steps_taken == 0 and not environment.trace


def test_the_expert_sorts_over_two_tables(world, monkeypatch):
    monkeypatch.setattr(MobileWorld, "observe", lambda self: (None,) * len(self.tables))
    tables = set()
    for index, name in enumerate(("object-sorting-seen", "object-sorting-unseen") * 2):
        task = tasks.make(name, "val")
        world.reset(task, tasks.episode_seed("val", index))
        action = task.expert(world).action
        tables |= {action.pick_table, action.place_table}
        assert world.step(action).reward == 1
    assert tables == {0, 1}


def test_sorting_goes_through_its_objects_and_keeps_the_sets_apart(world):
    assert len(object_sorting.SEEN) == 15 and len(object_sorting.UNSEEN) == 12
    assert not set(object_sorting.SEEN) & set(object_sorting.UNSEEN)
    laid_out = [layout(world, "object-sorting-seen", "train", index) for index in range(15)]
    named = [task.instruction.split("pick the ")[1].split(" and ")[0] for task in laid_out]
    assert sorted(named) == sorted(object_sorting.SEEN) and {len(task.names) for task in laid_out} == {7}


def test_a_world_of_several_tables_has_a_style():
    pictures = []
    for name in ("home", "bright-light"):
        with MobileWorld(TABLES, STILL, style=looks.style(name)) as styled:
            styled.clear()
            pictures.append(styled.observe()[0].views[0].rgb.astype(int))
    assert (pictures[1] - pictures[0]).mean() > 5
