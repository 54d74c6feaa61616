"""Other people's words: spans, readings, the parser that asks, and the sentences that it was fitted on."""

import json
import math

import numpy as np
import pytest

from experiments.other_words import fit, sentences
from gem_lite import language, tasks
from gem_lite.language import PARSERS, Queries, Question, models, parse, reader, readings, understand
from gem_lite.language.reader import ModelParser, place_phrase, readable
from gem_lite.language.spans import Sentence, spans

FIRST, SECOND = sentences.read_file("first"), sentences.read_file("second")


def said(text):
    sentence = Sentence.read(text)
    return [sentence.said(span) for span in spans(sentence)]


@pytest.fixture(scope="module")
def parser():
    return ModelParser(models.load())


class Likes:
    """A model that finds the lines with certain words likely."""

    def __init__(self, thing, place):
        self.thing, self.place = f" {thing}\n", f" {place}\n"
        self.prompts = []

    def scores(self, prompt, continuations):
        self.prompts.append(prompt)
        liked = self.place if prompt.endswith("Place:") else self.thing
        return np.array([0.0 if text == liked else -9.0 for text in continuations])


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("The yellow block goes in the green bowl", {"yellow block", "green bowl"}),
        ("To the workbench carry the hammer.", {"workbench", "hammer"}),
        ("Put the watering can off the shelf", {"watering can", "shelf"}),
        ("Put the potato that rolled away into the sack", {"potato that rolled away", "sack"}),
        ("lay the scarf she knitted on the lid of the box", {"scarf she knitted", "lid of the box"}),
        ("pls drop bananna in frut bowl", {"bananna", "frut bowl"}),
        ("Can you put it there?", set()),
    ],
)
def test_spans_are_runs_of_the_sentences_words(text, wanted):
    found = said(text)
    assert wanted <= set(found) and all(span in text for span in found)
    assert not {"the", "it", "in", "can you"} & set(found)


def test_nearly_every_annotated_phrase_is_a_span():
    acting = [item for item in FIRST + SECOND if item.expected == "act"]
    missing = [item for item in acting if not {item.pick, item.place} <= set(said(item.sentence))]
    assert len(acting) > 400 and len(missing) / len(acting) < 0.03


def test_a_reading_is_two_spans_that_do_not_overlap_or_none():
    options = readings.all_readings([(0, 2), (1, 3), (4, 5)])
    assert options[0] is None
    pairs = {(option.thing, option.place) for option in options[1:]}
    assert pairs == {((0, 2), (4, 5)), ((4, 5), (0, 2)), ((1, 3), (4, 5)), ((4, 5), (1, 3))}


def test_probabilities_are_a_softmax_of_weighted_features():
    rows = [{"a": 1.0}, {"a": 2.0, "b": 1.0}, {}]
    chances = readings.probabilities(rows, {"a": math.log(2), "b": math.log(3)})
    assert chances == pytest.approx(np.array([2, 12, 1]) / 15)


def test_the_place_is_asked_after_the_likeliest_thing_and_scores_sum_to_one():
    sentence = Sentence.read("the yellow block goes in the green bowl")
    model = Likes("yellow block", "green bowl")
    scores = readings.score_spans(model, sentence, spans(sentence))
    assert model.prompts[1] == f"{model.prompts[0]} yellow block\nPlace:"
    assert np.exp(scores.thing).sum() == pytest.approx(1) and np.exp(scores.place).sum() == pytest.approx(1)
    reading, chance = readings.likeliest(model, sentence)
    assert (sentence.said(reading.thing), sentence.said(reading.place)) == (
        "yellow block",
        "green bowl",
    ) and chance > 0.7


def test_what_a_model_likes_decides_where_the_words_around_do_not():
    text = "pop the ring of the bull onto the tray"
    for thing in ("ring of the bull", "ring"):
        sentence = Sentence.read(text)
        assert sentence.said(readings.likeliest(Likes(thing, "tray"), sentence)[0].thing) == thing


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("Don't put the cup in the sink", "don't"), ("Don’t put the cup in the sink", "don't"),
        ("You mustn\u02bct put the cup in the sink", "mustn't"), ("Never put the cup in the sink", "never"),
        ("Put the red or the blue block in the bowl", "choice"), ("If it rains, put the hat on the rack", "condition"),
        ("Swap the cup and the plate", "two goals"), ("Is the cup in the sink?", "question"),
        ("Put all the toys in the box", "more than one pick"), ("I put the cup in the sink yesterday", "over"),
        ("Put the cup anywhere but in the sink", "must not"), ("Put something in the sink", "names nothing"),
        ("Good", "no pick and place"), (" ", "empty"), ("Keep the cup away from the plate", "must not"),
        ("put the cup " * 20, "more than 40 words"),
    ],
)  # fmt: skip
def test_what_must_not_be_acted_on_is_asked_about_before_a_model_is(text, word):
    class Never:
        def scores(self, prompt, continuations):
            raise AssertionError("no model is needed")

    question = understand(text, ModelParser(Never()))
    assert isinstance(question, Question) and word in question.text


@pytest.mark.parametrize(
    "text",
    [
        "Could you put the cup in the sink?",
        "If you don't mind, the cup goes in the sink",
        "Any chance the cup goes in the sink?",
    ],
)
def test_courtesies_are_no_conditions_and_no_questions(text):
    assert readings.reason_to_ask(Sentence.read(text)) == ""


def test_an_unlikely_reading_is_asked_about_and_the_limit_can_be_set():
    text = "the yellow block goes in the green bowl"
    model = Likes("yellow block", "green bowl")
    chance = readings.likeliest(model, Sentence.read(text))[1]
    assert understand(text, ModelParser(model, chance - 0.01)) == (Queries("yellow block", "green bowl"),)
    question = understand(text, ModelParser(model, min(1.0, chance + 0.0001)))
    assert "shall I pick yellow block, place green bowl?" in question.text


@pytest.mark.parametrize(
    ("text", "place", "phrase"),
    [
        ("the cup goes to the left of the plate", "plate", "left of plate"),
        ("the cup goes at the left side of the plate", "left side of the plate", "left of plate"),
        ("the cup goes in front of my plate", "plate", "in front of plate"),
        ("the cup goes between the plate and the jug", "plate and the jug", "between plate and jug"),
        ("the cup goes on the plate", "plate", "plate"),
    ],
)
def test_a_place_has_the_relation_of_the_words_before_it(text, place, phrase):
    sentence = Sentence.read(text)
    span = next(span for span in spans(sentence) if sentence.said(span) == place)
    assert place_phrase(sentence, span) == phrase


def test_of_two_cans_the_first_is_a_thing():
    sentence = Sentence.read("the watering can can go on the shelf")
    assert [sentence.is_open(index) for index in range(4)] == [False, True, True, False]


def test_a_push_stays_a_push_and_a_push_pin_is_none():
    pushed = (Queries("pile of red blocks", "green square", push=True),)
    for said in ("You should now push", "Would you mind pushing"):
        text = f"{said} the pile of red blocks into the green square"
        assert understand(text, ModelParser(Likes("pile of red blocks", "green square"), 0.0)) == pushed
    text = "the push pin goes in the green bowl"
    assert understand(text, ModelParser(Likes("push pin", "green bowl"), 0.0)) == (Queries("push pin", "green bowl"),)


def test_between_one_thing_is_asked_about():
    sentence = Sentence.read("the cup goes between the plate")
    with pytest.raises(ValueError, match="between"):
        place_phrase(sentence, spans(sentence)[-1])
    assert (
        readable("The Red Block on the left") == "left red block" and readable("pen that writes") == "pen that writes"
    )


def test_the_small_model_reads_what_the_grammar_refuses(parser):
    wanted = {
        "the yellow block goes in the green bowl": ("yellow block", "green bowl"),
        "into the toolbox with the pliers!": ("pliers", "toolbox"),
        "would you mind putting my mug on the shelf?": ("mug", "shelf"),
        "I'd love to see the teddy bear to the left of the box": ("teddy bear", "left of box"),
    }
    for text, (pick, place) in wanted.items():
        assert isinstance(understand(text, parse), Question)
        assert understand(text, parser) == (Queries(pick, place),)


def test_every_task_without_an_amount_is_read_as_by_the_grammar(parser):
    for text in ("put the red block in the green bowl", "pack the star in the brown box"):
        assert parser(text) == parse(text)
    assert PARSERS.find("words") is reader.read_words and "put-block-in-bowl-seen-colors" in tasks.names()


def test_without_the_weights_of_the_model_the_grammar_carries_on(monkeypatch):
    def missing():
        raise models.ModelError("the small language model is not installed")

    monkeypatch.setattr(reader, "_small_parser", missing)
    assert reader.read_words("put the red block in the green bowl") == Queries("red block", "green bowl")
    with pytest.raises(ValueError, match=r"does not begin with a known verb.*not installed"):
        reader.read_words("the red block goes in the green bowl")


# The sentences.


def test_the_sentences_follow_their_rules():
    for items in (FIRST, SECOND):
        assert len(items) == 300 == len({item.sentence for item in items})
        for item in items:
            acts = item.expected == "act"
            assert acts == (item.pick is not None) == (item.place is not None)
            assert not acts or {item.pick in item.sentence, item.place in item.sentence} == {True}
            assert item.relation is None or item.relation in language.RELATIONS.values()
    halves = [item.half for item in FIRST]
    assert 130 < halves.count("filed") < 170
    assert not {item.sentence for item in sentences.filed()} & {item.sentence for item in sentences.development()}


def test_outcomes():
    act = sentences.AnnotatedSentence("Grab the mug by its handle and put it there", "part", "mug", "box", None, "act")
    refuse = sentences.AnnotatedSentence("Hello", "chat", None, None, None, "refuse_or_ask")
    right = {"mug", "mug handle"}
    for pick in ("mug", "mug handle", "mug lid", "cup"):
        outcome = sentences.outcome(act, lambda _, pick=pick: Queries(pick, "box over there"))
        assert outcome == ("right" if pick in right else "misread")
    assert sentences.outcome(refuse, lambda _: Queries("mug", "box")) == "misread"
    assert (sentences.outcome(act, parse), sentences.outcome(refuse, parse)) == ("asked", "right")


def test_weights_make_right_readings_likely_and_held_out_ones_are_not_fitted():
    item = FIRST[0]
    made = [fit.Table(item, [{"x": 0.0}, {"x": 1.0}], [1]) for _ in range(20)]
    weights = fit.fit(made, ["x"])
    assert weights["x"] > 2
    chances = fit.held_out(made, ["x"])
    assert all(of_table[1] > 0.9 for of_table in chances)
    assert fit.counts(made, chances, 0.5) == {"right": 20, "asked": 0, "misread": 0}
    assert fit.counts(made, chances, 1.1) == {"right": 0, "asked": 20, "misread": 0}


def test_the_stored_rows_hold_what_the_readme_says():
    lines = (sentences.FOLDER / "rows.jsonl").read_text().splitlines()
    rows = {(row["half"], row["method"]): row for row in map(json.loads, lines)}
    filed = rows["filed", "words"]
    assert filed["sentences"] == len(sentences.filed()) and set(rows) >= {("filed", "grammar")}
    text = (sentences.FOLDER.parents[1] / "experiments" / "other_words" / "README.md").read_text()
    for name in ("right", "asked", "misread"):
        mean, low, high = filed[name]
        assert f"{mean} [{low}, {high}]" in text.replace("*", "")
