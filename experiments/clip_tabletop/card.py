"""What the embedded CLIP can and cannot do, measured on fresh scenes and written on its card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.clip_tabletop import basic_solids, vocabulary
from experiments.clip_tabletop.crops import PART_KEYS, Crops, render_crops
from experiments.clip_tabletop.scenes import COLOR_NAMES, NOUN_NAMES
from experiments.clip_tabletop.withheld import NOTHING, Withheld
from gem_lite.clip import Clip
from gem_lite.simulation.bodies import objects, shapes

SEED = 1_000_003
"""The seeds of the card's scenes are this one and the next two. Training and other tests use other seeds."""
SCENES = {"test": 100, "held-out": 60, "foreign": 25}

GROUPS: dict[str, tuple[str, ...]] = {
    "blocks and bowls": ("block", "bowl"),
    "solids (L-block, box, plate, ball, cylinder, cone)": ("L-block", *basic_solids.BASIC),
    "the 20 kitting shapes": shapes.SEEN_SHAPES + shapes.UNSEEN_SHAPES,
    "other letters and digits": vocabulary.GLYPHS,
    "everyday objects": objects.NAMES,
    "tiles with a letter or a digit": tuple(vocabulary.TILES),
    "blocks and towels with a pattern": vocabulary.TEXTURED,
    "boxes with a symbol": tuple(vocabulary.BOXES),
    "holes of a kit": tuple(vocabulary.HOLES),
    "kit, stand, rope, guide, pile": tuple(vocabulary.STRUCTURES),
}

CARD = """# The embedded CLIP

A small image-text model in the Hugging Face format (a residual convolutional image tower, a two-layer text tower,
{parameters:.1f} M parameters), trained by `python -m experiments.clip_tabletop pretrain` on {training_crops} crops
of scenes that it renders in PyBullet, with captions written by `experiments/clip_tabletop/vocabulary.py`. It stands in
for OpenAI's CLIP where there is no network; it is a different, far smaller model, and no figure made with it is one of
OpenAI's CLIP. This card is written by the same command.
{experiment}
## What it can do

Zero-shot accuracy in percent, on crops of scenes that no training and no calibration saw (seeds {seeds}, {scenes}
scenes), the everyday objects in proportions that training never showed. A crop is compared with every colour ("red
thing"), every shape or object ("a block"), or every pair of both ("red block"); chance is {chance}. A
column is empty where no colour has a name.

Crops that frame one object:

| crops of | crops | colour of {colors_count} | shape or object of {shapes_count} | pair of {pairs_count} |
|---|---|---|---|---|
{whole}

The same crops by another wording: colours and nouns replaced by synonyms where there are any ("scarlet cube").

| crops of | crops | colour | shape or object | pair |
|---|---|---|---|---|
{synonyms}

Patches as semantic maps cut them, anywhere on an object, many showing a piece of it:

| crops of | crops | colour | shape or object | pair |
|---|---|---|---|---|
{patches}

Parts: of patches that show mostly one named part ("mug handle"), {part_all} % are named right among all
{parts_count} parts, and {part_own} % among the parts of the object ({part_crops} crops).

The shapes it names worst in crops that frame them: {worst}.

Words it never read: the text tower puts {unread_colors} words for its colours ("{unread_color} block") and
{unread_nouns} words for its objects ("a {unread_noun}") nearest to what they mean, among all {colors_count} colours and
all {shapes_count} shapes and objects.

## What it was shown

Colours: {colors}. Shapes and objects: {shapes}. Parts such as {parts}. Synonyms such as "scarlet" and "cube", plurals
and several templates are in its captions; so are {unpictured} nouns that no picture goes with ("sofa"), which teach it
that an unknown thing is none of those it knows. About a third of training's bodies had any colour at all and captions
that name the shape alone. Views: jittered copies of the table's three cameras and the fused height map; light, table
and floor vary. These pairs were in no picture and no caption: {held_out}.

The blocks, the bowls and the kitting pieces of the tasks are the very meshes of its training, in other scenes; so are
those of this card's tests. Only the everyday objects of tests have proportions of their own. Its success with blocks,
bowls and pieces says nothing about other blocks, bowls and pieces.

## Limits

"Open vocabulary", the paper's word, holds here for the words of its captions and their combinations, also for pairs
that were never shown; it ends there. A word it never read is split into known pieces of words and lands anywhere, often
near a wrong thing and sometimes with a high score: the numbers are above.

It knows nothing beyond this renderer: objects that others modelled (pybullet_data's mug and duck) are named worse than
its own, and pictures of the real world are beyond it. Pieces whose outlines are alike from the side are confused
(square and diamond), and so are patches that show a corner of something.
"""

EXPERIMENT = """
**This one is an experiment (`--withhold {name}`): no caption names {phrases}.** A tile or piece with such a letter was
captioned by its colour alone, such a part by its object. What this card says about them is about words it never read.
"""


def accuracy(model: Clip, crops: Crops, synonyms: bool = False) -> dict[str, float]:
    """Zero-shot accuracy (0-100) on crops: noun among all; colour, and both at once, where the colour has a name.

    With ``synonyms``, each colour and noun is named by its last synonym instead of its plain name. A share of no crops
    is nan.
    """
    crops = crops.select(crops.shape >= 0)
    colored = crops.color >= 0
    image = model.embed_images(crops.images).cpu()
    colors = [names[-1 if synonyms else 0] for names in vocabulary.COLORS.values()]
    nouns = [names[-1 if synonyms else 0] for names in vocabulary.NOUNS.values()]

    def share(phrases: Sequence[str], truth: np.ndarray, rows: np.ndarray) -> float:
        if not rows.any():
            return float("nan")
        guess = (image[rows] @ model.embed_texts(phrases).cpu().T).argmax(dim=1).numpy()
        return round(100 * float((guess == truth[rows]).mean()), 1)

    named = [vocabulary.named(color, noun) for color in colors for noun in nouns]
    return {
        "color": share([f"{name} thing" for name in colors], crops.color, colored),
        "shape": share([f"a {vocabulary.named('', noun)}" for noun in nouns], crops.shape, np.full(len(crops), True)),
        "both": share(named, crops.color * len(nouns) + crops.shape, colored),
        "crops": len(crops),
    }


def part_accuracy(model: Clip, crops: Crops) -> dict[str, float]:
    """Accuracy (0-100) of naming the part that a crop shows, among all parts and among its object's own."""
    crops = crops.select(crops.part >= 0)
    words = model.embed_texts([f"{noun} {part}" for noun, part in PART_KEYS]).cpu()
    scores = (model.embed_images(crops.images).cpu() @ words.T).numpy()
    shape_of_part = np.array([NOUN_NAMES.index(noun) for noun, _ in PART_KEYS])
    own = np.where(shape_of_part[None] == crops.shape[:, None], scores, -np.inf)
    return {
        "all": round(100 * float((scores.argmax(axis=1) == crops.part).mean()), 1),
        "own": round(100 * float((own.argmax(axis=1) == crops.part).mean()), 1),
        "crops": len(crops),
    }


def unread_words(model: Clip, words: dict[str, tuple[str, ...]], plain: Sequence[str], template: str) -> list[bool]:
    """For each word that is in no caption: whether the plain name with its meaning is the nearest to its embedding.

    Args:
        words: the words by the plain name with their meaning.
        plain: all plain names.
        template: a phrase with a place ``{}`` for the word.
    """
    names = model.embed_texts([template.format(name) for name in plain])
    unread = model.embed_texts([template.format(word) for group in words.values() for word in group])
    truth = [name for name, group in words.items() for _ in group]
    return [plain[nearest] == name for nearest, name in zip((unread @ names.T).argmax(dim=1), truth, strict=True)]


def _of(crops: Crops, names: Sequence[str]) -> Crops:
    return crops.select(np.isin(crops.shape, [NOUN_NAMES.index(name) for name in names]))


def _held_out(crops: Crops) -> Crops:
    pairs = zip(crops.color, crops.shape, strict=True)
    held_out = [c >= 0 and (COLOR_NAMES[c], NOUN_NAMES[s]) in vocabulary.HELD_OUT for c, s in pairs]
    return crops.select(np.array(held_out))


def _rows(test: Crops, held_out: Crops, foreign: Crops) -> dict[str, Crops]:
    return {
        "**all**": test,
        **{title: _of(test, names) for title, names in GROUPS.items()},
        "pybullet_data's own mug and duck": _of(foreign, ("mug", "duck")),
        f"the {len(vocabulary.HELD_OUT)} pairs that training never showed": _held_out(held_out),
    }


def _table(model: Clip, rows: dict[str, Crops], synonyms: bool = False) -> str:
    lines = []
    for title, crops in rows.items():
        shares = accuracy(model, crops, synonyms)
        values = [str(shares[key]).replace("nan", "") for key in ("color", "shape", "both")]
        lines.append(f"| {title} | {shares['crops']} | {' | '.join(values)} |")
    return "\n".join(lines)


def _worst(model: Clip, crops: Crops, count: int = 6) -> str:
    shown = [NOUN_NAMES[index] for index in np.unique(crops.shape[crops.shape >= 0])]
    shares = {name: accuracy(model, _of(crops, [name]))["shape"] for name in shown}
    return ", ".join(f"{name} ({shares[name]:.0f} %)" for name in sorted(shares, key=shares.get)[:count])


def write(out: Path, model: Clip, training_crops: int, withheld: Withheld = NOTHING) -> str:
    """Measure a model and write its card, README.md of its folder; returns the text."""
    kinds = {kind: render_crops(scenes, SEED + i, kind) for i, (kind, scenes) in enumerate(SCENES.items())}
    whole = {title: crops.select(crops.whole) for title, crops in _rows(*kinds.values()).items()}
    patches = {title: crops.select(~crops.whole) for title, crops in _rows(*kinds.values()).items()}
    parts = part_accuracy(model, kinds["test"].select(~kinds["test"].whole))
    pairs = len(COLOR_NAMES) * len(NOUN_NAMES)
    unread_colors = unread_words(model, vocabulary.UNREAD_COLORS, COLOR_NAMES, "{} block")
    unread_nouns = unread_words(model, vocabulary.UNREAD_NOUNS, NOUN_NAMES, "a {}")
    phrases = ", ".join(withheld.phrases)
    shown_nouns = [name for name in NOUN_NAMES if not withheld.names(name)]
    shown_parts = [key for key in PART_KEYS if not withheld.names(*key)]
    text = CARD.format(
        experiment=EXPERIMENT.format(name=withheld.name, phrases=phrases) if phrases else "",
        parameters=model.parameter_count / 1e6,
        training_crops=training_crops,
        seeds=f"{SEED} to {SEED + len(SCENES) - 1}",
        scenes=sum(SCENES.values()),
        chance=f"{100 / len(COLOR_NAMES):.1f}, {100 / len(NOUN_NAMES):.1f} and {100 / pairs:.1f}",
        colors_count=len(COLOR_NAMES),
        shapes_count=len(NOUN_NAMES),
        pairs_count=pairs,
        whole=_table(model, whole),
        synonyms=_table(model, {title: whole[title] for title in list(whole)[:2]}, synonyms=True),
        patches=_table(model, patches),
        part_all=parts["all"],
        part_own=parts["own"],
        part_crops=parts["crops"],
        parts_count=len(PART_KEYS),
        unread_color=vocabulary.UNREAD_COLORS["blue"][0],
        unread_colors=f"{sum(unread_colors)} of {len(unread_colors)}",
        unread_noun=vocabulary.UNREAD_NOUNS["block"][0],
        unread_nouns=f"{sum(unread_nouns)} of {len(unread_nouns)}",
        worst=_worst(model, whole["**all**"]),
        colors=", ".join(COLOR_NAMES),
        shapes=", ".join(name.replace("{} ", "") for name in shown_nouns),
        parts=", ".join(f'"{noun} {part}"' for noun, part in shown_parts[:6]),
        unpictured=len(vocabulary.NOUNS_WITHOUT_PICTURES),
        held_out=", ".join(f"{c} {s}" for c, s in sorted(vocabulary.HELD_OUT)),
    )
    (out / "README.md").write_text(text, encoding="utf-8")
    return text
