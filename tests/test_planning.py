"""Planning, with a fake language model and a fake table: what is said, tried again, given up, refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.planning import nouns
from experiments.planning.scenes import KINDS, MEMBERS
from gem_lite import clip
from gem_lite.cli.plan import plan
from gem_lite.language import Queries, Spot, models
from gem_lite.language.phrases import plural
from gem_lite.maps import refusal, relations, things
from gem_lite.planning import belonging, goals
from gem_lite.planning.belonging import Belonging
from gem_lite.planning.naming import NamedThing, lies_in, phrase_scores, telling_phrase, whole_things
from gem_lite.planning.planner import Planner, Step
from gem_lite.planning.swaps import read_swap
from gem_lite.se2 import Workspace
from gem_lite.simulation.bodies import objects

NAMES = ("train", "mug", "robot", "hammer")
BOX = "brown box"
ALL_TOYS = "pick all toys and place them into the brown box"
SHAPE = (40, 40)
SEEING = SimpleNamespace(views=())


class Model:
    """Scores from a table of rules: the log-probability of a word after a prompt that contains some words."""

    def __init__(self, rules):
        self.rules = rules
        self.prompts = []

    def scores(self, prompt, continuations):
        self.prompts.append(prompt)
        return np.array([self.rules.get((prompt, text), -9.0) for text in continuations])


def test_a_list_score_is_the_gain_over_a_list_of_things_averaged_over_the_forms():
    rules = {}
    for number, form in enumerate(belonging.LISTS):
        rules[form.format("toys"), " a train"] = -2.0 - number
        rules[form.format("things"), " a train"] = -5.0
    scores = belonging.list_scores(Model(rules), ["train"], ["toys"])
    assert scores.tolist() == [[np.mean([3.0, 2.0, 1.0])]]


def test_a_kind_score_is_the_mean_probability_of_the_kinds_word():
    rules = {("An apple is a kind of", " food"): -1.0, ("An apple is a type of", " food"): -4.0}
    rules["A good example: an apple is a", " food"] = -4.0
    assert belonging.kind_scores(Model(rules), ["apple"], ["food", "tools"]).tolist() == [[-3.0, -9.0]]


def test_a_yes_no_score_is_the_difference_of_the_answers():
    question = "Question: Is an apple a toy? Answer:"
    assert nouns.yes_no_score(Model({(question, " yes"): -1.0, (question, " no"): -3.5}), "apple", "toys") == 2.5


def test_a_margin_is_counted_from_the_mean_over_nouns_and_against_the_best_other_kind(monkeypatch):
    table = {"train": [6.0, 4.0, 1.0], "bread": [1.0, 2.0, 3.0], "doll": [3.0, 2.0, 1.0]}
    asked = []

    def scores(model, names, kinds):
        assert kinds == ("food", "tools", "toys")
        asked.extend(names)
        return np.array([table[name][::-1] for name in names])  # tools and toys, and food

    monkeypatch.setattr(belonging, "scores", scores)
    monkeypatch.setattr(belonging, "NOUNS", ("bread", "doll"))
    belongs = Belonging(Model({}), ("food", "tools", "toys"))
    # The means over the nouns are food 2, tools 2, toys 2: of the train, food has -1, tools 2, toys 4.
    assert belongs.margins(["train"], "toys").tolist() == [2.0]
    assert belongs.margins(["train"], "tools").tolist() == [-2.0]
    assert belongs(["train", "bread"], "toys") == [True, False]
    assert asked.count("train") == 1, "what was found once is kept"


def test_a_name_belongs_to_itself_and_a_kind_is_no_rival_of_its_longer_name(monkeypatch):
    monkeypatch.setattr(belonging, "scores", lambda model, names, kinds: np.zeros((len(names), len(kinds))))
    belongs = Belonging(Model({}), ("kitchen utensils", "toys"))
    assert belongs(["brush"], "brushes") == [True]
    assert Belonging(Model({}), ("kitchen utensils",)).margins(["fork"], "utensils").tolist() == [np.inf]
    assert belongs.margins([], "toys").shape == (0,)


@pytest.mark.release
def test_the_written_zeros_are_those_of_the_small_model():
    found = belonging.scores(models.load(), belonging.NOUNS, belonging.KINDS).mean(axis=0)
    assert list(belonging.ZEROS[models.SMALL].values()) == pytest.approx(found, abs=0.01)
    assert tuple(belonging.ZEROS[models.SMALL]) == belonging.KINDS


def test_of_the_small_model_only_other_kinds_have_zeros_to_compute(monkeypatch):
    asked = []

    def scores(model, names, kinds):
        asked.append((len(names), kinds))
        return np.zeros((len(names), len(kinds)))

    monkeypatch.setattr(belonging, "scores", scores)
    small = Model({})
    small.name = models.SMALL
    belongs = Belonging(small, ("tools", "animals"))
    assert belongs.margins(["hammer"], "tools") == pytest.approx([9.4204 - 9.7310])
    belongs.margins(["hammer"], "boxes")
    everything = ("animals", "boxes", "tools")
    assert asked == [(1, ("animals", "tools")), (len(belonging.NOUNS), ("boxes",)), (1, everything)]


# Goals --------------------------------------------------------------------------------------------------


def test_a_vague_goal_is_a_kind_and_a_place():
    (goal,) = goals.read(ALL_TOYS)
    assert (goal.thing, goal.place, goal.every) == ("toys", BOX, True)
    assert goal.line("train") == "put the train in the brown box"
    (goal,) = goals.read("put every toy in the brown box")
    assert (goal.thing, goal.every) == ("toys", True)
    (goal,) = goals.read("put the tools in the brown box")
    assert (goal.thing, goal.every) == ("tools", True), "a known kind alone is all of it"
    (goal,) = goals.read("put the red mug in the brown box")
    assert (goal.thing, goal.every) == ("red mug", False)


def test_two_goals_in_one_sentence():
    first, second = goals.read("put all toys in the brown box and the mug in the green bowl")
    assert (first.thing, first.place, first.every) == ("toys", BOX, True)
    assert (second.thing, second.place, second.every) == ("mug", "green bowl", False)
    assert second.sentence == "put the mug in the green bowl"


def test_a_written_plan_is_lines_of_which_each_is_read_or_refused():
    text = "1. put the train in the brown box\n\n- import os; os.remove('x')\n* push the mug to the left\n"
    read, refused = goals.read_lines(text)
    assert [goal.sentence for goal in read] == ["put the train in the brown box"]
    assert len(refused) == 2
    with pytest.raises(ValueError, match="does not begin with a known verb"):
        goals.read("tidy up")


@pytest.mark.parametrize(
    ("sentence", "first", "second"),
    [
        ("Swap the red cup and the blue cup.", "red cup", "blue cup"),
        ("Please exchange the fuse with the relay, thanks", "fuse", "relay"),
        ("Can you switch the places of the penguin and the frog?", "penguin", "frog"),
        ("Let the hammer and the mallet change places.", "hammer", "mallet"),
        ("swap the red and white flashlight and the mug", "red and white flashlight", "mug"),
    ],
)
def test_a_swap_names_two_things(sentence, first, second):
    (swap,) = goals.read(sentence)
    assert (swap.first, swap.second) == (first, second)


def test_a_swap_may_be_one_of_two_goals():
    goal, swap = goals.read("put all toys in the brown box, then swap the mug and the red block")
    assert (goal.thing, swap.first, swap.second) == ("toys", "mug", "red block")
    for sentence in (
        "trade the positions of the two flasks", "swap the mug", "do not swap the mug and the fork",
        "swap the left mug and the fork", "swap the mug and the fork on the right",
        "swap the mug and the red and blue blocks",
    ):  # fmt: skip
        assert read_swap(sentence) is None, sentence


# The planner --------------------------------------------------------------------------------------------


def thing(name, row, col=5, size=3):
    mask = np.zeros(SHAPE, bool)
    mask[row : row + size, col : col + size] = True
    return NamedThing(name, 0.0, 0.0, 0.9 - row / 100, mask)


def box():
    mask = np.zeros(SHAPE, bool)
    mask[20:38, 20:38] = True
    mask[22:36, 22:36] = False  # only its walls rise
    return NamedThing("hammer", 0.0, 0.0, 0.5, mask)


class Table:
    """Fake maps and a fake policy: a scene is a list of things; the box is what the map of its name is high on."""

    def __init__(self, *things, with_box=True):
        self.things = [*things, *([box()] if with_box else [])]
        self.shine = {}

    def embed(self, views):
        return SimpleNamespace(things=list(self.things))

    def map(self, scene, query):
        semantic = np.zeros(SHAPE, np.float32)
        for found in scene.things:
            named = query == BOX if found.mask[20, 20] else query.endswith(found.name)
            semantic[found.mask] = self.shine.get(query, 1.0) if named else 0.0
        return semantic

    def pack(self, name):
        (found,) = [found for found in self.things if found.name == name and found.mask.any()]
        self.things.remove(found)
        self.things.append(thing(name, 28, 28))


@pytest.fixture(autouse=True)
def nothing_is_refused(monkeypatch):
    monkeypatch.setattr(refusal, "refusal", lambda scene, queries, source, nouns: None)


def planner(table, instruction=ALL_TOYS, **more):
    def belongs(names, kind):
        return [name in ("train", "robot") for name in names]

    return Planner(
        goals.read(instruction), belongs, NAMES, table, namer=lambda scene, names, source: scene.things, **more
    )


def said(planner, do):
    """The sentences until the end; after each, ``do`` gets the name of the step."""
    sentences = []
    while (sentence := planner.next(SEEING)) is not None:
        sentences.append(sentence)
        do(planner.plan.steps[-1].name)
        assert len(sentences) < 20, "it goes on for ever"
    return sentences


def test_all_that_belongs_is_packed_and_then_the_plan_ends():
    table = Table(thing("train", 0), thing("mug", 5), thing("robot", 10))
    plan = planner(table)
    assert said(plan, table.pack) == ["put the train in the brown box", "put the robot in the brown box"]
    assert plan.plan.steps == tuple(Step(f"put the {name} in the brown box", name, True) for name in ("train", "robot"))
    assert plan.plan.missing == plan.plan.failed == ()
    assert plan.next(SEEING) is None


def test_what_lies_in_the_box_is_not_picked():
    table = Table(thing("train", 28, 28), thing("mug", 5))
    plan = planner(table)
    assert said(plan, table.pack) == []
    assert plan.plan.missing == ('there is no "toys" outside of the "brown box"',)


def test_a_thing_that_fell_is_tried_once_more_and_then_reported():
    table = Table(thing("train", 0), thing("robot", 10))
    plan = planner(table)
    assert said(plan, lambda name: None if name == "train" else table.pack(name)) == [
        "put the train in the brown box", "put the train in the brown box", "put the robot in the brown box",
    ]  # fmt: skip
    assert plan.plan.failed == ('the "train" is still on the table after 2 tries',)
    assert [step.done for step in plan.plan.steps] == [False, False, True]


def test_a_thing_whose_name_changes_with_every_look_ends_the_plan():
    table = Table(thing("train", 0))

    def rename(name):
        table.things[0] = thing({"train": "robot", "robot": "train"}[name], 0)

    assert len(said(planner(table), rename)) == 2


def test_a_missing_place_is_said():
    plan = planner(Table(thing("train", 0), with_box=False))
    assert plan.next(SEEING) is None
    assert plan.plan.missing == ('there is no "brown box": nothing on the table looks like it',)


def test_a_line_is_refused_if_its_thing_is_not_on_the_table_or_the_parser_cannot_read_it(monkeypatch):
    plan = planner(Table(thing("train", 0)), parser=lambda sentence: (_ for _ in ()).throw(ValueError("unread")))
    assert plan.next(SEEING) is None
    assert plan.plan.failed == ("unread",)
    monkeypatch.setattr(refusal, "refusal", lambda scene, queries, source, nouns: f"there is no {queries[0]}")
    plan = planner(Table(thing("train", 0)), "put the red mug in the brown box")
    assert plan.next(SEEING) is None
    assert plan.plan.missing == ("there is no red mug",)


def test_a_goal_of_one_sentence_is_said_until_something_left_the_table():
    table = Table(thing("mug", 0), thing("train", 10))
    plan = planner(table, "put the blue mug in the brown box and all toys in the brown box")
    moved = {"blue mug": "mug"}
    assert said(plan, lambda name: table.pack(moved.get(name, name))) == [
        "put the blue mug in the brown box", "put the train in the brown box",
    ]  # fmt: skip


class Spots:
    """A fake source and a fake robot of a swap: where each thing lies, of which some cannot be moved."""

    def __init__(self, monkeypatch, fixed=(), **spots):
        self.spots, self.fixed = spots, fixed
        monkeypatch.setattr(refusal, "fit", lambda scene, phrase, source, nouns: self.spots.get(phrase))
        monkeypatch.setattr(relations, "free_spot", lambda heightmap, table: Spot(0.4, 0.4, table))

    def embed(self, views):
        return SimpleNamespace(heightmap=None)

    def do(self, move):
        if move.pick not in self.fixed:
            self.spots[move.pick] = lies_at(move.place.x, move.place.y)


def lies_at(x, y):
    return refusal.PhraseFit("", x, y, 1.0, 0.5, "")


def swapped(table):
    """The plan of a swap that a robot carried out."""
    plan = planner(table, "swap the mug and the fork")
    while (move := plan.next(SEEING)) is not None:
        table.do(move)
    return plan.plan


def test_a_swap_is_three_moves_over_a_free_spot(monkeypatch):
    table = Spots(monkeypatch, mug=lies_at(0.3, 0.0), fork=lies_at(0.6, 0.1))
    plan = swapped(table)
    assert [step.instruction for step in plan.steps] == [
        Queries("mug", Spot(0.4, 0.4)), Queries("fork", Spot(0.3, 0.0)), Queries("mug", Spot(0.6, 0.1)),
    ]  # fmt: skip
    assert [(step.name, step.done) for step in plan.steps] == [("mug", True), ("fork", True), ("mug", True)]
    assert plan.missing == plan.failed == ()
    assert (table.spots["mug"].x, table.spots["fork"].x) == (0.6, 0.3)


def test_a_move_that_fails_is_tried_once_more_and_ends_the_swap(monkeypatch):
    plan = swapped(Spots(monkeypatch, fixed=("fork",), mug=lies_at(0.3, 0.0), fork=lies_at(0.6, 0.1)))
    assert [(step.name, step.done) for step in plan.steps] == [("mug", True), ("fork", False), ("fork", False)]
    assert plan.failed == ('the "fork" is not at (0.30, 0.00) m after 2 tries',)


def test_a_swap_of_what_is_not_there_or_of_one_thing_is_not_begun(monkeypatch):
    plan = swapped(Spots(monkeypatch, mug=lies_at(0.3, 0.0)))
    assert plan.steps == () and plan.missing == ('there is no "fork": nothing lies on the table',)
    plan = swapped(Spots(monkeypatch, mug=lies_at(0.3, 0.0), fork=lies_at(0.31, 0.0)))
    assert plan.steps == () and "one thing looks like both" in plan.missing[0]


def test_the_location_word_of_a_place_tells_two_boxes_apart():
    workspace = Workspace()
    boxes = []
    for name, col in (("first", 20), ("second", 60)):
        mask = np.zeros(workspace.shape, bool)
        mask[75:85, col - 5 : col + 5] = True
        boxes.append(NamedThing(name, 0.0, 0.0, 1.0, mask))
    both = np.zeros(workspace.shape, np.float32)
    for box_thing in boxes:
        both[box_thing.mask] = 1.0
    scene = SimpleNamespace(heightmap=SimpleNamespace(workspace=workspace))
    source = SimpleNamespace(map=lambda scene, phrase: both)
    for phrase, expected in (("left box", [True, False]), ("right box", [False, True]), ("box", [True, True])):
        scores = phrase_scores([(scene, found) for found in boxes], phrase, source)
        assert (scores > 0.9).tolist() == expected, phrase


def test_several_tables_are_looked_at_together():
    first, second = Table(thing("train", 0), with_box=False), Table(thing("mug", 5))
    both = SimpleNamespace(map=first.map, embed=lambda views: views.embed(()))
    plan = planner(both)
    seen = [SimpleNamespace(views=first), SimpleNamespace(views=second)]
    assert plan.next(*seen) == "put the train in the brown box"
    first.things.clear()
    assert plan.next(*seen) is None
    assert plan.plan.steps[0].done


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="goals is empty"):
        Planner((), lambda names, kind: [], NAMES, Table())
    with pytest.raises(ValueError, match="names is empty"):
        Planner(goals.read(ALL_TOYS), lambda names, kind: [], (), Table())
    with pytest.raises(ValueError, match="observations is empty"):
        planner(Table()).next()


def test_a_colour_is_said_if_the_name_alone_does_not_tell_a_thing_from_others():
    table = Table(thing("train", 0), thing("mug", 5), with_box=False)
    scene = table.embed(())
    found = [(scene, each) for each in scene.things]
    assert telling_phrase(0, found, table) == "train"
    table.shine = {"train": 0.09, "red train": 0.3, "blue train": 0.5, "black train": 0.4}
    table.shine |= {f"{color} train": 0.0 for color in refusal.OTHER_COLORS if f"{color} train" not in table.shine}
    assert telling_phrase(0, found, table) == "blue train"


# Naming -------------------------------------------------------------------------------------------------


def test_a_thing_lies_in_a_box_whose_walls_are_around_its_middle():
    assert lies_in(thing("train", 28, 28), box())
    assert not lies_in(thing("train", 5, 5), box())


def test_a_middle_is_in_metres():
    workspace = Workspace()
    mask = np.zeros(workspace.shape, bool)
    mask[10:13, 20:25] = True
    assert things.middle(mask, workspace) == pytest.approx(tuple(map(float, workspace.to_world(11, 22))))


def test_a_flat_part_belongs_to_the_thing_that_it_touches(monkeypatch):
    handle, blade, paper = (thing("", row, col).mask for row, col in ((0, 0), (0, 5), (30, 30)))
    monkeypatch.setattr(things, "things", lambda heightmap: ([handle], [blade, paper]))
    whole, alone = whole_things(None)
    assert np.array_equal(whole, handle | blade)
    assert np.array_equal(alone, paper)


# The experiment -----------------------------------------------------------------------------------------


def test_the_area_under_the_curve_is_the_share_of_pairs_in_the_right_order():
    members = {kind: (kind,) for kind in KINDS}
    scores = np.eye(len(KINDS))
    assert nouns.mean_area(scores, members) == 1.0
    assert nouns.mean_area(np.zeros_like(scores), members) == 0.5
    scores[0, 1] = 2.0  # of the second kind, one of four pairs is in the wrong order
    assert nouns.mean_area(scores, members) == pytest.approx(1 - 0.25 / len(KINDS))


def test_no_noun_for_development_names_an_object_or_is_a_noun_of_the_library():
    development = {name for names in nouns.DEVELOPMENT.values() for name in names}
    assert not development & {*objects.NAMES, *belonging.NOUNS}
    assert not {*objects.NAMES} & {*belonging.NOUNS}
    assert {name for names in MEMBERS.values() for name in names} <= {*objects.NAMES}


@pytest.mark.parametrize("kind", ["toy", "tool", "box", "dish", "brush", "watch"])
def test_the_singular_of_a_plural(kind):
    assert belonging.singular(plural(kind)) == kind
    assert (belonging.singular("food"), belonging.singular("glasses")) == ("food", "glass")


def test_a_plan_is_not_carried_out_by_a_policy_of_another_table():
    with pytest.raises(ValueError, match="m; that of put-block-in-bowl-seen-colors is x"):
        plan(ALL_TOYS, task="put-block-in-bowl-seen-colors", policy=clip.DATA / "gem-object-sorting.safetensors")
