"""Toys, tools, stationery and kitchen things, part by part."""

from __future__ import annotations

from itertools import pairwise
from typing import cast

import numpy as np
import trimesh
from shapely import LineString, Polygon, affinity, box, union_all  # type: ignore[import-untyped]
from trimesh import Trimesh

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


def _join(*pieces: Trimesh) -> Trimesh:
    return cast(Trimesh, trimesh.util.concatenate(list(pieces)))


def _bead(centre: tuple, radii: float | tuple) -> Trimesh:
    """A ball or ellipsoid of few triangles, for small things."""
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    mesh.apply_scale(np.broadcast_to(radii, 3))
    mesh.apply_translation(centre)
    return mesh


def _wire(points: np.ndarray, radius: float) -> Trimesh:
    """A thin tube with few sides along (N, 3) points."""
    return _join(*[trimesh.creation.cylinder(radius, segment=ends, sections=6) for ends in pairwise(points)])


def _turn(mesh: Trimesh, angle: float, axis: str = "x") -> Trimesh:
    """The mesh, turned about the x, y or z axis (in place)."""
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, np.eye(3)["xyz".index(axis)]))


def _moved(mesh: Trimesh, x: float, y: float, z: float) -> Trimesh:
    """The mesh, moved (in place)."""
    return mesh.apply_translation([x, y, z])


def _wheels(xs: tuple, radius: float, y: float, width: float) -> Trimesh:
    """Pairs of wheels on the table at each x; ``y`` is where they begin."""
    return _join(*[rod((x, s * y, radius), (x, s * (y + width), radius), radius) for x in xs for s in (-1, 1)])


def _toy_train(v: Vary) -> list[Part]:
    r, roof, funnel = 0.0125 * v(), 0.050 * v(), 0.010 * v()
    top = 0.013 + 2 * r
    boiler = rod((-0.02, 0, 0.013 + r), (0.036, 0, 0.013 + r), r)
    guard = slab(Polygon([(0.038, -0.016), (0.056, 0), (0.038, 0.016)]), 0.002, 0.013)
    posts = [bar(x - 0.0025, x + 0.0025, 0.005, 0.03, roof, y) for x in (-0.043, -0.021) for y in (-0.015, 0.015)]
    cab = _join(bar(-0.046, -0.018, 0.036, 0.012, 0.031), *posts, bar(-0.052, -0.013, 0.044, roof, roof + 0.004))
    chimney = turned([(0, 0), (0.0055, 0), (0.0055, 0.012), (funnel, 0.024), (0, 0.024)])
    return [
        Part("", _join(boiler, bar(-0.046, 0.040, 0.024, 0.008, 0.015), guard, _bead((0.0, 0, top), 0.007))),
        Part("cab", cab),
        Part("chimney", _moved(chimney, 0.026, 0, top - 0.002), DARK),
        Part("wheels", _wheels((-0.034, -0.008, 0.018), 0.0105, 0.012, 0.007), DARK),
    ]


def _rocket(v: Vary) -> list[Part]:
    r, sweep = 0.0145 * v(), 0.032 * v()
    body = turned([(0, -0.04), (0.7 * r, -0.04), (r, -0.02), (r, 0.016), (0, 0.016)], True)
    nose = turned([(r, 0.016), (0.92 * r, 0.028), (0.62 * r, 0.043), (0, 0.058)], True)
    # The tips of the two lower fins are as low as the body.
    tip = 2 * r - 0.0035
    fin = Polygon([(-0.006, 0.8 * r), (-sweep, tip), (-0.052, tip), (-0.040, 0.5 * r)])
    fins = [_turn(slab(fin, -0.002, 0.002), np.pi * (0.5 + 2 * k / 3)) for k in range(3)]
    windows = [_turn(rod((0.004, 0, 0), (0.004, 0, r + 0.001), 0.0065), a) for a in (-0.9, 0.9)]
    return [
        Part("", body), Part("nose", nose, PALE), Part("fins", _join(*fins)), Part("window", _join(*windows), DARK)
    ]  # fmt: skip


def _robot(v: Vary) -> list[Part]:
    w, h, side = 0.034 * v(), 0.018 * v(), 0.034 * v()
    out = w / 2 + 0.013
    body = bar(-0.020, 0.012, w, 0, h)
    feet = [bar(-0.053, -0.043, 0.015, 0, 0.016, s * 0.012) for s in (-1, 1)]
    rings = [(s, disc(-0.018, s * out, 0.0085, 0.004)) for s in (-1, 1)]
    claws = [slab(ring.difference(box(-0.04, s * out - 0.003, -0.02, s * out + 0.003)), 0, 0.010) for s, ring in rings]
    limbs = [bar(-0.045, -0.018, 0.007, 0.002, 0.009, s * 0.011) for s in (-1, 1)]
    for s in (-1, 1):
        limbs.append(_wire(np.array([(0.006, 0, 0.006), (0.006, s * out, 0.006), (-0.012, s * out, 0.006)]), 0.0035))
    head = _join(bar(0.017, 0.041, side, 0, h + 0.004), bar(0.024, 0.034, side + 0.008, 0.003, 0.013))
    antenna = _join(rod((0.040, 0, 0.009), (0.050, 0, 0.009), 0.002), _bead((0.051, 0, 0.009), 0.005))
    eyes = [rod((0.032, s * side / 4, h), (0.032, s * side / 4, h + 0.006), 0.0052) for s in (-1, 1)]
    return [
        Part("", _join(body, *feet, *claws)),
        Part("head", _join(head, antenna)),
        Part("eyes", _join(*eyes, bar(0.020, 0.0235, 0.6 * side, h, h + 0.006)), DARK),
        Part("", _join(*limbs, bar(0.010, 0.018, 0.012, 0.003, 0.012)), METAL),
    ]


def _drum(v: Vary) -> list[Part]:
    r, h = 0.033 * v(), 0.034 * v()
    low, high = r - 0.003, r + 0.003
    hoops = [turned([(low, z), (high, z), (high, z + 0.006), (low, z + 0.006)]) for z in (0, h - 0.004)]
    t = np.linspace(0, 2 * np.pi, 17)
    zigzag = np.where(np.arange(17) % 2, h - 0.005, 0.005)
    cord = _wire(np.stack([(r + 0.0005) * np.cos(t), (r + 0.0005) * np.sin(t), zigzag], axis=1), 0.0018)
    skin = turned([(0, h), (r - 0.002, h), (r - 0.002, h + 0.001), (0, h + 0.001)])
    sticks = []
    for s in (-1, 1):
        tip = (0.020, -s * 0.012, h + 0.006)
        sticks += [rod((-0.046, s * 0.022, h + 0.006), tip, 0.0025), _bead(tip, 0.0055)]
    return [
        Part("", _join(turned([(0, 0), (r, 0), (r, h), (0, h)]), *hoops)),
        Part("skin", _join(skin, cord), PALE),
        Part("sticks", _join(*sticks), WOOD),
    ]


def _guitar(v: Vary) -> list[Part]:
    low, high = 0.0225 * v(), 0.0160 * v()
    outline = union_all([disc(-0.029, 0, low), disc(0.001, 0, high), box(-0.022, -0.5 * high, 0, 0.5 * high)])
    head = Polygon([(0.042, -0.005), (0.058, -0.008), (0.058, 0.008), (0.042, 0.005)])
    neck = slab(union_all([box(-0.004, -0.0035, 0.050, 0.0035), head]), 0.010, 0.015)
    pegs = slab(union_all([box(x, -0.012, x + 0.003, 0.012) for x in (0.044, 0.049, 0.054)]), 0.011, 0.014)
    hole = slab(disc(-0.010, 0, 0.0075), 0.010, 0.0125)
    return [
        Part("body", slab(outline.buffer(0.002, 4).buffer(-0.002, 4).simplify(0.0003), 0, 0.012)),
        Part("neck", _join(neck, pegs), WOOD),
        Part("hole", _join(hole, bar(-0.040, -0.035, 0.022, 0.011, 0.0145)), DARK),
    ]


def _trumpet(v: Vary) -> list[Part]:
    r, half, z = 0.0215 * v(), 0.013 * v(), 0.007
    bell = turned([(0.0035, 0.012), (0.005, 0.028), (0.009, 0.040), (r, 0.052), (r - 0.003, 0.053), (0.0, 0.034)], True)
    bell.apply_scale([1, 1, 0.65])  # A little flat, so that all of the trumpet lies on the table.
    right = arc(half, -np.pi / 2, np.pi / 2, (0.022, 0, z), count=6)
    left = arc(half, np.pi / 2, 3 * np.pi / 2, (-0.024, 0, z), count=6)
    loop = tube(np.concatenate([right, left, right[:1]]), 0.0035)
    mouth = _moved(turned([(0, -0.048), (0.003, -0.048), (0.0065, -0.058), (0, -0.058)], True), 0, half, z)
    valves = [rod((x, -half - 0.006, z), (x, half + 0.013, z), 0.006) for x in (-0.016, -0.001, 0.014)]
    return [
        Part("", _join(loop, rod((-0.054, half, z), (0.02, half, z), 0.0035), mouth)),
        Part("bell", _moved(bell, 0, half, 0.001 + 0.65 * r)),
        Part("valves", _join(*valves), METAL),
    ]


def _truck(v: Vary) -> list[Part]:
    w, h, back = 0.036 * v(), 0.032 * v(), -0.050
    frame = bar(-0.048, 0.046, 0.022, 0.009, 0.014)
    cab = _join(bar(0.022, 0.048, w, 0.009, 0.026), bar(0.022, 0.040, w, 0.026, 0.044))
    floor = bar(back, 0.016, w, 0.014, 0.017)
    walls = [bar(back, 0.016, 0.003, 0.014, h + 0.006, s * w / 2) for s in (-1, 1)]
    ends = [bar(x, x + 0.003, w, 0.014, h + 0.006) for x in (back, 0.013)]
    glass = _join(bar(0.025, 0.0408, w - 0.006, 0.029, 0.041), bar(0.026, 0.037, w + 0.001, 0.029, 0.041))
    wheels = _wheels((-0.038, -0.016, 0.034), 0.0105, w / 2 - 0.003, 0.008)
    bed = _join(floor, *walls, *ends)
    return [Part("cab", _join(cab, frame)), Part("bed", bed), Part("wheels", wheels, DARK), Part("window", glass, DARK)]


def _teddy_bear(v: Vary) -> list[Part]:
    r, body = 0.0195 * v(), 0.0195 * v()
    trunk = ball((-0.010, 0, 0.016), (0.024, body, 0.016))
    arms = [_bead((0.004, s * (body + 0.006), 0.013), (0.009, 0.014, 0.009)) for s in (-1, 1)]
    legs = [_bead((-0.034, s * (body - 0.003), 0.012), (0.016, 0.010, 0.012)) for s in (-1, 1)]
    head = ball((0.028, 0, 0.018), (r, r * 1.1, 0.018))
    ears = [_bead((0.027 + 0.80 * r, s * 0.98 * r, 0.014), (0.010, 0.010, 0.006)) for s in (-1, 1)]
    muzzle = _bead((0.025, 0, 0.033), (0.008, 0.009, 0.007))
    dots = [_bead((0.035, s * 0.0075, 0.0345), 0.0027) for s in (-1, 1)] + [_bead((0.027, 0, 0.040), 0.0033)]
    return [
        Part("", _join(trunk, *arms, *legs)), Part("head", _join(head, *ears)),
        Part("muzzle", muzzle, PALE), Part("", _join(*dots), DARK),
    ]  # fmt: skip


def _pliers(v: Vary) -> list[Part]:
    gap, bow = 0.007 * v(), 0.024 * v()
    tips = [(0.020, 0.015), (0.048, gap + 0.006), (0.048, gap - 0.001), (0.010, 0.001)]
    jaw = Polygon([(-0.004, 0), (0.002, 0.014), *tips])
    line = [(0.006, -0.002), (-0.006, -0.012), (-0.022, -bow), (-0.038, -bow), (-0.056, -0.85 * bow)]
    grip = LineString(line).buffer(0.0055, 3)
    jaws, grips = (slab(union_all([a, affinity.scale(a, 1, -1, origin=(0, 0))]), 0, 0.009) for a in (jaw, grip))
    return [Part("handles", grips), Part("jaws", _join(jaws, slab(disc(0.003, 0, 0.012), 0, 0.012)), METAL)]


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
    left = _turn(slab(half, 0, 0.003), 0.35)
    right = _turn(slab(affinity.scale(half, 1, -1, origin=(0, 0)), 0, 0.003), -0.35)
    frame = Polygon([(-0.036, 0), (-0.055, grip), (-0.055, -grip)]).buffer(0.002, 2)
    frame = frame.difference(Polygon([(-0.043, 0), (-0.051, 0.55 * grip), (-0.051, -0.55 * grip)]))
    shaft = rod((-0.040, 0, 0.005), (0.020, 0, 0.005), 0.0038)
    return [Part("blade", _join(left, right)), Part("shaft", shaft, WOOD), Part("handle", slab(frame, 0, 0.009))]


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
    screw = _join(
        rod((end - out, y, z), (0.012, y, z), 0.0035),
        rod((0.010, y, z), (0.016, y, z), 0.008),
        rod((end - out, y - 0.018, z), (end - out, y + 0.018, z), 0.003),
    )
    return [Part("frame", slab(frame, 0, 0.012)), Part("screw", screw, METAL)]


def _paint_roller(v: Vary) -> list[Part]:
    half, r = 0.030 * v(), 0.0125 * v()
    bend = [(0.036, half, r), (0.036, half + 0.008, r), (0.012, half + 0.008, r), (0.004, 0, 0.007), (-0.022, 0, 0.006)]
    grip = [(0, -0.058), (0.007, -0.056), (0.0085, -0.044), (0.006, -0.032), (0.0075, -0.016), (0, -0.016)]
    return [
        Part("sleeve", rod((0.036, -half, r), (0.036, half, r), r)),
        Part("", tube(np.array(bend), 0.0028), METAL),
        Part("handle", _moved(turned(grip, True), 0, 0, 0.0085), DARK),
    ]


def _ladle(v: Vary) -> list[Part]:
    r, rise = 0.0205 * v(), 0.014 * v()
    a = np.linspace(-np.pi / 2, 0, 6)
    wall = [(q * np.cos(t), r + q * np.sin(t)) for q, order in ((r, a), (r - 0.003, a[::-1])) for t in order]
    x, z = 0.034 - r, r - 0.002
    hook = [(-0.044, 0, 0.0045), (-0.051, 0, 0.0045), (-0.054, 0, 0.012), (-0.048, 0, 0.018), (-0.042, 0, 0.016)]
    line = np.array([(x, 0, z), (x - 0.003, 0, z + rise), (x - 0.012, 0, z + rise), *hook])
    return [Part("bowl", _moved(turned(wall), 0.032, 0, 0)), Part("handle", tube(line, 0.0038))]


def _rolling_pin(v: Vary) -> list[Part]:
    r, half, grip = 0.0145 * v(), 0.028 * v(), 0.0085 * v()
    body = [(0, -half), (r - 0.002, -half), (r, 0.002 - half), (r, half - 0.002), (r - 0.002, half), (0, half)]
    knob = [(0, 0), (0.004, 0), (0.004, 0.006), (grip, 0.013), (0.9 * grip, 0.020), (0, 0.023)]
    ends = [_turn(_moved(turned(knob, True), half, 0, 0), angle, "z") for angle in (0, np.pi)]
    return [Part("body", turned(body, True)), Part("handles", _join(*ends), WOOD)]


def _whisk(v: Vary) -> list[Part]:
    r = 0.0215 * v()
    lean = (0.87 * r - 0.005) / 0.087  # So that it rests on the wires and on the handle's end.
    t = np.linspace(0, 1, 8)
    side = np.stack([0.004 + 0.060 * t, r * np.sin(np.pi * t**1.6) ** 0.8, 0 * t], axis=1)
    wires = [_turn(_wire(side, 0.0015), k * np.pi / 3) for k in range(6)]
    profile = [(0, -0.044), (0.006, -0.042), (0.0075, -0.03), (0.0055, -0.012), (0.0065, 0.008), (0, 0.010)]
    grip, cage = (_turn(mesh, -lean, "y") for mesh in (turned(profile, True), _join(*wires)))
    return [Part("handle", grip), Part("wires", cage, METAL)]


def _salt_shaker(v: Vary) -> list[Part]:
    r, h = 0.0225 * v(), 0.044 * v()
    q = 0.8 * r
    body = trimesh.creation.revolve(np.array([(0, 0), (r, 0), (0.66 * r, h), (0, h)]), sections=8)
    cap = turned([(0, h), (q, h), (q, h + 0.009), (0.85 * q, h + 0.015), (0.45 * q, h + 0.019), (0, h + 0.020)])
    ring = np.arange(5) * 2 * np.pi / 5
    spots = [(0, 0, h + 0.019), *((0.58 * q * np.cos(a), 0.58 * q * np.sin(a), h + 0.017) for a in ring)]
    return [
        Part("body", body),
        Part("cap", cap, METAL),
        Part("holes", _join(*[_bead(spot, (0.003, 0.003, 0.0024)) for spot in spots]), DARK),
    ]


MAKERS: dict[str, Maker] = {
    "toy train": _toy_train,
    "rocket": _rocket,
    "robot": _robot,
    "drum": _drum,
    "guitar": _guitar,
    "trumpet": _trumpet,
    "truck": _truck,
    "teddy bear": _teddy_bear,
    "pliers": _pliers,
    "saw": _saw,
    "axe": _axe,
    "shovel": _shovel,
    "tape roll": _tape_roll,
    "stapler": _stapler,
    "clamp": _clamp,
    "paint roller": _paint_roller,
    "ladle": _ladle,
    "rolling pin": _rolling_pin,
    "whisk": _whisk,
    "salt shaker": _salt_shaker,
}
