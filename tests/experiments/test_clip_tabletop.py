"""How the embedded CLIP is made: its words, its pictures, its training, its card."""

import itertools
import json
import re
from types import SimpleNamespace

import numpy as np
import pybullet as p
import pytest
import torch
from small import SMALL

from experiments.clip_tabletop import (
    bodies,
    card,
    crop_search,
    part_peaks,
    pretrain,
    scenes,
    vocabulary,
    withheld,
    withheld_picks,
)
from experiments.clip_tabletop import crops as crop_files
from experiments.clip_tabletop.bodies import COLOR_NAMES, NOUN_NAMES, Label, LabelledScene
from experiments.clip_tabletop.crops import PART_KEYS, Crops
from gem_lite import clip
from gem_lite.evaluation import results
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.policies import checkpoints
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import GemConfig
from gem_lite.se2 import Workspace
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.grips import Surfaces

pytestmark = pytest.mark.release


def test_words_that_no_caption_holds_are_not_understood_and_the_card_says_so(model):
    lists = (*vocabulary.COLORS.values(), *vocabulary.NOUNS.values(), *vocabulary.PARTS.values())
    said = set(" ".join([*itertools.chain(*lists), *vocabulary.NOUNS_WITHOUT_PICTURES, *vocabulary.TABLE]).split())
    synonyms = {"blue": ("azure",), "red": ("scarlet", "crimson"), "green": ("emerald",)}
    assert all(card.unread_words(model, synonyms, COLOR_NAMES, "{} block")), "a word of its captions is understood"
    text = (clip.EMBEDDED / "README.md").read_text()
    for words, plain, template in (
        (vocabulary.UNREAD_COLORS, COLOR_NAMES, "{} block"),
        (vocabulary.UNREAD_NOUNS, NOUN_NAMES, "a {}"),
    ):
        assert not said & set(itertools.chain(*words.values()))
        right = card.unread_words(model, words, plain, template)
        assert sum(right) <= 0.2 * len(right)
        assert f"{sum(right)} of {len(right)} words for its" in text


def test_zero_shot_on_fresh_renders(model, jobs_here):
    # Seeds that neither training nor the card used, and proportions of objects that training never showed.
    crops = crop_files.render_crops(10, seed=77, kind="test")
    found = card.accuracy(model, crops.select(crops.whole))
    assert found["crops"] > 120
    assert found["color"] >= 98
    assert found["shape"] >= 92  # of 230: chance is 0.4
    assert found["both"] >= 90
    reworded = card.accuracy(model, crops.select(crops.whole), synonyms=True)
    assert all(reworded[key] >= found[key] - 5 for key in ("color", "shape", "both"))
    assert card.part_accuracy(model, crops)["own"] >= 90
    # Labels shifted by one colour: every colour and pair must be wrong, the shapes stay right.
    crops = crops.select(crops.whole & (crops.shape >= 0))
    crops.color = np.where(crops.color < 0, -1, (crops.color + 1) % len(COLOR_NAMES))
    found = card.accuracy(model, crops)
    assert found["color"] < 10 and found["both"] < 10 and found["shape"] > 80


def test_pairs_never_shown_are_composed(model, jobs_here):
    crops = crop_files.render_crops(5, seed=78, kind="held-out")
    held = card._held_out(crops.select(crops.whole))
    assert len(held) > 60
    assert card.accuracy(model, held)["both"] >= 85


def test_rendered_crops_are_kept_and_those_of_another_kind_or_renderer_are_rendered_anew(tmp_path, monkeypatch):
    rendered = []

    def render_crops(scenes, seed, kind):
        rendered.append((seed, kind))
        return Crops(*(np.array([len(rendered)]) for _ in range(5)))

    monkeypatch.setattr(crop_files, "render_crops", render_crops)
    wanted = [(81, "training"), (81, "test"), (81, "training"), (81, "test"), (82, "test")]
    found = [int(crop_files.rendered_crops(tmp_path, 1, seed=seed, kind=kind).images[0]) for seed, kind in wanted]
    assert found == [1, 2, 1, 2, 3] and rendered == [*wanted[:2], wanted[4]]
    monkeypatch.setattr(crop_files, "CAMERAS", crop_files.CAMERAS[::-1])  # other pictures of the same scenes
    assert crop_files.rendered_crops(tmp_path, 1, seed=81).images[0] == 4


def test_captions_are_seeded_and_name_parts_holes_piles_and_boxes():
    def captions(*words, count=300):
        return {vocabulary.caption(*words[:2], np.random.default_rng(i), *words[2:]) for i in range(count)}

    assert len(captions("red", "block", count=1)) == 1 < len(captions("red", "block"))
    for noun, plural in {
        "block": "blocks", "cross": "crosses", "magnifying glass": "magnifying glasses", "scissors": "scissors",
        "middle of the stand": "middle of the stand",
    }.items():  # fmt: skip
        assert vocabulary.plural(noun) == plural
    parts = captions("blue", "mug", "handle")
    assert any("grip" in text for text in parts) and all("handle" in text or "grip" in text for text in parts)
    holes = captions(None, "star hole")
    assert any("left star hole" in text for text in holes) and "star hole" in holes
    piles = captions("red", "pile of {} blocks")
    assert any("of red blocks" in text for text in piles) and not any("{" in text for text in piles)
    assert not any("  " in text for text in piles | holes)
    boxes = captions(None, "gear box")
    assert any("gear box" in text for text in boxes) and any("cogwheel box" in text for text in boxes)


def test_no_name_means_two_things_and_the_words_beside_the_weights_are_those_of_the_captions():
    named = [name for names in (*vocabulary.COLORS.values(), *vocabulary.NOUNS.values()) for name in names]
    assert len(set(named)) == len(named)
    assert not set(named) & set(vocabulary.NOUNS_WITHOUT_PICTURES)
    assert len(vocabulary.HELD_OUT) >= 20
    assert all(color in vocabulary.COLORS and shape in vocabulary.SHAPES for color, shape in vocabulary.HELD_OUT)
    stored = json.loads((clip.EMBEDDED / "words.json").read_text())
    assert stored == json.loads(json.dumps(vocabulary.lists()))


def test_training_never_draws_what_is_held_out():
    rng = np.random.default_rng(0)
    drawn = [bodies.draw("training", rng) for _ in range(4000)]
    for color, shape, rgba in drawn:
        name = COLOR_NAMES[color] if color >= 0 else vocabulary.nearest_color(255 * np.array(rgba[:3]))
        assert (name, shape) not in vocabulary.HELD_OUT
    assert 0.25 < np.mean([color < 0 for color, _, _ in drawn]) < 0.45
    boxes = np.mean([name in vocabulary.BOXES for _, name, _ in drawn])
    assert boxes == pytest.approx(bodies.SHARES["symbol"], abs=0.02)
    shown = [bodies.draw("held-out", rng) for _ in range(1000)]
    assert 0.4 < np.mean([(COLOR_NAMES[c], s) in vocabulary.HELD_OUT for c, s, _ in shown]) < 0.6


def test_a_crop_is_labelled_by_what_fills_its_middle():
    mug = NOUN_NAMES.index("mug")
    scene = LabelledScene({7: Label(2, mug, ("", "brim", "handle")), 8: Label(4, 0), 9: Label(-1, 1)}, ground={9})
    bodies, links = np.full((40, 40), -1), np.zeros((40, 40), int)
    assert crop_files._label(bodies, links, scene) == (-1, -1, -1)
    bodies[10:30, 10:30] = 7
    assert crop_files._label(bodies, links, scene) == (2, mug, -1)
    links[10:30, 10:27] = 2
    assert crop_files._label(bodies, links, scene) == (2, mug, PART_KEYS.index(("mug", "handle")))
    bodies[10:30, :20] = 8
    assert crop_files._label(bodies, links, scene) is None  # two compete
    bodies[:, :] = 9
    assert crop_files._label(bodies, links, scene) == (-1, 1, -1)
    bodies[12:26, 12:26] = 8
    assert crop_files._label(bodies, links, scene) == (4, 0, -1)  # what lies on the ground counts more
    scene.leader = {5: 5, 6: 5, 9: 5}  # a pile is one body in pictures
    assert scene.grouped(np.array([[-1, 7, 5], [6, 9, 4]])).tolist() == [[-1, 7, 5], [5, 5, 4]]


def test_scenes_show_what_the_tasks_build():
    shown = set()
    for index in range(45):
        client = p.connect(p.DIRECT)
        try:
            scene = scenes.lay_out(client, Workspace(), "training", np.random.default_rng((3, index)))
        finally:
            p.disconnect(client)
        shown |= {NOUN_NAMES[label.noun] for label in scene.labels.values()}
    assert set(vocabulary.STRUCTURES) <= shown
    assert len(shown & set(vocabulary.HOLES)) > 10
    assert len(shown & set(vocabulary.TILES)) > 20
    assert len(shown & set(vocabulary.BOXES)) > 4


def test_captions_match_their_crops():
    mug, hat = NOUN_NAMES.index("mug"), NOUN_NAMES.index("hat")
    handle = PART_KEYS.index(("mug", "handle"))
    crops = Crops(
        np.zeros((4, 2, 2, 3), np.uint8), np.array([0, -1, 0, -1]), np.array([mug, hat, mug, -1]),
        np.array([handle, -1, -1, -1]), np.ones(4, bool),
    )  # fmt: skip
    full, color, shape, part = pretrain.caption_sets(crops, np.random.default_rng(0))
    assert full[0].tolist() == [0, 2, 3]  # a hat in an unnamed colour has no full caption
    assert set(full[1]) == {("blue", "mug", None), (None, None, None)}
    assert [rows.tolist() for rows, _, _ in (color, shape, part)] == [[0, 2, 3], [0, 1, 2, 3], [0]]
    assert part[1][0][1:] == ("mug", "handle")
    for rows, keys, match in (full, color, shape, part):
        assert match.shape == (len(rows), len(keys))
        assert (match.sum(axis=1) == 1).all()
    assert full[2][0].tolist() == full[2][1].tolist() != full[2][2].tolist()


def test_a_state_of_another_training_or_a_damaged_one_is_refused(tmp_path):
    crops = Crops(np.zeros((600, 40, 40, 3), np.uint8), *np.zeros((3, 600), int), np.ones(600, bool))
    torch.save({"identity": {"crops": 1}}, tmp_path / "state.pt")
    with pytest.raises(ValueError, match="delete it first"):
        pretrain.train(crops, 1, 0, tmp_path)
    (tmp_path / "state.pt").write_bytes(b"")
    with pytest.raises(ValueError, match=r"state\.pt is cut off or no state of a training"):
        pretrain.train(crops, 1, 0, tmp_path)


def test_a_trained_clip_replaces_nothing_but_a_clip(tmp_path):
    pretrain.check_folder(clip.EMBEDDED)
    tokenizer = pretrain.train_tokenizer()
    model = pretrain.make_model(len(tokenizer))
    out = tmp_path / "out"
    for _ in range(2):  # the second time into the CLIP of the first
        pretrain.save(model, tokenizer, out)
        assert clip.load(out).dim == 128
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    (out / "notes.txt").write_text("mine")
    other = tmp_path / "other"
    other.mkdir()
    (other / "config.json").write_text('{"architectures": ["CLIPModel"]}')
    for folder, name in ((out, "notes.txt"), (other, "config.json"), (other / "config.json", "config.json")):
        with pytest.raises(ValueError, match=rf"out must be a new or empty folder.* holds {name}$"):
            pretrain.pretrain(folder, tmp_path / "run", 1, 1, 0)
        with pytest.raises(ValueError, match="out must be"):
            pretrain.save(model, tokenizer, folder)
    assert (out / "notes.txt").exists() and (other / "config.json").exists()


def test_a_symbol_box_is_labelled_whichever_sheet_is_seen():
    rows = [row for index in range(4) for row in crop_files.render_scene(np.random.default_rng((5, index)), "training")]
    boxed = [row for row in rows if row[2] >= 0 and bodies.NOUN_NAMES[row[2]] in vocabulary.BOXES]
    assert len(boxed) > 6 and all(row[1] == -1 for row in boxed)
    # Paper, ink and walls are one body: crops of boxes hold white, black and blue.
    pictures = np.stack([row[0] for row in boxed]).reshape(len(boxed), -1, 3)
    assert ((pictures.min(axis=2) > 180).mean(axis=1) > 0.05).mean() > 0.5


def test_each_list_withholds_one_part_of_each_object_and_some_letters():
    for hidden in (withheld.PAIRS, withheld.WORDS):
        for name in withheld.OBJECTS:
            assert sum(hidden.names(name, part) for part in objects.part_names(name)) == 1, name
        assert {name for name in hidden.nouns if name in vocabulary.TILES} == {f"letter {c}" for c in "AHOT"}
        assert {"letter A shape", "letter T shape hole"} < hidden.nouns
    handles = [withheld.PAIRS.names(*key) for key in PART_KEYS if key[0] in withheld.OBJECTS and "handle" in key[1]]
    assert any(handles) and not all(handles)
    assert not any("handle" in part for _, part in withheld.WORDS.parts)


@pytest.mark.parametrize("hidden", [withheld.PAIRS, withheld.WORDS], ids=lambda hidden: hidden.name)
def test_no_caption_and_no_word_list_names_what_is_withheld(hidden):
    def phrases(noun, part=None):
        names = [vocabulary.named("", name) for name in vocabulary.NOUNS[noun]]
        return [f"{name} {word}" for name in names for word in vocabulary.PARTS[noun, part]] if part else names

    forbidden = [phrase for noun in hidden.nouns for phrase in phrases(noun)]
    forbidden += [phrase for key in hidden.parts for phrase in phrases(*key)]
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, forbidden))})(?!\w)", re.IGNORECASE)
    # Crops of everything, each part in all colours.
    labels = [(c, s, -1) for c in range(-1, len(COLOR_NAMES)) for s in range(len(NOUN_NAMES))] + [(-1, -1, -1)]
    labels += [(c, NOUN_NAMES.index(n), q) for c in range(-1, len(COLOR_NAMES)) for q, (n, _) in enumerate(PART_KEYS)]
    columns = np.array(labels).T
    crops = Crops(np.zeros((len(labels), 1, 1, 3), np.uint8), *columns, np.ones(len(labels), bool))
    rng = np.random.default_rng(0)
    for shown, named in ((crops, True), (hidden.hide(crops), False)):
        texts = list(pretrain.write_captions(shown, rng).texts)
        texts += pretrain.captions_for_tokenizer(rng, withheld.NOTHING if named else hidden)
        assert len(texts) > 25_000
        assert any(pattern.search(text) for text in texts) == named
        assert not any(word in " ".join(texts) for word in ("bristle", "jaw")) or named or hidden != withheld.WORDS
    words = hidden.words()
    assert words["withheld"] == hidden.phrases
    assert not {*words["nouns"], *words["parts"]} & set(hidden.phrases)
    assert not any(
        pattern.search(name) for names in (*words["nouns"].values(), *words["parts"].values()) for name in names
    )
    assert withheld.NOTHING.words() == vocabulary.lists()
    token_texts = pretrain.train_tokenizer(withheld=hidden)
    assert (
        token_texts.decode(token_texts("mug brim letter A")["input_ids"], skip_special_tokens=True).strip()
        == "mug brim letter a"
    )


def test_a_withheld_tile_is_captioned_by_its_colour_and_a_part_by_its_object():
    tile, mug = NOUN_NAMES.index("letter A"), NOUN_NAMES.index("mug")
    brim, handle = (PART_KEYS.index(("mug", part)) for part in ("brim", "handle"))
    crops = Crops(
        np.zeros((4, 2, 2, 3), np.uint8), np.array([0, -1, 1, 1]), np.array([tile, tile, mug, mug]),
        np.array([-1, -1, brim, handle]), np.ones(4, bool),
    )  # fmt: skip
    hidden = withheld.WORDS.hide(crops)
    assert crops.shape.tolist() == [tile, tile, mug, mug], "the rendered labels stay"
    full, color, shape, part = pretrain.caption_sets(hidden, np.random.default_rng(0))
    assert [rows.tolist() for rows, _, _ in (full, color, shape, part)] == [[2, 3], [0, 2, 3], [2, 3], [3]]
    assert set(color[1]) == {("blue", None, None), ("red", None, None)}


def test_an_experimental_clip_does_not_replace_the_embedded_one(tmp_path):
    with pytest.raises(ValueError, match="out must be another folder"):
        pretrain.pretrain(clip.EMBEDDED, tmp_path, 1, 1, 0, withheld.WORDS)


def test_a_peak_is_on_the_part_that_lies_on_top():
    workspace = Workspace()
    x, y = workspace.x_min + 0.1, workspace.y_min + 0.2
    points = np.array([[x, y, 0.02], [x, y, 0.01], [x + 0.1, y, 0.01]])
    surfaces = Surfaces(points, np.zeros((3, 3)), np.array([1, 0, 0]), ())
    owners = part_peaks.owners_from_above(surfaces, workspace)
    assert owners[workspace.nearest_cell(x, y)] == 1
    assert owners[workspace.nearest_cell(x + 0.1, y)] == 0
    assert (owners >= 0).sum() == 2
    semantic = np.zeros(workspace.shape)
    semantic[workspace.nearest_cell(x, y)] = 1
    assert part_peaks.peak_is_on(semantic, owners == 1) and not part_peaks.peak_is_on(semantic, owners == 0)
    corner = np.zeros(workspace.shape)
    corner[0, 0] = 1
    assert part_peaks.peak_is_on(corner, np.roll(corner, 1) > 0), "a cell beside the peak counts"


def test_a_scene_of_parts_shows_the_part_that_its_sentence_names(model):
    config = GemConfig.preset("lite").for_table((0.384, 0.616, -0.145, 0.145), 0.5)
    asked = next(part_peaks.asked_parts(part_peaks.TASKS[0], "test", 0, "real-table", model, config))
    assert asked.part in objects.part_names(asked.noun)
    assert (
        asked.on_part.any()
        and (asked.on_object & ~asked.on_part).any()
        and not (asked.on_part & ~asked.on_object).any()
    )
    assert asked.on_object.sum() < 0.1 * asked.on_object.size, "an object is smaller than 5.5 cm"
    # The crop that a demonstration would remember is from the part itself: its middle is the colour of its cells.
    middle = asked.crop[asked.crop.shape[0] // 2, asked.crop.shape[1] // 2].astype(int)
    colors_of_part = asked.scene.heightmap.rgb[asked.on_part].astype(int)
    assert np.abs(colors_of_part - middle).max(axis=1).min() == 0


def test_peaks_are_summed_up_by_list_and_by_what_it_withholds():
    rows = [
        {"task": part_peaks.TASKS[0], "object": "mug", "part": part, **dict.fromkeys(part_peaks.MEANS, share)}
        for part, share in (("brim", 0.25), ("handle", 1.0))
    ] + [
        {"task": part_peaks.TASKS[1], "object": "axe", "part": part, **dict.fromkeys(part_peaks.MEANS, share)}
        for part, share in (("head", 0.5), ("handle", 0.75))
    ]  # fmt: skip
    lines = {" ".join(line.split()[:-7]): line.split()[-7:] for line in part_peaks.described(rows).splitlines()[2:]}
    assert lines["mug brim"] == lines["words, seen objects, withheld: 1 parts"] == ["25"] * 7
    assert lines["pairs, seen objects, kept: 1 parts"] == ["100"] * 7
    assert lines["words, unseen objects, kept: 1 parts"] == ["75"] * 7


def test_a_crop_of_the_very_scene_finds_its_part(monkeypatch):
    all_parts = part_peaks.asked_parts
    monkeypatch.setattr(
        part_peaks, "asked_parts", lambda *names, **_: itertools.islice(all_parts(*names[:2], 0, *names[3:]), 1)
    )
    rows = crop_search.measure_crops(0.03, 2, 1, "real-table", None)
    shares = {(row["text_weight"], row["image_weight"]): row for row in rows}
    assert set(shares) == set(crop_search.WEIGHTS)
    assert shares[0.0, 1.0]["on_part"] == shares[0.0, 1.0]["on_object"] == 1
    assert {(row["top_patch"], row["split"], row["scenes"]) for row in rows} == {(0.03, "val", 1)}
    table = crop_search.described(rows).splitlines()
    assert table[1 + crop_search.CROPS.index((0.03, 2))].split() == ["30", "15", *(len(rows) * ["100", "(100)"])]


def test_a_crop_search_refuses_no_episodes(tmp_path):
    with pytest.raises(ValueError, match="episodes must be at least 1, got 0"):
        crop_search.measure(0, "real-table", None, tmp_path / "rows.jsonl")


def test_picks_of_withheld_and_of_kept_parts_are_counted_apart(model, tmp_path, monkeypatch):
    path = tmp_path / "policy.safetensors"
    facts = {"task": withheld_picks.TASK, "demos": 5, "seed": 3, "demonstrations_world": "real-table"}
    checkpoints.save_policy(Gem(SMALL, model, seed=3), path, facts)
    sentences = ["pick the mug brim and place into brown box", "pick the mug handle and place into brown box"]
    rewards = [0.05, 0.0]

    def turns(*_):
        for sentence, reward in zip(sentences, rewards, strict=True):
            yield SimpleNamespace(instruction=sentence, result=SimpleNamespace(reward=reward))

    monkeypatch.setattr(withheld_picks, "rollout", turns)
    monkeypatch.setattr(Measurement, "actor", lambda *_: None)
    rows_path = tmp_path / "rows.jsonl"
    row = withheld_picks.measure(path, "words", None, "real-table", 2, rows_path)
    assert withheld.WORDS.names("mug", "brim") and not withheld.WORDS.names("mug", "handle")
    assert (row["withheld"]["mean"], row["kept"]["mean"]) == (100.0, 0.0)
    assert row["withheld"]["rewards"] == [1.0, 1.0]
    assert results.read_rows(rows_path) == [json.loads(json.dumps(row))]
    off = {**row, "method": "gem-without-image-map", "withheld": row["kept"], "seed": 0}
    one = {**row, "demos": 1}
    assert "minus" not in withheld_picks.described([off, one]), "other demonstrations are no rival"
    *_, difference, kept = withheld_picks.described([row, off, one]).splitlines()
    assert difference.startswith("gem minus gem-without-image-map, 5 demonstrations, withheld parts: +100.0 [")
    assert kept.startswith("gem minus gem-without-image-map, 5 demonstrations, kept parts: +0.0 [")


def test_a_list_without_parts_is_refused(tmp_path):
    with pytest.raises(ValueError, match="withheld must be one of pairs, words, got 'nothing'"):
        withheld_picks.measure(tmp_path / "a.safetensors", "nothing", None, "real-table", 1, tmp_path / "rows.jsonl")


def test_a_sentence_without_a_part_is_refused():
    with pytest.raises(ValueError, match="must name a part of an object, got 'put the red block in the blue bowl'"):
        withheld_picks.is_withheld("put the red block in the blue bowl", withheld.WORDS)
