"""``gem-lite clip calibrate``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite.cli.command import Command

# Each command imports what it runs: torch takes seconds to load, and the help needs none of it.


@dataclass(frozen=True, kw_only=True)
class Calibrate(Command):
    """Measure the scale of a CLIP's scores and its retrieval threshold on rendered scenes, and save them."""

    examples: ClassVar[tuple[str, ...]] = ("gem-lite clip calibrate openai/clip-vit-base-patch32",)

    clip: Positional[str]
    """Hugging Face name or folder of a CLIP"""

    @override
    def run(self) -> None:
        from gem_lite import clip
        from gem_lite.clip import calibration
        from gem_lite.learning import calibrating

        model = clip.load(self.clip)
        numbers = calibrating.calibrate(model, calibrating.rendered_scenes())
        print(f"{numbers}\nwrote {calibration.write(model, numbers)}")
