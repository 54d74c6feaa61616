"""Train the embedded CLIP on captions and crops that this project renders itself.

`experiments.clip_tabletop.crops` renders the pictures, `experiments.clip_tabletop.vocabulary` writes their captions,
and the result is stored in the Hugging Face format. It knows colours and shapes that are in no demonstration, like
the paper's CLIP.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from tokenizers import Tokenizer, decoders, models, normalizers, pre_tokenizers, processors, trainers
from tqdm import tqdm
from transformers import BatchEncoding, CLIPTextConfig, PreTrainedTokenizerFast, ResNetConfig

from experiments.clip_tabletop import card, vocabulary
from experiments.clip_tabletop.crops import IMAGE_SIZE, NO_NAME, PART_KEYS, TABLE, Crops, rendered_crops
from experiments.clip_tabletop.scenes import COLOR_NAMES, NOUN_NAMES
from experiments.clip_tabletop.withheld import NOTHING, Withheld
from gem_lite import clip
from gem_lite.clip import calibration
from gem_lite.clip.resnet_clip import ResNetClip, ResNetClipConfig
from gem_lite.evaluation import calibrating
from gem_lite.foundations.files import read_json
from gem_lite.training import training_state

SPECIAL = ("<pad>", "<bos>", "<unk>", "<eos>")
# <eos> must not have id 2: transformers' CLIP then pools at argmax(input_ids), which is some other word.
PAD, BOS, EOS = SPECIAL.index("<pad>"), SPECIAL.index("<bos>"), SPECIAL.index("<eos>")
PARAPHRASES_PER_BATCH = 96
UNPICTURED_PER_BATCH = 24
LEARNING_RATE = 2e-3
FILES = {
    "README.md", "calibration.json", "calibration-dense.json", "config.json", "model.safetensors",
    "preprocessor_config.json", "tokenizer.json", "tokenizer_config.json", "words.json",
}  # fmt: skip
"""The files of an embedded CLIP's folder."""

Key = tuple[str | None, str | None, str | None]
"""The content of a caption: colour, shape, part; None for what it does not name."""


def captions_for_tokenizer(rng: np.random.Generator, withheld: Withheld) -> list[str]:
    """Some captions of everything that the training may name."""
    captions = [
        vocabulary.caption(color, shape, rng)
        for color in (None, *COLOR_NAMES)
        for shape in (None, *NOUN_NAMES, *vocabulary.NOUNS_WITHOUT_PICTURES)
        if (color, shape) not in vocabulary.HELD_OUT and not withheld.names(shape)
        for _ in range(10)
    ]
    parts = [key for key in PART_KEYS if not withheld.names(*key)]
    return captions + [vocabulary.caption(None, shape, rng, part) for shape, part in parts for _ in range(100)]


def train_tokenizer(seed: int = 0, withheld: Withheld = NOTHING) -> PreTrainedTokenizerFast:
    """A byte-level BPE tokenizer over many captions: any text is accepted, known words are short."""
    tokenizer = Tokenizer(models.BPE(unk_token="<unk>"))
    tokenizer.normalizer = normalizers.Lowercase()
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=True)
    tokenizer.decoder = decoders.ByteLevel()
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    captions = captions_for_tokenizer(np.random.default_rng(seed), withheld)
    tokenizer.train_from_iterator(
        captions, trainers.BpeTrainer(vocab_size=2000, special_tokens=list(SPECIAL), initial_alphabet=alphabet)
    )
    tokenizer.post_processor = processors.TemplateProcessing(
        single="<bos> $A <eos>", special_tokens=[("<bos>", BOS), ("<eos>", EOS)]
    )
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer, pad_token="<pad>", bos_token="<bos>", eos_token="<eos>", unk_token="<unk>",
        model_max_length=32,
    )  # fmt: skip


def make_model(vocab_size: int, widths: Sequence[int] = (32, 64, 128, 256)) -> ResNetClip:
    """A residual image tower and a two-layer text tower, in transformers' dual-encoder format."""
    vision = ResNetConfig(
        embedding_size=widths[0], hidden_sizes=list(widths), depths=[1, 1, 2, 1], layer_type="basic",
        hidden_size=widths[-1], image_size=IMAGE_SIZE,
    )  # fmt: skip
    text = CLIPTextConfig(
        vocab_size=vocab_size, hidden_size=128, intermediate_size=512, num_hidden_layers=2, num_attention_heads=4,
        max_position_embeddings=32, pad_token_id=PAD, bos_token_id=BOS, eos_token_id=EOS, projection_dim=128,
    )  # fmt: skip
    return ResNetClip(ResNetClipConfig.from_vision_text_configs(vision, text, projection_dim=128))


def _contrast(image: torch.Tensor, text: torch.Tensor, match: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    """CLIP's symmetric loss where a caption may match many images. ``match`` (B, P): one caption a row."""
    logits = scale * image @ text.T  # (B, P)
    to_text = F.cross_entropy(logits, match.int().argmax(dim=1))
    target = match.float() / match.sum(dim=0)
    to_image = -(target * logits.log_softmax(dim=0)).sum(dim=0).mean()
    return (to_text + to_image) / 2


def caption_sets(crops: Crops, rng: np.random.Generator) -> list[tuple[np.ndarray, list[Key], np.ndarray]]:
    """Four ways to name a batch: colour and shape, colour, shape, and part (with the colour by a coin's toss).

    A crop whose colour has no name is in none that says a colour, one that shows no one part not in the last, and one
    of `NO_NAME` in the second alone.

    Returns:
        For each way (rows, keys, match): the crops that it names, its distinct captions, and (rows, keys) bool.
    """
    table = crops.shape == TABLE
    named = crops.shape != NO_NAME
    colored = crops.color >= 0
    nothing = np.full(len(crops), -1)
    part_color = crops.color if rng.random() < 0.5 else nothing
    sets = []
    for rows, columns in (
        (named & (table | colored), (crops.color, crops.shape, nothing)),
        (table | colored, (crops.color, nothing, nothing)),
        (named, (nothing, crops.shape, nothing)),
        (crops.part >= 0, (part_color, crops.shape, crops.part)),
    ):
        unique, inverse = np.unique(np.stack(columns, axis=1)[rows], axis=0, return_inverse=True)
        keys = [
            (
                COLOR_NAMES[c] if c >= 0 else None,
                NOUN_NAMES[s] if s >= 0 else None,
                PART_KEYS[q][1] if q >= 0 else None,
            )
            for c, s, q in unique
        ]
        sets.append((np.flatnonzero(rows), keys, inverse.reshape(-1, 1) == np.arange(len(keys))))
    return sets


def _augment(images: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """(B, H, W, 3) bytes to (B, 3, H, W) in [-1, 1], with other light and framing. No mirrors, for letters."""
    light = (1 + 0.08 * torch.randn(len(images), 1, 1, 1, generator=generator)) * (
        1 + 0.02 * torch.randn(len(images), 1, 1, 3, generator=generator)
    )
    side = int(torch.randint(IMAGE_SIZE - 6, IMAGE_SIZE + 1, (), generator=generator))
    top, left = (int(torch.randint(0, IMAGE_SIZE - side + 1, (), generator=generator)) for _ in range(2))
    pixels = images[:, top : top + side, left : left + side] * (light / 127.5) - 1
    framed = F.interpolate(pixels.permute(0, 3, 1, 2), (IMAGE_SIZE, IMAGE_SIZE), mode="bilinear")
    return framed.clamp(-1, 1)


@dataclass(frozen=True)
class _Captions:
    """A batch in words: the captions of each crop, and all texts of the step, the paraphrases twice at the end."""

    sets: list[tuple[np.ndarray, list[Key], np.ndarray]]
    texts: list[str]
    paraphrases: int


@dataclass(frozen=True)
class _Batch:
    """The input of one step: pixels (B, 3, H, W), the captions, and their tokens."""

    pixels: torch.Tensor
    captions: _Captions
    tokens: BatchEncoding


def write_captions(crops: Crops, rng: np.random.Generator) -> _Captions:
    """The captions of one step, with nouns without pictures and with paraphrases."""
    sets = caption_sets(crops, rng)
    nouns = vocabulary.NOUNS_WITHOUT_PICTURES
    unpictured = [
        (str(rng.choice(COLOR_NAMES)) if rng.random() < 0.8 else None, str(rng.choice(nouns)), None)
        for _ in range(UNPICTURED_PER_BATCH)
    ]
    shown = list(dict.fromkeys([*sets[0][1], *sets[2][1], *sets[3][1]]))
    paraphrased = [shown[i] for i in rng.permutation(len(shown))[:PARAPHRASES_PER_BATCH]]
    paraphrased += dict.fromkeys(unpictured)
    captioned = [key for _, keys, _ in sets for key in keys]
    keys = (*captioned, *paraphrased, *paraphrased)  # the second caption of a key is a paraphrase of the first
    texts = [vocabulary.caption(color, shape, rng, part) for color, shape, part in keys]
    return _Captions(sets, texts, len(paraphrased))


def _make_batch(
    crops: Crops, tokenizer: PreTrainedTokenizerFast, rng: np.random.Generator, generator: torch.Generator
) -> _Batch:
    captions = write_captions(crops, rng)
    pixels = _augment(torch.from_numpy(crops.images), generator).contiguous(memory_format=torch.channels_last)
    return _Batch(pixels, captions, tokenizer(captions.texts, padding=True, return_tensors="pt"))


def _loss(model: ResNetClip, batch: _Batch) -> torch.Tensor:
    """The contrast of pictures with four kinds of captions, and of captions with their paraphrases."""
    # bfloat16 makes the image tower faster where the processor has it, and ten times slower elsewhere. It makes the
    # text tower's gradient slower, and it would round the logits.
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=torch.ops.mkldnn._is_mkldnn_bf16_supported()):
        image = model.get_image_features(pixel_values=batch.pixels)
    text = model.get_text_features(input_ids=batch.tokens["input_ids"], attention_mask=batch.tokens["attention_mask"])
    image, text = clip.unit(image), clip.unit(text)
    scale = model.logit_scale.exp().clamp(max=30)
    sets, paraphrases = batch.captions.sets, batch.captions.paraphrases
    lengths = [len(keys) for _, keys, _ in sets]
    *parts, first, second = text.split([*lengths, paraphrases, paraphrases])
    loss = 0.3 * _contrast(first, second, torch.eye(paraphrases, dtype=torch.bool), scale)
    for (rows, _, match), words, weight in zip(sets, parts, (1.0, 0.5, 1.0, 0.5), strict=True):
        if len(rows):
            loss = loss + weight * _contrast(image[torch.from_numpy(rows)], words, torch.from_numpy(match), scale)
    return loss


def _batches(crops: Crops, batch: int, tokenizer: PreTrainedTokenizerFast, seed: int, epoch: int) -> Iterator[_Batch]:
    """One epoch's batches; the next one is made in a thread while a step is computed."""
    rng, generator = np.random.default_rng((seed, epoch)), torch.Generator().manual_seed(seed * 1000 + epoch)
    order = rng.permutation(len(crops))

    def make(step: int) -> _Batch:
        return _make_batch(crops.select(order[step * batch : (step + 1) * batch]), tokenizer, rng, generator)

    # One thread for the pictures: the step needs the cores more.
    with ThreadPoolExecutor(max_workers=1, initializer=torch.set_num_threads, initargs=(1,)) as thread:
        coming = thread.submit(make, 0)
        for step in range(1, len(crops) // batch + 1):
            ready = coming.result()
            if step < len(crops) // batch:
                coming = thread.submit(make, step)
            yield ready


def train(
    crops: Crops, epochs: int, seed: int, run: Path, batch: int = 512, rate: float = LEARNING_RATE,
    withheld: Withheld = NOTHING,
) -> tuple[ResNetClip, PreTrainedTokenizerFast]:  # fmt: skip
    """Train both towers; resumes from ``run`` if an earlier training with the same arguments was stopped.

    Args:
        withheld: what no caption names.

    Raises:
        ValueError: ``run`` holds a damaged state, or that of a training on other crops or with other arguments.
    """
    torch.manual_seed(seed)
    crops = withheld.hide(crops)
    tokenizer = train_tokenizer(withheld=withheld)
    model = make_model(len(tokenizer)).to(memory_format=torch.channels_last).train()
    optimizer = torch.optim.AdamW(model.parameters(), lr=rate, weight_decay=0.05)
    steps = epochs * (len(crops) // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps, pct_start=0.1)
    parts = {"model": model, "optimizer": optimizer, "schedule": schedule}
    identity = {"crops": len(crops), "epochs": epochs, "seed": seed, "batch": batch, "rate": rate}
    identity |= {"withheld": withheld.phrases}
    state_file = run / "state.pt"
    for epoch in range(_restore(parts, identity, state_file), epochs):
        batches = _batches(crops, batch, tokenizer, seed, epoch)
        bar = tqdm(batches, f"epoch {epoch + 1}/{epochs}", len(crops) // batch, unit="step", mininterval=2)
        for prepared_batch in bar:
            loss = _loss(model, prepared_batch)
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            bar.set_postfix(loss=f"{loss.item():.3f}")
        state = {name: part.state_dict() for name, part in parts.items()}
        training_state.save_state(state_file, state | {"epoch": epoch + 1, "identity": identity})
    return model.eval(), tokenizer


def _restore(parts: dict, identity: dict, state_file: Path) -> int:
    """Load the state of a stopped training. Returns the number of its finished epochs; 0 if there is no state."""
    if not state_file.exists():
        return 0
    state = training_state.load_state(state_file)
    if state["identity"] != identity:
        raise ValueError(f"{state_file} is of a training with {state['identity']}, not {identity}: delete it first")
    for name, part in parts.items():
        part.load_state_dict(state[name])
    print(f"resuming after epoch {state['epoch']} from {state_file}")
    return state["epoch"]


def check_folder(out: Path) -> None:
    """Check that `save` may replace a folder: it is new, empty, or holds an embedded CLIP and nothing else.

    Raises:
        ValueError: it holds something else, which would be lost, or it is a file.
    """
    if not out.exists():
        return
    names = {path.name for path in out.iterdir()} if out.is_dir() else {out.name}
    if not names:
        return
    config = out / "config.json"
    kinds = read_json(config.read_bytes(), config).get("architectures") if config.is_file() else None
    if names - FILES or kinds != [ResNetClip.__name__]:
        raise ValueError(
            f"out must be a new or empty folder, or one that holds an embedded CLIP alone, which is replaced; {out} "
            f"holds {', '.join(sorted(names - FILES or names)[:3])}"
        )


def save(
    model: ResNetClip, tokenizer: PreTrainedTokenizerFast, out: Path, withheld: Withheld = NOTHING
) -> None:  # fmt: skip
    """Write a folder that `transformers` loads; an old one is replaced after the new one is complete.

    A calibration or card in the old folder is removed, too: they belong to the old weights.

    Raises:
        ValueError: see `check_folder`.
    """
    check_folder(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"{out.name}-", dir=out.parent) as workplace:
        fresh = Path(workplace) / out.name
        model.to(memory_format=torch.contiguous_format).save_pretrained(fresh)
        tokenizer.save_pretrained(fresh)
        preprocessing = {
            "image_processor_type": "CLIPImageProcessor", "do_resize": True, "do_center_crop": False,
            "size": {"height": IMAGE_SIZE, "width": IMAGE_SIZE}, "do_normalize": True, "do_rescale": True,
            "image_mean": [0.5] * 3, "image_std": [0.5] * 3, "resample": 3,
        }  # fmt: skip
        (fresh / "preprocessor_config.json").write_text(json.dumps(preprocessing, indent=1))
        write_words(fresh, withheld)
        if out.exists():
            os.replace(out, Path(workplace) / "old")
        os.replace(fresh, out)


def write_words(folder: Path, withheld: Withheld = NOTHING) -> None:
    """Write words.json, the words of the captions that a CLIP learned from, into its folder."""
    (folder / "words.json").write_text(json.dumps(withheld.words(), indent=1) + "\n")


def pretrain(out: Path, run: Path, scenes: int, epochs: int, seed: int, withheld: Withheld = NOTHING) -> str:
    """Render, train, save, calibrate and measure the embedded CLIP in the folder ``out``; returns its card.

    Args:
        run: folder for the crops and for the state to resume from. Each list of words has its own state.
        withheld: what no caption names.

    Raises:
        ValueError: something is withheld and ``out`` is the embedded CLIP, ``scenes`` or ``epochs`` are below 1,
            ``seed`` is negative, or see `check_folder` and `train`.
    """
    check_size(scenes, epochs)
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")
    if withheld != NOTHING and out.resolve() == clip.EMBEDDED.resolve():
        raise ValueError(f"out must be another folder than {out}, the embedded CLIP: this one is an experiment")
    check_folder(out)  # Before an hour of training, not after it.
    start = time.time()
    crops = rendered_crops(run, scenes, seed)
    print(f"{len(crops)} crops, {(crops.shape == TABLE).mean():.0%} of them bare table")
    state = run if withheld == NOTHING else run / withheld.name
    model, tokenizer = train(crops, epochs, seed, state, withheld=withheld)
    save(model.half(), tokenizer, out, withheld)
    print(f"wrote {out} after {time.time() - start:.0f} s")
    embedded = clip.load(out)
    for kind, numbers in calibrating.calibrations(embedded):
        calibration.write(embedded, numbers, kind)
    return card.write(out, embedded, len(crops), withheld)


def check_size(scenes: int, epochs: int) -> None:
    """Raises ValueError if there is nothing to train on."""
    if scenes < 1 or epochs < 1:
        raise ValueError(f"scenes and epochs must be at least 1, got {scenes} and {epochs}")
