"""Everyday objects for kitchen and workshop, part by part."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely import affinity
from shapely.geometry import Polygon, box
from shapely.ops import unary_union

from gem_lite.simulation.bodies.solids import (
    DARK,
    METAL,
    PALE,
    WOOD,
    Maker,
    Part,
    Vary,
    arc,
    ball,
    bar,
    disc,
    rod,
    slab,
    tube,
    turned,
)


def _mug(v: Vary) -> list[Part]:
    r, h = 0.028 * v(), 0.055 * v()
    body = turned([(0, 0), (r, 0), (r, h), (r - 0.004, h), (r - 0.004, 0.005), (0, 0.005)])
    brim = turned([(r - 0.004, h), (r + 0.001, h), (r + 0.001, h + 0.004), (r - 0.004, h + 0.004), (r - 0.004, h)])
    loop = arc(0.36 * h, -np.pi / 2, np.pi / 2, (r - 0.002, 0, h / 2), upright=True)
    return [Part("", body), Part("brim", brim), Part("handle", tube(loop * [1, 1, 1], 0.0045 * v()))]


def _hammer(v: Vary) -> list[Part]:
    length, w = 0.095 * v(), 0.016 * v()
    head = [bar(length / 2 - w, length / 2, 0.052 * v(), 0, 0.018), bar(length / 2 - w, length / 2, 0.02, 0, 0.024)]
    return [
        Part("handle", rod((-length / 2, 0, 0.009), (length / 2 - w, 0, 0.009), 0.0065 * v())),
        Part("head", trimesh.util.concatenate(head), METAL),
    ]


def _screwdriver(v: Vary) -> list[Part]:
    r, middle = 0.011 * v(), 0.004 * v()
    handle = turned([(0, -0.05), (r, -0.046), (r, -0.02), (0.8 * r, -0.015), (r, -0.008), (0.6 * r, middle)], True)
    shaft = [rod((middle, 0, 0), (0.048, 0, 0), 0.0035 * v()), bar(0.042, 0.052, 0.009, -0.0015, 0.0015)]
    return [Part("handle", handle), Part("shaft", trimesh.util.concatenate(shaft), METAL)]


def _scissors(v: Vary) -> list[Part]:
    angle, r = 0.24 * v(), 0.014 * v()
    blades, handles = [], []
    for sign in (-1, 1):
        blade = Polygon([(0, -0.005), (0, 0.005), (0.05, 0.0)])
        ring = disc(-0.038, 0, r, 0.6 * r).union(box(-0.027, -0.004, 0.002, 0.004))
        z = 0.003 if sign > 0 else 0.006
        blades.append(slab(affinity.rotate(blade, sign * np.degrees(angle), origin=(0, 0)), z - 0.003, z))
        handles.append(slab(affinity.rotate(ring, sign * np.degrees(angle), origin=(0, 0)), z - 0.003, z + 0.004))
    return [
        Part("blade", trimesh.util.concatenate(blades), METAL),
        Part("handle", trimesh.util.concatenate(handles)),
    ]


def _bottle(v: Vary) -> list[Part]:
    r, neck = 0.019 * v(), 0.028 * v()
    body = turned([(0, -0.05), (r, -0.048), (r, neck - 0.014), (0.008, neck), (0.008, 0.038), (0, 0.038)], True)
    return [Part("body", body), Part("cap", rod((0.036, 0, 0), (0.05, 0, 0), 0.0105 * v()), DARK)]


def _spoon(v: Vary) -> list[Part]:
    head = ball((0.032, 0, 0.006), (0.02 * v(), 0.0135 * v(), 0.006))
    return [Part("head", head), Part("handle", bar(-0.05, 0.016, 0.006 * v(), 0.002, 0.008))]


def _fork(v: Vary) -> list[Part]:
    w = 0.022 * v()
    tines = [bar(0.018, 0.05, 0.0035, 0.001, 0.006, y) for y in (-w / 2, -w / 6, w / 6, w / 2)]
    palm = bar(0.01, 0.02, w + 0.0035, 0.001, 0.006)
    handle = bar(-0.05, 0.01, 0.006 * v(), 0.001, 0.006)
    return [Part("tines", trimesh.util.concatenate([*tines, palm])), Part("handle", handle)]


def _knife(v: Vary) -> list[Part]:
    w, middle = 0.014 * v(), -0.006 * v()
    blade = Polygon([(middle, -w / 2), (0.052, w / 2), (middle, w / 2)])
    handle = bar(-0.052, middle, 0.012 * v(), 0, 0.01)
    return [Part("blade", slab(blade, 0.003, 0.006), METAL), Part("handle", handle)]


def _pan(v: Vary) -> list[Part]:
    r, h = 0.033 * v(), 0.014 * v()
    dish = turned([(0, 0), (0.85 * r, 0), (r, h), (r - 0.003, h), (0.8 * r, 0.003), (0, 0.003)])
    dish.apply_translation([-0.022, 0, 0])
    return [Part("", dish), Part("handle", bar(r - 0.024, 0.06, 0.009 * v(), h - 0.006, h), DARK)]


def _spatula(v: Vary) -> list[Part]:
    w = 0.034 * v()
    slots = unary_union([box(0.02, y - 0.002, 0.042, y + 0.002) for y in (-w / 4, 0, w / 4)])
    head = slab(box(0.012, -w / 2, 0.05, w / 2).difference(slots), 0.002, 0.005)
    return [Part("head", head), Part("handle", rod((-0.052, 0, 0.005), (0.013, 0, 0.005), 0.0045 * v()), WOOD)]


def _brush(v: Vary) -> list[Part]:
    w = 0.02 * v()
    rows = [bar(x, x + 0.003, w, 0.008, 0.022 * v()) for x in np.arange(0.008, 0.05, 0.007)]
    back = slab(box(0.004, -w / 2 - 0.002, 0.054, w / 2 + 0.002), 0, 0.008)
    handle = bar(-0.052, 0.006, 0.011 * v(), 0, 0.008)
    return [Part("bristles", trimesh.util.concatenate(rows), PALE), Part("handle", handle), Part("", back)]


def _wrench(v: Vary) -> list[Part]:
    r = 0.016 * v()
    jaw = disc(0.035, 0, r).difference(box(0.036, -0.42 * r, 0.06, 0.42 * r))
    ring = disc(-0.042, 0, 0.011 * v(), 0.0055)
    return [
        Part("head", slab(jaw, 0, 0.008)),
        Part("handle", slab(unary_union([box(-0.034, -0.005, 0.022, 0.005), ring]), 0.001, 0.007)),
    ]


def _magnifying_glass(v: Vary) -> list[Part]:
    r = 0.024 * v()
    rim = slab(disc(0.026, 0, r, r - 0.004), 0, 0.008)
    lens = slab(disc(0.026, 0, r - 0.003), 0.003, 0.005)
    handle = rod((-0.052, 0, 0.006), (0.027 - r, 0, 0.006), 0.0055 * v())
    return [Part("lens", lens, (0.75, 0.86, 0.92, 1)), Part("", rim), Part("handle", handle)]


def _flashlight(v: Vary) -> list[Part]:
    r, head = 0.011 * v(), 0.019 * v()
    body = turned([(0, -0.05), (r, -0.05), (r, 0.018), (0, 0.018)], True)
    cone = turned([(0, 0.016), (r, 0.016), (head, 0.034), (head, 0.048), (0, 0.048)], True)
    glass = rod((0.048, 0, 0), (0.05, 0, 0), head - 0.003)
    return [Part("handle", body), Part("head", cone), Part("", glass, (0.98, 0.95, 0.70, 1))]


def _key(v: Vary) -> list[Part]:
    r = 0.019 * v()
    bow = disc(-0.032, 0, r, 0.5 * r)
    teeth = unary_union([box(x, -0.016 * v(), x + 0.006, 0) for x in (0.018, 0.03, 0.042)])
    shank = box(-0.034 + r, -0.0045, 0.05, 0.0045)
    return [Part("head", slab(bow, 0, 0.006)), Part("teeth", slab(shank.union(teeth), 0, 0.006))]


def _teapot(v: Vary) -> list[Part]:
    r = 0.028 * v()
    body = ball((0, 0, 0.8 * r), (r, r, 0.8 * r))
    spout = tube(
        np.array([[0.7 * r, 0, 0.6 * r], [1.4 * r, 0, 0.9 * r], [1.75 * r, 0, 1.5 * r]]), [0.008, 0.006, 0.004]
    )
    handle = tube(arc(0.62 * r, np.pi / 2, 3 * np.pi / 2, (-0.85 * r, 0, 0.9 * r), upright=True), 0.0042 * v())
    lid = ball((0, 0, 1.65 * r), 0.006)
    return [Part("", body), Part("spout", spout), Part("handle", handle), Part("lid", lid, DARK)]


def _wine_glass(v: Vary) -> list[Part]:
    r, foot = 0.020 * v(), 0.019 * v()
    bowl = turned([(0, 0.008), (0.7 * r, 0.014), (r, 0.03), (0.85 * r, 0.05), (0.7 * r, 0.05), (0, 0.014)], True)
    stem = rod((-0.044, 0, 0), (0.01, 0, 0), 0.0032 * v())
    return [Part("bowl", bowl), Part("stem", stem), Part("foot", rod((-0.047, 0, 0), (-0.043, 0, 0), foot))]


MAKERS: dict[str, Maker] = {
    "mug": _mug,
    "hammer": _hammer,
    "screwdriver": _screwdriver,
    "scissors": _scissors,
    "bottle": _bottle,
    "spoon": _spoon,
    "fork": _fork,
    "knife": _knife,
    "pan": _pan,
    "spatula": _spatula,
    "brush": _brush,
    "wrench": _wrench,
    "magnifying glass": _magnifying_glass,
    "flashlight": _flashlight,
    "key": _key,
    "teapot": _teapot,
    "wine glass": _wine_glass,
}
