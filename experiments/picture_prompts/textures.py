"""Patterns that bodies wear: plain colours, stripes, dots, swirls, paisleys and ten others, drawn as small pictures.

The names and their sets are those of VIMABench's visual manipulation (its 49 textures that are not "dark"). The
pictures are our own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
import pybullet as p

from gem_lite.foundations import colors
from gem_lite.rgbd import png
from gem_lite.simulation.bodies.shapes import TEXTURE_SIDE, Body

PIXELS = 128
"""A picture has so many rows and columns. It covers `shapes.TEXTURE_SIDE` metres, and then begins again."""
Color = Sequence[float]
"""RGB, 0-255."""
PLAIN: dict[str, Color] = {
    name: colors.RGB[name] for name in ("blue", "red", "green", "orange", "yellow", "purple", "pink", "cyan")
} | {"olive": (128, 128, 0)}  # fmt: skip
BLACK, WHITE = (20, 20, 20), (240, 240, 240)
_AXIS = (np.arange(PIXELS) + 0.5) / PIXELS * TEXTURE_SIDE
_X, _Y = np.meshgrid(_AXIS, _AXIS)
"""The place (m) of each pixel in its picture. All patterns repeat after `TEXTURE_SIDE`."""


def _blend(share: np.ndarray | float, first: Color, second: Color) -> np.ndarray:
    """``first`` where the share (H, W) is 0, ``second`` where it is 1: (H, W, 3) floats, 0-255."""
    mixed = np.broadcast_to(share, _X.shape)[..., None]
    return (1 - mixed) * np.array(first) + mixed * np.array(second)


def _cells(side: float, above: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The place (m) of each pixel from the middle of its square cell. Every second row is moved by half a cell.

    Args:
        above: the cells lie so much (m) higher.
    """
    y = _Y + above
    x = _X + side / 2 * (np.floor(y / side) % 2)
    return x % side - side / 2, y % side - side / 2


def _waves(seed: int, slowest: int, fastest: int, count: int = 40) -> np.ndarray:
    """A smooth random surface (H, W) in about [-1, 1]: waves with this many periods in the picture."""
    rng = np.random.default_rng(seed)
    total = np.zeros(_X.shape)
    for _ in range(count):
        angle = rng.uniform(0, 2 * np.pi)
        periods = rng.uniform(slowest, fastest)
        across, along = round(periods * np.cos(angle)), round(periods * np.sin(angle))  # Whole: the picture repeats.
        total += np.sin(2 * np.pi * (across * _X + along * _Y) / TEXTURE_SIDE + rng.uniform(0, 2 * np.pi))
    return total / (2 * total.std())


def _stripes(first: Color, second: Color) -> np.ndarray:
    return _blend(_X % 0.04 < 0.02, first, second)


def _dots(ground: Color, dot: Color) -> np.ndarray:
    x, y = _cells(0.032)
    return _blend(np.hypot(x, y) < 0.0105, ground, dot)


def _swirl(color: Color) -> np.ndarray:
    """White spirals on a colour."""
    x, y = _cells(0.08, above=0.04)  # So that the edges of a frame go through spirals.
    radius = np.hypot(x, y)
    arm = np.sin(2 * np.arctan2(y, x) + radius / 0.0045) > 0.2
    return _blend(arm & (radius < 0.042), color, WHITE)


def _paisley(color: Color) -> np.ndarray:
    """Bent drops of a colour with a pale eye, on a pale ground."""
    x, y = _cells(0.04)
    x = x + 18 * y**2 * (y > -0.005) - 0.002  # The tip bends.
    half_width = 0.013 * np.sqrt(np.clip((y + 0.018) / 0.012, 0, 1)) * np.clip((0.018 - y) / 0.024, 0, 1) ** 0.8
    drop = np.abs(x) < half_width
    eye = np.hypot(x, y + 0.007) < 0.0045
    pale = 0.25 * np.array(color) + 0.75 * np.array(WHITE)
    return np.where(eye[..., None], pale, _blend(drop, pale, 0.85 * np.array(color)))


def _brick() -> np.ndarray:
    row = np.floor(_Y / 0.02)
    along = (_X + 0.02 * (row % 2)) % 0.04
    mortar = (along < 0.0045) | (_Y % 0.02 < 0.0045)
    return _blend(mortar, (150, 62, 45), (205, 195, 180))


def _tiles() -> np.ndarray:
    grout = (_X % 0.04 < 0.005) | (_Y % 0.04 < 0.005)
    return _blend(grout, (120, 165, 200), (235, 240, 240))


def _wooden() -> np.ndarray:
    rings = np.sin(2 * np.pi * (16 * _Y / TEXTURE_SIDE + 0.8 * _waves(1, 1, 3)))
    return _blend((rings + 1) / 2, (122, 78, 42), (190, 138, 85))


def _granite() -> np.ndarray:
    grain = _waves(2, 20, 50, 150)
    gray = _blend(np.clip(0.5 + grain, 0, 1), (95, 95, 100), (200, 198, 195))
    return np.where((grain < -0.75)[..., None], 30, gray)


def _plastic() -> np.ndarray:
    """A smooth ribbed sheet."""
    rib = (1 + np.sin(2 * np.pi * (_X + _Y) / 0.02)) / 2
    return _blend(rib**3, (95, 200, 165), (205, 250, 235))


def _checkerboard() -> np.ndarray:
    return _blend((np.floor(_X / 0.02) + np.floor(_Y / 0.02)) % 2, BLACK, WHITE)


def _tiger() -> np.ndarray:
    bands = np.sin(2 * np.pi * (10 * _Y / TEXTURE_SIDE + 0.7 * _waves(3, 1, 4)))
    return _blend(bands + 0.4 * _waves(4, 4, 9) > 0.35, (225, 130, 35), BLACK)


def _magma() -> np.ndarray:
    """Glowing cracks in black rock."""
    crack = np.clip(1 - np.abs(_waves(5, 3, 9)) / 0.22, 0, 1)
    glow = _blend(crack, (250, 60, 0), (255, 225, 90))
    return np.where((crack > 0.55)[..., None], glow, _blend(crack, BLACK, (190, 20, 0)))


def _rainbow() -> np.ndarray:
    bands = np.array([(228, 45, 45), (250, 145, 35), (250, 225, 50), (70, 175, 75), (55, 105, 205), (140, 70, 170)])
    return bands[np.floor((_X + _Y) / (0.08 / 6) % 6).astype(int)].astype(float)


def _pairs(kind: str, draw: Callable[[Color, Color], np.ndarray]) -> dict[str, Callable[[], np.ndarray]]:
    """A two-coloured pattern in the ten pairs of five colours."""
    names = ("red", "yellow", "green", "blue", "purple")
    return {
        f"{first} and {second} {kind}": partial(draw, PLAIN[first], PLAIN[second])
        for number, first in enumerate(names)
        for second in names[number + 1 :]
    }


def _singles(kind: str, draw: Callable[[Color], np.ndarray]) -> dict[str, Callable[[], np.ndarray]]:
    return {f"{name} {kind}": partial(draw, PLAIN[name]) for name in ("red", "yellow", "green", "blue", "purple")}


_MAKERS: dict[str, Callable[[], np.ndarray]] = {
    **{name: partial(_blend, 0.0, color, color) for name, color in PLAIN.items()},
    "brick": _brick, "tiles": _tiles, "wooden": _wooden, "granite": _granite, "plastic": _plastic,
    "polka dot": partial(_dots, WHITE, BLACK), "checkerboard": _checkerboard, "tiger": _tiger, "magma": _magma,
    "rainbow": _rainbow,
    **_pairs("stripe", _stripes), **_pairs("polka dot", _dots), **_singles("swirl", _swirl),
    **_singles("paisley", _paisley),
}  # fmt: skip
NAMES = tuple(_MAKERS)
"""All 49."""
W = (
    "red", "green", "yellow", "granite", "polka dot", "tiger", "rainbow", "red and yellow stripe",
    "yellow and green stripe", "red and yellow polka dot", "red and green polka dot", "red and blue polka dot",
    "yellow and blue polka dot", "green and blue polka dot", "red swirl", "green swirl", "red paisley",
    "yellow paisley", "green paisley",
)  # fmt: skip
"""VIMABench's set W: in training, what is dragged wears one of these."""
C = (
    "blue", "purple", "cyan", "olive", "tiles", "wooden", "plastic", "checkerboard", "red and blue stripe",
    "yellow and blue stripe", "red and purple stripe", "yellow and purple stripe", "green and purple stripe",
    "blue and purple stripe", "yellow and purple polka dot", "green and purple polka dot",
    "blue and purple polka dot", "purple swirl", "blue swirl", "blue paisley",
)  # fmt: skip
"""VIMABench's set C: in training, containers wear one of these."""


@cache
def picture(name: str) -> np.ndarray:
    """A texture, (`PIXELS`, `PIXELS`, 3) uint8. Nobody may write into it.

    Raises:
        ValueError: no texture has this name.
    """
    if name not in _MAKERS:
        raise ValueError(f"no texture is named {name!r}; the names are {', '.join(NAMES)}")
    drawn = np.round(_MAKERS[name]()).astype(np.uint8)
    drawn.flags.writeable = False
    return drawn


def dress(client: int, body: Body, name: str) -> Body:
    """Give a white body a texture. Returns the body. Raises ValueError if no texture has this name."""
    content = png.encode(picture(name))
    with tempfile.TemporaryDirectory() as folder:  # PyBullet reads textures from files only.
        path = Path(folder) / "texture.png"
        path.write_bytes(content)
        texture = p.loadTexture(str(path), physicsClientId=client)
    p.changeVisualShape(body.id, -1, textureUniqueId=texture, physicsClientId=client)
    return body
