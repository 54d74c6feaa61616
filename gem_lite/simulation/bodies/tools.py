"""Tools and stationery, part by part."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from shapely import LineString, Polygon, affinity, box, union_all

from gem_lite.simulation.bodies.parts import DARK, METAL, PALE, WOOD, Part, Vary
from gem_lite.simulation.bodies.solids import SIDES, bar, disc, join, moved, rod, slab, tilted, tube, turned


def _hammer(v: Vary) -> list[Part]:
    length, w = 0.095 * v(), 0.016 * v()
    head = [bar(length / 2 - w, length / 2, 0.052 * v(), 0, 0.018), bar(length / 2 - w, length / 2, 0.02, 0, 0.024)]
    handle = rod((-length / 2, 0, 0.009), (length / 2 - w, 0, 0.009), 0.0065 * v())
    return [Part("handle", handle), Part("head", join(*head), METAL)]


def _screwdriver(v: Vary) -> list[Part]:
    r, middle = 0.011 * v(), 0.004 * v()
    handle = turned([(0, -0.05), (r, -0.046), (r, -0.02), (0.8 * r, -0.015), (r, -0.008), (0.6 * r, middle)], True)
    shaft = [rod((middle, 0, 0), (0.048, 0, 0), 0.0035 * v()), bar(0.042, 0.052, 0.009, -0.0015, 0.0015)]
    return [Part("handle", handle), Part("shaft", join(*shaft), METAL)]


def _scissors(v: Vary) -> list[Part]:
    angle, r = 0.24 * v(), 0.014 * v()
    blades, handles = [], []
    for sign in SIDES:
        blade = Polygon([(0, -0.005), (0, 0.005), (0.05, 0.0)])
        ring = disc(-0.038, 0, r, 0.6 * r).union(box(-0.027, -0.004, 0.002, 0.004))
        z = 0.003 if sign > 0 else 0.006
        blades.append(slab(affinity.rotate(blade, sign * np.degrees(angle), origin=(0, 0)), z - 0.003, z))
        handles.append(slab(affinity.rotate(ring, sign * np.degrees(angle), origin=(0, 0)), z - 0.003, z + 0.004))
    return [Part("blade", join(*blades), METAL), Part("handle", join(*handles))]


def _brush(v: Vary) -> list[Part]:
    w = 0.02 * v()
    rows = [bar(x, x + 0.003, w, 0.008, 0.022 * v()) for x in np.arange(0.008, 0.05, 0.007)]
    back = slab(box(0.004, -w / 2 - 0.002, 0.054, w / 2 + 0.002), 0, 0.008)
    handle = bar(-0.052, 0.006, 0.011 * v(), 0, 0.008)
    return [Part("bristles", join(*rows), PALE), Part("handle", handle), Part("", back)]


def _wrench(v: Vary) -> list[Part]:
    r = 0.016 * v()
    jaw = disc(0.035, 0, r).difference(box(0.036, -0.42 * r, 0.06, 0.42 * r))
    ring = disc(-0.042, 0, 0.011 * v(), 0.0055)
    handle = union_all([box(-0.034, -0.005, 0.022, 0.005), ring])
    return [Part("head", slab(jaw, 0, 0.008)), Part("handle", slab(handle, 0.001, 0.007))]


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
    teeth = union_all([box(x, -0.016 * v(), x + 0.006, 0) for x in (0.018, 0.03, 0.042)])
    shank = box(-0.034 + r, -0.0045, 0.05, 0.0045)
    return [Part("head", slab(bow, 0, 0.006)), Part("teeth", slab(shank.union(teeth), 0, 0.006))]


def _pencil(v: Vary) -> list[Part]:
    r = 0.007 * v()
    body = rod((-0.04, 0, 0), (0.034, 0, 0), r, sections=6)
    tip = turned([(0, 0.054), (r, 0.034), (0, 0.034)], True)
    eraser = rod((-0.052, 0, 0), (-0.04, 0, 0), r)
    return [Part("", body), Part("tip", tip, PALE), Part("eraser", eraser, (0.9, 0.5, 0.5, 1))]


def _pliers(v: Vary) -> list[Part]:
    gap, bow = 0.007 * v(), 0.024 * v()
    tips = [(0.020, 0.015), (0.048, gap + 0.006), (0.048, gap - 0.001), (0.010, 0.001)]
    jaw = Polygon([(-0.004, 0), (0.002, 0.014), *tips])
    line = [(0.006, -0.002), (-0.006, -0.012), (-0.022, -bow), (-0.038, -bow), (-0.056, -0.85 * bow)]
    grip = LineString(line).buffer(0.0055, 3)
    jaws, grips = (slab(union_all([a, affinity.scale(a, 1, -1, origin=(0, 0))]), 0, 0.009) for a in (jaw, grip))
    return [Part("handles", grips), Part("jaws", join(jaws, slab(disc(0.003, 0, 0.012), 0, 0.012)), METAL)]


def _saw(v: Vary) -> list[Part]:
    high, low, teeth = 0.030 * v(), 0.014 * v(), 0.007 * v()
    xs = np.linspace(-0.020, 0.053, 9)
    edge = [point for a, b in pairwise(xs) for point in ((a, 0.0), ((a + b) / 2, -teeth))]
    blade = Polygon([*edge, (0.053, 0), (0.053, low), (-0.020, high)])
    hole = box(-0.045, 0.006, -0.030, 0.024).buffer(0.002, 2)
    grip = box(-0.054, -0.004, -0.018, 0.034).buffer(0.003, 2).difference(hole)
    return [Part("blade", slab(blade, 0, 0.004), METAL), Part("handle", slab(grip, 0, 0.009))]


def _axe(v: Vary) -> list[Part]:
    end, reach, flare = 0.044 * v(), 0.036 * v(), 0.022 * v()
    x = end - 0.015
    edge = [(x + flare * a, -reach + 0.007 * a * a) for a in np.linspace(-1, 1, 7)]
    head = Polygon([(x - 0.008, 0.010), (x - 0.008, -0.006), *edge, (x + 0.008, -0.006), (x + 0.008, 0.010)])
    shaft = LineString([(-0.050, -0.003), (-0.025, 0.0), (end, 0)]).buffer(0.005, 2)
    return [Part("handle", slab(shaft, 0, 0.010)), Part("head", slab(head, 0, 0.013), METAL)]


def _shovel(v: Vary) -> list[Part]:
    w, grip = 0.020 * v(), 0.014 * v()
    half = Polygon([(0.008, 0), (0.008, 0.55 * w), (0.011, w), (0.032, w), (0.044, 0.62 * w), (0.053, 0)])
    left = tilted(slab(half, 0, 0.003), 0.35)
    right = tilted(slab(affinity.scale(half, 1, -1, origin=(0, 0)), 0, 0.003), -0.35)
    frame = Polygon([(-0.036, 0), (-0.055, grip), (-0.055, -grip)]).buffer(0.002, 2)
    frame = frame.difference(Polygon([(-0.043, 0), (-0.051, 0.55 * grip), (-0.051, -0.55 * grip)]))
    shaft = rod((-0.040, 0, 0.005), (0.020, 0, 0.005), 0.0038)
    return [Part("blade", join(left, right)), Part("shaft", shaft, WOOD), Part("handle", slab(frame, 0, 0.009))]


def _tape_roll(v: Vary) -> list[Part]:
    r, h, tail = 0.027 * v(), 0.022 * v(), 0.044 * v()
    core = slab(disc(0, 0, 0.68 * r, 0.58 * r), 0, h + 0.001)
    strip = LineString([(0, r - 0.001), (0.4 * tail, r + 0.001), (0.8 * tail, r + 0.006), (1.2 * tail, r + 0.015)])
    ring, end = slab(disc(0, 0, r, 0.66 * r), 0, h), slab(strip.buffer(0.0012, 1), 0, h)
    return [Part("", ring), Part("core", core, PALE), Part("end", end)]


def _stapler(v: Vary) -> list[Part]:
    """It lies on its side, open."""
    w, gape = 0.020 * v(), 17 * v()
    foot = union_all([box(-0.052, 0, 0.054, 0.007), box(-0.052, 0, -0.030, 0.018), box(0.042, 0, 0.050, 0.010)])
    crown = [(0.104, 0), (0.104, 0.008), (0.092, 0.017), (0.060, 0.021), (0.020, 0.020), (0.002, 0.013)]
    shapes = (Polygon([(0, 0), *crown]), box(0.012, -0.006, 0.098, 0.001))
    top, strip = (affinity.translate(affinity.rotate(a, gape, origin=(0, 0)), -0.048, 0.014) for a in shapes)
    rail = slab(strip, 0.003, w - 0.003)
    return [Part("arm", slab(top, 0, w)), Part("base", slab(foot, 0, w), METAL), Part("rail", rail, METAL)]


def _clamp(v: Vary) -> list[Part]:
    end, depth, out = 0.036 - 0.058 * v(), 0.032 * v(), 0.028 * v()
    frame = LineString([(0.036, depth), (0.036, 0), (end, 0), (end, depth)]).buffer(0.0055, 3, cap_style="flat")
    y, z = depth - 0.006, 0.008
    screw = join(
        rod((end - out, y, z), (0.012, y, z), 0.0035),
        rod((0.010, y, z), (0.016, y, z), 0.008),
        rod((end - out, y - 0.018, z), (end - out, y + 0.018, z), 0.003),
    )
    return [Part("frame", slab(frame, 0, 0.012)), Part("screw", screw, METAL)]


def _paint_roller(v: Vary) -> list[Part]:
    half, r = 0.030 * v(), 0.0125 * v()
    bend = [(0.036, half, r), (0.036, half + 0.008, r), (0.012, half + 0.008, r), (0.004, 0, 0.007), (-0.022, 0, 0.006)]
    grip = [(0, -0.058), (0.007, -0.056), (0.0085, -0.044), (0.006, -0.032), (0.0075, -0.016), (0, -0.016)]
    sleeve = rod((0.036, -half, r), (0.036, half, r), r)
    handle = moved(turned(grip, True), 0, 0, 0.0085)
    return [Part("sleeve", sleeve), Part("", tube(bend, 0.0028), METAL), Part("handle", handle, DARK)]
