"""``gem-lite clip calibrate``."""

from __future__ import annotations


def calibrate(clip: str, /) -> None:
    """Measure the scales of a CLIP's scores and its retrieval threshold on rendered scenes, and save them.

    One scale is for patches, one for the map source "dense".

    Args:
        clip: Hugging Face name or folder of a CLIP

    Examples:
      gem-lite clip calibrate openai/clip-vit-base-patch32
    """
    from typing import get_args

    from gem_lite.clip import calibration, load
    from gem_lite.evaluation import calibrating

    model = load(clip)
    for kind in get_args(calibration.Kind):
        numbers = calibrating.calibrate(model, calibrating.rendered_scenes(), kind=kind)
        print(f"{numbers}\nwrote {calibration.write(model, numbers, kind)}")
