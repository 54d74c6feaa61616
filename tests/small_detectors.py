"""Detectors of transformers' own classes, tiny and with random weights. No published weights have a part in them."""

import json

import torch
import transformers

LETTERS = "abcdefghijklmnopqrstuvwxyz"
IMAGE_SIDE = 48
"""OWL-ViT's and OWLv2's input (pixels): a view of 480 x 640 is squeezed, or padded, into it."""
LONGEST = 8
"""How many tokens OWL-ViT and OWLv2 read."""


def clip_tokenizer():
    """Reads words letter by letter."""
    tokens = ["!", *LETTERS, *(f"{letter}</w>" for letter in LETTERS), "<|startoftext|>", "<|endoftext|>"]
    vocabulary = {token: number for number, token in enumerate(tokens)}
    return transformers.CLIPTokenizer(vocab=vocabulary, merges=[], model_max_length=LONGEST, pad_token="!"), len(tokens)


def save_owl(folder, kind):
    """``kind``: "owlvit" or "owlv2"."""
    torch.manual_seed(0)
    tokenizer, count = clip_tokenizer()
    name = {"owlvit": "OwlViT", "owlv2": "Owlv2"}[kind]
    sizes = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2}
    ends = {"bos_token_id": count - 2, "eos_token_id": count - 1, "pad_token_id": 0}
    config = getattr(transformers, f"{name}Config")(
        text_config={**sizes, **ends, "vocab_size": count, "max_position_embeddings": LONGEST},
        vision_config={**sizes, "image_size": IMAGE_SIDE, "patch_size": 8},
        projection_dim=16,
    )
    model = getattr(transformers, f"{name}ForObjectDetection")(config)
    with torch.no_grad():  # As a new model is made, all boxes have nearly one score, and many have no width.
        model.class_head.logit_scale.weight.normal_()
        model.class_head.logit_shift.bias.fill_(-0.5)
        model.class_head.dense0.weight.normal_()
        model.box_head.dense2.weight.mul_(0.01)
    model.save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    size = {"height": IMAGE_SIDE, "width": IMAGE_SIDE}
    getattr(transformers, f"{name}ImageProcessorPil")(size=size).save_pretrained(folder)
    return folder


def save_grounding_dino(folder):
    torch.manual_seed(0)
    tokens = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", ".", *LETTERS, *(f"##{letter}" for letter in LETTERS)]
    folder.mkdir(parents=True, exist_ok=True)
    tokenizer = transformers.BertTokenizer(vocab={token: number for number, token in enumerate(tokens)})
    sizes = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2}
    config = transformers.GroundingDinoConfig(
        text_config={"model_type": "bert", **sizes, "vocab_size": len(tokens), "max_position_embeddings": 64},
        backbone_config={
            "model_type": "swin", "image_size": 64, "embed_dim": 8, "depths": [1, 1, 1, 1], "num_heads": [1, 1, 2, 2],
            "window_size": 2, "out_indices": [2, 3, 4],
        },
        num_queries=20, d_model=32, encoder_layers=1, encoder_ffn_dim=16, encoder_attention_heads=2, decoder_layers=2,
        decoder_ffn_dim=16, decoder_attention_heads=2, max_text_len=32,
    )  # fmt: skip
    transformers.GroundingDinoForObjectDetection(config).save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    size = {"shortest_edge": 60, "longest_edge": 100}
    transformers.GroundingDinoImageProcessorPil(size=size).save_pretrained(folder)
    return folder


def change_json(path, **changes):
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
