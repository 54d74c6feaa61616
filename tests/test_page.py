"""What a visitor of the page can do, and cannot; the page itself is tried in tests/browser/page.py."""

import json
import tempfile

import numpy as np
import pytest

from gem_lite import clip
from gem_lite.page import session as sessions
from gem_lite.page.session import Session
from gem_lite.policies import robot_plan

FOREIGN = clip.DATA / "foreign-scenes"
TASK = "put-block-in-bowl-seen-colors"


@pytest.fixture
def visitor(multi):
    visitor = Session(multi)
    yield visitor
    visitor.close()


def files_of(scene):
    return {path.name: path.read_bytes() for path in (FOREIGN / scene).iterdir() if path.suffix in (".png", ".json")}


def is_picture(picture):
    return picture.dtype == np.uint8 and picture.ndim == 3 and len(np.unique(picture)) > 50


def test_a_sentence_a_refusal_an_act_and_another_table(visitor):
    shown = visitor.lay(TASK, 0)
    sentence = shown.text.split('"')[1]
    assert sentence.startswith("put the") and is_picture(shown.picture)
    asked = visitor.ask(sentence)
    assert asked.text.startswith("Understood: pick") and "It picks at (" in asked.text and is_picture(asked.picture)
    acted = visitor.act()
    assert acted.text.startswith("Outcome: placed. Score") and not np.array_equal(acted.picture, shown.picture)
    with pytest.raises(ValueError, match="one choice is carried out once"):
        visitor.act()
    refused = visitor.ask("put the banana in the brown box")
    assert refused.text.startswith('Refused: there is no "banana"') and is_picture(refused.picture)
    with pytest.raises(ValueError, match="ask first"):
        visitor.act()
    visitor.ask(sentence)
    assert visitor.lay(TASK, 1).text != shown.text, "another scene, and the choice for the last one is gone"
    with pytest.raises(ValueError, match="ask first"):
        visitor.act()
    visitor.close()
    with pytest.raises(ValueError, match="lay a table first"):
        visitor.ask(sentence)
    assert visitor.lay(TASK, 0).text == shown.text, "a session that was closed can begin again"


def test_what_no_camera_saw_is_told(visitor):
    files = files_of("kitchen")
    cameras = json.loads(files["cameras.json"])
    cameras["cameras"] = [entry for entry in cameras["cameras"] if entry["name"] == "right"]
    shown = visitor.upload(files | {"cameras.json": json.dumps(cameras).encode()})
    assert "No camera sees " in shown.text and "nothing is picked or placed there." in shown.text
    choice = visitor.policy.decide(visitor._observation, "put the red mug in the blue bowl")
    wanted = robot_plan.plan(choice).forbidden_in_words()
    said = visitor.ask("put the red mug in the blue bowl").text
    assert said.count("the policy wanted another") == len(wanted)
    assert "No camera sees" not in visitor.lay(TASK, 0).text, "three cameras see the simulated table"


def test_an_upload_is_looked_at_and_not_acted_on(visitor):
    shown = visitor.upload(files_of("workbench"))
    assert shown.text.startswith("Your table.") and is_picture(shown.picture)
    assert "It picks at (" in visitor.ask("put the red block in the blue bowl").text
    with pytest.raises(ValueError, match="on a simulated table"):
        visitor.act()


def test_uploads_that_are_not_scenes_are_refused(visitor, monkeypatch):
    files = files_of("workbench")
    with pytest.raises(ValueError, match=r"must hold cameras\.json and its pictures, got left\.depth\.png"):
        visitor.upload({"left.depth.png": files["left.depth.png"]})
    with pytest.raises(ValueError, match=r"left\.color\.png is missing"):
        visitor.upload({name: content for name, content in files.items() if name != "left.color.png"})
    with pytest.raises(ValueError, match=r"left\.depth\.png"):
        visitor.upload(files | {"left.depth.png": files["left.depth.png"][:100]})
    outside = json.loads(files["cameras.json"])
    outside["cameras"][0]["color"] = "../../etc/passwd"
    with pytest.raises(ValueError, match="must be a picture in the folder"):
        visitor.upload(files | {"cameras.json": json.dumps(outside).encode()})
    with pytest.raises(ValueError, match="at most 13 files"):
        visitor.upload({f"{number}.png": b"" for number in range(14)})
    many = json.loads(files["cameras.json"])
    many["cameras"] = [many["cameras"][0] | {"name": f"{number}"} for number in range(60)]
    with pytest.raises(ValueError, match="at most 25 million pixels together"):
        visitor.upload(files | {"cameras.json": json.dumps(many).encode()})
    monkeypatch.setattr(sessions, "MOST_BYTES", 1000)
    with pytest.raises(ValueError, match="at most 13 files with 0 MB together"):
        visitor.upload(files)
    with pytest.raises(ValueError, match="lay a table first"):
        visitor.ask("put the red block in the blue bowl")


def test_what_a_visitor_types_is_checked(visitor):
    with pytest.raises(ValueError, match="pack-everything"):
        visitor.lay("pack-everything", 0)
    with pytest.raises(ValueError, match="index must be in"):
        visitor.lay(TASK, -1)
    with pytest.raises(ValueError, match="object-sorting-seen has another table than the one that the policy"):
        visitor.lay("object-sorting-seen", 0)
    visitor.lay(TASK, 0)
    with pytest.raises(ValueError, match="at most 300 characters, got 301"):
        visitor.ask("a" * 301)
    for wrong in ("", "dance", "__import__('os').system('true')"):
        with pytest.raises(ValueError, match=r"."):
            visitor.ask(wrong)


def test_nothing_is_written(visitor, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    visitor.upload(files_of("desk"))
    visitor.ask("put the blue block in the orange bowl")
    assert list(tmp_path.iterdir()) == []
