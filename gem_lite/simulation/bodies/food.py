"""Food, part by part."""

from __future__ import annotations

from math import radians

import numpy as np
import trimesh
from shapely import Polygon, union_all

from gem_lite.simulation.bodies.parts import LEAF, PALE, RGBA, WOOD, Part, Vary
from gem_lite.simulation.bodies.solids import SIDES, arc, ball, disc, join, moved, oval, rod, slab, tilted, tube, turned

_BAKED: RGBA = (0.80, 0.58, 0.32, 1.0)
_SALAMI: RGBA = (0.60, 0.16, 0.12, 1.0)
_MEAT: RGBA = (0.30, 0.17, 0.11, 1.0)


def _banana(v: Vary) -> list[Part]:
    radius, half = 0.055 * v(), 0.85 * v()
    bow = arc(radius, np.pi / 2 - half, np.pi / 2 + half, (0, -radius, 0.013), count=11)
    thickness = 0.0135 * v() * np.sqrt(np.sin(np.linspace(0.35, np.pi - 0.35, 11)))
    crown = tube(arc(radius, np.pi / 2 + half, np.pi / 2 + half + 0.28, (0, -radius, 0.013), count=3), 0.0055)
    return [Part("", tube(bow, thickness)), Part("crown", crown, WOOD)]


def _pear(v: Vary) -> list[Part]:
    low, top = 0.024 * v(), 0.015 * v()
    body = [ball((-0.014, 0, low), low), ball((0.015, 0, low), (0.021, top, top))]
    return [Part("", join(*body)), Part("stem", rod((0.034, 0, low), (0.05, 0.004, low + 0.004), 0.003), WOOD)]


def _carrot(v: Vary) -> list[Part]:
    r = 0.0135 * v()
    root = turned([(0, -0.052), (0.5 * r, -0.035), (r, 0.012), (0.8 * r, 0.02), (0, 0.022)], True)
    leaves = [ball((0.038, y, 0.002), (0.017 * v(), 0.005, 0.005)) for y in (-0.009, 0, 0.009)]
    return [Part("root", root), Part("leaves", join(*leaves), LEAF)]


def _lollipop(v: Vary) -> list[Part]:
    r = 0.021 * v()
    return [Part("candy", ball((0.026, 0, r), r)), Part("stick", rod((-0.052, 0, r), (0.01, 0, r), 0.003 * v()), PALE)]


def _mushroom(v: Vary) -> list[Part]:
    r, stem = 0.027 * v(), 0.010 * v()
    cap = turned([(0, 0.0), (r, 0.0), (0.9 * r, 0.014), (0.5 * r, 0.024), (0, 0.027)], True)
    return [Part("cap", cap), Part("stem", turned([(0, -0.034), (1.2 * stem, -0.034), (stem, 0), (0, 0)], True), PALE)]


def _apple(v: Vary) -> list[Part]:
    r, h = 0.030 * v(), 0.050 * v()
    profile = [(0, 0.1), (0.35, 0), (0.75, 0.2), (1, 0.58), (0.93, 0.82), (0.62, 1), (0.3, 0.93), (0, 0.72)]
    fruit = turned([(r * x, h * z) for x, z in profile])
    leaf = slab(oval(0.016, 0, 0.032, 0.017), -0.0012, 0.0012)
    moved(tilted(tilted(leaf, radians(-22), "y"), radians(35), "z"), 0.001, 0, h + 0.001)
    stem = rod((0, 0, 0.7 * h), (-0.007, 0, h + 0.016), 0.003)
    return [Part("", fruit), Part("apple stem", stem, WOOD), Part("apple leaf", leaf, LEAF)]


def _donut(v: Vary) -> list[Part]:
    r, thick = 0.023 * v(), 0.0125 * v()
    dough = trimesh.creation.torus(r, thick, major_sections=20, minor_sections=8)
    icing = trimesh.creation.torus(r, 1.1 * thick, major_sections=30, minor_sections=10)
    angle = np.arctan2(icing.vertices[:, 1], icing.vertices[:, 0])
    icing.vertices[:, 2] = np.maximum(icing.vertices[:, 2], thick * (0.15 + 0.3 * np.sin(6 * angle)))
    sprinkles = []
    for i in range(12):
        t, turn = 2 * np.pi * i / 12, 2.4 * i
        out = r + (-1) ** i * 0.35 * thick
        at = np.array([out * np.cos(t), out * np.sin(t), 1.03 * thick])
        half = 0.0042 * np.array([np.cos(turn), np.sin(turn), 0])
        sprinkles.append(rod(at - half, at + half, 0.0017, sections=5))
    return [Part("", dough, _BAKED), Part("donut icing", icing), Part("donut sprinkles", join(*sprinkles), PALE)]


def _ice_cream(v: Vary) -> list[Part]:
    r, top = 0.022 * v(), 0.017 * v()
    wide = 0.86 * r
    rim = [(wide, 0.002), (wide + 0.003, 0.002), (wide + 0.003, 0.010)]
    cone = turned([(0, -0.052), (0.002, -0.052), *rim, (0, 0.010)], True)
    scoops = [ball((0.018, 0, 0), r), ball((0.042, 0, 0), top)]
    for i in range(8):
        t = 2 * np.pi * i / 8
        scoops.append(ball((0.011 - 0.004 * (i % 2), r * np.cos(t), r * np.sin(t)), (0.009, 0.0075, 0.0075), 0))
    return [Part("ice cream cone", cone, _BAKED), Part("ice cream scoops", join(*scoops))]


def _pizza_slice(v: Vary) -> list[Part]:
    length, half = 0.078 * v(), 0.42 * v()
    rim = arc(length, -half, half, (-0.04, 0, 0.007), count=8)
    base = slab(Polygon([(-0.04, 0), *rim[:, :2]]), 0, 0.007)
    slices = []
    for share, turn in ((0.40, 0.0), (0.68, -0.45), (0.74, 0.45)):
        spot = disc(-0.04 + length * share * np.cos(half * turn), length * share * np.sin(half * turn), 0.0085)
        slices.append(slab(spot.simplify(3e-4), 0.006, 0.010))
    return [Part("", base), Part("pizza crust", tube(rim, 0.0075), _BAKED), Part("", join(*slices), _SALAMI)]


def _cheese(v: Vary) -> list[Part]:
    length, half, h = 0.078 * v(), 0.36 * v(), 0.032 * v()
    rim = arc(length, -half, half, (0, 0, 0), count=8)[:, :2]
    wedge = Polygon([(0, 0), *rim])
    holes = [(0.42, 0.0, 0.007), (0.70, 0.42, 0.009), (0.66, -0.95, 0.008), (0.86, -0.35, 0.007), (0.55, 1.0, 0.006)]
    pits = [disc(length * a * np.cos(half * t), length * a * np.sin(half * t), size) for a, t, size in holes]
    pitted = wedge.difference(union_all([pit.simplify(3e-4) for pit in pits]))
    rind = Polygon([*rim, *(rim[::-1] * 1.05)])
    whole = join(slab(wedge, 0, 0.35 * h), slab(pitted, 0.35 * h, h))
    return [Part("", whole), Part("cheese rind", slab(rind, 0, h), _SALAMI)]


def _cherries(v: Vary) -> list[Part]:
    left, right, spread = 0.018 * v(), 0.018 * v(), 0.023 * v()
    fruits, stems = [], []
    for side, r in ((-1, left), (1, right)):
        y = side * spread
        fruits.append(ball((-0.028, y, r), r))
        path = [(-0.028 + 0.8 * r, y, 1.4 * r), (0.012, 0.75 * y, 0.016), (0.030, 0.4 * y, 0.008), (0.044, 0, 0.004)]
        stems.append(tube(path, 0.0028))
    leaf = slab(oval(0.040, 0.020, 0.040, 0.018, 75), 0.002, 0.006)
    return [Part("", join(*fruits)), Part("cherry stems", join(*stems), WOOD), Part("cherry leaf", leaf, LEAF)]


def _hamburger(v: Vary) -> list[Part]:
    r, h = 0.031 * v(), 0.026 * v()
    low = turned([(0, 0), (0.85 * r, 0), (r, 0.004), (r, 0.012), (0, 0.012)])
    patty = turned([(0, 0.012), (1.06 * r, 0.012), (1.10 * r, 0.017), (1.06 * r, 0.022), (0, 0.022)])
    t = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    wave = r * (1.16 + 0.10 * np.cos(9 * t))
    leaf = slab(Polygon(np.stack([wave * np.cos(t), wave * np.sin(t)], axis=1)), 0.022, 0.025)
    upper = [(0.88 * r, 0.025 + 0.6 * h), (0.5 * r, 0.025 + 0.92 * h), (0, 0.025 + h)]
    dome = turned([(0, 0.025), (r, 0.025), (1.02 * r, 0.030), *upper])
    seeds = []
    for i in range(9):
        share, turn = (0.0, 0.0) if i == 0 else (0.55, i * np.pi / 4)
        z = 0.025 + h * (0.88 if i else 1.0)
        seeds.append(ball((share * r * np.cos(turn), share * r * np.sin(turn), z), (0.0034, 0.0034, 0.002), 0))
    return [Part("hamburger bun", join(low, dome, *seeds)), Part("hamburger patty", patty, _MEAT), Part("", leaf, LEAF)]


def _corn(v: Vary) -> list[Part]:
    r, leaf = 0.0155 * v(), 0.062 * v()
    profile = [(0, -0.030), (0.8, -0.030), (0.9, 0.010), (0.65, 0.036), (0.2, 0.050), (0, 0.052)]
    cob = turned([(share * r, z) for share, z in profile], True)
    grains = []
    for i in range(9):
        x = -0.020 + 0.0078 * i
        size = 0.95 * r * (1 - max(0.0, (x - 0.005) / 0.055) ** 2)
        for k in range(5):
            t = (k - 2 + 0.5 * (i % 2)) * 0.62
            grains.append(ball((x, size * np.sin(t), size * np.cos(t)), (0.0042, 0.0046, 0.0042), 0))
    husk = []
    for side in SIDES:
        outer = [(-0.010, side * (r + 0.013)), (leaf - 0.046, side * (r + 0.016))]
        blade = Polygon([(-0.046, 0), (-0.040, side * 0.010), *outer, (0.0, side * (0.5 * r))])
        husk.append(slab(blade, -0.8 * r, 0.004 - 0.8 * r))
    husk.append(rod((-0.054, 0, -0.3 * r), (-0.026, 0, -0.1 * r), 0.55 * r))
    return [Part("", join(cob, *grains)), Part("corn husk", join(*husk), LEAF)]
