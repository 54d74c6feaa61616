"""Toy animals, part by part."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely import affinity
from shapely.geometry import Polygon
from shapely.ops import unary_union

from gem_lite.simulation.bodies.solids import (
    DARK,
    LEAF,
    PALE,
    RGBA,
    Maker,
    Part,
    Vary,
    ball,
    bead,
    disc,
    join,
    oval,
    rod,
    slab,
    tilted,
    tube,
    turned,
)

_SIDES = (-1, 1)
_WATER: RGBA = (0.72, 0.88, 0.97, 1.0)


def _fish(v: Vary) -> list[Part]:
    w, span = 0.020 * v(), 0.026 * v()
    body = ball((0.012, 0, 0.012), (0.036, w, 0.012))
    fork = Polygon(
        [(-0.014, 0.006), (-0.052, span), (-0.042, 0.3 * span), (-0.040, 0), (-0.042, -0.3 * span),
         (-0.052, -span), (-0.014, -0.006)]
    )  # fmt: skip
    back = Polygon([(0.028, 0.8 * w), (-0.002, w + 0.014), (-0.010, w + 0.012), (-0.006, 0.7 * w)])
    belly = Polygon([(0.016, -0.8 * w), (0.0, -w - 0.010), (-0.007, -w - 0.008), (-0.004, -0.7 * w)])
    return [
        Part("", body),
        Part("fish tail", slab(fork, 0, 0.011)),
        Part("fish fins", join([slab(back, 0.004, 0.011), slab(belly, 0.004, 0.011)])),
        Part("", bead((0.032, 0.25 * w, 0.0205), (0.0048, 0.0048, 0.003)), DARK),
    ]


def _turtle(v: Vary) -> list[Part]:
    length, w, h = 0.032 * v(), 0.027 * v(), 0.026 * v()
    dome = tilted(bead((0, 0, 0), 1.0), 90, (0, 0, 1))
    dome.vertices[:, 2] = np.maximum(dome.vertices[:, 2], 0)
    dome.apply_scale((length, w, h)).apply_translation((0, 0, 0.010))
    rim = slab(oval(0, 0, 2 * length + 0.006, 2 * w + 0.006), 0.007, 0.011)
    legs = []
    for front in _SIDES:
        for side in _SIDES:
            leg = bead((0.013, 0, 0), (0.015, 0.008, 0.005))
            place = (0.55 * front * length, 0.68 * side * w, 0.005)
            legs.append(tilted(leg, side * (90 - front * 32), (0, 0, 1)).apply_translation(place))
    head = join(
        [
            bead((length + 0.013, 0, 0.016), (0.012, 0.010, 0.010)),
            rod((0.7 * length, 0, 0.01), (length + 0.01, 0, 0.014), 0.006),
        ]
    )
    tail = tilted(trimesh.creation.cone(0.005, 0.016, sections=8), -90, (0, 1, 0)).apply_translation(
        (-length, 0, 0.007)
    )
    return [
        Part("turtle shell", join([dome, rim])),
        Part("turtle legs", join([*legs, tail]), LEAF),
        Part("turtle head", head, LEAF),
    ]


def _rabbit(v: Vary) -> list[Part]:
    w, ear = 0.022 * v(), 0.022 * v()
    body = ball((-0.010, 0, 0.022), (0.030, w, 0.022))
    paws = [bead((x, s * 0.7 * w, 0.005), (0.012, 0.007, 0.005)) for x in (-0.014, 0.018) for s in _SIDES]
    head = ball((0.026, 0, 0.040), (0.017, 0.015, 0.015))
    ears = []
    for side in _SIDES:
        one = bead((0, 0, 0.9 * ear), (0.0045, 0.0085, ear))
        tilted(tilted(one, -22 * side, (1, 0, 0)), -30, (0, 1, 0))
        ears.append(one.apply_translation((0.020, 0.006 * side, 0.050)))
    return [
        Part("", join([body, *paws, head])),
        Part("rabbit ears", join(ears)),
        Part("rabbit tail", bead((-0.042, 0, 0.024), 0.010), PALE),
    ]


def _butterfly(v: Vary) -> list[Part]:
    fore, hind, w = 0.052 * v(), 0.036 * v(), 0.033 * v()
    wings = []
    for side in _SIDES:
        upper = affinity.rotate(oval(fore / 2, 0, fore, w), side * 58, origin=(0, 0))
        lower = affinity.rotate(oval(hind / 2, 0, hind, 0.85 * w), side * 122, origin=(0, 0))
        wings.append(upper.union(affinity.translate(lower, -0.002, 0)))
    feelers = []
    for side in _SIDES:
        feelers.append(
            tube(np.array([(0.024, 0, 0.006), (0.036, side * 0.007, 0.008), (0.044, side * 0.016, 0.008)]), 0.0018)
        )
        feelers.append(bead((0.045, side * 0.017, 0.008), 0.004, 0))
    body = [bead((-0.004, 0, 0.006), (0.030, 0.0055, 0.006)), bead((0.025, 0, 0.007), 0.0068)]
    return [
        Part("butterfly wings", slab(unary_union(wings), 0, 0.004)),
        Part("butterfly body", join([*body, *feelers]), DARK),
    ]


def _crab(v: Vary) -> list[Part]:
    length, w, claw = 0.022 * v(), 0.030 * v(), 0.016 * v()
    shell = ball((0, 0, 0.014), (length, w, 0.012))
    claws, legs, eyes = [], [], []
    for side in _SIDES:
        tip = (0.036, side * 0.026, 0.012)
        jaw = disc(0, 0, claw).difference(
            Polygon([(-0.1 * claw, 0), (2 * claw, -0.75 * claw), (2 * claw, 0.75 * claw)])
        )
        jaw = affinity.translate(affinity.rotate(jaw, -28 * side, origin=(0, 0)), tip[0], tip[1])
        claws.append(slab(jaw, 0.006, 0.018))
        claws.append(tube(np.array([(0.006, side * 0.8 * w, 0.012), (0.018, side * (w + 0.008), 0.012), tip]), 0.0045))
        for x in (-0.013, -0.003, 0.007):
            knee = (1.4 * x - 0.002, side * (w + 0.009), 0.015)
            legs.append(
                tube(np.array([(x, side * 0.75 * w, 0.012), knee, (2.0 * x - 0.006, side * (w + 0.019), 0)]), 0.003)
            )
        eyes.append(rod((length - 0.006, side * 0.009, 0.018), (length, side * 0.010, 0.030), 0.0022))
        eyes.append(bead((length, side * 0.010, 0.031), 0.0048))
    return [
        Part("", shell),
        Part("crab claws", join(claws)),
        Part("crab legs", join(legs)),
        Part("crab eyes", join(eyes), DARK),
    ]


def _snail(v: Vary) -> list[Part]:
    r, thick = 0.027 * v(), 0.0095 * v()
    turns = np.linspace(0, 4.4 * np.pi, 27)
    reach = (r - thick) * (1 - turns / turns[-1]) ** 0.9
    middle = np.array([-0.006, 0.010, thick])
    coil = np.stack([reach * np.cos(turns - 0.5), reach * np.sin(turns - 0.5), 0.9 * thick * turns / turns[-1]], axis=1)
    wide = thick * np.linspace(1.0, 0.55, len(turns))
    pieces = [
        trimesh.creation.cylinder(size, segment=[a, b], sections=10)
        for a, b, size in zip(coil + middle, coil[1:] + middle, wide, strict=False)
    ]
    low = middle[1] - r + 0.002
    foot = Polygon(
        [(-0.050, low - 0.008), (0.034, low - 0.008), (0.044, low + 0.002), (0.046, low + 0.014), (0.036, low + 0.020),
         (0.028, low + 0.012), (0.020, low + 0.006), (-0.020, low + 0.004)]
    )  # fmt: skip
    horns = []
    for x in (0.034, 0.053):
        horns.append(rod((0.040, low + 0.012, 0.008), (x, low + 0.034, 0.008), 0.0022))
        horns.append(bead((x, low + 0.034, 0.008), 0.0038))
    return [
        Part("snail shell", join(pieces)),
        Part("", slab(foot, 0, 0.014), PALE),
        Part("snail horns", join(horns), PALE),
    ]


def _elephant(v: Vary) -> list[Part]:
    w, ear, thick = 0.021 * v(), 0.034 * v(), 0.0062 * v()
    body = ball((-0.016, 0, 0.033), (0.028, w, 0.020))
    legs = [rod((x, s * 0.55 * w, 0), (x, s * 0.55 * w, 0.026), 0.0085) for x in (-0.032, 0.002) for s in _SIDES]
    head = bead((0.018, 0, 0.043), (0.016, 0.015, 0.016))
    ears = []
    for side in _SIDES:
        flap = slab(oval(0, side * (0.010 + 0.42 * ear), 1.05 * ear, 0.9 * ear), -0.002, 0.002)
        ears.append(tilted(flap, 50, (0, 1, 0)).apply_translation((0.012, 0, 0.046)))
    path = [
        (0.028, 0, 0.040),
        (0.040, 0, 0.028),
        (0.050, 0, 0.020),
        (0.061, 0, 0.020),
        (0.067, 0, 0.028),
        (0.068, 0, 0.036),
    ]
    trunk = tube(np.array(path), thick * np.linspace(1.25, 0.8, len(path)))
    tusks = [rod((0.026, s * 0.009, 0.036), (0.046, s * 0.014, 0.032), 0.0028) for s in _SIDES]
    return [
        Part("", join([body, *legs, head])),
        Part("elephant ears", join(ears)),
        Part("elephant trunk", trunk),
        Part("elephant tusks", join(tusks), PALE),
    ]


def _whale(v: Vary) -> list[Part]:
    r, span = 0.025 * v(), 0.029 * v()
    body = turned(
        [
            (0, -0.044),
            (0.16 * r, -0.044),
            (0.6 * r, -0.018),
            (r, 0.012),
            (0.95 * r, 0.030),
            (0.6 * r, 0.044),
            (0, 0.048),
        ],
        True,
    )
    body.vertices[:, 2] = np.maximum(body.vertices[:, 2], -0.55 * r)
    stem = tube(np.array([(-0.030, 0, -0.1 * r), (-0.044, 0, 0.004), (-0.050, 0, 0.014)]), [0.009, 0.006, 0.004])
    fluke = Polygon(
        [(0.006, 0), (0.002, 0.6 * span), (-0.012, span), (-0.018, 0.5 * span), (-0.010, 0), (-0.018, -0.5 * span),
         (-0.012, -span), (0.002, -0.6 * span)]
    )  # fmt: skip
    tail = tilted(slab(fluke, 0, 0.004), 25, (0, 1, 0)).apply_translation((-0.048, 0, 0.012))
    fins = [
        slab(
            Polygon([(0.018, s * 0.8 * r), (0.004, s * 0.8 * r), (-0.012, s * (r + 0.018)), (0.0, s * (r + 0.016))]),
            -0.5 * r,
            0.004 - 0.5 * r,
        )
        for s in _SIDES
    ]
    jets = [
        tube(
            np.array(
                [
                    (0.016, 0, 0.8 * r),
                    (0.016, s * 0.003, r + 0.016),
                    (0.016, s * 0.011, r + 0.023),
                    (0.016, s * 0.018, r + 0.014),
                ]
            ),
            0.0032,
        )
        for s in _SIDES
    ]
    return [
        Part("", join([body, stem])),
        Part("whale tail", tail),
        Part("whale fins", join(fins)),
        Part("", join(jets), _WATER),
    ]


MAKERS: dict[str, Maker] = {
    "fish": _fish,
    "turtle": _turtle,
    "rabbit": _rabbit,
    "butterfly": _butterfly,
    "crab": _crab,
    "snail": _snail,
    "elephant": _elephant,
    "whale": _whale,
}
