"""Everyday objects with named parts, made of a few trimesh solids each: a mug has a handle, a hammer a head.

An object comes in endless variants, which differ in their proportions. The embedded CLIP was trained on
`TRAINING_VARIANTS`; tests use others. Lengths are in metres; an object lies along x, on z = 0, and is at
most about 0.11 m long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pybullet as p
import trimesh
from shapely import affinity
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union
from trimesh import Trimesh

from gem_lite.se2 import Pose2, quaternion
from gem_lite.simulation.shapes import Body, create_compound, triangles

TRAINING_VARIANTS = 12
"""Variants 0 .. 11 trained the embedded CLIP; it never saw a later one."""

RGBA = tuple[float, float, float, float]
METAL: RGBA = (0.66, 0.67, 0.70, 1.0)
DARK: RGBA = (0.14, 0.14, 0.15, 1.0)
PALE: RGBA = (0.93, 0.90, 0.84, 1.0)
LEAF: RGBA = (0.25, 0.50, 0.22, 1.0)
WOOD: RGBA = (0.50, 0.36, 0.25, 1.0)


@dataclass(frozen=True)
class Part:
    """One part: its ``name`` ("" for what has none), its mesh, and its own RGBA (None: the object's colour)."""

    name: str
    mesh: Trimesh
    rgba: RGBA | None = None


Vary = Callable[[], float]
"""A factor near 1 that differs from variant to variant."""


def _bar(x0: float, x1: float, width: float, z0: float, z1: float, y: float = 0.0) -> Trimesh:
    return trimesh.creation.box(bounds=[[x0, y - width / 2, z0], [x1, y + width / 2, z1]])


def _rod(a: tuple, b: tuple, radius: float) -> Trimesh:
    return trimesh.creation.cylinder(radius, segment=[a, b], sections=14)


def _ball(centre: tuple, radii: float | tuple) -> Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    mesh.apply_scale(np.broadcast_to(radii, 3))
    mesh.apply_translation(centre)
    return mesh


def _slab(outline: Polygon, z0: float, z1: float) -> Trimesh:
    return trimesh.util.concatenate(
        [
            trimesh.creation.extrude_polygon(piece, z1 - z0).apply_translation([0, 0, z0])
            for piece in getattr(outline, "geoms", [outline])
        ]
    )


def _turned(profile: list, lying: bool = False) -> Trimesh:
    """A solid of revolution from (radius, height) points; ``lying`` puts its axis along x."""
    mesh = trimesh.creation.revolve(np.array(profile), sections=20)
    if lying:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    return mesh


def _tube(points: np.ndarray, radius: float | np.ndarray) -> Trimesh:
    radii = np.broadcast_to(radius, len(points))
    rods = [_rod(a, b, (r + s) / 2) for a, b, r, s in zip(points, points[1:], radii, radii[1:], strict=False)]
    return trimesh.util.concatenate(rods)


def _arc(radius: float, start: float, stop: float, centre: tuple, upright: bool = False, count: int = 9) -> np.ndarray:
    """Points on a circle in the table's plane or, ``upright``, in the x-z plane."""
    t = np.linspace(start, stop, count)
    flat = np.stack([np.cos(t), np.sin(t), np.zeros(count)], axis=1)
    return np.array(centre) + radius * (flat[:, [0, 2, 1]] if upright else flat)


def _disc(x: float, y: float, radius: float, hole: float = 0.0) -> Polygon:
    disc = Point(x, y).buffer(radius, 12)
    return disc.difference(Point(x, y).buffer(hole, 12)) if hole else disc


def _mug(v: Vary) -> list[Part]:
    r, h = 0.028 * v(), 0.055 * v()
    body = _turned([(0, 0), (r, 0), (r, h), (r - 0.004, h), (r - 0.004, 0.005), (0, 0.005)])
    brim = _turned([(r - 0.004, h), (r + 0.001, h), (r + 0.001, h + 0.004), (r - 0.004, h + 0.004), (r - 0.004, h)])
    loop = _arc(0.36 * h, -np.pi / 2, np.pi / 2, (r - 0.002, 0, h / 2), upright=True)
    return [Part("", body), Part("brim", brim), Part("handle", _tube(loop * [1, 1, 1], 0.0045 * v()))]


def _hammer(v: Vary) -> list[Part]:
    length, w = 0.095 * v(), 0.016 * v()
    head = [_bar(length / 2 - w, length / 2, 0.052 * v(), 0, 0.018), _bar(length / 2 - w, length / 2, 0.02, 0, 0.024)]
    return [
        Part("handle", _rod((-length / 2, 0, 0.009), (length / 2 - w, 0, 0.009), 0.0065 * v())),
        Part("head", trimesh.util.concatenate(head), METAL),
    ]


def _screwdriver(v: Vary) -> list[Part]:
    r, middle = 0.011 * v(), 0.004 * v()
    handle = _turned([(0, -0.05), (r, -0.046), (r, -0.02), (0.8 * r, -0.015), (r, -0.008), (0.6 * r, middle)], True)
    shaft = [_rod((middle, 0, 0), (0.048, 0, 0), 0.0035 * v()), _bar(0.042, 0.052, 0.009, -0.0015, 0.0015)]
    return [Part("handle", handle), Part("shaft", trimesh.util.concatenate(shaft), METAL)]


def _banana(v: Vary) -> list[Part]:
    radius, half = 0.055 * v(), 0.85 * v()
    arc = _arc(radius, np.pi / 2 - half, np.pi / 2 + half, (0, -radius, 0.013), count=11)
    thickness = 0.0135 * v() * np.sqrt(np.sin(np.linspace(0.35, np.pi - 0.35, 11)))
    crown = _tube(_arc(radius, np.pi / 2 + half, np.pi / 2 + half + 0.28, (0, -radius, 0.013), count=3), 0.0055)
    return [Part("", _tube(arc, thickness)), Part("crown", crown, WOOD)]


def _scissors(v: Vary) -> list[Part]:
    angle, r = 0.24 * v(), 0.014 * v()
    blades, handles = [], []
    for sign in (-1, 1):
        blade = Polygon([(0, -0.005), (0, 0.005), (0.05, 0.0)])
        ring = _disc(-0.038, 0, r, 0.6 * r).union(box(-0.027, -0.004, 0.002, 0.004))
        z = 0.003 if sign > 0 else 0.006
        blades.append(_slab(affinity.rotate(blade, sign * np.degrees(angle), origin=(0, 0)), z - 0.003, z))
        handles.append(_slab(affinity.rotate(ring, sign * np.degrees(angle), origin=(0, 0)), z - 0.003, z + 0.004))
    return [
        Part("blade", trimesh.util.concatenate(blades), METAL),
        Part("handle", trimesh.util.concatenate(handles)),
    ]


def _bottle(v: Vary) -> list[Part]:
    r, neck = 0.019 * v(), 0.028 * v()
    body = _turned([(0, -0.05), (r, -0.048), (r, neck - 0.014), (0.008, neck), (0.008, 0.038), (0, 0.038)], True)
    return [Part("body", body), Part("cap", _rod((0.036, 0, 0), (0.05, 0, 0), 0.0105 * v()), DARK)]


def _spoon(v: Vary) -> list[Part]:
    head = _ball((0.032, 0, 0.006), (0.02 * v(), 0.0135 * v(), 0.006))
    return [Part("head", head), Part("handle", _bar(-0.05, 0.016, 0.006 * v(), 0.002, 0.008))]


def _fork(v: Vary) -> list[Part]:
    w = 0.022 * v()
    tines = [_bar(0.018, 0.05, 0.0035, 0.001, 0.006, y) for y in (-w / 2, -w / 6, w / 6, w / 2)]
    palm = _bar(0.01, 0.02, w + 0.0035, 0.001, 0.006)
    handle = _bar(-0.05, 0.01, 0.006 * v(), 0.001, 0.006)
    return [Part("tines", trimesh.util.concatenate([*tines, palm])), Part("handle", handle)]


def _knife(v: Vary) -> list[Part]:
    w, middle = 0.014 * v(), -0.006 * v()
    blade = Polygon([(middle, -w / 2), (0.052, w / 2), (middle, w / 2)])
    handle = _bar(-0.052, middle, 0.012 * v(), 0, 0.01)
    return [Part("blade", _slab(blade, 0.003, 0.006), METAL), Part("handle", handle)]


def _pan(v: Vary) -> list[Part]:
    r, h = 0.033 * v(), 0.014 * v()
    dish = _turned([(0, 0), (0.85 * r, 0), (r, h), (r - 0.003, h), (0.8 * r, 0.003), (0, 0.003)])
    dish.apply_translation([-0.022, 0, 0])
    return [Part("", dish), Part("handle", _bar(r - 0.024, 0.06, 0.009 * v(), h - 0.006, h), DARK)]


def _spatula(v: Vary) -> list[Part]:
    w = 0.034 * v()
    slots = unary_union([box(0.02, y - 0.002, 0.042, y + 0.002) for y in (-w / 4, 0, w / 4)])
    head = _slab(box(0.012, -w / 2, 0.05, w / 2).difference(slots), 0.002, 0.005)
    return [Part("head", head), Part("handle", _rod((-0.052, 0, 0.005), (0.013, 0, 0.005), 0.0045 * v()), WOOD)]


def _brush(v: Vary) -> list[Part]:
    w = 0.02 * v()
    rows = [_bar(x, x + 0.003, w, 0.008, 0.022 * v()) for x in np.arange(0.008, 0.05, 0.007)]
    back = _slab(box(0.004, -w / 2 - 0.002, 0.054, w / 2 + 0.002), 0, 0.008)
    handle = _bar(-0.052, 0.006, 0.011 * v(), 0, 0.008)
    return [Part("bristles", trimesh.util.concatenate(rows), PALE), Part("handle", handle), Part("", back)]


def _wrench(v: Vary) -> list[Part]:
    r = 0.016 * v()
    jaw = _disc(0.035, 0, r).difference(box(0.036, -0.42 * r, 0.06, 0.42 * r))
    ring = _disc(-0.042, 0, 0.011 * v(), 0.0055)
    return [
        Part("head", _slab(jaw, 0, 0.008)),
        Part("handle", _slab(unary_union([box(-0.034, -0.005, 0.022, 0.005), ring]), 0.001, 0.007)),
    ]


def _magnifying_glass(v: Vary) -> list[Part]:
    r = 0.024 * v()
    rim = _slab(_disc(0.026, 0, r, r - 0.004), 0, 0.008)
    lens = _slab(_disc(0.026, 0, r - 0.003), 0.003, 0.005)
    handle = _rod((-0.052, 0, 0.006), (0.027 - r, 0, 0.006), 0.0055 * v())
    return [Part("lens", lens, (0.75, 0.86, 0.92, 1)), Part("", rim), Part("handle", handle)]


def _flashlight(v: Vary) -> list[Part]:
    r, head = 0.011 * v(), 0.019 * v()
    body = _turned([(0, -0.05), (r, -0.05), (r, 0.018), (0, 0.018)], True)
    cone = _turned([(0, 0.016), (r, 0.016), (head, 0.034), (head, 0.048), (0, 0.048)], True)
    glass = _rod((0.048, 0, 0), (0.05, 0, 0), head - 0.003)
    return [Part("handle", body), Part("head", cone), Part("", glass, (0.98, 0.95, 0.70, 1))]


def _key(v: Vary) -> list[Part]:
    r = 0.019 * v()
    bow = _disc(-0.032, 0, r, 0.5 * r)
    teeth = unary_union([box(x, -0.016 * v(), x + 0.006, 0) for x in (0.018, 0.03, 0.042)])
    shank = box(-0.034 + r, -0.0045, 0.05, 0.0045)
    return [Part("head", _slab(bow, 0, 0.006)), Part("teeth", _slab(shank.union(teeth), 0, 0.006))]


def _headphones(v: Vary) -> list[Part]:
    r = 0.034 * v()
    band = _tube(_arc(r, 0.12, np.pi - 0.12, (0, -0.012, 0.009), count=13), 0.0045)
    cups = [_rod((s * (r - 0.009), -0.016, 0.014), (s * (r + 0.006), -0.016, 0.014), 0.0145 * v()) for s in (-1, 1)]
    return [Part("band", band), Part("cups", trimesh.util.concatenate(cups), DARK)]


def _teapot(v: Vary) -> list[Part]:
    r = 0.028 * v()
    body = _ball((0, 0, 0.8 * r), (r, r, 0.8 * r))
    spout = _tube(
        np.array([[0.7 * r, 0, 0.6 * r], [1.4 * r, 0, 0.9 * r], [1.75 * r, 0, 1.5 * r]]), [0.008, 0.006, 0.004]
    )
    handle = _tube(_arc(0.62 * r, np.pi / 2, 3 * np.pi / 2, (-0.85 * r, 0, 0.9 * r), upright=True), 0.0042 * v())
    lid = _ball((0, 0, 1.65 * r), 0.006)
    return [Part("", body), Part("spout", spout), Part("handle", handle), Part("lid", lid, DARK)]


def _toy_car(v: Vary) -> list[Part]:
    w, roof = 0.036 * v(), 0.034 * v()
    body = _bar(-0.04, 0.04, w, 0.007, 0.02)
    cabin = _bar(-0.024, 0.014, w - 0.006, 0.02, roof)
    wheels = [
        _rod((x, s * w / 2, 0.009), (x, s * (w / 2 + 0.007), 0.009), 0.0095) for x in (-0.024, 0.025) for s in (-1, 1)
    ]
    return [Part("", body), Part("roof", cabin), Part("wheels", trimesh.util.concatenate(wheels), DARK)]


def _airplane(v: Vary) -> list[Part]:
    span, w = 0.048 * v(), 0.016 * v()
    wings = Polygon([(0.014, 0), (0.0, span), (-w, span), (-0.008, 0), (-w, -span), (0.0, -span)])
    tail = Polygon([(-0.038, 0), (-0.046, 0.019), (-0.054, 0.019), (-0.05, 0), (-0.054, -0.019), (-0.046, -0.019)])
    fin = _bar(-0.052, -0.04, 0.003, 0.012, 0.028)
    body = _ball((0, 0, 0.01), (0.052, 0.0085 * v(), 0.0095))
    return [
        Part("", body), Part("wings", _slab(wings, 0.009, 0.013)),
        Part("tail", trimesh.util.concatenate([_slab(tail, 0.010, 0.014), fin])),
    ]  # fmt: skip


def _duck(v: Vary) -> list[Part]:
    body = _ball((-0.008, 0, 0.018), (0.032 * v(), 0.022 * v(), 0.018))
    tail = trimesh.creation.cone(0.010, 0.018, sections=10)
    tail.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 3, [0, 1, 0], (0, 0, 0)))
    tail.apply_translation([-0.033, 0, 0.024])
    head = _ball((0.021, 0, 0.044), 0.0145 * v())
    beak = _ball((0.037, 0, 0.042), (0.008, 0.006, 0.003))
    return [
        Part("", trimesh.util.concatenate([body, tail])),
        Part("head", head),
        Part("beak", beak, (0.95, 0.55, 0.15, 1)),
    ]


def _dumbbell(v: Vary) -> list[Part]:
    r, w = 0.019 * v(), 0.018 * v()
    weights = [_rod((s * 0.042, 0, 0), (s * (0.042 - w), 0, 0), r) for s in (-1, 1)]
    return [
        Part("weights", trimesh.util.concatenate(weights)),
        Part("bar", _rod((-0.03, 0, 0), (0.03, 0, 0), 0.006 * v()), METAL),
    ]


def _hat(v: Vary) -> list[Part]:
    r, h = 0.022 * v(), 0.028 * v()
    brim = _slab(_disc(0, 0, 0.04 * v()), 0, 0.003)
    band = _turned([(0, 0.003), (r + 0.001, 0.003), (r + 0.001, 0.010), (0, 0.010)])
    return [
        Part("brim", brim),
        Part("crown", _turned([(0, 0.003), (r, 0.003), (0.85 * r, h), (0, h)])),
        Part("", band, DARK),
    ]


def _glasses(v: Vary) -> list[Part]:
    r = 0.017 * v()
    rims = _slab(
        unary_union([_disc(0, s * 0.022, r, r - 0.004) for s in (-1, 1)] + [box(-0.003, -0.008, 0.003, 0.008)]),
        0,
        0.006,
    )
    lenses = _slab(unary_union([_disc(0, s * 0.022, r - 0.003) for s in (-1, 1)]), 0.002, 0.004)
    arms = [_bar(-0.055, -0.005, 0.004, 0.001, 0.006, s * (0.02 + r)) for s in (-1, 1)]
    return [Part("lenses", lenses, (0.30, 0.33, 0.36, 1)), Part("", rims), Part("arms", trimesh.util.concatenate(arms))]


def _pear(v: Vary) -> list[Part]:
    low, top = 0.024 * v(), 0.015 * v()
    body = [_ball((-0.014, 0, low), low), _ball((0.015, 0, low), (0.021, top, top))]
    return [
        Part("", trimesh.util.concatenate(body)),
        Part("stem", _rod((0.034, 0, low), (0.05, 0.004, low + 0.004), 0.003), WOOD),
    ]


def _carrot(v: Vary) -> list[Part]:
    r = 0.0135 * v()
    root = _turned([(0, -0.052), (0.5 * r, -0.035), (r, 0.012), (0.8 * r, 0.02), (0, 0.022)], True)
    leaves = [_ball((0.038, y, 0.002), (0.017 * v(), 0.005, 0.005)) for y in (-0.009, 0, 0.009)]
    return [Part("root", root), Part("leaves", trimesh.util.concatenate(leaves), LEAF)]


def _lollipop(v: Vary) -> list[Part]:
    r = 0.021 * v()
    return [
        Part("candy", _ball((0.026, 0, r), r)),
        Part("stick", _rod((-0.052, 0, r), (0.01, 0, r), 0.003 * v()), PALE),
    ]


def _pencil(v: Vary) -> list[Part]:
    r = 0.007 * v()
    body = trimesh.creation.cylinder(r, segment=[(-0.04, 0, 0), (0.034, 0, 0)], sections=6)
    tip = _turned([(0, 0.054), (r, 0.034), (0, 0.034)], True)
    return [
        Part("", body),
        Part("tip", tip, PALE),
        Part("eraser", _rod((-0.052, 0, 0), (-0.04, 0, 0), r), (0.9, 0.5, 0.5, 1)),
    ]


def _mushroom(v: Vary) -> list[Part]:
    r, stem = 0.027 * v(), 0.010 * v()
    cap = _turned([(0, 0.0), (r, 0.0), (0.9 * r, 0.014), (0.5 * r, 0.024), (0, 0.027)], True)
    return [Part("cap", cap), Part("stem", _turned([(0, -0.034), (1.2 * stem, -0.034), (stem, 0), (0, 0)], True), PALE)]


def _wine_glass(v: Vary) -> list[Part]:
    r, foot = 0.020 * v(), 0.019 * v()
    bowl = _turned([(0, 0.008), (0.7 * r, 0.014), (r, 0.03), (0.85 * r, 0.05), (0.7 * r, 0.05), (0, 0.014)], True)
    stem = _rod((-0.044, 0, 0), (0.01, 0, 0), 0.0032 * v())
    return [Part("bowl", bowl), Part("stem", stem), Part("foot", _rod((-0.047, 0, 0), (-0.043, 0, 0), foot))]


def _chair(v: Vary) -> list[Part]:
    w, h = 0.044 * v(), 0.03 * v()
    legs = [_bar(x - 0.003, x + 0.003, 0.006, 0, h, y) for x in (-w / 2, w / 2) for y in (-w / 2, w / 2)]
    back = [_bar(-w / 2 - 0.004, -w / 2, 0.006, h, h + 0.045, y) for y in (-w / 2, w / 2)]
    back.append(_bar(-w / 2 - 0.004, -w / 2, w, h + 0.024, h + 0.045))
    seat = _bar(-w / 2 - 0.004, w / 2 + 0.004, w + 0.008, h, h + 0.005)
    return [
        Part("seat", seat), Part("legs", trimesh.util.concatenate(legs)), Part("back", trimesh.util.concatenate(back))
    ]  # fmt: skip


def _sailboat(v: Vary) -> list[Part]:
    length, w = 0.042 * v(), 0.014 * v()
    hull = Polygon([(length, 0), (0.4 * length, w), (-length, 0.8 * w), (-length, -0.8 * w), (0.4 * length, -w)])
    sail = Polygon([(-0.03, 0.018), (0.012, 0.018), (0.008, 0.068 * v())])
    cloth = _slab(sail, -0.001, 0.001)
    cloth.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    mast = _rod((0.012, 0, 0.01), (0.012, 0, 0.07), 0.002)
    return [Part("hull", _slab(hull, 0, 0.014)), Part("sail", cloth, PALE), Part("", mast, WOOD)]


def _lamp(v: Vary) -> list[Part]:
    low, high, h = 0.027 * v(), 0.016 * v(), 0.036 * v()
    base = _turned([(0, 0), (0.02 * v(), 0), (0.018, 0.006), (0.004, 0.008), (0.004, h), (0, h)])
    shade = _turned(
        [(low, h - 0.004), (high, h + 0.026), (high - 0.003, h + 0.026), (low - 0.003, h - 0.004), (low, h - 0.004)]
    )
    return [Part("base", base, DARK), Part("shade", shade)]


_MAKERS: dict[str, Callable[[Vary], list[Part]]] = {
    "mug": _mug, "hammer": _hammer, "screwdriver": _screwdriver, "banana": _banana, "scissors": _scissors,
    "bottle": _bottle, "spoon": _spoon, "fork": _fork, "knife": _knife, "pan": _pan, "spatula": _spatula,
    "brush": _brush, "wrench": _wrench, "magnifying glass": _magnifying_glass, "flashlight": _flashlight,
    "key": _key, "headphones": _headphones, "teapot": _teapot, "toy car": _toy_car, "airplane": _airplane,
    "duck": _duck, "dumbbell": _dumbbell, "hat": _hat, "glasses": _glasses, "pear": _pear, "carrot": _carrot,
    "lollipop": _lollipop, "pencil": _pencil, "mushroom": _mushroom, "wine glass": _wine_glass, "chair": _chair,
    "sailboat": _sailboat, "lamp": _lamp,
}  # fmt: skip

NAMES: tuple[str, ...] = tuple(_MAKERS)


@cache
def parts(name: str, variant: int = 0) -> tuple[Part, ...]:
    """The parts of an object, in one frame: centred in x and y, resting on z = 0.

    Args:
        name: one of `NAMES`.
        variant: which proportions, at least 0; see `TRAINING_VARIANTS`.

    Raises:
        ValueError: an unknown name or a negative variant.
    """
    if name not in _MAKERS:
        raise ValueError(f"no object is named {name!r}; the names are {', '.join(NAMES)}")
    if variant < 0:
        raise ValueError(f"variant must be at least 0, got {variant}")
    rng = np.random.default_rng((NAMES.index(name), variant))
    found = _MAKERS[name](lambda: float(rng.uniform(0.82, 1.18)))
    low, high = trimesh.util.concatenate([part.mesh for part in found]).bounds
    shift = [-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]]
    for part in found:
        part.mesh.apply_translation(shift)
    return tuple(found)


def part_names(name: str) -> tuple[str, ...]:
    """The names of an object's parts: ("brim", "handle") for a mug."""
    return tuple(part.name for part in parts(name) if part.name)


def add_object(client: int, name: str, color: RGBA, pose: Pose2, variant: int = 0, movable: bool = True) -> Body:
    """Put an object on the table. Part i is the body's link i - 1 (the first one its base).

    Its contact shape is the convex hull of the whole.
    """
    pieces = parts(name, variant)
    whole = trimesh.util.concatenate([part.mesh for part in pieces])
    lower = whole.extents[2] / 2
    hull = whole.convex_hull.vertices - [0, 0, lower]
    visuals = [
        p.createVisualShape(
            p.GEOM_MESH, **triangles(part.mesh, lower), rgbaColor=part.rgba or color, physicsClientId=client
        )
        for part in pieces
    ]
    collision = p.createCollisionShape(p.GEOM_MESH, vertices=hull.tolist(), physicsClientId=client)
    place = ((pose.x, pose.y, lower), quaternion(pose.yaw))
    body = create_compound(client, collision, visuals, place, 0.03 if movable else 0.0)
    p.changeDynamics(body, -1, lateralFriction=1.0, rollingFriction=1e-4, physicsClientId=client)
    return Body(body, lower, movable)
