"""Rules of acting: near the peak of a map, empty picks, acts that change nothing, what a trained policy may change."""

import dataclasses
import math
import types

import numpy as np
import pytest
import torch
from small import SMALL, small

from gem_lite import clip, tasks
from gem_lite.actions import PickPlace, Push
from gem_lite.language import Queries
from gem_lite.maps.relations import NoFreePlaceError
from gem_lite.policies import checkpoints, methods
from gem_lite.policies.choosing import Gate, best_cells, gated, log_probability, near_peak, place_gate, untried
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.inputs import Inputs
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2

D = 16
SHAPE = SMALL.workspace.shape
EVERYWHERE = torch.ones(SHAPE, dtype=torch.bool)
FLAT = torch.zeros(SHAPE)
FROM_ABOVE = HeightMap(
    SMALL.workspace, np.zeros((*SHAPE, 3), np.uint8), np.zeros(SHAPE, np.float32), np.ones(SHAPE, bool)
)


def policy_of(name="gem", **values):
    clip_sizes = types.SimpleNamespace(dim=D, width=D, inner_widths=(8, 8, 8))
    return methods.find(name)[0](small(name, **values), clip_sizes)


def scores_at(*cells):
    """Logits (1, R, H, W) that are 0 but for cells (angle, row, col, value)."""
    scores = torch.zeros(1, SMALL.angles, *SHAPE)
    for angle, row, col, value in cells:
        scores[0, angle, row, col] = value
    return scores


def choose(policy, monkeypatch, pick, place, empty_picks=(), push=False, gates=None):
    monkeypatch.setattr(policy, "score_picks", lambda inputs: pick)
    monkeypatch.setattr(policy, "score_places", lambda inputs, table, pixel: place)
    inputs = Inputs(rgbd=torch.zeros(4, *SHAPE))
    return policy.choose("", Queries("block", "square", push=push), FROM_ABOVE, inputs, empty_picks, gates or {})


def spots(*cells):
    semantic = torch.zeros(SHAPE)
    for row, col, value in cells:
        semantic[row, col] = value
    return semantic


def test_near_is_a_disc_of_the_radius():
    # 12.5 mm are two cells: (2, 0) is near, (2, 1) with 14 mm and (2, 2) with 17.7 mm are not.
    near = near_peak(spots((40, 40, 1.0)), FLAT, EVERYWHERE, LITE)
    rows, cols = np.nonzero(near.numpy())
    distances = LITE.pixel * np.hypot(rows - 40, cols - 40)
    assert distances.max() == pytest.approx(LITE.peak_radius)
    assert near.sum() == 13


def test_of_several_tables_the_highest_value_counts_for_all():
    semantic = torch.stack([spots((20, 20, 1.0)), spots((50, 50, 0.95), (10, 60, 0.85))])
    allowed = torch.ones_like(semantic, dtype=torch.bool)
    height = torch.zeros_like(semantic)
    near = near_peak(semantic, height, allowed, LITE)
    assert near[0, 20, 20] and near[1, 50, 50] and near.sum() == 26, "one peak on each table; 0.85 is too low"
    # An excluded peak is none: then the next one counts.
    allowed[0, 20, 20] = allowed[1, 50, 50] = False
    near = near_peak(semantic, height, allowed, LITE)
    assert near[1, 10, 60] and near.sum() == 13
    assert torch.equal(near_peak(semantic, height, allowed, dataclasses.replace(LITE, peak_margin=None)), allowed)


def test_the_whole_thing_is_near_and_no_other():
    # A long thing whose map fades from one end to the other; beside it, apart, another one with the same values.
    semantic = torch.zeros(SHAPE)
    height = torch.zeros(SHAPE)
    semantic[40, 20:50] = torch.linspace(1.0, 0.75, 30)
    semantic[80, 20:50] = 0.75
    height[40, 20:50] = height[80, 20:50] = 0.01
    near = near_peak(semantic, height, EVERYWHERE, LITE)
    assert near[40, 20:50].all() and not near[70:90].any()
    # Flat on the table, it does not rise, and only the peak counts.
    assert not near_peak(semantic, FLAT, EVERYWHERE, LITE)[40, 40:50].any()


@pytest.mark.release
def test_the_rule_allows_what_the_expert_picks_on_the_rope(multi, world):
    # Before, "near" ended within the rope: 6 of 37 of the expert's picks were forbidden.
    task = tasks.make("align-rope", "val")
    (observation,) = world.reset(task, tasks.episode_seed("val", 0))
    for _ in range(3):
        action = task.expert(world).action
        queries = multi.read(task.instruction)
        gates = multi.gates(observation.views, multi.inputs(multi.embed(observation.views), queries), queries)
        cells = gated([gates], "pick", EVERYWHERE[None])[0]
        assert cells.float().mean() < 0.1
        assert cells[multi.config.workspace.nearest_cell(action.pick.x, action.pick.y)]
        (observation,) = world.step(action).observations


@pytest.mark.parametrize(("second", "is_kept"), [(0.75, True), (0.85, False), (0.0, True)])
def test_a_place_keeps_to_the_peak_of_a_decided_map(second, is_kept):
    policy = policy_of("gem-with-place-peak")
    semantic = spots((40, 40, 1.0), (90, 20, second))[None]
    inputs = Inputs(rgbd=torch.zeros(4, *SHAPE), maps={"pick": semantic, "place": semantic})
    for push in (False, True):
        gates = policy.gates((), inputs, Queries("block", "square", push=push))
        cells = gated([gates], "place", EVERYWHERE[None])[0]
        assert cells[40, 40] and cells[90, 20] == cells[0, 0] == (not is_kept)
        assert cells[40, 44] and cells[40, 45] == (not is_kept), "30 mm are 4.8 cells"
    assert "place" not in policy_of().gates((), inputs, Queries("block", "square"))


def test_a_map_is_decided_by_all_tables_together():
    policy = policy_of("gem-with-place-peak")
    gates = [
        policy.gates(
            (), Inputs(rgbd=torch.zeros(4, *SHAPE), maps={"pick": semantic, "place": semantic}), Queries("a", "b")
        )
        for semantic in (spots((40, 40, 1.0))[None], spots((20, 20, 0.85))[None])
    ]
    allowed = torch.ones(2, *SHAPE, dtype=torch.bool)
    assert gated(gates, "place", allowed).all(), "neither table alone has two high places"


def test_a_push_may_start_away_from_the_peak_of_its_map():
    policy = policy_of()
    semantic = spots((40, 40, 1.0))[None]
    inputs = Inputs(rgbd=torch.zeros(4, *SHAPE), maps={"pick": semantic, "place": semantic})
    gates = policy.gates((), inputs, Queries("block", "square"))
    cells = gated([gates], "pick", EVERYWHERE[None])[0]
    assert cells[40, 40] and cells.sum() < 30
    assert policy.gates((), inputs, Queries("block", "square", push=True)) == {}
    assert policy_of("gem-without-peak").gates((), inputs, Queries("block", "square")) == {}


def test_a_pick_keeps_away_from_empty_picks_and_begins_again_if_they_cover_the_table(monkeypatch):
    policy = policy_of()
    pick = scores_at((0, 40, 40, 2.0), (0, 80, 20, 1.0))
    place = scores_at((0, 100, 60, 1.0))
    tried = Pose2(*SMALL.workspace.to_world(40, 40))
    chosen = choose(policy, monkeypatch, pick, place, [tried])
    assert chosen.pick_cell[1:] == (80, 20)
    assert np.array_equal(chosen.pick_logits, pick[0]), "the logits are the network's own"
    for other, empty in ((policy, []), (policy_of(empty_radius=0.0), [tried])):
        assert choose(other, monkeypatch, pick, place, empty).pick_cell[1:] == (40, 40)
    cells, radius = ~untried([tried], SMALL, EVERYWHERE), SMALL.empty_radius / SMALL.pixel
    assert cells[40, 40] and int(cells.sum()) == pytest.approx(np.pi * radius**2, rel=0.35)
    rows, cols = np.indices(SHAPE)
    everything = [
        Pose2(x, y) for x, y in np.stack(SMALL.workspace.to_world(rows, cols), axis=-1)[::2, ::2].reshape(-1, 2)
    ]
    gates = {"pick": Gate(spots((40, 40, 1.0)), FLAT, LITE)}
    assert choose(policy, monkeypatch, pick, place, everything, gates=gates).pick_cell[1:] == (40, 40)


def test_no_act_changes_nothing(monkeypatch):
    policy = policy_of()
    pick = scores_at((0, 40, 40, 2.0))
    # Back in its cell and not turned: the second best is taken. Turned in its cell it is another act.
    place = scores_at((0, 40, 40, 3.0), (2, 40, 40, 2.0), (0, 90, 20, 1.0))
    chosen = choose(policy, monkeypatch, pick, place)
    assert chosen.place_cell == (2, 40, 40) and isinstance(chosen.action, PickPlace)
    pushed = choose(policy, monkeypatch, pick, place, push=True)
    assert pushed.place_cell == (0, 90, 20) and isinstance(pushed.action, Push)


def test_a_push_without_a_place_is_refused(monkeypatch):
    gates = {"place": place_gate(spots((40, 40, 1.0)), FLAT)}
    with pytest.raises(NoFreePlaceError, match="no push leads to a place 'square': it would end where it begins"):
        choose(policy_of(), monkeypatch, scores_at((0, 40, 40, 2.0)), scores_at(), push=True, gates=gates)


@pytest.mark.parametrize("highest", [0.05, 0.25, 1.0])
def test_the_gate_of_a_place_is_where_its_map_is_above_zero(highest):
    place = spots((40, 40, highest), (41, 40, highest / 2))
    raised = torch.full(SHAPE, 0.01)  # all of the table is as high as a flat thing
    (left,) = gated([{"place": place_gate(place, raised)}], "place", EVERYWHERE[None])
    assert torch.equal(left, place > 0)


@pytest.mark.parametrize("training", [True, False])
def test_acting_leaves_the_mode_as_it_was(training):
    policy = Gem(SMALL, types.SimpleNamespace(dim=D)).train(training)
    semantic = torch.rand(1, *SHAPE)
    words = {"pick": torch.randn(policy.language_dim), "place": torch.randn(policy.language_dim)}
    inputs = Inputs(rgbd=torch.rand(4, *SHAPE), maps={"pick": semantic, "place": semantic}, words=words)
    policy.choose("", Queries("block", "square"), FROM_ABOVE, inputs)
    assert {module.training for module in policy.modules()} == {training}


@pytest.mark.parametrize("dtype", [torch.float16, torch.float64])
def test_another_precision_is_refused_in_one_sentence(dtype):
    policy = policy_of("gem").to(dtype)
    inputs = Inputs(rgbd=torch.zeros(4, *SHAPE))
    with pytest.raises(ValueError, match=r"computes in float32, got torch.float(16|64): call its float"):
        policy.choose("", Queries("block", "square"), FROM_ABOVE, inputs)


def test_names_of_rules_alone_share_their_training():
    assert methods.trained("gem-multi-without-peak-without-locations") == "gem-multi"
    assert methods.trained("gem-without-conjuncts-without-parsing") == "gem-without-parsing"
    assert methods.trained("cliport-with-map-rules") == "cliport"
    assert methods.trained("cliport-with-wide-crops-with-map-rules") == "cliport-with-wide-crops"


def test_a_trained_policy_acts_by_other_rules_and_keeps_its_networks(multi):
    card = checkpoints.read_card(clip.DATA / "gem-multi.safetensors")
    _, config = methods.acting_as(card, "gem-multi-without-peak-without-locations")
    assert config.variant == "-without-locations-without-peak-multi"
    assert (config.peak_margin, config.locations, config.location_code) == (None, False, True)
    for other in ("gem-multi-without-semantic-map", "gem", "cliport-multi"):
        with pytest.raises(ValueError, match="the checkpoint holds gem-multi, not"):
            methods.acting_as(card, other)
    own = multi.config
    for config, beyond in ((own.ablated("with-continued-border"), "replicate"), (own, "zeros")):
        multi.act_as(config)
        assert multi.place.encoder.up[0].first.padding_mode == beyond
    with pytest.raises(ValueError, match="config may differ from the policy's in"):
        multi.act_as(multi.config.ablated("without-recoloring"))
    with pytest.raises(ValueError, match="config may differ from the policy's in"):
        multi.act_as(methods.find("cliport-multi")[1])


def test_a_rival_with_the_rules_keeps_to_the_same_cells_as_gem(monkeypatch):
    rival = policy_of("transporter-lan", map_rules=True)
    two = spots((40, 20, 1.0), (40, 60, 1.0))
    maps = {"red block": spots((100, 40, 1.0)), "left star hole": two, "star hole": two}
    scene = types.SimpleNamespace(heightmap=types.SimpleNamespace(height=FLAT.numpy()))
    source = types.SimpleNamespace(
        uses_views=False, embed=lambda views: scene, map=lambda scene, query: maps[query].numpy()
    )
    monkeypatch.setattr(rival, "_map_source", source)
    gates = rival.gates((), None, Queries("red block", "left star hole"))
    pick = scores_at((0, 10, 10, 5.0), (3, 101, 40, 1.0))
    place = scores_at((0, 40, 60, 5.0), (1, 41, 20, 1.0))
    chosen = choose(rival, monkeypatch, pick, place, gates=gates)
    assert chosen.pick_cell == (3, 101, 40) and chosen.place_cell == (1, 41, 20)
    assert set(rival.gates((), None, Queries("red block", "star hole"))) == {"pick"}, "as GEM's place, free"
    assert set(rival.gates((), None, Queries("red block", "left star hole", push=True))) == {"place"}
    assert policy_of("transporter-lan").gates((), None, Queries("red block", "left star hole")) == {}


@pytest.mark.parametrize("name", ["transporter-lan-with-one-pick-angle", "cliport-with-one-pick-angle"])
def test_one_pick_angle_is_yaw_0(name, monkeypatch):
    policy = policy_of(name)
    assert policy.pick_angles == 1
    place = scores_at((3, 90, 20, 1.0))
    chosen = choose(policy, monkeypatch, scores_at((0, 40, 40, 2.0))[:, :1], place)
    assert chosen.action.pick.yaw == 0
    assert chosen.action.delta == pytest.approx(np.pi / 2)


# The product rule (A.1.6): p(pick) p(place | pick).


def test_the_joint_choice_takes_the_second_pick_if_its_place_is_surer(monkeypatch):
    pick = scores_at((0, 40, 40, 12.0), (0, 80, 20, 11.5))  # nearly the same
    unsure = scores_at((0, 100, 60, 8.0), (0, 20, 20, 8.0), (0, 20, 60, 8.0))
    sure = scores_at((0, 100, 60, 20.0))
    asked = []

    def places(inputs, table, pixel):
        asked.append(pixel)
        return sure if pixel == (80, 20) else unsure

    for name, expected, scored in (("gem", (40, 40), 1), ("gem-with-joint-choice", (80, 20), 8)):
        policy = policy_of(name, peak_margin=None)
        monkeypatch.setattr(policy, "score_picks", lambda inputs: pick)
        monkeypatch.setattr(policy, "score_places", places)
        asked.clear()
        chosen = policy.choose("", Queries("block", "square"), FROM_ABOVE, Inputs(rgbd=torch.zeros(4, *SHAPE)))
        assert chosen.pick_cell[1:] == expected and len(asked) == scored
    assert chosen.place_cell == (0, 100, 60), "the place belongs to the pick that was chosen"


def test_the_best_cells_lie_apart_and_a_probability_sums_over_what_is_allowed():
    logits = scores_at((0, 40, 40, 3.0), (1, 41, 40, 2.5), (0, 43, 40, 2.0), (0, 90, 10, 1.0))
    cells = [cell for _, cell in best_cells(logits, EVERYWHERE[None, None], 3)]
    assert cells == [(0, 40, 40), (0, 43, 40), (0, 90, 10)]
    allowed = torch.zeros(logits.shape, dtype=torch.bool)
    allowed[0, 0, 40, 40] = allowed[0, 0, 90, 10] = True
    assert len(best_cells(logits, allowed, 8)) == 2
    first, second = (log_probability(logits, allowed, 0, cell) for cell in ((0, 40, 40), (0, 90, 10)))
    assert first - second == pytest.approx(2.0) and np.exp(first) + np.exp(second) == pytest.approx(1.0)


def test_the_yaws_of_an_action_are_plain_numbers_within_one_turn(monkeypatch):
    last = SMALL.angles - 1
    choice = choose(policy_of(), monkeypatch, scores_at((last, 40, 40, 1.0)), scores_at((last, 20, 20, 1.0)))
    assert choice.action.pick.yaw == pytest.approx(math.tau * last / SMALL.angles)
    assert choice.action.place.yaw == pytest.approx(math.tau * (last - 1) / SMALL.angles)
    assert "float64" not in repr(choice.action)
