"""The input of a policy."""

from __future__ import annotations

from dataclasses import dataclass

from gem_lite.rgbd.camera import View


@dataclass(frozen=True)
class Observation:
    """All that a policy sees: RGB-D views of the table. It has no mask, no pose and no rendering from above."""

    views: tuple[View, ...]
