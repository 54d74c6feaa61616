"""Toy animals, part by part."""

from __future__ import annotations

from itertools import product
from math import radians

import numpy as np
import trimesh
from shapely import Polygon, affinity, union_all

from gem_lite.simulation.bodies.parts import DARK, LEAF, PALE, RGBA, Part, Vary
from gem_lite.simulation.bodies.solids import SIDES, ball, disc, join, moved, oval, rod, slab, tilted, tube, turned

_WATER: RGBA = (0.72, 0.88, 0.97, 1.0)


def _fish(v: Vary) -> list[Part]:
    w, span = 0.020 * v(), 0.026 * v()
    body = ball((0.012, 0, 0.012), (0.036, w, 0.012))
    upper = [(-0.014, 0.006), (-0.052, span), (-0.042, 0.3 * span)]
    fork = Polygon([*upper, (-0.040, 0), *((x, -y) for x, y in reversed(upper))])
    back = Polygon([(0.028, 0.8 * w), (-0.002, w + 0.014), (-0.010, w + 0.012), (-0.006, 0.7 * w)])
    belly = Polygon([(0.016, -0.8 * w), (0.0, -w - 0.010), (-0.007, -w - 0.008), (-0.004, -0.7 * w)])
    fins = join(slab(back, 0.004, 0.011), slab(belly, 0.004, 0.011))
    eye = ball((0.032, 0.25 * w, 0.0205), (0.0048, 0.0048, 0.003), 1)
    return [Part("", body), Part("fish tail", slab(fork, 0, 0.011)), Part("fish fins", fins), Part("", eye, DARK)]


def _turtle(v: Vary) -> list[Part]:
    length, w, h = 0.032 * v(), 0.027 * v(), 0.026 * v()
    dome = tilted(ball((0, 0, 0), 1.0, 1), radians(90), "z")
    dome.vertices[:, 2] = np.maximum(dome.vertices[:, 2], 0)
    dome.apply_scale((length, w, h)).apply_translation((0, 0, 0.010))
    rim = slab(oval(0, 0, 2 * length + 0.006, 2 * w + 0.006), 0.007, 0.011)
    legs = []
    for front, side in product(SIDES, SIDES):
        leg = tilted(ball((0.013, 0, 0), (0.015, 0.008, 0.005), 1), radians(side * (90 - front * 32)), "z")
        legs.append(moved(leg, 0.55 * front * length, 0.68 * side * w, 0.005))
    neck = rod((0.7 * length, 0, 0.01), (length + 0.01, 0, 0.014), 0.006)
    head = join(ball((length + 0.013, 0, 0.016), (0.012, 0.010, 0.010), 1), neck)
    tail = moved(tilted(trimesh.creation.cone(0.005, 0.016, sections=8), radians(-90), "y"), -length, 0, 0.007)
    limbs = join(*legs, tail)
    return [Part("turtle shell", join(dome, rim)), Part("turtle legs", limbs, LEAF), Part("turtle head", head, LEAF)]


def _rabbit(v: Vary) -> list[Part]:
    w, ear = 0.022 * v(), 0.022 * v()
    body = ball((-0.010, 0, 0.022), (0.030, w, 0.022))
    paws = [ball((x, s * 0.7 * w, 0.005), (0.012, 0.007, 0.005), 1) for x in (-0.014, 0.018) for s in SIDES]
    head = ball((0.026, 0, 0.040), (0.017, 0.015, 0.015))
    ears = []
    for side in SIDES:
        upright = ball((0, 0, 0.9 * ear), (0.0045, 0.0085, ear), 1)
        leaning = tilted(tilted(upright, radians(-22 * side), "x"), radians(-30), "y")
        ears.append(moved(leaning, 0.020, 0.006 * side, 0.050))
    tail = ball((-0.042, 0, 0.024), 0.010, 1)
    return [Part("", join(body, *paws, head)), Part("rabbit ears", join(*ears)), Part("rabbit tail", tail, PALE)]


def _butterfly(v: Vary) -> list[Part]:
    fore, hind, w = 0.052 * v(), 0.036 * v(), 0.033 * v()
    wings, feelers = [], []
    for side in SIDES:
        upper = affinity.rotate(oval(fore / 2, 0, fore, w), side * 58, origin=(0, 0))
        lower = affinity.rotate(oval(hind / 2, 0, hind, 0.85 * w), side * 122, origin=(0, 0))
        wings.append(upper.union(affinity.translate(lower, -0.002, 0)))
        feelers.append(tube([(0.024, 0, 0.006), (0.036, side * 0.007, 0.008), (0.044, side * 0.016, 0.008)], 0.0018))
        feelers.append(ball((0.045, side * 0.017, 0.008), 0.004, 0))
    body = join(ball((-0.004, 0, 0.006), (0.030, 0.0055, 0.006), 1), ball((0.025, 0, 0.007), 0.0068, 1), *feelers)
    return [Part("butterfly wings", slab(union_all(wings), 0, 0.004)), Part("butterfly body", body, DARK)]


def _crab(v: Vary) -> list[Part]:
    length, w, claw = 0.022 * v(), 0.030 * v(), 0.016 * v()
    shell = ball((0, 0, 0.014), (length, w, 0.012))
    claws, legs, eyes = [], [], []
    for side in SIDES:
        tip = (0.036, side * 0.026, 0.012)
        gap = Polygon([(-0.1 * claw, 0), (2 * claw, -0.75 * claw), (2 * claw, 0.75 * claw)])
        jaw = disc(0, 0, claw).difference(gap)
        jaw = affinity.translate(affinity.rotate(jaw, -28 * side, origin=(0, 0)), tip[0], tip[1])
        claws.append(slab(jaw, 0.006, 0.018))
        claws.append(tube([(0.006, side * 0.8 * w, 0.012), (0.018, side * (w + 0.008), 0.012), tip], 0.0045))
        for x in (-0.013, -0.003, 0.007):
            knee = (1.4 * x - 0.002, side * (w + 0.009), 0.015)
            legs.append(tube([(x, side * 0.75 * w, 0.012), knee, (2.0 * x - 0.006, side * (w + 0.019), 0)], 0.003))
        eyes.append(rod((length - 0.006, side * 0.009, 0.018), (length, side * 0.010, 0.030), 0.0022))
        eyes.append(ball((length, side * 0.010, 0.031), 0.0048, 1))
    claws, legs, eyes = join(*claws), join(*legs), join(*eyes)
    return [Part("", shell), Part("crab claws", claws), Part("crab legs", legs), Part("crab eyes", eyes, DARK)]


def _snail(v: Vary) -> list[Part]:
    r, thick = 0.027 * v(), 0.0095 * v()
    turns = np.linspace(0, 4.4 * np.pi, 27)
    reach = (r - thick) * (1 - turns / turns[-1]) ** 0.9
    middle = np.array([-0.006, 0.010, thick])
    coil = np.stack([reach * np.cos(turns - 0.5), reach * np.sin(turns - 0.5), 0.9 * thick * turns / turns[-1]], axis=1)
    wide = thick * np.linspace(1.0, 0.55, len(turns))
    ends = zip(coil + middle, coil[1:] + middle, wide, strict=False)
    shell = join(*[rod(start, end, size, sections=10) for start, end, size in ends])
    low = middle[1] - r + 0.002
    edge = [
        (-0.050, -0.008), (0.034, -0.008), (0.044, 0.002), (0.046, 0.014), (0.036, 0.020), (0.028, 0.012),
        (0.020, 0.006), (-0.020, 0.004),
    ]  # fmt: skip
    foot = slab(Polygon([(x, low + y) for x, y in edge]), 0, 0.014)
    horns = []
    for x in (0.034, 0.053):
        horns.append(rod((0.040, low + 0.012, 0.008), (x, low + 0.034, 0.008), 0.0022))
        horns.append(ball((x, low + 0.034, 0.008), 0.0038, 1))
    return [Part("snail shell", shell), Part("", foot, PALE), Part("snail horns", join(*horns), PALE)]


def _elephant(v: Vary) -> list[Part]:
    w, ear, thick = 0.021 * v(), 0.034 * v(), 0.0062 * v()
    body = ball((-0.016, 0, 0.033), (0.028, w, 0.020))
    legs = [rod((x, s * 0.55 * w, 0), (x, s * 0.55 * w, 0.026), 0.0085) for x in (-0.032, 0.002) for s in SIDES]
    head = ball((0.018, 0, 0.043), (0.016, 0.015, 0.016), 1)
    ears = []
    for side in SIDES:
        flap = slab(oval(0, side * (0.010 + 0.42 * ear), 1.05 * ear, 0.9 * ear), -0.002, 0.002)
        ears.append(moved(tilted(flap, radians(50), "y"), 0.012, 0, 0.046))
    path = [(0.028, 0.040), (0.040, 0.028), (0.050, 0.020), (0.061, 0.020), (0.067, 0.028), (0.068, 0.036)]
    trunk = tube([(x, 0, z) for x, z in path], thick * np.linspace(1.25, 0.8, len(path)))
    tusks = [rod((0.026, s * 0.009, 0.036), (0.046, s * 0.014, 0.032), 0.0028) for s in SIDES]
    return [
        Part("", join(body, *legs, head)),
        Part("elephant ears", join(*ears)),
        Part("elephant trunk", trunk),
        Part("elephant tusks", join(*tusks), PALE),
    ]


def _whale(v: Vary) -> list[Part]:
    r, span = 0.025 * v(), 0.029 * v()
    profile = [(0, -0.044), (0.16, -0.044), (0.6, -0.018), (1, 0.012), (0.95, 0.030), (0.6, 0.044), (0, 0.048)]
    body = turned([(share * r, z) for share, z in profile], True)
    body.vertices[:, 2] = np.maximum(body.vertices[:, 2], -0.55 * r)
    stem = tube([(-0.030, 0, -0.1 * r), (-0.044, 0, 0.004), (-0.050, 0, 0.014)], [0.009, 0.006, 0.004])
    half = [(0.002, 0.6 * span), (-0.012, span), (-0.018, 0.5 * span)]
    fluke = Polygon([(0.006, 0), *half, (-0.010, 0), *((x, -y) for x, y in reversed(half))])
    tail = moved(tilted(slab(fluke, 0, 0.004), radians(25), "y"), -0.048, 0, 0.012)
    fins, jets = [], []
    for s in SIDES:
        fin = [(0.018, s * 0.8 * r), (0.004, s * 0.8 * r), (-0.012, s * (r + 0.018)), (0.0, s * (r + 0.016))]
        fins.append(slab(Polygon(fin), -0.5 * r, 0.004 - 0.5 * r))
        path = [(0, 0.8 * r), (s * 0.003, r + 0.016), (s * 0.011, r + 0.023), (s * 0.018, r + 0.014)]
        jets.append(tube([(0.016, y, z) for y, z in path], 0.0032))
    whole, fins, jets = join(body, stem), join(*fins), join(*jets)
    return [Part("", whole), Part("whale tail", tail), Part("whale fins", fins), Part("", jets, _WATER)]
