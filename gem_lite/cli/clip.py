"""``gem-lite clip calibrate``."""

from __future__ import annotations


def calibrate(clip: str, /, *, scenes: int = 8) -> None:
    """Measure the scales of a CLIP's scores and its retrieval threshold on rendered scenes, and save them.

    One scale is for patches, one for the map source "dense". With a ViT-B/32
    on a CPU, a scene takes some minutes.

    Args:
        clip: Hugging Face name or folder of a CLIP
        scenes: number of scenes; fewer take less time, and give less exact numbers

    Examples:
      gem-lite clip calibrate openai/clip-vit-base-patch32
    """
    from gem_lite.clip import calibration, load
    from gem_lite.evaluation import calibrating

    if scenes < 1:
        raise ValueError(f"--scenes must be 1 or more, got {scenes}")
    model = load(clip)
    for kind, numbers in calibrating.calibrations(model, scenes):
        print(f"{numbers}\nwrote {calibration.write(model, numbers, kind)}")
