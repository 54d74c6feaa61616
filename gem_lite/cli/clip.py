"""``gem-lite clip``: make an embedded CLIP, write its card, and calibrate any CLIP."""

from __future__ import annotations

from pathlib import Path

from gem_lite.cli.base import continues


def pretrain(
    *,
    scenes: int = 3200,
    epochs: int = 7,
    seed: int = 0,
    out: Path = Path("runs/clip-tabletop"),
    state: Path = Path("runs/pretrain_clip"),
) -> None:
    """Train the embedded CLIP on captions and crops that this project renders itself.

    A stopped training continues.

    Args:
        scenes: training scenes to render
        epochs: passes over the crops
        seed: seed of scenes, captions and weights
        out: folder to write: a new one, or one with an embedded CLIP, which is replaced
        state: folder for the crops and for the state to resume from

    Examples:
      gem-lite clip pretrain --scenes 3200 --epochs 7 --out runs/clip-tabletop
    """
    from experiments.clip_tabletop import pretrain

    with continues(f"the last epoch in {state}"):
        print(pretrain.pretrain(out, state, scenes, epochs, seed))


def card(folder: Path, /, *, training_crops: int) -> None:
    """Measure an embedded CLIP on fresh scenes and write its card, README.md of its folder (some minutes).

    Args:
        folder: the CLIP, as `gem-lite clip pretrain` writes it
        training_crops: number of crops of its training, for the card

    Examples:
      gem-lite clip card data/clip-tabletop --training-crops 806689
    """
    from experiments.clip_tabletop import card
    from gem_lite import clip

    print(card.write(folder, clip.load(folder), training_crops))


def calibrate(clip: str, /) -> None:
    """Measure the scale of a CLIP's scores and its retrieval threshold on rendered scenes, and save them.

    Args:
        clip: Hugging Face name or folder of a CLIP

    Examples:
      gem-lite clip calibrate openai/clip-vit-base-patch32
    """
    from gem_lite.clip import calibration, load
    from gem_lite.learning import calibrating

    model = load(clip)
    numbers = calibrating.calibrate(model, calibrating.rendered_scenes())
    print(f"{numbers}\nwrote {calibration.write(model, numbers)}")
