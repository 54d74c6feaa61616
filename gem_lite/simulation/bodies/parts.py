"""The named parts of everyday objects, and the colours of materials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from trimesh import Trimesh

RGBA = tuple[float, float, float, float]
METAL: RGBA = (0.66, 0.67, 0.70, 1.0)
DARK: RGBA = (0.14, 0.14, 0.15, 1.0)
PALE: RGBA = (0.93, 0.90, 0.84, 1.0)
LEAF: RGBA = (0.25, 0.50, 0.22, 1.0)
WOOD: RGBA = (0.50, 0.36, 0.25, 1.0)
BROWNS: tuple[RGBA, ...] = ((0.918, 0.688, 0.559, 1.0), (0.612, 0.459, 0.373, 1.0), (0.306, 0.229, 0.186, 1.0))
"""Three plates, from light to dark."""


@dataclass(frozen=True)
class Part:
    """One part: its ``name`` ("" if it has none), its mesh, and its own RGBA (None: the object's colour)."""

    name: str
    mesh: Trimesh
    rgba: RGBA | None = None


Vary = Callable[[], float]
"""Returns a random factor near 1. The factors differ from variant to variant."""
