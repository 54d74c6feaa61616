"""``gem-lite clip calibrate``."""

from __future__ import annotations


def calibrate(clip: str, /) -> None:
    """Measure the scale of a CLIP's scores and its retrieval threshold on rendered scenes, and save them.

    Args:
        clip: Hugging Face name or folder of a CLIP

    Examples:
      gem-lite clip calibrate openai/clip-vit-base-patch32
    """
    from gem_lite.clip import calibration, load
    from gem_lite.evaluation import calibrating

    model = load(clip)
    numbers = calibrating.calibrate(model, calibrating.rendered_scenes())
    print(f"{numbers}\nwrote {calibration.write(model, numbers)}")
