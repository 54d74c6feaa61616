import csv
import json
import os
import pickle
import re
import shutil
import types
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
import torch
import transformers
from PIL import Image
from transformers import CLIPConfig, CLIPModel

from experiments.clip_tabletop import pretrain
from gem_lite import clip
from gem_lite.clip import calibration
from gem_lite.evaluation import calibrating
from gem_lite.foundations import colors
from gem_lite.maps import patches, semantic_map


def test_embeddings_are_unit_length_and_deterministic_every_word_counts_and_wrong_input_is_named(model):
    texts = model.embed_texts(["red block", "red bowl", "blue block", "red block", "Zürich 東京 🤖 zzyzx"])
    assert texts.shape == (5, model.dim) and torch.equal(texts[0], texts[3])
    images = model.embed_images(np.zeros((2, 40, 40, 3), np.uint8))
    for vectors in (texts, images):
        assert torch.allclose(vectors.norm(dim=1), torch.ones(len(vectors)), atol=1e-5)
    # A text tower that ignored the shape (or colour) word would give cosine 1 here.
    assert texts[0] @ texts[1] < 0.9 and texts[0] @ texts[2] < 0.9
    for images in (np.zeros((2, 40, 40, 3), np.float32), np.zeros((40, 40, 3), np.uint8)):
        with pytest.raises(ValueError, match="images"):
            model.embed_images(images)
    with pytest.raises(ValueError, match="phrases"):
        model.embed_texts(["red block", " "])
    words = " ".join(["red block"] * 15)
    assert model.embed_texts([words]).shape == (1, model.dim), "32 tokens with those of beginning and end"
    with pytest.raises(ValueError, match=r"at most 32 tokens .* got 33"):
        model.embed_texts(["bowl", f"{words} bowl"])


def test_text_is_pooled_at_the_end_token(model):
    # The trap: with eos_token_id 2, transformers pools at argmax(input_ids), some other word.
    assert model._model.config.text_config.eos_token_id == pretrain.EOS != 2
    tokens = model.tokenizer(["red block", "a picture of the purple letter R shape"], padding=True, return_tensors="pt")
    output = model._model.text_model(**{k: tokens[k] for k in ("input_ids", "attention_mask")})
    for row, (ids, pooled) in enumerate(zip(tokens["input_ids"], output.pooler_output, strict=True)):
        end = (ids == pretrain.EOS).nonzero()[0, 0]
        assert torch.allclose(pooled, output.last_hidden_state[row, end])


def test_a_copy_of_a_model_that_knows_many_phrases_is_small(model):
    phrases = [
        f"{color} {noun} {number}" for color in ("red", "blue") for noun in ("block", "bowl") for number in range(50)
    ]
    before = len(pickle.dumps(model))
    model.embed_texts(phrases)
    model.embed_known_images(np.random.default_rng(0).integers(0, 256, (200, 8, 8, 3), np.uint8))
    assert len(pickle.dumps(model)) - before < 400 * (4 * model.dim + 1000), "each is kept with its whole batch"


def test_pictures_that_were_embedded_before_are_looked_up(model, monkeypatch):
    rng = np.random.default_rng(0)
    first = rng.integers(0, 256, (3, 20, 20, 3), np.uint8)
    second = np.concatenate([first[1:2], rng.integers(0, 256, (2, 20, 20, 3), np.uint8)])
    asked = []
    embed_images = model.embed_images
    monkeypatch.setattr(model, "embed_images", lambda images: asked.append(len(images)) or embed_images(images))
    known = [model.embed_known_images(first), model.embed_known_images(second), model.embed_known_images(first)]
    assert asked == [3, 2]
    assert torch.equal(known[0], known[2]) and torch.equal(known[1][0], known[0][1])
    assert torch.allclose(known[1], embed_images(second), atol=1e-5)
    monkeypatch.setattr(clip, "REMEMBERED", 2)
    model.embed_known_images(second)
    model.embed_known_images(first)
    assert asked == [3, 2, 3] and len(model._pictures) == 2


def test_paraphrases_find_their_crop_and_strangers_none(model):
    for color in colors.UNSEEN:
        plain, reworded, bowl = model.embed_texts([f"{color} block", f"the {color} blocks", f"{color} bowl"])
        assert plain @ reworded > model.calibration.retrieval_threshold > plain @ bowl
    # 161 pairs of phrases that the calibration of the threshold did not use.
    rows = list(csv.DictReader((clip.DATA / "phrase_pairs.csv").open()))
    calibrated = {(plain, words) for plain, more in calibrating.retrieval_phrases() for words in more}
    assert not calibrated & {(row["stored"], row["query"]) for row in rows}
    same = np.array([row["same"] == "1" for row in rows])
    stored, asked = (model.embed_texts([row[key] for row in rows]) for key in ("stored", "query"))
    found = (stored * asked).sum(dim=1).numpy() >= model.calibration.retrieval_threshold
    assert 60 <= same.sum() <= len(rows) - 60
    assert (found & same).sum() / found.sum() >= 0.95  # precision
    assert (found & same).sum() / same.sum() >= 0.95  # recall


def test_folding_the_batch_norms_changes_nothing(model):
    plain = transformers.AutoModel.from_pretrained(clip.EMBEDDED, dtype=torch.float32).eval()
    pictures = np.random.default_rng(0).integers(0, 255, (4, 40, 40, 3), dtype=np.uint8)
    with torch.inference_mode():
        expected = clip.unit(plain.get_image_features(pixel_values=model._pixels(torch.from_numpy(pictures))))
    assert torch.allclose(model.embed_images(pictures), expected, atol=1e-5)
    assert not any(isinstance(layer, torch.nn.BatchNorm2d) for layer in model._model.modules())
    assert any(isinstance(layer, torch.nn.BatchNorm2d) for layer in plain.modules())


def small_clip(folder, **preprocessing):
    """A folder with a copy of the embedded CLIP, and with changes of its preprocessing; None takes an entry away."""
    shutil.copytree(clip.EMBEDDED, folder)
    path = folder / "preprocessor_config.json"
    entries = {**json.loads(path.read_text()), **preprocessing}
    path.write_text(json.dumps({key: value for key, value in entries.items() if value is not None}))
    return folder


def without(*pattern):
    """Damages a folder: it takes files away."""
    return lambda folder: [path.unlink() for part in pattern for path in folder.glob(part)]


def cut_weights(folder):
    os.truncate(folder / "model.safetensors", 2_000_000)


def take_a_weight(folder):
    tensors = safetensors.torch.load((folder / "model.safetensors").read_bytes())
    del tensors["visual_projection.weight"]
    safetensors.torch.save_file(tensors, folder / "model.safetensors", {"format": "pt"})


@pytest.mark.parametrize(
    ("damage", "preprocessing", "message"),
    [
        (without("config*"), {}, "has no configuration: .* is missing"),
        (without("model*"), {}, "has no weights: .* is missing"),
        (cut_weights, {}, "weights in the CLIP folder .* are cut off or damaged"),
        (take_a_weight, {}, r"lack 1 tensors, such as visual_projection\.weight"),
        *((without(), {name: value}, f"{name}.* got ") for name, value in (
            ("image_mean", None), ("image_std", [0.5]), ("size", None), ("resample", 0))),
    ],
)  # fmt: skip
def test_a_damaged_folder_is_refused_in_a_sentence(damage, preprocessing, message, tmp_path):
    folder = small_clip(tmp_path / "clip", **preprocessing)
    damage(folder)
    with pytest.raises(OSError, match=message) as error:
        clip.load(folder)
    assert len(str(error.value).splitlines()) == 1


def test_the_environment_names_a_clip_and_an_unreachable_one_says_what_to_do(monkeypatch):
    monkeypatch.setenv(clip.ENVIRONMENT_VARIABLE, "nobody/no-such-clip")
    with pytest.raises(OSError, match=r"nobody/no-such-clip[^$]*unset GEM_LITE_CLIP") as error:
        clip.load()
    assert len(str(error.value).splitlines()) == 2


def test_the_fingerprint_covers_an_unusual_preprocessing(tmp_path, model):
    assert model.fingerprint == json.loads((clip.DATA / "gem-multi.json").read_text())["clip"]["fingerprint"]
    changes = ({}, {"image_mean": [0.4] * 3}, {"size": {"height": 32, "width": 32}}, {"resample": 2})
    found = [clip.load(small_clip(tmp_path / str(i), **change)) for i, change in enumerate(changes)]
    assert found[0].fingerprint == model.fingerprint, "a copy in another folder"
    assert len({one.fingerprint for one in found}) == len(changes)
    picture = np.random.default_rng(0).integers(0, 255, (1, 20, 20, 3), np.uint8)
    plain = found[0].embed_images(picture)[0]
    assert all(float(plain @ one.embed_images(picture)[0]) < 0.9999 for one in found[1:])


def test_threads_that_share_a_small_memory_find_their_pictures(model, monkeypatch):
    monkeypatch.setattr(clip, "REMEMBERED", 3)
    monkeypatch.setattr(model, "embed_images", lambda images: torch.from_numpy(images[:, 0, 0, :1].astype(np.float32)))

    def ask(seed):
        rng = np.random.default_rng(seed)
        for _ in range(300):
            values = rng.integers(0, 6, 5)
            pictures = np.broadcast_to(values[:, None, None, None], (5, 4, 5, 3)).astype(np.uint8)
            assert model.embed_known_images(pictures)[:, 0].tolist() == values.tolist()

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(ask, range(8)))
    assert len(model._pictures) <= 3 + 8 * 5


MEAN, STD = [0.48145466, 0.4578275, 0.40821073], [0.26862954, 0.26130258, 0.27577711]
"""Of the pictures of OpenAI's CLIP."""


def test_a_clip_model_in_openais_own_format_loads_through_the_same_path(tmp_path, model):
    """Random weights in half precision; the tokenizer is the embedded model's."""
    tower = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2}
    text = {"vocab_size": 2000, "eos_token_id": pretrain.EOS, "max_position_embeddings": 32}
    vision = {"image_size": 64, "patch_size": 16}
    config = CLIPConfig(text_config=tower | text, vision_config=tower | vision, projection_dim=24)
    CLIPModel(config).half().save_pretrained(tmp_path)
    for name in ("tokenizer.json", "tokenizer_config.json"):
        shutil.copy(clip.EMBEDDED / name, tmp_path)
    preprocessing = {"size": {"shortest_edge": 64}, "crop_size": 64, "image_mean": MEAN, "image_std": STD}
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(preprocessing))
    real = clip.load(tmp_path)
    assert (real.dim, real.name) == (24, str(tmp_path))
    assert next(real._model.parameters()).dtype == torch.float32
    assert real.embed_images(np.zeros((3, 40, 40, 3), np.uint8)).shape == (3, 24)
    assert real.embed_texts(["red block"]).shape == (1, 24)
    assert real.fingerprint != model.fingerprint
    assert calibration.path_for(real) != calibration.path_for(model)
    with pytest.raises(FileNotFoundError, match=re.escape(f"gem-lite clip calibrate {tmp_path}")):
        _ = real.calibration
    # Pictures as OpenAI prepares them. Away from 0 and 255: PIL clips between its two passes, where we clip once.
    picture = np.random.default_rng(0).integers(90, 160, (1, 40, 40, 3), dtype=np.uint8)
    resized = np.asarray(Image.fromarray(picture[0]).resize((64, 64), Image.BICUBIC)) / 255
    pixels = real._pixels(torch.from_numpy(picture))[0].permute(1, 2, 0).numpy()
    assert np.abs(pixels - (resized - MEAN) / STD).max() < 0.03  # PIL rounds to bytes
    # Dense: cells row by row, each most of all about what lies in it.
    picture = np.full((80, 160, 3), 90, np.uint8)
    plain = real.embed_dense(picture, 40)
    assert plain.shape == (24, 8, 16)
    assert torch.allclose(plain.norm(dim=0), torch.ones(8, 16), atol=1e-5)
    picture[20:30, 110:120] = (255, 0, 0)
    change = (real.embed_dense(picture, 40) - plain).norm(dim=0)
    assert divmod(int(change.argmax()), 16) == (2, 11)
    embeddings = patches.embed_patches(picture, patches.PatchGrid((80, 160), 40, 40), real)
    scores = embeddings.score(semantic_map.embed_phrase("red block", real))
    assert scores.shape == (80, 160) and scores.std() > 0


def test_in_half_precision_the_embeddings_are_nearly_the_same_float32():
    half, whole = clip.load().to("cpu", torch.bfloat16), clip.load()
    pictures = np.random.default_rng(0).integers(0, 255, (8, 40, 40, 3), dtype=np.uint8)
    for method, values in (
        ("embed_images", pictures),
        ("embed_texts", ["red block"]),
        ("embed_known_images", pictures),
    ):
        found, expected = (getattr(model, method)(values) for model in (half, whole))
        assert found.dtype == torch.float32
        assert (found * expected).sum(dim=1).min() > 0.999, method
    picture = np.random.default_rng(0).integers(0, 255, (80, 120, 3), dtype=np.uint8)
    found, expected = (model.embed_positions(picture, 40) for model in (half, whole))
    assert found.dtype == torch.float32 and (found * expected).sum(dim=0).min() > 0.99
    with pytest.raises(ValueError, match=r"dtype must be one of .*float32, .*float16, .*bfloat16, got .*int8"):
        half.to("cpu", torch.int8)
    assert half.to("cpu").embed_images(pictures).dtype == torch.float32 and half._model.dtype == torch.bfloat16


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_gives_the_same_embeddings():
    there, here = clip.load().to("cuda"), clip.load()
    pictures = np.random.default_rng(0).integers(0, 255, (8, 40, 40, 3), dtype=np.uint8)
    assert torch.allclose(there.embed_images(pictures).cpu(), here.embed_images(pictures), atol=1e-3)
    assert torch.allclose(there.embed_texts(["red block"]).cpu(), here.embed_texts(["red block"]), atol=1e-3)


def test_an_empty_cache_variable_counts_as_none(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    some = types.SimpleNamespace(folder=None, fingerprint="abc")
    assert calibration.path_for(some) == Path.home() / ".cache" / "gem_lite" / "calibration-abc.json"
