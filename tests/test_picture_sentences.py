"""Sentences with pictures in the places of phrases: how they are read, kept in files, and followed."""

import json
import math

import cv2
import numpy as np
import pytest
from damages import png_that_claims
from small import SMALL

from gem_lite import clip
from gem_lite.actions import ExpertAction, PickPlace
from gem_lite.cli import main, own_table
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.foundations import colors
from gem_lite.language import ImageQuery, PictureSentence, Queries, parse, read_goals, read_picture
from gem_lite.language.reader import read_words
from gem_lite.maps.crop_memory import cut
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd import png
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2

SCENE = clip.DATA / "foreign-scenes" / "workbench"
RED, GREEN = (np.full((4, 6, 3), color, np.uint8) for color in ((200, 0, 0), (0, 200, 0)))
MUG, BOX = ImageQuery(RED, "mug"), ImageQuery(GREEN, "box")
BOTH = PictureSentence("put {0} into {1}", (MUG, BOX))
ACTION = ExpertAction(PickPlace(Pose2(0.4, 0.25, 0.3), Pose2(0.62, 0.36, 0.3)))


@pytest.fixture(scope="module")
def observation():
    return Observation.load(SCENE)


@pytest.mark.parametrize("parser", [parse, read_words])
@pytest.mark.parametrize(
    ("text", "queries"),
    [
        ("put {0} into {1}", Queries(MUG, BOX)),
        ("Please put the {1} in the {0}!", Queries(BOX, MUG)),
        ("pick up {0} and place it in {1}", Queries(MUG, BOX)),
        ("push {0} to {1}", Queries(MUG, BOX, push=True)),
        ("put {0} in the brown box", Queries(MUG, "brown box")),
    ],
)
def test_a_picture_stands_where_a_phrase_would(parser, text, queries):
    sentence = PictureSentence(text, (MUG, BOX)[: text.count("{")])
    assert read_goals(sentence, parser) == (queries,)
    assert read_goals("put the mug in the box", parser) == (Queries("mug", "box"),)


def test_a_refusal_repeats_the_sentence_as_it_was_said():
    with pytest.raises(ValueError, match=r"the instruction 'put \{0\} \{1\}' names no place"):
        parse(PictureSentence("put {0} {1}", (MUG, BOX)))


@pytest.mark.parametrize("text", ["put {0} left of {1}", "put the left {0} into {1}", "put {0}s into {1}"])
def test_a_picture_is_no_part_of_a_phrase(text):
    with pytest.raises(ValueError, match="a picture must stand in the place of a whole phrase"):
        parse(PictureSentence(text, (MUG, BOX)))


def test_a_sentence_holds_each_picture_once():
    assert str(BOTH) == "put [mug] into [box]"
    assert PictureSentence("put {0} into {1}", (ImageQuery(RED.copy(), "mug"), BOX)) == BOTH
    assert PictureSentence("put {0} into {1}", (ImageQuery(GREEN, "mug"), BOX)) != BOTH
    assert len({BOTH, PictureSentence("put {0} into {1}", (ImageQuery(RED.copy(), "mug"), BOX))}) == 1
    for text, count in (("put {0} into {0}", 2), ("put {0} into {2}", 2), ("put it there", 0), ("put {0} there", 2)):
        with pytest.raises(ValueError, match="text must hold each of"):
            PictureSentence(text, (MUG, BOX)[:count])


def test_a_demonstration_keeps_its_pictures(tmp_path, observation):
    folder = tmp_path / "put" / "episode-1"
    DemonstrationStep(observation, BOTH, ACTION, reward=1.0).save(folder / "step-1", 2e-4)
    for name, pixels in (("picture-0", RED), ("picture-1", GREEN)):
        assert np.array_equal(cv2.imread(str(folder / "step-1" / f"{name}.png"))[..., ::-1], pixels)
    (loaded,) = Demonstration.load(folder).steps
    named = (ImageQuery(RED, "picture-0"), ImageQuery(GREEN, "picture-1"))
    assert loaded.instruction == PictureSentence(BOTH.text, named)
    assert loaded.phrases == Queries(*named)
    spoken = DemonstrationStep(observation, "put the mug in the box", ACTION).contents(tmp_path)
    assert "pictures" not in json.loads(spoken[tmp_path / "action.json"]), "files of today's sets stay as they are"


def test_a_person_names_the_pictures_of_a_recording(tmp_path, observation):
    DemonstrationStep(observation, "put the mug in the box", ACTION).save(tmp_path, 2e-4)
    written = json.loads((tmp_path / "action.json").read_text())

    def record(sentence, *names):
        written.update(sentence=sentence, pictures=names)
        (tmp_path / "action.json").write_text(json.dumps(written))
        return DemonstrationStep.load(tmp_path).phrases

    (tmp_path / "my mug.png").write_bytes(png.encode(RED[..., 0]))  # gray
    assert record("put {0} in the box", "my mug.png") == Queries(
        ImageQuery(np.full((4, 6, 3), 200, np.uint8), "my mug"), "box"
    )
    with pytest.raises(FileNotFoundError, match=r"there is no picture .*hat\.png"):
        record("put {0} in the box", "hat.png")
    with pytest.raises(ValueError, match=r"action.json pictures 0 .* got '../mug.png'"):
        record("put {0} in the box", "../mug.png")
    with pytest.raises(ValueError, match=r"action.json: text must hold each of 1 pictures once, as \{0\}"):
        record("put the mug in the box", "my mug.png")


def test_pictures_of_every_kind_become_rgb(tmp_path):
    path = tmp_path / "mug.png"

    def read(image):
        path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
        return read_picture(path).picture

    clear = np.zeros((2, 2, 4), np.uint8)
    clear[0] = (10, 20, 30, 255)  # BGR and opaque
    assert read(clear).tolist() == [[[30, 20, 10]] * 2, [list(colors.TABLE)] * 2]
    assert read(np.full((2, 3), 7, np.uint8)).tolist() == [[[7, 7, 7]] * 3] * 2
    assert read(np.full((2, 3, 3), 513, np.uint16)).tolist() == [[[2, 2, 2]] * 3] * 2
    assert read(np.full((1000, 2000, 3), 9, np.uint8)).shape == (256, 512, 3)
    assert read(np.full((1, 5000, 3), 9, np.uint8)).shape == (1, 512, 3)
    for content, reason in ((b"", "is cut off or no PNG"), (b"no picture", "is cut off or no PNG"),
                            (png_that_claims(100_000, 100_000), "must have at most")):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(ValueError, match=f"mug.png {reason}"):
            read_picture(path)


def test_a_policy_follows_pictures(model, observation):
    policy = Gem(SMALL, model)
    choice = policy.decide(observation, BOTH)
    assert choice.queries == Queries(MUG, BOX) and choice.instruction == "put [mug] into [box]"
    assert choice.pick_image is not None and choice.place_image is not None
    same = policy.decide(observation, Queries(MUG, BOX))
    assert np.array_equal(choice.pick_logits, same.pick_logits) and choice.action == same.action
    exchanged = policy.decide(observation, PictureSentence("put {1} into {0}", (MUG, BOX)))
    assert np.array_equal(exchanged.pick_map, choice.place_map) and not np.array_equal(
        exchanged.pick_map, choice.pick_map
    )
    demo = Demonstration("put", "train", 0, (DemonstrationStep(observation, BOTH, ACTION, reward=1.0),))
    policy.remember([demo])
    (forms,) = policy.prepare([demo])
    losses = policy.losses(forms[:1])
    assert all(math.isfinite(loss.item()) for loss in losses.values())


def test_only_crops_that_words_name_are_remembered(model, observation):
    long_name = "-".join(["4f2a"] * 20)  # more tokens than a phrase may have
    mixed = PictureSentence("put {0} in the brown box", (ImageQuery(RED, long_name),))
    demo = Demonstration("put", "train", 0, (DemonstrationStep(observation, mixed, ACTION, reward=1.0),))
    policy = Gem(SMALL, model)
    policy.remember([demo])
    assert [entry.phrase for entry in policy.memory.entries] == ["brown box"]
    pictures_alone = Demonstration("put", "train", 0, (DemonstrationStep(observation, BOTH, ACTION, reward=1.0),))
    fresh = Gem(SMALL, model)
    fresh.remember([pictures_alone])
    assert fresh.memory is None and len(list(fresh.prepare([pictures_alone]))) == 1


def test_without_parsing_there_are_only_words(model, observation):
    with pytest.raises(ValueError, match=r"gem without parsing reads whole sentences of words, got .* put \[mug\]"):
        Gem(SMALL.ablated("without-parsing"), model).act(observation, BOTH)


def test_look_finds_what_a_picture_shows(capsys, tmp_path, multi, monkeypatch, observation):
    monkeypatch.setattr(own_table, "load", lambda *_: multi)
    truth = json.loads((SCENE / "truth.json").read_text())["things"]
    x, y = next((one["x"], one["y"]) for one in truth if (one["color"], one["kind"]) == ("red", "block"))
    picture = str(tmp_path / "block.png")
    crop = cut(fuse_views(observation.views, multi.config.workspace), Pose2(x, y), LITE.top_patch)
    (tmp_path / "block.png").write_bytes(png.encode(np.ascontiguousarray(crop)))

    def look(*words):
        code = main(["look", str(SCENE), *words, "--out", str(tmp_path)])
        return json.loads((tmp_path / "look.json").read_text()) if code == 0 else capsys.readouterr().err

    found = look("--pick", picture, "--place", "blue bowl")
    assert list(found["places"]) == [picture, "blue bowl"] and found["action"]["place"]
    best = found["places"][picture][0]
    assert math.dist((best["x"], best["y"]), (x, y)) < 0.03
    found = look("--place", picture)
    assert list(found["places"]) == [picture] and found["action"] is None
    assert "there is no picture" in look("--pick", str(tmp_path / "no.png"))
    assert "text must be empty besides --pick or --place, got 'red block'" in look("red block", "--pick", picture)
    assert "the instruction is empty" in look()
