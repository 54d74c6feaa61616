"""Train the embedded CLIP on captions and crops that this file renders itself.

Scenes of coloured shapes are rendered in PyBullet through jittered copies of the table's cameras and
under changing light; crops as the semantic maps will cut them become images, `gem_lite.vocabulary`
writes their captions. The result is stored in the Hugging Face format. It knows colours and shapes
that no demonstration shows: CLIP is broad, demonstrations are narrow, as in the paper.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pybullet as p
import torch
import torch.nn.functional as F
from scipy.spatial.transform import Rotation
from tokenizers import Tokenizer, decoders, models, normalizers, pre_tokenizers, processors, trainers
from tqdm import tqdm
from transformers import (
    CLIPTextConfig,
    ConvNextConfig,
    PreTrainedTokenizerFast,
    VisionTextDualEncoderConfig,
    VisionTextDualEncoderModel,
)

from gem_lite import clip, vocabulary
from gem_lite.se2 import Pose2, Workspace
from gem_lite.tabletop import shapes
from gem_lite.tabletop.cameras import CAMERAS, Camera, View, render
from gem_lite.tabletop.heightmap import fuse_views
from gem_lite.tabletop.tasks.spawn import FreeSpace

IMAGE_SIZE = 32
SIDE_PATCH = (30, 56)
"""Side lengths (pixels) of crops from camera views; the maps use 40."""
TOP_PATCH = (0.09, 0.15)
"""Side lengths (metres) of crops from the height map; the maps use 0.125."""
SPECIAL = ("<pad>", "<bos>", "<unk>", "<eos>")
# <eos> must not have id 2: transformers' CLIP then pools at argmax(input_ids), which is some other word.
PAD, BOS, EOS = SPECIAL.index("<pad>"), SPECIAL.index("<bos>"), SPECIAL.index("<eos>")
CARD_SCENES, CARD_SEED = 100, 1_000_003
"""The card's test scenes: seeds that training (seed 0) never drew from."""
COLOR_NAMES, SHAPE_NAMES = tuple(vocabulary.COLORS), tuple(vocabulary.SHAPES)

CARD = """# The embedded CLIP
 A small image-text model in the Hugging Face format (`VisionTextDualEncoderModel`: a ConvNeXt image tower, a
two-layer text tower, {parameters:.1f} M parameters), trained by `python -m gem_lite.pretrain_clip` on
{training_crops} crops of scenes that it renders in PyBullet, with captions written by `gem_lite/vocabulary.py`. It
stands in for OpenAI's CLIP where there is no network; it is a different, far smaller model, and no figure made with
it is one of OpenAI's CLIP. This card is written by the same command.

## What it can do

Zero-shot accuracy in percent, over crops of {scenes} fresh scenes a row (seeds {seeds}): the crop is compared with
every colour ("red thing"), every shape ("a block"), or every pair of both ("red block"). Crops are cut as semantic
maps cut them, so many show an object in part, and an object's side more often than its top.

| crops of | crops | colour of 12 | shape of 23 | pair of 276 |
|---|---|---|---|---|
{table}

Chance is 8.3, 4.3 and 0.4.

## What it was shown

Colours: {colors}. Shapes: {shapes}. Synonyms such as "scarlet" and "cube", plurals and several templates are in its
captions. Views: jittered copies of the table's three cameras and the fused height map; light, table and floor vary.
Never shown nor said: {held_out}.

## Limits

It knows nothing beyond these words and this renderer. On pairs that training never showed it names the colour and
mostly misses the shape (last row): it has not learned to combine them freely. Colour weighs more than shape. Flat
shapes that differ in a corner (pentagon, hexagon, circle) and letters seen from the side are often confused. A word
it never read is split into known pieces and lands anywhere.
"""


@dataclass
class Crops:
    """Rendered crops: ``images`` (N, 32, 32, 3) uint8; ``color`` and ``shape`` (N,) ids, -1 for bare table."""

    images: np.ndarray
    color: np.ndarray
    shape: np.ndarray

    def __len__(self) -> int:
        return len(self.images)


def _add(client: int, shape: str, color: tuple[float, ...], pose: Pose2) -> shapes.Body:
    if shape == "block":
        return shapes.add_block(client, color, pose)
    if shape == "bowl":
        return shapes.add_bowl(client, color, pose, movable=False)
    mesh = shapes.l_block_mesh() if shape == "L-block" else shapes.piece_mesh(shape)
    return shapes.add_mesh(client, mesh, color, pose)


def _jitter_color(name: str, rng: np.random.Generator) -> tuple[float, ...]:
    rgb = np.array(vocabulary.RGB[name]) * rng.uniform(0.9, 1.08) + rng.normal(0, 6, 3)
    return (*np.clip(rgb / 255, 0, 1), 1.0)


def _jitter_camera(camera: Camera, rng: np.random.Generator) -> Camera:
    turn = Rotation.from_quat(camera.quaternion) * Rotation.from_euler("xyz", rng.normal(0, 0.06, 3))
    position = np.array(camera.position) + rng.normal(0, 0.06, 3)
    return dataclasses.replace(camera, position=tuple(position), quaternion=tuple(turn.as_quat()))


def _draw_pair(rng: np.random.Generator, held_out: bool) -> tuple[str, str]:
    if held_out and rng.random() < 0.5:
        return sorted(vocabulary.HELD_OUT)[rng.integers(len(vocabulary.HELD_OUT))]
    while True:
        # Blocks and bowls fill half of the table: they are what the tasks are made of.
        shape = str(rng.choice(["block", "bowl"]) if rng.random() < 0.35 else rng.choice(SHAPE_NAMES))
        color = str(rng.choice(COLOR_NAMES))
        if held_out or (color, shape) not in vocabulary.HELD_OUT:
            return color, shape


def _label(ids: np.ndarray, owner: dict[int, tuple[int, int]]) -> tuple[int, int] | None:
    """The colour and shape of the body that fills most of a crop; None if two compete."""
    present, count = np.unique(ids, return_counts=True)
    sizes = sorted(((c, b) for b, c in zip(present, count, strict=True) if b in owner), reverse=True)
    if not sizes or sizes[0][0] < 0.01 * ids.size:
        return -1, -1
    if sizes[0][0] < 0.06 * ids.size or (len(sizes) > 1 and sizes[1][0] > 0.4 * sizes[0][0]):
        return None
    return owner[sizes[0][1]]


def _cut(image: np.ndarray, row: int, col: int, side: int) -> np.ndarray | None:
    top, left = row - side // 2, col - side // 2
    if top < 0 or left < 0 or top + side > image.shape[0] or left + side > image.shape[1]:
        return None
    return image[top : top + side, left : left + side]


def render_scene(rng: np.random.Generator, held_out: bool) -> list[tuple[np.ndarray, int, int]]:
    """One scene's labelled crops, from camera views and from the fused height map."""
    client = p.connect(p.DIRECT)
    try:
        workspace = Workspace(pixel=float(rng.choice([0.00625, 0.003125])))
        gray = rng.uniform(0.12, 0.4)
        sheet = p.createVisualShape(
            p.GEOM_BOX, halfExtents=(0.25, 0.5, 5e-4), rgbaColor=(*(gray + rng.normal(0, 0.015, 3)), 1),
            physicsClientId=client,
        )  # fmt: skip
        p.createMultiBody(0, -1, sheet, (0.5, 0, -5e-4), physicsClientId=client)
        floor = p.createVisualShape(
            p.GEOM_BOX, halfExtents=(3, 3, 5e-4), rgbaColor=(*([rng.uniform(0.15, 0.5)] * 3), 1), physicsClientId=client
        )
        p.createMultiBody(0, -1, floor, (0.5, 0, -0.1), physicsClientId=client)
        free, owner, placed = FreeSpace(workspace, rng, gap=0.004), {}, []
        for _ in range(rng.integers(10, 22)):
            color, shape = _draw_pair(rng, held_out)
            pose = free.sample({"bowl": 0.058, "block": 0.03, "L-block": 0.07}.get(shape, 0.042))
            if pose is None:
                continue
            label = COLOR_NAMES.index(color), SHAPE_NAMES.index(shape)
            body = _add(client, shape, _jitter_color(color, rng), pose)
            owner[body.id] = label
            placed.append((pose, label))
            if shape == "bowl" and rng.random() < 0.15:
                # A block in a bowl, as the table shows after a placement.
                inside = str(rng.choice(COLOR_NAMES))
                block = _add(client, "block", _jitter_color(inside, rng), pose)
                p.resetBasePositionAndOrientation(
                    block.id, (pose.x, pose.y, 0.031), p.getQuaternionFromEuler((0, 0, rng.uniform(0, 6))), client
                )
                owner[block.id] = COLOR_NAMES.index(inside), SHAPE_NAMES.index("block")
                placed.pop()
        light = tuple(np.array([0.3, 0.2, 1.0]) + rng.normal(0, 0.25, 3))
        light_color = tuple(np.clip(rng.normal(1, 0.03, 3), 0.85, 1.0))
        crops, views = [], []
        for camera in CAMERAS:
            view, ids = render(client, _jitter_camera(camera, rng), light, light_color, segmentation=True)
            views.append(view)
            crops += _side_crops(view, ids, owner, rng)
        crops += _top_crops(fuse_views(views, workspace).rgb, workspace, placed, rng)
    finally:
        p.disconnect(client)
    return crops


def _side_crops(view: View, ids: np.ndarray, owner: dict, rng: np.random.Generator) -> list:
    crops = []
    rows, cols = np.nonzero(np.isin(ids, list(owner)))
    if len(rows) == 0:
        return crops
    # Even over bodies, not over pixels: pick a body first, then one of its pixels.
    seen = np.unique(ids[rows, cols])
    for index in range(2 * len(seen) + 8):
        side = int(rng.integers(*SIDE_PATCH))
        if index < 2 * len(seen):
            mine = np.flatnonzero(ids[rows, cols] == seen[index % len(seen)])
            pixel = rng.choice(mine)
            row, col = np.array([rows[pixel], cols[pixel]]) + np.round(rng.normal(0, 5, 2)).astype(int)
        else:
            row, col = rng.integers(0, ids.shape[0]), rng.integers(0, ids.shape[1])
        image, mask = _cut(view.rgb, row, col, side), _cut(ids, row, col, side)
        if image is not None and (label := _label(mask, owner)) is not None:
            crops.append((_shrink(image), *label))
    return crops


def _top_crops(rgb: np.ndarray, workspace: Workspace, placed: list, rng: np.random.Generator) -> list:
    crops = []
    for pose, label in placed:
        row, col = workspace.to_pixel(pose.x, pose.y)
        side = int(rng.uniform(*TOP_PATCH) / workspace.pixel)
        offset = rng.normal(0, 0.012, 2) / workspace.pixel
        # Alone in the crop, or nearly: others must be farther than half of it.
        others = [np.hypot(pose.x - q.x, pose.y - q.y) for q, _ in placed if q is not pose]
        if min(others, default=1.0) < 0.5 * side * workspace.pixel + 0.02:
            continue
        image = _cut(rgb, int(row + offset[0]), int(col + offset[1]), side)
        if image is not None:
            crops.append((_shrink(image), *label))
    return crops


def _shrink(image: np.ndarray) -> np.ndarray:
    method = cv2.INTER_AREA if image.shape[0] > IMAGE_SIZE else cv2.INTER_CUBIC
    return cv2.resize(image, (IMAGE_SIZE, IMAGE_SIZE), interpolation=method)


def _render_indexed(job: tuple[int, int, bool]) -> list[tuple[np.ndarray, int, int]]:
    seed, index, held_out = job
    return render_scene(np.random.default_rng((seed, index)), held_out)


def render_crops(scenes: int, seed: int, held_out: bool = False) -> Crops:
    """Render ``scenes`` scenes, one process a core; the same crops whatever the number of cores.

    With ``held_out``, half the bodies are of pairs that training never shows.
    """
    jobs = [(seed, index, held_out) for index in range(scenes)]
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        parts = tqdm(pool.imap(_render_indexed, jobs, chunksize=4), "rendering scenes", scenes, unit="scene")
        rows = [row for part in parts for row in part]
    images, color, shape = zip(*rows, strict=True)
    return Crops(np.stack(images), np.array(color), np.array(shape))


def train_tokenizer(seed: int = 0) -> PreTrainedTokenizerFast:
    """A byte-level BPE tokenizer over many captions: any text is accepted, known words are short."""
    rng = np.random.default_rng(seed)
    captions = [
        vocabulary.caption(color, shape, rng)
        for color in (None, *COLOR_NAMES)
        for shape in (None, *SHAPE_NAMES)
        if (color, shape) not in vocabulary.HELD_OUT
        for _ in range(20)
    ]
    tokenizer = Tokenizer(models.BPE(unk_token="<unk>"))
    tokenizer.normalizer = normalizers.Lowercase()
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=True)
    tokenizer.decoder = decoders.ByteLevel()
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    tokenizer.train_from_iterator(
        captions, trainers.BpeTrainer(vocab_size=700, special_tokens=list(SPECIAL), initial_alphabet=alphabet)
    )
    tokenizer.post_processor = processors.TemplateProcessing(
        single="<bos> $A <eos>", special_tokens=[("<bos>", BOS), ("<eos>", EOS)]
    )
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer, pad_token="<pad>", bos_token="<bos>", eos_token="<eos>", unk_token="<unk>",
        model_max_length=32,
    )  # fmt: skip


def make_model(vocab_size: int, widths: tuple[int, int, int] = (48, 96, 192)) -> VisionTextDualEncoderModel:
    """A convolutional image tower and a two-layer text tower, in transformers' dual-encoder format."""
    vision = ConvNextConfig(
        patch_size=4, num_stages=3, hidden_sizes=list(widths), depths=[2, 2, 2], image_size=IMAGE_SIZE,
        hidden_size=widths[-1],
    )  # fmt: skip
    text = CLIPTextConfig(
        vocab_size=vocab_size, hidden_size=128, intermediate_size=512, num_hidden_layers=2, num_attention_heads=4,
        max_position_embeddings=32, pad_token_id=PAD, bos_token_id=BOS, eos_token_id=EOS, projection_dim=128,
    )  # fmt: skip
    config = VisionTextDualEncoderConfig.from_vision_text_configs(vision, text, projection_dim=128)
    return VisionTextDualEncoderModel(config)


def _contrast(image: torch.Tensor, text: torch.Tensor, match: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    """CLIP's symmetric loss where a caption may match many images. ``match`` (B, P): one caption a row."""
    logits = scale * image @ text.T  # (B, P)
    to_text = F.cross_entropy(logits, match.int().argmax(dim=1))
    used = match.any(dim=0)
    target = match[:, used].float()
    target = target / target.sum(dim=0)
    to_image = -(target * logits[:, used].log_softmax(dim=0)).sum(dim=0).mean()
    return (to_text + to_image) / 2


def _captions(color: np.ndarray, shape: np.ndarray, rng: np.random.Generator) -> list[tuple[list[str], np.ndarray]]:
    """Three sets of captions for a batch (full, colour only, shape only), each with its match matrix."""
    sets = []
    for keys in (
        np.stack([color, shape], axis=1),
        np.stack([color, np.full_like(shape, -1)], axis=1),
        np.stack([np.full_like(color, -1), shape], axis=1),
    ):
        unique, inverse = np.unique(keys, axis=0, return_inverse=True)
        texts = [
            vocabulary.caption(COLOR_NAMES[c] if c >= 0 else None, SHAPE_NAMES[s] if s >= 0 else None, rng)
            for c, s in unique
        ]
        sets.append((texts, inverse[:, None] == np.arange(len(unique))[None]))
    return sets


def _augment(images: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """Random mirror-free quarter turns are left out (letters!); brightness and noise are not."""
    gain = 1 + 0.08 * torch.randn(len(images), 1, 1, 1, generator=generator)
    noise = 3 * torch.randn(images.shape, generator=generator)
    return (images.float() * gain + noise).clamp(0, 255)


def train(
    crops: Crops, epochs: int, seed: int, run: Path, batch: int = 512
) -> tuple[VisionTextDualEncoderModel, PreTrainedTokenizerFast]:
    """Train both towers; resumes from ``run`` if an earlier training of the same length was stopped."""
    torch.manual_seed(seed)
    tokenizer = train_tokenizer()
    model = make_model(len(tokenizer)).to(memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3, weight_decay=0.05)
    steps = epochs * (len(crops) // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=2e-3, total_steps=steps, pct_start=0.1)
    state_file, start = run / "state.pt", 0
    if state_file.exists():
        state = torch.load(state_file)
        model.load_state_dict(state["model"])
        optimizer.load_state_dict(state["optimizer"])
        schedule.load_state_dict(state["schedule"])
        start = state["epoch"]
        print(f"resuming after epoch {start} from {state_file}")
    images = torch.from_numpy(crops.images)
    for epoch in range(start, epochs):
        rng = np.random.default_rng((seed, epoch))
        generator = torch.Generator().manual_seed(seed * 1000 + epoch)
        order = rng.permutation(len(crops))
        bar = tqdm(range(len(crops) // batch), desc=f"epoch {epoch + 1}/{epochs}", unit="step")
        for step in bar:
            index = order[step * batch : (step + 1) * batch]
            pixels = _augment(images[index], generator).permute(0, 3, 1, 2) / 127.5 - 1
            image = clip.unit(model.get_image_features(pixel_values=pixels))
            scale = model.logit_scale.exp().clamp(max=30)
            loss = torch.zeros(())
            for texts, match in _captions(crops.color[index], crops.shape[index], rng):
                tokens = tokenizer(texts, padding=True, return_tensors="pt")
                text = clip.unit(
                    model.get_text_features(input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"])
                )
                loss = loss + _contrast(image, text, torch.from_numpy(match), scale) / 3
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            bar.set_postfix(loss=f"{loss.item():.3f}")
        state = {
            "model": model.state_dict(), "optimizer": optimizer.state_dict(),
            "schedule": schedule.state_dict(), "epoch": epoch + 1,
        }  # fmt: skip
        torch.save(state, state_file.with_suffix(".tmp"))
        os.replace(state_file.with_suffix(".tmp"), state_file)
    return model, tokenizer


def save(model: VisionTextDualEncoderModel, tokenizer: PreTrainedTokenizerFast, out: Path) -> None:
    """Write a folder that `transformers` loads; the old folder stays whole until the new one is.

    A calibration or card in the old folder goes with it: they belong to the old weights.
    """
    fresh = out.with_name(out.name + ".new")
    shutil.rmtree(fresh, ignore_errors=True)
    model.to(memory_format=torch.contiguous_format).save_pretrained(fresh)
    tokenizer.save_pretrained(fresh)
    preprocessing = {
        "image_processor_type": "CLIPImageProcessor", "do_resize": True, "do_center_crop": False,
        "size": {"height": IMAGE_SIZE, "width": IMAGE_SIZE}, "do_normalize": True, "do_rescale": True,
        "image_mean": [0.5] * 3, "image_std": [0.5] * 3, "resample": 3,
    }  # fmt: skip
    (fresh / "preprocessor_config.json").write_text(json.dumps(preprocessing, indent=1))
    shutil.rmtree(out, ignore_errors=True)
    os.replace(fresh, out)


def accuracy(model: clip.Clip, crops: Crops) -> dict[str, float]:
    """Zero-shot accuracy (0-100) on crops of objects: colour, shape, and both at once."""
    real = crops.color >= 0
    image = model.embed_images(crops.images[real])
    color, shape = crops.color[real], crops.shape[real]

    def share(phrases: list[str], truth: np.ndarray) -> float:
        guess = (image @ model.embed_texts(phrases).T).argmax(dim=1).numpy()
        return round(100 * float((guess == truth).mean()), 1)

    pairs = [f"{c} {s}" for c in COLOR_NAMES for s in SHAPE_NAMES]
    return {
        "color": share([f"{name} thing" for name in COLOR_NAMES], color),
        "shape": share([f"a {name}" for name in SHAPE_NAMES], shape),
        "both": share(pairs, color * len(SHAPE_NAMES) + shape),
        "crops": int(real.sum()),
    }


def chosen(crops: Crops, keep: Callable[[str, str], bool]) -> Crops:
    """The crops of objects whose colour and shape names satisfy ``keep``."""
    pairs = zip(crops.color, crops.shape, strict=True)
    index = np.array([c >= 0 and keep(COLOR_NAMES[c], SHAPE_NAMES[s]) for c, s in pairs])
    return Crops(crops.images[index], crops.color[index], crops.shape[index])


def write_card(out: Path, rows: dict[str, dict], training_crops: int, model: clip.Clip) -> str:
    """Write the model's card, README.md of its folder, from what was measured; returns its text."""
    table = "\n".join(
        f"| {title} | {row['crops']} | {row['color']} | {row['shape']} | {row['both']} |" for title, row in rows.items()
    )
    text = CARD.format(
        training_crops=training_crops,
        table=table,
        colors=", ".join(COLOR_NAMES),
        shapes=", ".join(SHAPE_NAMES),
        held_out=", ".join(f"{c} {s}" for c, s in sorted(vocabulary.HELD_OUT)),
        scenes=CARD_SCENES,
        seeds=f"{CARD_SEED} and {CARD_SEED + 1}",
        parameters=model.parameter_count / 1e6,
    )
    (out / "README.md").write_text(text, encoding="utf-8")
    return text


def main() -> None:
    """Command line: see ``python -m gem_lite.pretrain_clip --help``."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0],
        epilog="example: python -m gem_lite.pretrain_clip --scenes 2000 --epochs 5 --out data/clip-tabletop",
    )
    parser.add_argument("--scenes", type=int, default=2000, help="training scenes to render (default 2000)")
    parser.add_argument("--epochs", type=int, default=5, help="passes over the crops (default 5)")
    parser.add_argument("--seed", type=int, default=0, help="seed of scenes, captions and weights (default 0)")
    parser.add_argument("--out", type=Path, default=clip.EMBEDDED, help="folder to write (default the embedded CLIP's)")
    parser.add_argument("--run", type=Path, default=Path("runs/pretrain_clip"), help="folder for crops and resuming")
    args = parser.parse_args()
    args.run.mkdir(parents=True, exist_ok=True)
    start = time.time()
    cache = args.run / f"crops-{args.scenes}-{args.seed}.npz"
    if cache.exists():
        crops = Crops(**np.load(cache))
    else:
        crops = render_crops(args.scenes, args.seed)
        partial = cache.with_suffix(".tmp.npz")
        np.savez(partial, images=crops.images, color=crops.color, shape=crops.shape)
        os.replace(partial, cache)
    print(f"{len(crops)} crops, {(crops.color < 0).mean():.0%} of them bare table")
    model, tokenizer = train(crops, args.epochs, args.seed, args.run)
    save(model, tokenizer, args.out)
    print(f"wrote {args.out} after {time.time() - start:.0f} s")
    loaded = clip.load(args.out)
    fresh = render_crops(CARD_SCENES, CARD_SEED)
    rows = {
        "all": accuracy(loaded, fresh),
        "blocks and bowls": accuracy(loaded, chosen(fresh, lambda c, s: s in ("block", "bowl"))),
        "pairs that training never showed": accuracy(
            loaded, chosen(render_crops(CARD_SCENES, CARD_SEED + 1, held_out=True), lambda *p: p in vocabulary.HELD_OUT)
        ),
    }
    card = write_card(args.out, rows, len(crops), loaded)
    print(card)


if __name__ == "__main__":
    main()
