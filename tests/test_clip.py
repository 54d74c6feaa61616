import json
import shutil

import numpy as np
import pytest
import torch
from transformers import CLIPConfig, CLIPModel

from gem_lite import calibration, clip, colors, pretrain_clip, vocabulary


@pytest.fixture(scope="module")
def model():
    return clip.load()


def test_embeddings_are_unit_length_and_deterministic(model):
    texts = model.embed_texts(["red block", "green bowl", "red block"])
    assert texts.shape == (3, model.dim)
    assert torch.equal(texts[0], texts[2])
    images = model.embed_images(np.zeros((2, 40, 40, 3), np.uint8))
    assert torch.allclose(images.norm(dim=1), torch.ones(2), atol=1e-5)


def test_text_is_pooled_at_the_end_token(model):
    # The trap: with eos_token_id 2, transformers pools at argmax(input_ids), some other word.
    assert model._model.config.text_config.eos_token_id == pretrain_clip.EOS != 2
    tokens = model._tokenizer(
        ["red block", "a picture of the purple letter R shape"], padding=True, return_tensors="pt"
    )
    output = model._model.text_model(**{k: tokens[k] for k in ("input_ids", "attention_mask")})
    for row, (ids, pooled) in enumerate(zip(tokens["input_ids"], output.pooler_output, strict=True)):
        end = (ids == pretrain_clip.EOS).nonzero()[0, 0]
        assert torch.allclose(pooled, output.last_hidden_state[row, end])


def test_every_word_of_a_phrase_counts(model):
    # A text tower that ignored the shape (or colour) word would give cosine 1 here.
    a, shape, color = model.embed_texts(["red block", "red bowl", "blue block"])
    assert a @ shape < 0.9
    assert a @ color < 0.9


def test_any_text_is_accepted(model):
    assert torch.isfinite(model.embed_texts(["Zürich 東京 🤖 zzyzx"])).all()


def test_zero_shot_on_fresh_renders(model):
    # Seeds that neither training nor the card used. Colour is what the tasks rest on.
    found = pretrain_clip.accuracy(model, pretrain_clip.render_crops(6, seed=77))
    assert found["crops"] > 300
    assert found["color"] >= 97
    assert found["shape"] >= 40  # 25 names: chance is 4


def test_bad_images_and_phrases_are_named(model):
    with pytest.raises(ValueError, match="images"):
        model.embed_images(np.zeros((2, 40, 40, 3), np.float32))
    with pytest.raises(ValueError, match="images"):
        model.embed_images(np.zeros((40, 40, 3), np.uint8))
    with pytest.raises(ValueError, match="phrases"):
        model.embed_texts(["red block", " "])


def test_unreachable_name_says_what_to_do():
    with pytest.raises(OSError, match="unset GEM_LITE_CLIP") as error:
        clip.load("nobody/no-such-clip")
    assert len(str(error.value).splitlines()) == 2


def test_environment_variable_chooses(monkeypatch):
    monkeypatch.setenv(clip.ENVIRONMENT_VARIABLE, "nobody/no-such-clip")
    with pytest.raises(OSError, match="nobody/no-such-clip"):
        clip.load()


def test_a_real_clip_model_loads_through_the_same_path(tmp_path, model):
    # Random weights in CLIPModel's own format; the tokenizer is borrowed from the embedded model.
    config = CLIPConfig(
        text_config={"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2,
                     "vocab_size": 1000, "eos_token_id": pretrain_clip.EOS, "max_position_embeddings": 32},
        vision_config={"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2,
                       "image_size": 64, "patch_size": 16},
        projection_dim=24,
    )  # fmt: skip
    CLIPModel(config).save_pretrained(tmp_path)
    for name in ("tokenizer.json", "tokenizer_config.json"):
        shutil.copy(clip.EMBEDDED / name, tmp_path)
    preprocessing = {"size": {"shortest_edge": 64}, "crop_size": 64, "image_mean": [0.45] * 3, "image_std": [0.27] * 3}
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(preprocessing))
    real = clip.load(tmp_path)
    assert real.dim == 24
    assert real.name == str(tmp_path)
    assert real.embed_images(np.zeros((3, 40, 40, 3), np.uint8)).shape == (3, 24)
    assert real.embed_texts(["red block"]).shape == (1, 24)
    assert real.fingerprint != model.fingerprint
    assert calibration.path_for(real) != calibration.path_for(model)


def test_stored_calibration_is_what_calibrate_measures(model):
    measured, stored = calibration.calibrate(model), model.calibration
    for name, value in vars(stored).items():
        assert getattr(measured, name) == pytest.approx(value, abs=0.02), name


def test_threshold_parts_rewordings_from_other_things(model):
    threshold = model.calibration.retrieval_threshold
    for color in colors.UNSEEN:
        plain, reworded, bowl = model.embed_texts([f"{color} block", f"the {color} blocks", f"{color} bowl"])
        same, other = plain @ reworded, plain @ bowl
        assert same > threshold > other


def test_tokenizer_and_captions_are_seeded():
    first, again = (vocabulary.caption("red", "block", np.random.default_rng(5)) for _ in range(2))
    assert first == again
    assert vocabulary.plural("block") == "blocks"
    assert vocabulary.plural("cross") == "crosses"


def test_held_out_pairs_stay_out_of_training():
    rng = np.random.default_rng(0)
    drawn = {pretrain_clip._draw_pair(rng, held_out=False) for _ in range(5000)}
    assert not drawn & vocabulary.HELD_OUT
    assert len(drawn) > 200
    assert {pretrain_clip._draw_pair(rng, held_out=True) for _ in range(300)} & vocabulary.HELD_OUT
