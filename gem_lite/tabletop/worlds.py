"""The looks of worlds by name. A stub: it only has the shape of what will stand here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WorldStyle:
    """How a world looks."""

    name: str


WORLDS = {
    name: WorldStyle(name)
    for name in ("home", "varied", "other-containers", "white-floor", "shadows", "touching", "bright-light")
}
