"""A CLIP of the full size with random weights: loaded, calibrated, trained with and looked through.

`python -m experiments.full_size_clip` does the same by the commands, and plays an episode.
"""

import dataclasses
import shutil

import numpy as np
import pytest

from experiments.full_size_clip.__main__ import DEMOS, make_folder, tokenizer
from gem_lite import clip
from gem_lite.clip import calibration
from gem_lite.evaluation import calibrating
from gem_lite.maps.patches import PatchConfig
from gem_lite.policies import methods
from gem_lite.policies.checkpoints import load_policy, read_card
from gem_lite.rgbd.observation import Observation
from gem_lite.training.train import train_from_folder

pytestmark = pytest.mark.release

COARSE = PatchConfig(patch=120, stride=120, top_stride=0.125)
"""Few patches: each takes a tenth of a second."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A ViT-B/32 with random weights."""
    folder = tmp_path_factory.mktemp("vit-b-32")
    make_folder(folder)
    yield folder
    shutil.rmtree(folder)  # pytest would keep its 605 MB


def test_the_tokens_are_those_of_openais_clip():
    words = tokenizer()
    assert len(words) == 49_408
    # As in the readme of OpenAI's repository and the model's card.
    assert words("a diagram")["input_ids"] == [49406, 320, 22697, 49407]
    assert words("A photo of a cat")["input_ids"] == [49406, 320, 1125, 539, 320, 2368, 49407]


def test_it_is_loaded_calibrated_trained_with_and_looked_through(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    model = clip.load(folder)
    assert (model.parameter_count, model.dim, model.width, model.longest) == (151_277_313, 512, 768, 77)
    with pytest.raises(ValueError, match="a phrase may have at most 77 tokens"):
        model.embed_texts(["red " * 80])
    for kind in ("patches", "dense"):
        measured = calibrating.calibrate(model, calibrating.rendered_scenes(1), COARSE, kind)
        calibration.write(model, measured, kind)

    method, config = methods.find("gem")
    settings = dataclasses.replace(config, semantic_map="dense", steps=10, top_stride=COARSE.top_stride)
    checkpoint = tmp_path / "gem.safetensors"
    train_from_folder(DEMOS, checkpoint, method, settings, tmp_path / "state", episodes=1, clip_name=str(folder))
    assert read_card(checkpoint)["clip"]["fingerprint"] == model.fingerprint
    with pytest.raises(ValueError, match=r"CLIP"):
        load_policy(checkpoint, clip.load())

    policy = load_policy(checkpoint, model)
    views = Observation.load(clip.DATA / "foreign-scenes" / "workbench").views
    scene = policy.source.embed(views)
    maps = [policy.source.map(scene, phrase) for phrase in ("red block", "blue bowl")]
    assert all(found.shape == scene.heightmap.height.shape and np.isfinite(found).all() for found in maps)
    assert np.abs(maps[0] - maps[1]).max() > 0.01, "each phrase has a map of its own"
