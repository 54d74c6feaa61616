"""Dense maps: one pass of the image tower for each view."""

import json
import re
import shutil

import numpy as np
import pytest
import torch
from transformers import CLIPConfig, CLIPModel

from experiments.clip_tabletop import pretrain
from gem_lite import clip, tasks
from gem_lite.language import ImageQuery
from gem_lite.maps import crop_memory, dense, patches, semantic_map
from gem_lite.maps.dense import PositionEmbeddings
from gem_lite.maps.sources import SOURCES
from gem_lite.policies.gem_config import LITE


@pytest.fixture(scope="module")
def scene_and_truth(model, world):
    task = tasks.make("put-block-in-bowl-unseen-colors", "val")
    (observation,) = world.reset(task, tasks.episode_seed("val", 50))
    return observation.views, task, task.expert(world).action


@pytest.fixture(scope="module")
def transformer(tmp_path_factory):
    """A CLIP of transformers' own class with random weights and the embedded model's tokenizer."""
    folder = tmp_path_factory.mktemp("vit")
    tower = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2}
    text = {"vocab_size": 2000, "eos_token_id": pretrain.EOS, "max_position_embeddings": 32}
    config = CLIPConfig(
        text_config=tower | text, vision_config=tower | {"image_size": 64, "patch_size": 16}, projection_dim=24
    )
    torch.manual_seed(0)
    CLIPModel(config).save_pretrained(folder)
    for name in ("tokenizer.json", "tokenizer_config.json"):
        shutil.copy(clip.EMBEDDED / name, folder)
    preprocessing = {"size": 64, "image_mean": [0.5] * 3, "image_std": [0.5] * 3}
    (folder / "preprocessor_config.json").write_text(json.dumps(preprocessing))
    return clip.load(folder)


def test_a_position_resembles_the_patch_around_it_where_something_lies(scene_and_truth, model):
    view = scene_and_truth[0][0]
    positions = model.embed_positions(view.rgb, 20)  # one every 8 pixels
    assert torch.allclose(positions.norm(dim=0), torch.ones(positions.shape[1:]), atol=1e-5)
    cosines = []
    for i in range(10, 50, 2):
        for j in range(10, 70, 2):
            row, col = 8 * i + 4, 8 * j + 4
            patch = view.rgb[row - 10 : row + 10, col - 10 : col + 10]
            if patch.std(axis=(0, 1)).max() > 40:
                cosines.append(float(positions[:, i, j] @ model.embed_images(patch[None].copy())[0]))
    assert len(cosines) > 20 and np.median(cosines) > 0.75


def test_the_map_points_at_the_named_things_by_a_text_and_by_a_picture(scene_and_truth, model):
    views, task, action = scene_and_truth
    source = SOURCES.find("dense")(model, LITE)
    scene = source.embed(views)
    block, bowl = task.named_colors
    crop = ImageQuery(crop_memory.cut(scene.heightmap, action.place, LITE.top_patch).copy())
    for query, pose in ((f"{block} blocks", action.pick), (f"{bowl} bowl", action.place), (crop, action.place)):
        made = source.map(scene, query)
        assert made.shape == LITE.workspace.shape and made.dtype == np.float32
        assert made[LITE.workspace.nearest_cell(pose.x, pose.y)] > 0.5
        assert np.median(made) < 0.3


def test_it_is_like_the_map_of_patches(scene_and_truth, model):
    views, task, _ = scene_and_truth
    source = SOURCES.find("dense")(model, LITE)
    phrase = f"{task.named_colors[1]} bowl"
    by_patches = semantic_map.text_conditioned_map(semantic_map.embed_scene(views, model, LITE), phrase, model)
    made = source.map(source.embed(views), phrase)
    assert np.corrcoef(made.ravel(), by_patches.ravel())[0, 1] > 0.8


def test_scores_lie_where_their_positions_lie():
    values = torch.zeros(2, 3, 4)
    values[0, 1, 2] = 1
    scores = PositionEmbeddings(values, (40, 50), slice(5, 35), slice(0, 40)).score(torch.tensor([1.0, 0.0]))
    assert scores.shape == (40, 50) and scores.dtype == np.float32
    assert scores[20, 25] > 0.9 and scores.max() == pytest.approx(scores[18:22, 23:27].max())
    assert scores[:, :10].max() == scores[:5].max() == scores[35:].max() == scores[:, 40:].max() == 0


@pytest.mark.parametrize("size", [(64, 96), (70, 100)])
def test_a_transformer_has_a_position_for_each_token_and_keeps_its_own_values(transformer, size):
    picture = np.full((*size, 3), 90, np.uint8)
    plain = transformer.embed_positions(picture, 20)
    assert plain.shape == (24, 4, 6)
    picture[34:46, 66:78] = (255, 0, 0)
    change = (transformer.embed_positions(picture, 20) - plain).norm(dim=0)
    assert divmod(int(change.argmax()), 6) == (2, 4)


def test_a_transformers_position_is_its_values_projected(transformer):
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    network = transformer._model
    pixels = transformer._pixels(torch.from_numpy(picture)[None])
    with torch.inference_mode():
        before = network.vision_model(pixel_values=pixels, output_hidden_states=True).hidden_states[-2]
        last = network.vision_model.encoder.layers[-1]
        attention = last.self_attn
        tokens = last.layer_norm1(before)[0, 1:]
        values = tokens @ attention.v_proj.weight.T + attention.v_proj.bias
        by_hand = network.visual_projection(network.vision_model.post_layernorm(attention.out_proj(values)))
    by_hand = torch.nn.functional.normalize(by_hand, dim=-1)
    assert torch.allclose(transformer.embed_positions(picture, 20).flatten(1).T, by_hand, atol=1e-5)


def test_a_clip_without_a_calibration_names_the_command(transformer, scene_and_truth):
    source = SOURCES.find("dense")(transformer, LITE)
    scene = source.embed(scene_and_truth[0])
    with pytest.raises(FileNotFoundError, match=re.escape(f"gem-lite clip calibrate {transformer.folder}")):
        source.map(scene, "red block")


def test_what_lies_outside_the_workspace_gets_the_tables_color_or_is_cut_off(scene_and_truth, model):
    view = scene_and_truth[0][1]
    inside = np.zeros(view.rgb.shape[:2], bool)
    inside[200:300, 200:300] = True
    inside[280:300, 300:400] = True
    embedded = dense.embed_view(view, inside, model, LITE)
    painted = patches.paint_outside(view.rgb, inside)[200:300, 200:400]
    assert torch.allclose(embedded.values, model.embed_positions(painted, 20), atol=1e-5)
    assert (embedded.shape, embedded.rows, embedded.cols) == ((480, 640), slice(200, 300), slice(200, 400))
    nothing = dense.embed_view(view, np.zeros_like(inside), model, LITE)
    assert (nothing.rows, nothing.cols) == (slice(0, 480), slice(0, 640))
