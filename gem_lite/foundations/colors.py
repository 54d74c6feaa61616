"""Colour names, their RGB values, and CLIPort's seen / unseen sets."""

from __future__ import annotations

RGB: dict[str, tuple[int, int, int]] = {
    "blue": (78, 121, 167),
    "red": (255, 87, 89),
    "green": (89, 169, 79),
    "orange": (242, 142, 43),
    "yellow": (237, 201, 72),
    "purple": (176, 122, 161),
    "pink": (255, 157, 167),
    "cyan": (118, 183, 178),
    "brown": (156, 117, 95),
    "white": (255, 255, 255),
    "gray": (186, 176, 172),
}
"""The colours of the bodies, 0-255. Distractors take them in this order."""

OTHERS: dict[str, tuple[int, int, int]] = {
    "lime": (165, 235, 45),
    "magenta": (205, 35, 150),
    "light brown": (234, 175, 143),
}
"""Colours that no body of a task has by chance. The embedded CLIP knows their names, too."""

SEEN: tuple[str, ...] = ("blue", "red", "green", "yellow", "brown", "gray", "cyan")
UNSEEN: tuple[str, ...] = ("blue", "red", "green", "orange", "purple", "pink", "white")
NEW: tuple[str, ...] = tuple(name for name in UNSEEN if name not in SEEN)
"""Colours that no demonstration names."""

TABLE = (51, 51, 51)
"""The dark grey sheet that marks the workspace."""


def rgba(name: str) -> tuple[float, float, float, float]:
    """The RGBA of a named colour, of `RGB` or `OTHERS`, in [0, 1], as PyBullet needs it."""
    r, g, b = (RGB | OTHERS)[name]
    return r / 255, g / 255, b / 255, 1.0
