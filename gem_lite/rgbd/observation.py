"""What a policy sees."""

from __future__ import annotations

from dataclasses import dataclass

from gem_lite.rgbd.camera import View


@dataclass(frozen=True)
class Observation:
    """All that a policy gets to see: RGB-D views of the table. No mask, no pose, no render from above."""

    views: tuple[View, ...]
