"""Toys, vehicles, music and sports, part by part."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely import Polygon, box, union_all
from trimesh import Trimesh

from gem_lite.simulation.bodies.parts import DARK, METAL, PALE, WOOD, Part, Vary
from gem_lite.simulation.bodies.solids import SIDES, arc, ball, bar, disc, join, moved, rod, slab, tilted, tube, turned


def _wheels(xs: tuple, radius: float, y: float, width: float) -> Trimesh:
    """Pairs of wheels on the table at each x; ``y`` is where they begin."""
    return join(*[rod((x, s * y, radius), (x, s * (y + width), radius), radius) for x in xs for s in SIDES])


def _toy_car(v: Vary) -> list[Part]:
    w, roof = 0.036 * v(), 0.034 * v()
    body = bar(-0.04, 0.04, w, 0.007, 0.02)
    cabin = bar(-0.024, 0.014, w - 0.006, 0.02, roof)
    ends = [((x, s * w / 2, 0.009), (x, s * (w / 2 + 0.007), 0.009)) for x in (-0.024, 0.025) for s in SIDES]
    wheels = join(*[rod(start, end, 0.0095) for start, end in ends])
    return [Part("", body), Part("roof", cabin), Part("wheels", wheels, DARK)]


def _airplane(v: Vary) -> list[Part]:
    span, w = 0.048 * v(), 0.016 * v()
    wings = Polygon([(0.014, 0), (0.0, span), (-w, span), (-0.008, 0), (-w, -span), (0.0, -span)])
    tail = Polygon([(-0.038, 0), (-0.046, 0.019), (-0.054, 0.019), (-0.05, 0), (-0.054, -0.019), (-0.046, -0.019)])
    fin = bar(-0.052, -0.04, 0.003, 0.012, 0.028)
    body = ball((0, 0, 0.01), (0.052, 0.0085 * v(), 0.0095))
    return [Part("", body), Part("wings", slab(wings, 0.009, 0.013)), Part("tail", join(slab(tail, 0.010, 0.014), fin))]


def _duck(v: Vary) -> list[Part]:
    body = ball((-0.008, 0, 0.018), (0.032 * v(), 0.022 * v(), 0.018))
    tail = moved(tilted(trimesh.creation.cone(0.010, 0.018, sections=10), -np.pi / 3, "y"), -0.033, 0, 0.024)
    head = ball((0.021, 0, 0.044), 0.0145 * v())
    beak = ball((0.037, 0, 0.042), (0.008, 0.006, 0.003))
    return [Part("", join(body, tail)), Part("head", head), Part("beak", beak, (0.95, 0.55, 0.15, 1))]


def _dumbbell(v: Vary) -> list[Part]:
    r, w = 0.019 * v(), 0.018 * v()
    weights = [rod((s * 0.042, 0, 0), (s * (0.042 - w), 0, 0), r) for s in SIDES]
    return [Part("weights", join(*weights)), Part("bar", rod((-0.03, 0, 0), (0.03, 0, 0), 0.006 * v()), METAL)]


def _sailboat(v: Vary) -> list[Part]:
    length, w = 0.042 * v(), 0.014 * v()
    hull = Polygon([(length, 0), (0.4 * length, w), (-length, 0.8 * w), (-length, -0.8 * w), (0.4 * length, -w)])
    sail = Polygon([(-0.03, 0.018), (0.012, 0.018), (0.008, 0.068 * v())])
    cloth = tilted(slab(sail, -0.001, 0.001), np.pi / 2)
    mast = rod((0.012, 0, 0.01), (0.012, 0, 0.07), 0.002)
    return [Part("hull", slab(hull, 0, 0.014)), Part("sail", cloth, PALE), Part("", mast, WOOD)]


def _toy_train(v: Vary) -> list[Part]:
    r, roof, funnel = 0.0125 * v(), 0.050 * v(), 0.010 * v()
    top = 0.013 + 2 * r
    boiler = rod((-0.02, 0, 0.013 + r), (0.036, 0, 0.013 + r), r)
    guard = slab(Polygon([(0.038, -0.016), (0.056, 0), (0.038, 0.016)]), 0.002, 0.013)
    posts = [bar(x - 0.0025, x + 0.0025, 0.005, 0.03, roof, y) for x in (-0.043, -0.021) for y in (-0.015, 0.015)]
    cab = join(bar(-0.046, -0.018, 0.036, 0.012, 0.031), *posts, bar(-0.052, -0.013, 0.044, roof, roof + 0.004))
    chimney = turned([(0, 0), (0.0055, 0), (0.0055, 0.012), (funnel, 0.024), (0, 0.024)])
    return [
        Part("", join(boiler, bar(-0.046, 0.040, 0.024, 0.008, 0.015), guard, ball((0.0, 0, top), 0.007, 1))),
        Part("cab", cab),
        Part("chimney", moved(chimney, 0.026, 0, top - 0.002), DARK),
        Part("wheels", _wheels((-0.034, -0.008, 0.018), 0.0105, 0.012, 0.007), DARK),
    ]


def _rocket(v: Vary) -> list[Part]:
    r, sweep = 0.0145 * v(), 0.032 * v()
    body = turned([(0, -0.04), (0.7 * r, -0.04), (r, -0.02), (r, 0.016), (0, 0.016)], True)
    nose = turned([(r, 0.016), (0.92 * r, 0.028), (0.62 * r, 0.043), (0, 0.058)], True)
    # The tips of the two lower fins are as low as the body.
    tip = 2 * r - 0.0035
    fin = Polygon([(-0.006, 0.8 * r), (-sweep, tip), (-0.052, tip), (-0.040, 0.5 * r)])
    fins = [tilted(slab(fin, -0.002, 0.002), np.pi * (0.5 + 2 * k / 3)) for k in range(3)]
    windows = [tilted(rod((0.004, 0, 0), (0.004, 0, r + 0.001), 0.0065), a) for a in (-0.9, 0.9)]
    return [Part("", body), Part("nose", nose, PALE), Part("fins", join(*fins)), Part("window", join(*windows), DARK)]


def _robot(v: Vary) -> list[Part]:
    w, h, side = 0.034 * v(), 0.018 * v(), 0.034 * v()
    out = w / 2 + 0.013
    body = bar(-0.020, 0.012, w, 0, h)
    feet = [bar(-0.053, -0.043, 0.015, 0, 0.016, s * 0.012) for s in SIDES]
    rings = [(s, disc(-0.018, s * out, 0.0085, 0.004)) for s in SIDES]
    claws = [slab(ring.difference(box(-0.04, s * out - 0.003, -0.02, s * out + 0.003)), 0, 0.010) for s, ring in rings]
    limbs = [bar(-0.045, -0.018, 0.007, 0.002, 0.009, s * 0.011) for s in SIDES]
    for s in SIDES:
        limbs.append(tube([(0.006, 0, 0.006), (0.006, s * out, 0.006), (-0.012, s * out, 0.006)], 0.0035, sections=6))
    head = join(bar(0.017, 0.041, side, 0, h + 0.004), bar(0.024, 0.034, side + 0.008, 0.003, 0.013))
    antenna = join(rod((0.040, 0, 0.009), (0.050, 0, 0.009), 0.002), ball((0.051, 0, 0.009), 0.005, 1))
    eyes = [rod((0.032, s * side / 4, h), (0.032, s * side / 4, h + 0.006), 0.0052) for s in SIDES]
    return [
        Part("", join(body, *feet, *claws)),
        Part("head", join(head, antenna)),
        Part("eyes", join(*eyes, bar(0.020, 0.0235, 0.6 * side, h, h + 0.006)), DARK),
        Part("", join(*limbs, bar(0.010, 0.018, 0.012, 0.003, 0.012)), METAL),
    ]


def _drum(v: Vary) -> list[Part]:
    r, h = 0.033 * v(), 0.034 * v()
    low, high = r - 0.003, r + 0.003
    hoops = [turned([(low, z), (high, z), (high, z + 0.006), (low, z + 0.006)]) for z in (0, h - 0.004)]
    t = np.linspace(0, 2 * np.pi, 17)
    zigzag = np.where(np.arange(17) % 2, h - 0.005, 0.005)
    cord = tube(np.stack([(r + 0.0005) * np.cos(t), (r + 0.0005) * np.sin(t), zigzag], axis=1), 0.0018, sections=6)
    skin = turned([(0, h), (r - 0.002, h), (r - 0.002, h + 0.001), (0, h + 0.001)])
    sticks = []
    for s in SIDES:
        tip = (0.020, -s * 0.012, h + 0.006)
        sticks += [rod((-0.046, s * 0.022, h + 0.006), tip, 0.0025), ball(tip, 0.0055, 1)]
    body = join(turned([(0, 0), (r, 0), (r, h), (0, h)]), *hoops)
    return [Part("", body), Part("skin", join(skin, cord), PALE), Part("sticks", join(*sticks), WOOD)]


def _guitar(v: Vary) -> list[Part]:
    low, high = 0.0225 * v(), 0.0160 * v()
    outline = union_all([disc(-0.029, 0, low), disc(0.001, 0, high), box(-0.022, -0.5 * high, 0, 0.5 * high)])
    head = Polygon([(0.042, -0.005), (0.058, -0.008), (0.058, 0.008), (0.042, 0.005)])
    neck = slab(union_all([box(-0.004, -0.0035, 0.050, 0.0035), head]), 0.010, 0.015)
    pegs = slab(union_all([box(x, -0.012, x + 0.003, 0.012) for x in (0.044, 0.049, 0.054)]), 0.011, 0.014)
    hole = slab(disc(-0.010, 0, 0.0075), 0.010, 0.0125)
    body = slab(outline.buffer(0.002, 4).buffer(-0.002, 4).simplify(0.0003), 0, 0.012)
    dark = join(hole, bar(-0.040, -0.035, 0.022, 0.011, 0.0145))
    return [Part("body", body), Part("neck", join(neck, pegs), WOOD), Part("hole", dark, DARK)]


def _trumpet(v: Vary) -> list[Part]:
    r, half, z = 0.0215 * v(), 0.013 * v(), 0.007
    bell = turned([(0.0035, 0.012), (0.005, 0.028), (0.009, 0.040), (r, 0.052), (r - 0.003, 0.053), (0.0, 0.034)], True)
    bell.apply_scale([1, 1, 0.65])  # A little flat, so that all of the trumpet lies on the table.
    right = arc(half, -np.pi / 2, np.pi / 2, (0.022, 0, z), count=6)
    left = arc(half, np.pi / 2, 3 * np.pi / 2, (-0.024, 0, z), count=6)
    loop = tube(np.concatenate([right, left, right[:1]]), 0.0035)
    mouth = moved(turned([(0, -0.048), (0.003, -0.048), (0.0065, -0.058), (0, -0.058)], True), 0, half, z)
    valves = [rod((x, -half - 0.006, z), (x, half + 0.013, z), 0.006) for x in (-0.016, -0.001, 0.014)]
    pipes = join(loop, rod((-0.054, half, z), (0.02, half, z), 0.0035), mouth)
    moved(bell, 0, half, 0.001 + 0.65 * r)
    return [Part("", pipes), Part("bell", bell), Part("valves", join(*valves), METAL)]


def _truck(v: Vary) -> list[Part]:
    w, h, back = 0.036 * v(), 0.032 * v(), -0.050
    frame = bar(-0.048, 0.046, 0.022, 0.009, 0.014)
    cab = join(bar(0.022, 0.048, w, 0.009, 0.026), bar(0.022, 0.040, w, 0.026, 0.044))
    floor = bar(back, 0.016, w, 0.014, 0.017)
    walls = [bar(back, 0.016, 0.003, 0.014, h + 0.006, s * w / 2) for s in SIDES]
    ends = [bar(x, x + 0.003, w, 0.014, h + 0.006) for x in (back, 0.013)]
    glass = join(bar(0.025, 0.0408, w - 0.006, 0.029, 0.041), bar(0.026, 0.037, w + 0.001, 0.029, 0.041))
    rolling = _wheels((-0.038, -0.016, 0.034), 0.0105, w / 2 - 0.003, 0.008)
    bed = join(floor, *walls, *ends)
    return [Part("cab", join(cab, frame)), Part("bed", bed), Part("wheels", rolling, DARK), Part("window", glass, DARK)]


def _teddy_bear(v: Vary) -> list[Part]:
    r, body = 0.0195 * v(), 0.0195 * v()
    trunk = ball((-0.010, 0, 0.016), (0.024, body, 0.016))
    arms = [ball((0.004, s * (body + 0.006), 0.013), (0.009, 0.014, 0.009), 1) for s in SIDES]
    legs = [ball((-0.034, s * (body - 0.003), 0.012), (0.016, 0.010, 0.012), 1) for s in SIDES]
    head = ball((0.028, 0, 0.018), (r, r * 1.1, 0.018))
    ears = [ball((0.027 + 0.80 * r, s * 0.98 * r, 0.014), (0.010, 0.010, 0.006), 1) for s in SIDES]
    muzzle = ball((0.025, 0, 0.033), (0.008, 0.009, 0.007), 1)
    dots = [ball((0.035, s * 0.0075, 0.0345), 0.0027, 1) for s in SIDES] + [ball((0.027, 0, 0.040), 0.0033, 1)]
    body, head, dots = join(trunk, *arms, *legs), join(head, *ears), join(*dots)
    return [Part("", body), Part("head", head), Part("muzzle", muzzle, PALE), Part("", dots, DARK)]
