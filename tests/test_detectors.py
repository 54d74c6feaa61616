"""Maps from object detectors. The models are tiny and random: the tests are about boxes, pixels and errors."""

import dataclasses
import shutil

import numpy as np
import pytest
import small_detectors
import torch

from gem_lite import clip, tasks
from gem_lite.clip import loading
from gem_lite.language import ImageQuery
from gem_lite.maps import detectors
from gem_lite.maps.query_maps import query_maps
from gem_lite.maps.sources import SOURCES
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.camera import Camera, View

KINDS = {"owlvit": "owl-vit", "owlv2": "owl-vit", "grounding-dino": "grounding-dino"}
"""The source of each kind of model."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """The folder of each kind of model. Copy one before damaging it."""
    root = tmp_path_factory.mktemp("detectors")
    return {
        "owlvit": small_detectors.save_owl(root / "owlvit", "owlvit"),
        "owlv2": small_detectors.save_owl(root / "owlv2", "owlv2"),
        "grounding-dino": small_detectors.save_grounding_dino(root / "grounding-dino"),
    }


@pytest.fixture(scope="module")
def found(folders, model):
    """The source of each kind of model."""
    return {kind: make(name, folders[kind], model) for kind, name in KINDS.items()}


@pytest.fixture(scope="module")
def views(world):
    task = tasks.make("put-block-in-bowl-seen-colors", "val")
    return world.reset(task, tasks.episode_seed("val", 3))[0].views


def make(name, folder, model):
    return SOURCES.find(name)(model, dataclasses.replace(LITE, semantic_map=name, detector=str(folder)))


def noise(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8)


def view_of(picture):
    camera = Camera.pinhole("small", (0, 0, 1), (1, 0, 0, 0), picture.shape[:2])
    return View(camera, picture, np.ones(picture.shape[:2], np.float32))


def whole_model(source, picture, query):
    """(logits, boxes) of a picture as the model itself gives them, with the inputs of its own processor."""
    detector = source.detector
    pixels = detector.prepared(picture)
    with torch.inference_mode():
        if isinstance(query, ImageQuery):
            asked = detector.prepared(query.picture)["pixel_values"]
            outputs = detector.model.image_guided_detection(pixels["pixel_values"], asked)
            return outputs.logits, outputs.target_pred_boxes
        outputs = detector.model(**pixels, **detector.tokenizer(query, return_tensors="pt"))
        return outputs.logits, outputs.pred_boxes


@pytest.mark.parametrize("kind", KINDS)
def test_a_map_has_the_tables_shape_and_the_values_of_boxes(kind, found, views):
    source = found[kind]
    scene = source.embed(views)
    semantic = source.map(scene, "red")
    assert semantic.shape == LITE.workspace.shape and semantic.dtype == np.float32
    assert semantic.min() >= 0 and 0.5 < semantic.max() <= 1
    assert len(np.unique(semantic)) > 5
    sides = [source.score_view(side, "red") for side in scene.sides]
    assert np.array_equal(semantic, scene.fuse(sides))
    for side, view in zip(sides, views, strict=True):
        assert side.shape == view.rgb.shape[:2] and not ((side > 0) & (side < detectors.AT_THRESHOLD)).any()
    one = source.embed(views[:1])
    assert np.array_equal(source.map(one, "red"), one.fuse(sides[:1])), "a view's boxes know no other view"
    assert np.array_equal(source.map(scene, "red"), semantic)
    assert not np.array_equal(source.map(scene, "blue"), semantic)
    assert not any(parameter.requires_grad for parameter in source.detector.model.parameters())
    assert not source.detector.model.training


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(61, 83), (83, 61)])
def test_a_picture_of_any_size_gets_the_boxes_of_the_whole_model(kind, size, found):
    source = found[kind]
    picture = noise(*size)
    queries = ["red"] if kind == "grounding-dino" else ["red", ImageQuery(noise(20, 30, 1))]
    for query in queries:
        text = f"{query}." if kind == "grounding-dino" else query
        logits, boxes = whole_model(source, picture, text)
        scores = torch.sigmoid(logits.amax(dim=-1))[0].numpy()
        middles, sizes = boxes[0, :, :2].numpy(), boxes[0, :, 2:].numpy()
        # OWLv2 pads a picture to a square at the right and below; the others keep its corners in the corners.
        scale = max(size) if kind == "owlv2" else np.array(size[::-1])
        corners = np.hstack([(middles - sizes / 2) * scale, (middles + sizes / 2) * scale])
        expected = np.zeros(size)
        for box, score in zip(corners, scores, strict=True):
            for row in range(size[0]) if score > 0.1 else ():
                for col in range(size[1]):
                    if box[0] <= col + 0.5 < box[2] and box[1] <= row + 0.5 < box[3]:
                        expected[row, col] = max(expected[row, col], 1 + 0.5 * np.log10(score))
        got = source.score_view(source.embed_view(view_of(picture), np.ones(size, bool)), query)
        # A side within float32's last bits of a pixel's centre may fall on either side of it.
        assert got.shape == size and np.mean(np.abs(got - expected) > 1e-4) < 0.02
        assert (expected > 0).any()


@pytest.mark.parametrize("kind", KINDS)
def test_no_box_above_the_threshold_gives_zeros(kind, found, views, monkeypatch):
    monkeypatch.setattr(detectors, "THRESHOLD", 1.0)
    source = found[kind]
    assert not source.map(source.embed(views), "red").any()


def test_boxes_become_pixels():
    boxes = np.array([
        [1.5, 0.5, 3.5, 2.5],  # The centre of column 1 lies on the left side: inside. That of column 3: outside.
        [1.51, 0.0, 2.49, 9.0],  # no centre of a column
        [-5.0, 3.2, 1.0, 99.0],  # leaves the picture at the left and below
        [2.0, 1.0, 4.0, 2.0],  # overlaps the first
        [7.0, -3.0, 9.0, -1.0],  # outside
    ])  # fmt: skip
    expected = [
        [0, 0.6, 0.6, 0, 0],
        [0, 0.6, 0.9, 0.9, 0],
        [0, 0, 0, 0, 0],
        [0.7, 0, 0, 0, 0],
    ]
    for values in ([0.6, 1.0, 0.7, 0.9, 0.8], [0.6, 1.0, 0.7, 0.5, 0.8]):
        wanted = np.array(expected)
        if values[3] < values[0]:
            wanted[1, 2:4] = 0.6, 0.5
        got = detectors.filled(boxes, np.array(values), (4, 5))
        assert got.dtype == np.float32 and np.allclose(got, wanted)
    for order in ([3, 0, 4, 2, 1], [1, 2, 3, 4, 0]):
        assert np.allclose(detectors.filled(boxes[order], np.array(values)[order], (4, 5)), wanted)
    assert not detectors.filled(np.zeros((0, 4)), np.zeros(0), (2, 3)).any()


def test_a_source_fills_the_boxes_that_its_detector_finds(found, monkeypatch):
    source = found["owlvit"]
    boxes = torch.tensor([[[0.25, 0.5, 0.5, 1.0], [0.5, 0.25, 1.0, 0.5], [0.5, 0.5, 1.0, 1.0]]])  # middle, size
    logits = torch.logit(torch.tensor([[[0.3], [0.5], [0.1]]]))
    monkeypatch.setattr(source, "detect", lambda embedded, asked: (logits, boxes))
    seen = detectors.SeenView((6, 8), {})
    expected = np.zeros((6, 8))
    expected[:, :4] = detectors.calibrated(np.array(0.3))
    expected[:3] = detectors.calibrated(np.array(0.5))
    assert np.allclose(source.score_view(seen, "red"), expected, atol=1e-6)


def test_scores_come_to_the_scale_of_maps():
    got = detectors.calibrated(np.array([0.0, 0.05, 0.1, 0.1001, 0.2, 0.4, 1.0, 1.0000001]))
    assert not got[:3].any() and got[3] == pytest.approx(0.5, abs=1e-3)
    assert np.diff(got[3:6]) == pytest.approx(0.1505, abs=1e-3) and np.allclose(got[6:], 1)
    assert (np.diff(got) >= 0).all() and got.max() <= 1


def test_a_picture_is_a_query_of_owl_vit_alone(found, views):
    for kind in ("owlvit", "owlv2"):
        source = found[kind]
        scene = source.embed(views)
        one, other = (source.map(scene, ImageQuery(noise(20, 30, seed))) for seed in (1, 2))
        assert one.shape == LITE.workspace.shape and 0.5 < one.max() <= 1
        assert not np.array_equal(one, other)
        query = ImageQuery(noise(20, 20), "this block")
        maps = query_maps(source, scene, query, source.config)
        assert maps.image is not None, "CLIP compares the picture with the height map's patches, as always"
        assert np.array_equal(maps.text, source.map(scene, query))
    source = found["grounding-dino"]
    with pytest.raises(ValueError, match="Grounding DINO finds phrases only, got this block"):
        source.map(source.embed(views), ImageQuery(noise(20, 20), "this block"))


def test_a_picture_without_any_thing_is_refused(found, monkeypatch):
    source = found["owlvit"]
    monkeypatch.setattr(source.detector.model, "embed_image_query", lambda *_: (None, None, None))
    with pytest.raises(ValueError, match="finds no thing in the picture of this block"):
        source.ask(ImageQuery(noise(20, 20), "this block"))


@pytest.mark.parametrize(("kind", "longest"), [("owlvit", 8), ("owlv2", 8), ("grounding-dino", 32)])
def test_phrases_that_the_model_cannot_read_are_refused(kind, longest, found):
    source = found[kind]
    added = 3 if kind == "grounding-dino" else 2  # beginning and end, and a full stop
    source.ask("a" * (longest - added))
    with pytest.raises(ValueError, match=f"at most {longest} tokens for the detector .*, got {longest + 1}: 'aaa"):
        source.ask("a" * (longest - added + 1))
    for empty in ("", " ", *([" . "] if kind == "grounding-dino" else [])):
        with pytest.raises(ValueError, match="must not be empty"):
            source.ask(empty)


def test_a_source_without_its_detector_names_the_entry(folders, model):
    for name, allowed in (("owl-vit", "OWL-ViT or OWLv2"), ("grounding-dino", "Grounding DINO")):
        with pytest.raises(ValueError, match=f"detector must be the Hugging Face name or .* of {allowed}, got ''"):
            make(name, "", model)
    with pytest.raises(
        OSError, match=r"could not be read: detector must be a model of OWL-ViT or OWLv2, got .* 'ground"
    ):
        make("owl-vit", folders["grounding-dino"], model)
    with pytest.raises(OSError, match=r"detector must be a model of Grounding DINO, got .* of the kind 'owlv2'"):
        make("grounding-dino", folders["owlv2"], model)
    with pytest.raises(OSError, match=r"detector must be a model of OWL-ViT or OWLv2, got .*"):
        make("owl-vit", clip.EMBEDDED, model)


def test_a_name_that_is_nowhere_is_one_sentence(model, capsys):
    with pytest.raises(
        OSError, match=r"the detector 'nobody/no-detector' could not be loaded: no such folder.*"
    ) as raised:
        make("owl-vit", "nobody/no-detector", model)
    assert "\n" not in str(raised.value)
    assert capsys.readouterr().out.startswith("nobody/no-detector is not on this machine; asking Hugging Face")


def test_a_name_is_read_from_this_machine_first(folders, model, monkeypatch, capsys):
    asked = []

    def offline_first(name, read):
        asked.append(name)
        return read(True)

    monkeypatch.setattr(loading, "offline_first", offline_first)
    monkeypatch.setattr(detectors.Path, "is_dir", lambda self: False)
    source = make("owl-vit", folders["owlvit"], model)
    assert asked == [str(folders["owlvit"])] and capsys.readouterr().out == ""
    assert source.detector.longest == small_detectors.LONGEST


def damage_config(folder):
    (folder / "config.json").write_text("{")


def damage_weights(folder):
    path = folder / "model.safetensors"
    path.write_bytes(path.read_bytes()[:500])


def other_class(folder):
    """A model without the heads that detect."""
    import transformers

    transformers.OwlViTModel.from_pretrained(folder).save_pretrained(folder)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (damage_config, "could not be read: "),
        (damage_weights, "the weights in the detector folder .* are cut off or damaged"),
        (other_class, "the detector.s weights lack [0-9]+ tensors, such as "),
        (lambda folder: (folder / "config.json").unlink(), "has no configuration: config.json is missing"),
        (lambda folder: (folder / "model.safetensors").unlink(), "has no weights"),
        (lambda folder: (folder / "tokenizer.json").unlink(), "has no tokenizer"),
        (lambda folder: (folder / "preprocessor_config.json").unlink(), "has no preprocessing"),
    ],
)
def test_a_damaged_folder_is_one_sentence(damage, sentence, folders, model, tmp_path):
    folder = shutil.copytree(folders["owlvit"], tmp_path / "detector")
    damage(folder)
    with pytest.raises(OSError, match=sentence) as raised:
        make("owl-vit", folder, model)
    assert "detector folder" in str(raised.value) and "\n" not in str(raised.value)


def test_the_query_is_read_once_for_all_views(found, views, monkeypatch):
    source = found["owlv2"]
    scene = source.embed(views)
    honest, asked = type(source).ask, []
    monkeypatch.setattr(type(source), "ask", lambda self, query: asked.append(query) or honest(self, query))
    first = source.map(scene, "cup")
    assert asked == ["cup"] and len(views) == 3
    source.map(scene, "pan")
    assert np.array_equal(source.map(scene, "cup"), first) and asked == ["cup", "pan", "cup"]


def test_an_older_configuration_has_no_detector():
    assert "detector" not in LITE.as_dict() and LITE.detector == ""
    named = dataclasses.replace(LITE, semantic_map="owl-vit", detector="a/b")
    assert type(named).from_dict(named.as_dict()) == named and named.inputs.detector == "a/b"
    with pytest.raises(ValueError, match="detector must be a text, got None"):
        dataclasses.replace(LITE, detector=None)
