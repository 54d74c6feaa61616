"""Train the embedded CLIP further, on the symbol boxes of object-sorting. The result is a second embedded CLIP.

The first one is kept, because a policy needs the CLIP that it was trained with.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import torch

from gem_lite import clip
from gem_lite.clip import Clip, calibration
from gem_lite.clip.resnet_clip import ResNetClip
from gem_lite.clip_training import clip_card, pretrain_clip, vocabulary
from gem_lite.clip_training.clip_crops import NOUN_NAMES, SHAPE_NAMES, Crops, render_crops, rendered_crops
from gem_lite.learning import calibrating

OUT = clip.DATA / "clip-sorting"
LEARNING_RATE = 5e-4
"""A quarter of the first training's rate, so that the model does not forget."""

CARD = """# The embedded CLIP for object-sorting

`data/clip-tabletop` trained further by `gem-lite clip extend` on {crops} crops of
{scenes} scenes, in which every fifth body is a box with a symbol on its floor: {boxes}.
Weights are stored in half precision. What the other card says of it, and of what it is not (OpenAI's), holds here,
too. This card is written by the same command.

Zero-shot accuracy in percent on fresh scenes (seed {seed}, {test_scenes} scenes, other proportions), each crop
compared with the plain names of all {nouns} shapes, objects and symbol boxes:

| crops of | crops | before | after |
|---|---|---|---|
{rows}
"""


def accuracy(model: Clip, crops: Crops) -> float:
    """Share (0-100) of crops whose shape, object or symbol box is named right among all of them."""
    words = model.embed_texts([f"a {names[0]}" for names in vocabulary.NOUNS.values()]).cpu()
    guess = (model.embed_images(crops.images).cpu() @ words.T).argmax(dim=1).numpy()
    return 100 * float((guess == crops.shape).mean())


def write_card(out: Path, before: Clip, after: Clip, crops: int, scenes: int, test_scenes: int) -> str:
    """Measure both models and write README.md of the new one's folder; returns the text."""
    test = render_crops(test_scenes, clip_card.SEED + 10, "sorting-test")
    boxed = test.shape >= len(SHAPE_NAMES)
    groups = {
        "symbol boxes, framed": test.select(boxed & test.whole),
        "symbol boxes, patches anywhere on them": test.select(boxed & ~test.whole),
        "shapes and objects, framed": test.select(~boxed & (test.shape >= 0) & test.whole),
        "shapes and objects, patches": test.select(~boxed & (test.shape >= 0) & ~test.whole),
    }
    rows = [
        f"| {title} | {len(part)} | {accuracy(before, part):.1f} | {accuracy(after, part):.1f} |"
        for title, part in groups.items()
    ]
    text = CARD.format(
        crops=crops, scenes=scenes, boxes=", ".join(vocabulary.BOXES), seed=clip_card.SEED + 10,
        test_scenes=test_scenes, nouns=len(NOUN_NAMES), rows="\n".join(rows),
    )  # fmt: skip
    (out / "README.md").write_text(text, encoding="utf-8")
    return text


def extend(out: Path, run: Path, scenes: int, epochs: int, seed: int) -> str:
    """Render crops; train, save, calibrate and measure the second embedded CLIP. Returns its card and its numbers.

    Args:
        out: folder to write.
        run: folder for the crops and for the state to resume from.

    Raises:
        ValueError: ``scenes`` or ``epochs`` below 1, or see `pretrain_clip.train`.
    """
    pretrain_clip.check_size(scenes, epochs)
    start = time.time()
    crops = rendered_crops(run, scenes, seed, "sorting")
    share = np.mean(crops.shape >= len(SHAPE_NAMES))
    print(f"{len(crops)} crops, {share:.0%} of them symbol boxes")
    before = clip.load(clip.EMBEDDED)
    pretrained = (ResNetClip.from_pretrained(clip.EMBEDDED, dtype=torch.float32), before.tokenizer)
    model, tokenizer = pretrain_clip.train(crops, epochs, seed, run, rate=LEARNING_RATE, pretrained=pretrained)
    pretrain_clip.save(model.half(), tokenizer, out)
    print(f"wrote {out} after {time.time() - start:.0f} s")
    after = clip.load(out)
    calibration.write(after, calibrating.calibrate(after, calibrating.rendered_scenes()))
    return f"{write_card(out, before, after, len(crops), scenes, 60)} {after.calibration}"
