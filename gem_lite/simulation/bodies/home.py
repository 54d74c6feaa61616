"""What is at home, part by part: kitchen things, what one wears, a chair and a lamp."""

from __future__ import annotations

import numpy as np
from shapely import Polygon, box, union_all

from gem_lite.simulation.bodies.parts import DARK, METAL, WOOD, Part, Vary
from gem_lite.simulation.bodies.solids import SIDES, arc, ball, bar, disc, join, moved, rod, slab, tilted, tube, turned


def _mug(v: Vary) -> list[Part]:
    r, h = 0.028 * v(), 0.055 * v()
    body = turned([(0, 0), (r, 0), (r, h), (r - 0.004, h), (r - 0.004, 0.005), (0, 0.005)])
    brim = turned([(r - 0.004, h), (r + 0.001, h), (r + 0.001, h + 0.004), (r - 0.004, h + 0.004), (r - 0.004, h)])
    loop = arc(0.36 * h, -np.pi / 2, np.pi / 2, (r - 0.002, 0, h / 2), upright=True)
    return [Part("", body), Part("brim", brim), Part("handle", tube(loop * [1, 1, 1], 0.0045 * v()))]


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
    return [Part("tines", join(*tines, palm)), Part("handle", handle)]


def _knife(v: Vary) -> list[Part]:
    w, middle = 0.014 * v(), -0.006 * v()
    blade = Polygon([(middle, -w / 2), (0.052, w / 2), (middle, w / 2)])
    handle = bar(-0.052, middle, 0.012 * v(), 0, 0.01)
    return [Part("blade", slab(blade, 0.003, 0.006), METAL), Part("handle", handle)]


def _pan(v: Vary) -> list[Part]:
    r, h = 0.033 * v(), 0.014 * v()
    dish = turned([(0, 0), (0.85 * r, 0), (r, h), (r - 0.003, h), (0.8 * r, 0.003), (0, 0.003)])
    return [Part("", moved(dish, -0.022, 0, 0)), Part("handle", bar(r - 0.024, 0.06, 0.009 * v(), h - 0.006, h), DARK)]


def _spatula(v: Vary) -> list[Part]:
    w = 0.034 * v()
    slots = union_all([box(0.02, y - 0.002, 0.042, y + 0.002) for y in (-w / 4, 0, w / 4)])
    head = slab(box(0.012, -w / 2, 0.05, w / 2).difference(slots), 0.002, 0.005)
    return [Part("head", head), Part("handle", rod((-0.052, 0, 0.005), (0.013, 0, 0.005), 0.0045 * v()), WOOD)]


def _teapot(v: Vary) -> list[Part]:
    r = 0.028 * v()
    body = ball((0, 0, 0.8 * r), (r, r, 0.8 * r))
    spout = tube([[0.7 * r, 0, 0.6 * r], [1.4 * r, 0, 0.9 * r], [1.75 * r, 0, 1.5 * r]], [0.008, 0.006, 0.004])
    handle = tube(arc(0.62 * r, np.pi / 2, 3 * np.pi / 2, (-0.85 * r, 0, 0.9 * r), upright=True), 0.0042 * v())
    lid = ball((0, 0, 1.65 * r), 0.006)
    return [Part("", body), Part("spout", spout), Part("handle", handle), Part("lid", lid, DARK)]


def _wine_glass(v: Vary) -> list[Part]:
    r, foot = 0.020 * v(), 0.019 * v()
    bowl = turned([(0, 0.008), (0.7 * r, 0.014), (r, 0.03), (0.85 * r, 0.05), (0.7 * r, 0.05), (0, 0.014)], True)
    stem = rod((-0.044, 0, 0), (0.01, 0, 0), 0.0032 * v())
    return [Part("bowl", bowl), Part("stem", stem), Part("foot", rod((-0.047, 0, 0), (-0.043, 0, 0), foot))]


def _headphones(v: Vary) -> list[Part]:
    r = 0.034 * v()
    band = tube(arc(r, 0.12, np.pi - 0.12, (0, -0.012, 0.009), count=13), 0.0045)
    cups = [rod((s * (r - 0.009), -0.016, 0.014), (s * (r + 0.006), -0.016, 0.014), 0.0145 * v()) for s in SIDES]
    return [Part("band", band), Part("cups", join(*cups), DARK)]


def _hat(v: Vary) -> list[Part]:
    r, h = 0.022 * v(), 0.028 * v()
    brim = slab(disc(0, 0, 0.04 * v()), 0, 0.003)
    band = turned([(0, 0.003), (r + 0.001, 0.003), (r + 0.001, 0.010), (0, 0.010)])
    crown = turned([(0, 0.003), (r, 0.003), (0.85 * r, h), (0, h)])
    return [Part("brim", brim), Part("crown", crown), Part("", band, DARK)]


def _glasses(v: Vary) -> list[Part]:
    r = 0.017 * v()
    frame = [*(disc(0, s * 0.022, r, r - 0.004) for s in SIDES), box(-0.003, -0.008, 0.003, 0.008)]
    rims = slab(union_all(frame), 0, 0.006)
    lenses = slab(union_all([disc(0, s * 0.022, r - 0.003) for s in SIDES]), 0.002, 0.004)
    arms = [bar(-0.055, -0.005, 0.004, 0.001, 0.006, s * (0.02 + r)) for s in SIDES]
    return [Part("lenses", lenses, (0.30, 0.33, 0.36, 1)), Part("", rims), Part("arms", join(*arms))]


def _chair(v: Vary) -> list[Part]:
    w, h = 0.044 * v(), 0.03 * v()
    legs = [bar(x - 0.003, x + 0.003, 0.006, 0, h, y) for x in (-w / 2, w / 2) for y in (-w / 2, w / 2)]
    back = [bar(-w / 2 - 0.004, -w / 2, 0.006, h, h + 0.045, y) for y in (-w / 2, w / 2)]
    back.append(bar(-w / 2 - 0.004, -w / 2, w, h + 0.024, h + 0.045))
    seat = bar(-w / 2 - 0.004, w / 2 + 0.004, w + 0.008, h, h + 0.005)
    return [Part("seat", seat), Part("legs", join(*legs)), Part("back", join(*back))]


def _lamp(v: Vary) -> list[Part]:
    low, high, h = 0.027 * v(), 0.016 * v(), 0.036 * v()
    base = turned([(0, 0), (0.02 * v(), 0), (0.018, 0.006), (0.004, 0.008), (0.004, h), (0, h)])
    bottom, top = h - 0.004, h + 0.026
    shade = turned([(low, bottom), (high, top), (high - 0.003, top), (low - 0.003, bottom), (low, bottom)])
    return [Part("base", base, DARK), Part("shade", shade)]


def _ladle(v: Vary) -> list[Part]:
    r, rise = 0.0205 * v(), 0.014 * v()
    a = np.linspace(-np.pi / 2, 0, 6)
    wall = [(q * np.cos(t), r + q * np.sin(t)) for q, order in ((r, a), (r - 0.003, a[::-1])) for t in order]
    x, z = 0.034 - r, r - 0.002
    hook = [(-0.044, 0, 0.0045), (-0.051, 0, 0.0045), (-0.054, 0, 0.012), (-0.048, 0, 0.018), (-0.042, 0, 0.016)]
    line = [(x, 0, z), (x - 0.003, 0, z + rise), (x - 0.012, 0, z + rise), *hook]
    return [Part("bowl", moved(turned(wall), 0.032, 0, 0)), Part("handle", tube(line, 0.0038))]


def _rolling_pin(v: Vary) -> list[Part]:
    r, half, grip = 0.0145 * v(), 0.028 * v(), 0.0085 * v()
    body = [(0, -half), (r - 0.002, -half), (r, 0.002 - half), (r, half - 0.002), (r - 0.002, half), (0, half)]
    knob = [(0, 0), (0.004, 0), (0.004, 0.006), (grip, 0.013), (0.9 * grip, 0.020), (0, 0.023)]
    ends = [tilted(moved(turned(knob, True), half, 0, 0), angle, "z") for angle in (0, np.pi)]
    return [Part("body", turned(body, True)), Part("handles", join(*ends), WOOD)]


def _whisk(v: Vary) -> list[Part]:
    r = 0.0215 * v()
    lean = (0.87 * r - 0.005) / 0.087  # So that it rests on the wires and on the handle's end.
    t = np.linspace(0, 1, 8)
    side = np.stack([0.004 + 0.060 * t, r * np.sin(np.pi * t**1.6) ** 0.8, 0 * t], axis=1)
    wires = [tilted(tube(side, 0.0015, sections=6), k * np.pi / 3) for k in range(6)]
    profile = [(0, -0.044), (0.006, -0.042), (0.0075, -0.03), (0.0055, -0.012), (0.0065, 0.008), (0, 0.010)]
    grip, cage = (tilted(mesh, -lean, "y") for mesh in (turned(profile, True), join(*wires)))
    return [Part("handle", grip), Part("wires", cage, METAL)]


def _salt_shaker(v: Vary) -> list[Part]:
    r, h = 0.0225 * v(), 0.044 * v()
    q = 0.8 * r
    body = turned([(0, 0), (r, 0), (0.66 * r, h), (0, h)], sections=8)
    cap = turned([(0, h), (q, h), (q, h + 0.009), (0.85 * q, h + 0.015), (0.45 * q, h + 0.019), (0, h + 0.020)])
    ring = np.arange(5) * 2 * np.pi / 5
    spots = [(0, 0, h + 0.019), *((0.58 * q * np.cos(a), 0.58 * q * np.sin(a), h + 0.017) for a in ring)]
    holes = join(*[ball(spot, (0.003, 0.003, 0.0024), 1) for spot in spots])
    return [Part("body", body), Part("cap", cap, METAL), Part("holes", holes, DARK)]
