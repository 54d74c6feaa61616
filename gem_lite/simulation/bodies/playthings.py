"""Toys, food and other everyday objects, part by part."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely.geometry import Polygon, box
from shapely.ops import unary_union

from gem_lite.simulation.bodies.solids import (
    DARK,
    LEAF,
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


def _banana(v: Vary) -> list[Part]:
    radius, half = 0.055 * v(), 0.85 * v()
    bow = arc(radius, np.pi / 2 - half, np.pi / 2 + half, (0, -radius, 0.013), count=11)
    thickness = 0.0135 * v() * np.sqrt(np.sin(np.linspace(0.35, np.pi - 0.35, 11)))
    crown = tube(arc(radius, np.pi / 2 + half, np.pi / 2 + half + 0.28, (0, -radius, 0.013), count=3), 0.0055)
    return [Part("", tube(bow, thickness)), Part("crown", crown, WOOD)]


def _headphones(v: Vary) -> list[Part]:
    r = 0.034 * v()
    band = tube(arc(r, 0.12, np.pi - 0.12, (0, -0.012, 0.009), count=13), 0.0045)
    cups = [rod((s * (r - 0.009), -0.016, 0.014), (s * (r + 0.006), -0.016, 0.014), 0.0145 * v()) for s in (-1, 1)]
    return [Part("band", band), Part("cups", trimesh.util.concatenate(cups), DARK)]


def _toy_car(v: Vary) -> list[Part]:
    w, roof = 0.036 * v(), 0.034 * v()
    body = bar(-0.04, 0.04, w, 0.007, 0.02)
    cabin = bar(-0.024, 0.014, w - 0.006, 0.02, roof)
    wheels = [
        rod((x, s * w / 2, 0.009), (x, s * (w / 2 + 0.007), 0.009), 0.0095) for x in (-0.024, 0.025) for s in (-1, 1)
    ]
    return [Part("", body), Part("roof", cabin), Part("wheels", trimesh.util.concatenate(wheels), DARK)]


def _airplane(v: Vary) -> list[Part]:
    span, w = 0.048 * v(), 0.016 * v()
    wings = Polygon([(0.014, 0), (0.0, span), (-w, span), (-0.008, 0), (-w, -span), (0.0, -span)])
    tail = Polygon([(-0.038, 0), (-0.046, 0.019), (-0.054, 0.019), (-0.05, 0), (-0.054, -0.019), (-0.046, -0.019)])
    fin = bar(-0.052, -0.04, 0.003, 0.012, 0.028)
    body = ball((0, 0, 0.01), (0.052, 0.0085 * v(), 0.0095))
    return [
        Part("", body), Part("wings", slab(wings, 0.009, 0.013)),
        Part("tail", trimesh.util.concatenate([slab(tail, 0.010, 0.014), fin])),
    ]  # fmt: skip


def _duck(v: Vary) -> list[Part]:
    body = ball((-0.008, 0, 0.018), (0.032 * v(), 0.022 * v(), 0.018))
    tail = trimesh.creation.cone(0.010, 0.018, sections=10)
    tail.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 3, [0, 1, 0], (0, 0, 0)))
    tail.apply_translation([-0.033, 0, 0.024])
    head = ball((0.021, 0, 0.044), 0.0145 * v())
    beak = ball((0.037, 0, 0.042), (0.008, 0.006, 0.003))
    return [
        Part("", trimesh.util.concatenate([body, tail])),
        Part("head", head),
        Part("beak", beak, (0.95, 0.55, 0.15, 1)),
    ]


def _dumbbell(v: Vary) -> list[Part]:
    r, w = 0.019 * v(), 0.018 * v()
    weights = [rod((s * 0.042, 0, 0), (s * (0.042 - w), 0, 0), r) for s in (-1, 1)]
    return [
        Part("weights", trimesh.util.concatenate(weights)),
        Part("bar", rod((-0.03, 0, 0), (0.03, 0, 0), 0.006 * v()), METAL),
    ]


def _hat(v: Vary) -> list[Part]:
    r, h = 0.022 * v(), 0.028 * v()
    brim = slab(disc(0, 0, 0.04 * v()), 0, 0.003)
    band = turned([(0, 0.003), (r + 0.001, 0.003), (r + 0.001, 0.010), (0, 0.010)])
    return [
        Part("brim", brim),
        Part("crown", turned([(0, 0.003), (r, 0.003), (0.85 * r, h), (0, h)])),
        Part("", band, DARK),
    ]


def _glasses(v: Vary) -> list[Part]:
    r = 0.017 * v()
    rims = slab(
        unary_union([disc(0, s * 0.022, r, r - 0.004) for s in (-1, 1)] + [box(-0.003, -0.008, 0.003, 0.008)]),
        0,
        0.006,
    )
    lenses = slab(unary_union([disc(0, s * 0.022, r - 0.003) for s in (-1, 1)]), 0.002, 0.004)
    arms = [bar(-0.055, -0.005, 0.004, 0.001, 0.006, s * (0.02 + r)) for s in (-1, 1)]
    return [Part("lenses", lenses, (0.30, 0.33, 0.36, 1)), Part("", rims), Part("arms", trimesh.util.concatenate(arms))]


def _pear(v: Vary) -> list[Part]:
    low, top = 0.024 * v(), 0.015 * v()
    body = [ball((-0.014, 0, low), low), ball((0.015, 0, low), (0.021, top, top))]
    return [
        Part("", trimesh.util.concatenate(body)),
        Part("stem", rod((0.034, 0, low), (0.05, 0.004, low + 0.004), 0.003), WOOD),
    ]


def _carrot(v: Vary) -> list[Part]:
    r = 0.0135 * v()
    root = turned([(0, -0.052), (0.5 * r, -0.035), (r, 0.012), (0.8 * r, 0.02), (0, 0.022)], True)
    leaves = [ball((0.038, y, 0.002), (0.017 * v(), 0.005, 0.005)) for y in (-0.009, 0, 0.009)]
    return [Part("root", root), Part("leaves", trimesh.util.concatenate(leaves), LEAF)]


def _lollipop(v: Vary) -> list[Part]:
    r = 0.021 * v()
    return [
        Part("candy", ball((0.026, 0, r), r)),
        Part("stick", rod((-0.052, 0, r), (0.01, 0, r), 0.003 * v()), PALE),
    ]


def _pencil(v: Vary) -> list[Part]:
    r = 0.007 * v()
    body = trimesh.creation.cylinder(r, segment=[(-0.04, 0, 0), (0.034, 0, 0)], sections=6)
    tip = turned([(0, 0.054), (r, 0.034), (0, 0.034)], True)
    return [
        Part("", body),
        Part("tip", tip, PALE),
        Part("eraser", rod((-0.052, 0, 0), (-0.04, 0, 0), r), (0.9, 0.5, 0.5, 1)),
    ]


def _mushroom(v: Vary) -> list[Part]:
    r, stem = 0.027 * v(), 0.010 * v()
    cap = turned([(0, 0.0), (r, 0.0), (0.9 * r, 0.014), (0.5 * r, 0.024), (0, 0.027)], True)
    return [Part("cap", cap), Part("stem", turned([(0, -0.034), (1.2 * stem, -0.034), (stem, 0), (0, 0)], True), PALE)]


def _chair(v: Vary) -> list[Part]:
    w, h = 0.044 * v(), 0.03 * v()
    legs = [bar(x - 0.003, x + 0.003, 0.006, 0, h, y) for x in (-w / 2, w / 2) for y in (-w / 2, w / 2)]
    back = [bar(-w / 2 - 0.004, -w / 2, 0.006, h, h + 0.045, y) for y in (-w / 2, w / 2)]
    back.append(bar(-w / 2 - 0.004, -w / 2, w, h + 0.024, h + 0.045))
    seat = bar(-w / 2 - 0.004, w / 2 + 0.004, w + 0.008, h, h + 0.005)
    return [
        Part("seat", seat), Part("legs", trimesh.util.concatenate(legs)), Part("back", trimesh.util.concatenate(back))
    ]  # fmt: skip


def _sailboat(v: Vary) -> list[Part]:
    length, w = 0.042 * v(), 0.014 * v()
    hull = Polygon([(length, 0), (0.4 * length, w), (-length, 0.8 * w), (-length, -0.8 * w), (0.4 * length, -w)])
    sail = Polygon([(-0.03, 0.018), (0.012, 0.018), (0.008, 0.068 * v())])
    cloth = slab(sail, -0.001, 0.001)
    cloth.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    mast = rod((0.012, 0, 0.01), (0.012, 0, 0.07), 0.002)
    return [Part("hull", slab(hull, 0, 0.014)), Part("sail", cloth, PALE), Part("", mast, WOOD)]


def _lamp(v: Vary) -> list[Part]:
    low, high, h = 0.027 * v(), 0.016 * v(), 0.036 * v()
    base = turned([(0, 0), (0.02 * v(), 0), (0.018, 0.006), (0.004, 0.008), (0.004, h), (0, h)])
    shade = turned(
        [(low, h - 0.004), (high, h + 0.026), (high - 0.003, h + 0.026), (low - 0.003, h - 0.004), (low, h - 0.004)]
    )
    return [Part("base", base, DARK), Part("shade", shade)]


MAKERS: dict[str, Maker] = {
    "banana": _banana,
    "headphones": _headphones,
    "toy car": _toy_car,
    "airplane": _airplane,
    "duck": _duck,
    "dumbbell": _dumbbell,
    "hat": _hat,
    "glasses": _glasses,
    "pear": _pear,
    "carrot": _carrot,
    "lollipop": _lollipop,
    "pencil": _pencil,
    "mushroom": _mushroom,
    "chair": _chair,
    "sailboat": _sailboat,
    "lamp": _lamp,
}
