"""Toy animals and food, part by part."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely import affinity
from shapely.geometry import Polygon
from shapely.ops import unary_union
from trimesh import Trimesh

from gem_lite.simulation.solids import (
    DARK,
    LEAF,
    PALE,
    RGBA,
    WOOD,
    Maker,
    Part,
    Vary,
    arc,
    ball,
    disc,
    rod,
    slab,
    tube,
    turned,
)

_SIDES = (-1, 1)
_BAKED: RGBA = (0.80, 0.58, 0.32, 1.0)
_WATER: RGBA = (0.72, 0.88, 0.97, 1.0)
_SALAMI: RGBA = (0.60, 0.16, 0.12, 1.0)
_MEAT: RGBA = (0.30, 0.17, 0.11, 1.0)


def _join(meshes: list[Trimesh]) -> Trimesh:
    return trimesh.util.concatenate(meshes)


def _bead(centre: tuple, radii: float | tuple, detail: int = 1) -> Trimesh:
    """A small ball of few triangles: 20 for ``detail`` 0, 80 for 1."""
    mesh = trimesh.creation.icosphere(subdivisions=detail, radius=1.0)
    mesh.apply_scale(np.broadcast_to(radii, 3))
    return mesh.apply_translation(centre)


def _tilted(mesh: Trimesh, degrees: float, axis: tuple, point: tuple = (0, 0, 0)) -> Trimesh:
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), axis, point))


def _oval(x: float, y: float, length: float, width: float, degrees: float = 0.0) -> Polygon:
    """The outline of an ellipse, with its length along x before it is turned."""
    return affinity.rotate(affinity.scale(disc(x, y, 1).simplify(0.02), length / 2, width / 2), degrees)


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
        Part("fish fins", _join([slab(back, 0.004, 0.011), slab(belly, 0.004, 0.011)])),
        Part("", _bead((0.032, 0.25 * w, 0.0205), (0.0048, 0.0048, 0.003)), DARK),
    ]


def _turtle(v: Vary) -> list[Part]:
    length, w, h = 0.032 * v(), 0.027 * v(), 0.026 * v()
    dome = _tilted(_bead((0, 0, 0), 1.0), 90, (0, 0, 1))
    dome.vertices[:, 2] = np.maximum(dome.vertices[:, 2], 0)
    dome.apply_scale((length, w, h)).apply_translation((0, 0, 0.010))
    rim = slab(_oval(0, 0, 2 * length + 0.006, 2 * w + 0.006), 0.007, 0.011)
    legs = []
    for front in _SIDES:
        for side in _SIDES:
            leg = _bead((0.013, 0, 0), (0.015, 0.008, 0.005))
            place = (0.55 * front * length, 0.68 * side * w, 0.005)
            legs.append(_tilted(leg, side * (90 - front * 32), (0, 0, 1)).apply_translation(place))
    head = _join(
        [
            _bead((length + 0.013, 0, 0.016), (0.012, 0.010, 0.010)),
            rod((0.7 * length, 0, 0.01), (length + 0.01, 0, 0.014), 0.006),
        ]
    )
    tail = _tilted(trimesh.creation.cone(0.005, 0.016, sections=8), -90, (0, 1, 0)).apply_translation(
        (-length, 0, 0.007)
    )
    return [
        Part("turtle shell", _join([dome, rim])),
        Part("turtle legs", _join([*legs, tail]), LEAF),
        Part("turtle head", head, LEAF),
    ]


def _rabbit(v: Vary) -> list[Part]:
    w, ear = 0.022 * v(), 0.022 * v()
    body = ball((-0.010, 0, 0.022), (0.030, w, 0.022))
    paws = [_bead((x, s * 0.7 * w, 0.005), (0.012, 0.007, 0.005)) for x in (-0.014, 0.018) for s in _SIDES]
    head = ball((0.026, 0, 0.040), (0.017, 0.015, 0.015))
    ears = []
    for side in _SIDES:
        one = _bead((0, 0, 0.9 * ear), (0.0045, 0.0085, ear))
        _tilted(_tilted(one, -22 * side, (1, 0, 0)), -30, (0, 1, 0))
        ears.append(one.apply_translation((0.020, 0.006 * side, 0.050)))
    return [
        Part("", _join([body, *paws, head])),
        Part("rabbit ears", _join(ears)),
        Part("rabbit tail", _bead((-0.042, 0, 0.024), 0.010), PALE),
    ]


def _butterfly(v: Vary) -> list[Part]:
    fore, hind, w = 0.052 * v(), 0.036 * v(), 0.033 * v()
    wings = []
    for side in _SIDES:
        upper = affinity.rotate(_oval(fore / 2, 0, fore, w), side * 58, origin=(0, 0))
        lower = affinity.rotate(_oval(hind / 2, 0, hind, 0.85 * w), side * 122, origin=(0, 0))
        wings.append(upper.union(affinity.translate(lower, -0.002, 0)))
    feelers = []
    for side in _SIDES:
        feelers.append(
            tube(np.array([(0.024, 0, 0.006), (0.036, side * 0.007, 0.008), (0.044, side * 0.016, 0.008)]), 0.0018)
        )
        feelers.append(_bead((0.045, side * 0.017, 0.008), 0.004, 0))
    body = [_bead((-0.004, 0, 0.006), (0.030, 0.0055, 0.006)), _bead((0.025, 0, 0.007), 0.0068)]
    return [
        Part("butterfly wings", slab(unary_union(wings), 0, 0.004)),
        Part("butterfly body", _join([*body, *feelers]), DARK),
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
        eyes.append(_bead((length, side * 0.010, 0.031), 0.0048))
    return [
        Part("", shell),
        Part("crab claws", _join(claws)),
        Part("crab legs", _join(legs)),
        Part("crab eyes", _join(eyes), DARK),
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
        horns.append(_bead((x, low + 0.034, 0.008), 0.0038))
    return [
        Part("snail shell", _join(pieces)),
        Part("", slab(foot, 0, 0.014), PALE),
        Part("snail horns", _join(horns), PALE),
    ]


def _elephant(v: Vary) -> list[Part]:
    w, ear, thick = 0.021 * v(), 0.034 * v(), 0.0062 * v()
    body = ball((-0.016, 0, 0.033), (0.028, w, 0.020))
    legs = [rod((x, s * 0.55 * w, 0), (x, s * 0.55 * w, 0.026), 0.0085) for x in (-0.032, 0.002) for s in _SIDES]
    head = _bead((0.018, 0, 0.043), (0.016, 0.015, 0.016))
    ears = []
    for side in _SIDES:
        flap = slab(_oval(0, side * (0.010 + 0.42 * ear), 1.05 * ear, 0.9 * ear), -0.002, 0.002)
        ears.append(_tilted(flap, 50, (0, 1, 0)).apply_translation((0.012, 0, 0.046)))
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
        Part("", _join([body, *legs, head])),
        Part("elephant ears", _join(ears)),
        Part("elephant trunk", trunk),
        Part("elephant tusks", _join(tusks), PALE),
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
    tail = _tilted(slab(fluke, 0, 0.004), 25, (0, 1, 0)).apply_translation((-0.048, 0, 0.012))
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
        Part("", _join([body, stem])),
        Part("whale tail", tail),
        Part("whale fins", _join(fins)),
        Part("", _join(jets), _WATER),
    ]


def _apple(v: Vary) -> list[Part]:
    r, h = 0.030 * v(), 0.050 * v()
    profile = [(0, 0.1), (0.35, 0), (0.75, 0.2), (1, 0.58), (0.93, 0.82), (0.62, 1), (0.3, 0.93), (0, 0.72)]
    fruit = turned([(r * x, h * z) for x, z in profile])
    leaf = slab(_oval(0.016, 0, 0.032, 0.017), -0.0012, 0.0012)
    _tilted(_tilted(leaf, -22, (0, 1, 0)), 35, (0, 0, 1)).apply_translation((0.001, 0, h + 0.001))
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
        at = np.array(
            [(r + (-1) ** i * 0.35 * thick) * np.cos(t), (r + (-1) ** i * 0.35 * thick) * np.sin(t), 1.03 * thick]
        )
        half = 0.0042 * np.array([np.cos(turn), np.sin(turn), 0])
        sprinkles.append(trimesh.creation.cylinder(0.0017, segment=[at - half, at + half], sections=5))
    return [
        Part("", dough, _BAKED),
        Part("donut icing", icing),
        Part("donut sprinkles", _join(sprinkles), PALE),
    ]


def _ice_cream(v: Vary) -> list[Part]:
    r, top = 0.022 * v(), 0.017 * v()
    wide = 0.86 * r
    cone = turned(
        [(0, -0.052), (0.002, -0.052), (wide, 0.002), (wide + 0.003, 0.002), (wide + 0.003, 0.010), (0, 0.010)], True
    )
    scoops = [ball((0.018, 0, 0), r), ball((0.042, 0, 0), top)]
    for i in range(8):
        t = 2 * np.pi * i / 8
        scoops.append(_bead((0.011 - 0.004 * (i % 2), r * np.cos(t), r * np.sin(t)), (0.009, 0.0075, 0.0075), 0))
    return [Part("ice cream cone", cone, _BAKED), Part("ice cream scoops", _join(scoops))]


def _pizza_slice(v: Vary) -> list[Part]:
    length, half = 0.078 * v(), 0.42 * v()
    rim = arc(length, -half, half, (-0.04, 0, 0.007), count=8)
    base = slab(Polygon([(-0.04, 0), *rim[:, :2]]), 0, 0.007)
    spots = [(0.40, 0.0), (0.68, -0.45), (0.74, 0.45)]
    slices = [
        slab(
            disc(-0.04 + length * share * np.cos(half * turn), length * share * np.sin(half * turn), 0.0085).simplify(
                3e-4
            ),
            0.006,
            0.010,
        )
        for share, turn in spots
    ]
    return [
        Part("", base),
        Part("pizza crust", tube(rim, 0.0075), _BAKED),
        Part("", _join(slices), _SALAMI),
    ]


def _cheese(v: Vary) -> list[Part]:
    length, half, h = 0.078 * v(), 0.36 * v(), 0.032 * v()
    rim = arc(length, -half, half, (0, 0, 0), count=8)[:, :2]
    wedge = Polygon([(0, 0), *rim])
    holes = [(0.42, 0.0, 0.007), (0.70, 0.42, 0.009), (0.66, -0.95, 0.008), (0.86, -0.35, 0.007), (0.55, 1.0, 0.006)]
    pits = unary_union(
        [
            disc(length * a * np.cos(half * t), length * a * np.sin(half * t), size).simplify(3e-4)
            for a, t, size in holes
        ]
    )
    rind = Polygon([*rim, *(rim[::-1] * 1.05)])
    return [
        Part("", _join([slab(wedge, 0, 0.35 * h), slab(wedge.difference(pits), 0.35 * h, h)])),
        Part("cheese rind", slab(rind, 0, h), _SALAMI),
    ]


def _cherries(v: Vary) -> list[Part]:
    left, right, spread = 0.018 * v(), 0.018 * v(), 0.023 * v()
    fruits, stems = [], []
    for side, r in ((-1, left), (1, right)):
        y = side * spread
        fruits.append(ball((-0.028, y, r), r))
        path = [(-0.028 + 0.8 * r, y, 1.4 * r), (0.012, 0.75 * y, 0.016), (0.030, 0.4 * y, 0.008), (0.044, 0, 0.004)]
        stems.append(tube(np.array(path), 0.0028))
    leaf = slab(_oval(0.040, 0.020, 0.040, 0.018, 75), 0.002, 0.006)
    return [
        Part("", _join(fruits)), Part("cherry stems", _join(stems), WOOD), Part("cherry leaf", leaf, LEAF)
    ]  # fmt: skip


def _hamburger(v: Vary) -> list[Part]:
    r, h = 0.031 * v(), 0.026 * v()
    low = turned([(0, 0), (0.85 * r, 0), (r, 0.004), (r, 0.012), (0, 0.012)])
    patty = turned([(0, 0.012), (1.06 * r, 0.012), (1.10 * r, 0.017), (1.06 * r, 0.022), (0, 0.022)])
    t = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    wave = r * (1.16 + 0.10 * np.cos(9 * t))
    leaf = slab(Polygon(np.stack([wave * np.cos(t), wave * np.sin(t)], axis=1)), 0.022, 0.025)
    dome = turned(
        [
            (0, 0.025),
            (r, 0.025),
            (1.02 * r, 0.030),
            (0.88 * r, 0.025 + 0.6 * h),
            (0.5 * r, 0.025 + 0.92 * h),
            (0, 0.025 + h),
        ]
    )
    seeds = []
    for i in range(9):
        share, turn = (0.0, 0.0) if i == 0 else (0.55, i * np.pi / 4)
        z = 0.025 + h * (0.88 if i else 1.0)
        seeds.append(_bead((share * r * np.cos(turn), share * r * np.sin(turn), z), (0.0034, 0.0034, 0.002), 0))
    return [
        Part("hamburger bun", _join([low, dome, *seeds])),
        Part("hamburger patty", patty, _MEAT),
        Part("", leaf, LEAF),
    ]


def _corn(v: Vary) -> list[Part]:
    r, leaf = 0.0155 * v(), 0.062 * v()
    cob = turned(
        [(0, -0.030), (0.8 * r, -0.030), (0.9 * r, 0.010), (0.65 * r, 0.036), (0.2 * r, 0.050), (0, 0.052)], True
    )
    grains = []
    for i in range(9):
        x = -0.020 + 0.0078 * i
        size = 0.95 * r * (1 - max(0.0, (x - 0.005) / 0.055) ** 2)
        for k in range(5):
            t = (k - 2 + 0.5 * (i % 2)) * 0.62
            grains.append(_bead((x, size * np.sin(t), size * np.cos(t)), (0.0042, 0.0046, 0.0042), 0))
    husk = []
    for side in _SIDES:
        blade = Polygon(
            [
                (-0.046, 0),
                (-0.040, side * 0.010),
                (-0.010, side * (r + 0.013)),
                (leaf - 0.046, side * (r + 0.016)),
                (0.0, side * (0.5 * r)),
            ]
        )
        husk.append(slab(blade, -0.8 * r, 0.004 - 0.8 * r))
    husk.append(rod((-0.054, 0, -0.3 * r), (-0.026, 0, -0.1 * r), 0.55 * r))
    return [Part("", _join([cob, *grains])), Part("corn husk", _join(husk), LEAF)]


MAKERS: dict[str, Maker] = {
    "fish": _fish,
    "turtle": _turtle,
    "rabbit": _rabbit,
    "butterfly": _butterfly,
    "crab": _crab,
    "snail": _snail,
    "elephant": _elephant,
    "whale": _whale,
    "apple": _apple,
    "donut": _donut,
    "ice cream": _ice_cream,
    "pizza slice": _pizza_slice,
    "cheese": _cheese,
    "cherries": _cherries,
    "hamburger": _hamburger,
    "corn": _corn,
}
