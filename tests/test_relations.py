"""Places that are relations: their wordings, their maps on free table, who keeps to them, and the task put-beside."""

import dataclasses
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from small import SMALL, small
from tabletop import block, bowl, lay_out, teleport

from gem_lite import language, tasks
from gem_lite.evaluation import evaluate
from gem_lite.foundations import colors
from gem_lite.language import Queries, Spot, parse, split_relation
from gem_lite.maps import crop_memory, refusal, relations
from gem_lite.maps.query_maps import query_maps
from gem_lite.maps.relations import GAP, HALF, WIDTH, place_map
from gem_lite.policies import methods
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import shapes
from gem_lite.tasks.put_beside import SAID, RelationMetric

WORKSPACE = Workspace()
ROWS, COLS = np.indices(WORKSPACE.shape)
X, Y = WORKSPACE.to_world(ROWS, COLS)
SIGNS = [
    ("left of", (-1, 0)), ("right of", (1, 0)), ("in front of", (0, -1)), ("behind", (0, 1)),
]  # fmt: skip
"""Where a relation is, in x and y: the picture from above shows a larger y further up."""
MUG, BOX = (0.42, 0.2), (0.58, -0.06)

READ = """
    put the red block to the left of the green bowl | red block | left of green bowl
    put the red block on the right of a green bowl | red block | right of green bowl
    move the red block left of the bowl | red block | left of bowl
    Put the mug in front of the teapot, please. | mug | in front of teapot
    pick the mug up and place it behind the teapot | mug | behind teapot
    put the mug next to the teapot | mug | beside teapot
    put the left shoe alongside the top hat | left shoe | beside top hat
    put the mug on the left beside the bowl on the right | left mug | beside right bowl
    put the fork between the mug and the box | fork | between mug and box
    put the fork in between mug and box | fork | between mug and box
    put the fork between the red and the blue block | fork | between red block and blue block
    put the fork between the red and white flashlight and the box | fork | between red and white flashlight and box
    push the pile of red blocks behind the green square | pile of red blocks | behind green square
"""
WRONG = """
    put the mug behind | must name one thing after 'behind'
    put the mug next to the bowl and the box | must name one thing after 'beside'
    put the mug next to each of the bowls | must name one thing after 'beside'
    put the mug between the bowls | must name two single things after 'between'
    put the mug between the bowl, the box and the plate | must name two single things after 'between'
    put the mug between the bowl and all boxes | must name two single things after 'between'
    put the mug next to the bowl in the box | leftover words 'in the box'
    put the fork behind the spoon to the left of the mug | leftover words 'to the left of the mug'
    pick the mug behind the bowl | not whether the thing lies there or is to be put there
    pick up the mug next to the bowl and put it in the box | not whether the thing lies there
    put beside the mug | names nothing to pick
    put the block to the left | names no place
"""


def table(text):
    return [line.strip().split(" | ") for line in text.strip().splitlines()]


def around(place, radius=0.03):
    """The cells (H, W) bool of a round thing."""
    return np.hypot(X - place[0], Y - place[1]) <= radius


def scene_of(*places):
    """A bare table with things on it."""
    height = np.zeros(WORKSPACE.shape, np.float32)
    for place in places:
        height[around(place)] = 0.05
    heightmap = HeightMap(WORKSPACE, np.full((*height.shape, 3), 50, np.uint8), height, height >= 0)
    return SimpleNamespace(heightmap=heightmap)


def painted(**maps):
    """A source with given maps by phrase; no phrase has alternatives that fit."""

    def semantic(scene, phrase):
        of_phrase = maps.get(phrase.replace(" ", "_"), np.zeros(WORKSPACE.shape, bool))
        return of_phrase.astype(np.float32)

    clip = SimpleNamespace(embed_texts=lambda phrases: np.ones((len(phrases), 1)))
    clip.calibration = SimpleNamespace(retrieval_threshold=0.9)
    return SimpleNamespace(map=semantic, uses_views=True, clip=clip, config=LITE)


def test_every_relation_has_its_wordings_and_one_phrase():
    assert len(table(READ)) == 13
    for sentence, pick, place in table(READ):
        assert parse(sentence) == Queries(pick, place, push=sentence.startswith("push")), sentence
        relation, anchors = split_relation(place)
        assert relation in SAID and language.conjuncts(place) == (place,)
        assert language.without_relation(place) == " and ".join(anchors)
    assert split_relation("between mug and box") == ("between", ("mug", "box"))
    assert split_relation("left mug") == (None, ("left mug",)) == split_relation("left mug")
    assert set(language.RELATIONS.values()) == set(SAID) == {*relations.DIRECTIONS, "beside", "between"}


@pytest.mark.parametrize(("sentence", "message"), table(WRONG))
def test_what_is_no_place_is_refused(sentence, message):
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        parse(sentence)
    assert language.EXAMPLE in str(error.value)


def test_wrong_queries_are_refused():
    with pytest.raises(ValueError, match="pick must name a thing, not a place, got 'left of mug'"):
        Queries("left of mug", "box")
    with pytest.raises(ValueError, match="pick must name a thing, not a place, got Spot"):
        Queries(Spot(0.5, 0.0), "box")
    for place in ("between mug", "behind mug and box"):
        with pytest.raises(ValueError, match=r"phrase must name [12] after"):
            Queries("fork", place)


def test_the_map_of_a_spot_is_high_there_where_a_camera_sees_the_table():
    heightmap = scene_of().heightmap
    semantic = relations.spot_map(Spot(0.45, 0.1), heightmap)
    distance = np.hypot(X - 0.45, Y - 0.1)
    assert np.array_equal(semantic > 0, distance <= relations.SPOT_RADIUS) and semantic.max() == 1
    assert distance[semantic == 1].max() < 0.01
    unseen = dataclasses.replace(heightmap, seen=distance > 0.2)
    assert not relations.spot_map(Spot(0.45, 0.1), unseen).any()


def test_the_freest_spot_is_far_from_things_and_from_the_border():
    spot = relations.free_spot(scene_of((0.5, -0.2), (0.45, 0.3)).heightmap, 1)
    assert spot.table == 1
    assert all(math.hypot(spot.x - x, spot.y - y) > 0.15 for x, y in ((0.5, -0.2), (0.45, 0.3)))
    assert WORKSPACE.contains(spot.x, spot.y, HALF + GAP)
    crowded = [(x, y) for x in np.arange(0.3, 0.75, 0.1) for y in np.arange(-0.45, 0.5, 0.1)]
    assert relations.free_spot(scene_of(*crowded).heightmap) is None


@pytest.mark.parametrize(("relation", "sign"), SIGNS)
def test_the_map_is_high_on_the_right_side_at_a_fitting_distance_and_0_elsewhere(relation, sign):
    scene = scene_of(MUG)
    semantic = place_map(relation, [around(MUG).astype(np.float32)], scene.heightmap, LITE)
    assert semantic.max() == pytest.approx(1) and semantic[semantic > 0].min() >= 0.5
    highest = np.unravel_index(semantic.argmax(), semantic.shape)
    x, y = X[highest] - MUG[0], Y[highest] - MUG[1]
    middle = 0.03 + HALF + GAP + WIDTH / 2
    assert (x, y) == pytest.approx((sign[0] * middle, sign[1] * middle), abs=0.02)
    along = sign[0] * (X - MUG[0]) + sign[1] * (Y - MUG[1])
    distance = np.hypot(X - MUG[0], Y - MUG[1])
    places = semantic > 0
    assert (along[places] >= distance[places] * math.cos(relations.SECTOR) - 0.01).all()
    assert distance[places].min() >= 0.02 + HALF + GAP and distance[places].max() <= 0.04 + HALF + GAP + WIDTH


def test_beside_is_every_side_and_between_is_the_middle():
    maps = [around(MUG).astype(np.float32), around(BOX).astype(np.float32)]
    scene = scene_of(MUG, BOX)
    sides = [place_map(name, maps[:1], scene.heightmap, LITE) > 0 for name, _ in SIGNS]
    beside = place_map("beside", maps[:1], scene.heightmap, LITE) > 0
    assert np.array_equal(beside, np.any(sides, axis=0)) and all(side.any() for side in sides)
    semantic = place_map("between", maps, scene.heightmap, LITE)
    highest = np.unravel_index(semantic.argmax(), semantic.shape)
    assert (X[highest], Y[highest]) == pytest.approx((0.5, 0.07), abs=0.015)
    assert np.hypot(X - 0.5, Y - 0.07)[semantic > 0].max() < 0.08
    assert not place_map("between", [maps[0], maps[0]], scene.heightmap, LITE).any(), "one thing has no middle"


def test_a_place_is_on_free_table_that_a_camera_saw():
    mug = around(MUG).astype(np.float32)
    free = place_map("right of", [mug], scene_of(MUG).heightmap, LITE) > 0
    other = (MUG[0] + 0.12, MUG[1] + 0.07)
    crowded = place_map("right of", [mug], scene_of(MUG, other).heightmap, LITE) > 0
    assert (crowded & ~free).sum() == 0 and 0 < crowded.sum() < free.sum()
    assert np.hypot(X - other[0], Y - other[1])[crowded].min() >= 0.02 + HALF + GAP
    flat = scene_of(MUG).heightmap
    flat.rgb[around(other, 0.05)] = (250, 200, 50)  # a print does not rise, and is a thing all the same
    assert not (place_map("right of", [mug], flat, LITE) > 0)[around(other, 0.05 + HALF)].any()
    unseen = dataclasses.replace(flat, seen=MUG[1] < Y, rgb=scene_of().heightmap.rgb)
    assert not (place_map("right of", [mug], unseen, LITE) > 0)[MUG[1] >= Y].any()
    near_edge = place_map("left of", [around((0.36, 0.0)).astype(np.float32)], scene_of((0.36, 0.0)).heightmap, LITE)
    assert not near_edge.any(), "0.11 m from the edge there is no room for the band and half a thing"


def test_something_flat_is_where_its_map_is():
    heightmap = scene_of().heightmap
    heightmap.rgb[around(MUG, 0.05)] = (250, 200, 50)
    semantic = place_map("behind", [around(MUG, 0.05).astype(np.float32)], heightmap, LITE)
    highest = np.unravel_index(semantic.argmax(), semantic.shape)
    assert (X[highest], Y[highest]) == pytest.approx((MUG[0], MUG[1] + 0.05 + HALF + GAP + WIDTH / 2), abs=0.02)


def test_a_location_word_chooses_the_thing_of_a_relation():
    scene = scene_of(MUG, BOX)
    source = painted(mug=around(MUG) | around(BOX), right_mug=around(MUG) | around(BOX))
    maps = query_maps(source, scene, "behind right mug", LITE)
    highest = np.unravel_index(maps.fused.argmax(), maps.fused.shape)
    assert X[highest] == pytest.approx(BOX[0], abs=0.02) and Y[highest] > BOX[1] + HALF
    assert maps.image is None and maps.text is maps.fused


def test_a_missing_thing_and_a_place_that_is_not_free_are_said():
    near = (0.36, 0.0)
    source = painted(mug=around(near), fork=around(MUG))
    scene = scene_of(near, MUG)
    assert refusal.refusal(scene, ["fork", "right of mug"], source, nouns=()) is None
    assert refusal.refusal(scene, ["left of mug"], source, nouns=()) == 'there is no free place left of "mug"'
    assert 'there is no "box"' in refusal.refusal(scene, ["right of box"], source, nouns=())
    assert 'there is no "box"' in refusal.refusal(scene, ["between mug and box"], source, nouns=())
    assert relations.no_free_place("between mug and box") == 'there is no free place between "mug" and "box"'


@pytest.mark.parametrize("values", [("beyond", 1), ("behind", 2), ("between", 1)])
def test_what_a_map_cannot_be_made_of_is_refused(values):
    relation, count = values
    with pytest.raises(ValueError, match=r"(anchors|relation) must be"):
        place_map(relation, [around(MUG).astype(np.float32)] * count, scene_of(MUG).heightmap, LITE)


GREEN, RED = Pose2(0.5, 0.0), Pose2(0.4, -0.3, 0.3)


@pytest.fixture(scope="module")
def observation(stage):
    """A red block, a green bowl with free table around it, and a blue block near the left border."""
    return stage(block(RED), bowl(GREEN), block(Pose2(0.3, 0.34), color="blue"))[1]


def policy_of(name, model):
    return methods.find(name)[0](small(name), model)


@pytest.mark.parametrize("name", ["gem", "gem-without-peak", "transporter-lan-with-map-rules"])
def test_a_policy_that_was_never_trained_places_on_the_right_side(name, model, observation):
    policy = policy_of(name, model)
    for relation, (sign_x, sign_y) in SIGNS:
        place = policy.act(observation, f"put the red block {SAID[relation]} the green bowl").place
        x, y = place.x - GREEN.x, place.y - GREEN.y
        assert sign_x * x + sign_y * y >= math.cos(math.radians(35)) * math.hypot(x, y), relation
        assert 0.058 + HALF < math.hypot(x, y) < 0.07 + HALF + GAP + WIDTH
    beside = policy.act(observation, "put the red block next to the green bowl").place
    assert 0.1 < math.hypot(beside.x - GREEN.x, beside.y - GREEN.y) < 0.2
    middle = policy.act(observation, "put the red block between the green bowl and the blue block").place
    assert (middle.x, middle.y) == pytest.approx((0.4, 0.17), abs=0.07)


@pytest.mark.parametrize("name", ["transporter-lan", "cliport", "gem-without-semantic-map", "gem-without-parsing"])
def test_a_method_without_such_maps_refuses(name, model, observation):
    policy = policy_of(name, model)
    with pytest.raises(ValueError, match=rf"({name}|reads whole sentences and) has no map of a place"):
        policy.act(observation, "put the red block behind the green bowl")
    assert policy.act(observation, "put the red block in the green bowl").place


def test_a_place_that_is_not_free_is_no_act(model, observation):
    policy = policy_of("gem", model)
    with pytest.raises(ValueError, match='there is no free place left of "blue block"'):
        policy.act(observation, "put the red block to the left of the blue block")


def test_an_episode_in_which_no_place_is_free_ends_with_the_reason(blind):
    def refuse(environment, observations, empty_picks):
        raise relations.NoFreePlaceError(relations.no_free_place("behind mug"))

    episode = evaluate.run_episode(blind, refuse, "put-beside-seen-colors", "val", 0)
    assert (episode.reward, episode.error) == (0.0, 'there is no free place behind "mug"')


def test_the_words_of_a_relation_reach_no_network_and_no_crop(model):
    policy = policy_of("gem", model)
    plain = policy.embed_words("green bowl")
    for relation in ("left of", "beside"):
        assert policy.embed_words(f"{relation} green bowl").equal(plain)
    assert not policy.embed_words("left bowl").equal(policy.embed_words("left of bowl"))


def test_the_bare_table_at_a_place_is_remembered_for_no_phrase(demo_set):
    demos = demo_set[1]
    read = {"put": Queries("red block", "left of green bowl")}
    crops = list(crop_memory.collect_crops(demos, SMALL.workspace, SMALL.top_patch, lambda sentence: read["put"]))
    assert crops and {entry.phrase for entry in crops} == {"red block"}


@pytest.mark.parametrize(
    ("name", "palette"),
    [("put-beside-unseen-colors", colors.UNSEEN), ("put-beside-seen-colors", colors.SEEN)],
)
def test_the_expert_puts_it_there(blind, name, palette):
    relations_asked = set()
    for index in range(10):
        task = lay_out(blind, name, index)
        goal = task.goals[0]
        assert task.score(blind) == 0 and set(task.named_colors) <= set(palette)
        assert split_relation(parse(task.instruction).place)[0] == goal.metric.relation
        step = blind.step(task.expert(blind).action)
        assert step.grasped and step.reward == 1 and step.done, task.instruction
        relations_asked.add(goal.metric.relation)
    assert len(relations_asked) >= 4


def test_everyday_objects_of_the_splits(blind):
    for name, split, allowed in (
        ("put-beside-unseen-objects", "test", tasks.packing_objects.UNSEEN),
        ("put-beside-unseen-objects", "train", tasks.packing_objects.SEEN),
        ("put-beside-seen-objects", "test", tasks.packing_objects.SEEN),
    ):
        task = lay_out(blind, name, 0, split)
        assert {what.split(" ", 1)[1] for what in task.names.values()} <= set(allowed)
    assert blind.step(task.expert(blind).action).reward == 1


def test_the_metric_wants_the_direction_the_distance_and_free_table(blind, stage):
    (thing, anchor, other, _), _ = stage(
        block(RED), bowl(GREEN), block(Pose2(0.5, 0.34), color="blue"), block(Pose2(0.56, 0.13), color="cyan")
    )

    def share(relation, pose, z=0.02, anchors=(anchor,)):
        teleport(blind, thing, pose, z)
        return RelationMetric(relation, anchors).share(blind, thing, GREEN)

    for relation, (x, y) in SIGNS:
        assert share(relation, Pose2(0.5 + 0.14 * x, 0.14 * y)) == 1
        assert share(relation, Pose2(0.5 - 0.14 * x, -0.14 * y)) == 0, "the other side"
        assert share(relation, Pose2(0.5 + 0.1 * x - 0.12 * y, 0.1 * y + 0.12 * x)) == 0, "too far off the direction"
        assert share("beside", Pose2(0.5 + 0.14 * x, 0.14 * y)) == 1
    assert share("in front of", Pose2(0.5, -0.24)) == 0, "too far away"
    assert share("left of", Pose2(0.445, 0.0), shapes.BOWL.height + 0.0205) == 0, "on the rim"
    assert share("behind", Pose2(0.56, 0.13), 0.06) == 0, "on another thing"
    between = {"anchors": (anchor, other)}
    assert share("between", Pose2(0.52, 0.18), **between) == 1
    assert share("between", Pose2(0.5, 0.29), **between) == 0 and share("between", Pose2(0.6, 0.17), **between) == 0
