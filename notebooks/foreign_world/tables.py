"""Tables of MuJoCo: what can lie on them, their cameras, and the whole as a model. Nothing comes from gem_lite.

MuJoCo has its own renderer, lights and materials, and all shapes are made below. Bowls are hollow. Things that move are
free bodies. They collide as shapes that are not drawn: bowls as boxes that make their floor and their wall, mugs,
rings, stars and cylinders as prisms.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

COLORS = {
    "red": (0.78, 0.11, 0.12), "green": (0.13, 0.52, 0.20), "blue": (0.14, 0.27, 0.72), "yellow": (0.92, 0.76, 0.13),
    "orange": (0.93, 0.46, 0.09), "purple": (0.45, 0.20, 0.60), "pink": (0.94, 0.55, 0.66), "cyan": (0.22, 0.72, 0.76),
    "brown": (0.42, 0.26, 0.14), "white": (0.92, 0.92, 0.90), "gray": (0.50, 0.50, 0.50),
}  # fmt: skip
LOOKS = {
    "workbench": ((0.36, 0.30, 0.24), (0.2, 0.5, 1.6)), "kitchen": ((0.30, 0.31, 0.33), (0.9, -0.2, 1.4)),
    "nursery": ((0.24, 0.33, 0.38), (0.5, 0.0, 1.8)), "workshop": ((0.20, 0.20, 0.21), (0.1, -0.6, 1.5)),
    "desk": ((0.45, 0.38, 0.30), (0.8, 0.6, 1.3)),
}  # fmt: skip
"""By name of a table: its colour, and where its lamp hangs (m)."""
KINDS = {
    "block": (0.034, 0.050, 0.06), "bowl": (0.083, 0.090, 0.25), "ball": (0.034, 0.034, 0.06),
    "mug": (0.073, 0.073, 0.20), "cylinder": (0.028, 0.028, 0.07), "star": (0.055, 0.055, 0.06),
    "ring": (0.046, 0.046, 0.05),
}  # fmt: skip
"""By kind: the radius of a circle around it, the least distance of its middle from the border (m), its mass (kg)."""
PRISMS = {"bowl": (0.047, 0.005), "mug": (0.038, 0.085), "cylinder": (0.027, 0.070), "star": (0.045, 0.025),
          "ring": (0.044, 0.032)}  # fmt: skip
"""By kind: the inner radius and the height (m) of the prism as which it collides; of a bowl, that is the floor."""
HIDDEN = 'group="3" condim="4"'
"""Attributes of a shape that is not drawn, and against which things turn with friction."""
TRAIN_SEEDS, TEST_SEEDS = range(1000), range(10_000, 20_000)
"""Seeds of tables for demonstrations, and of those for tests. None is in both."""
NAMED = tuple(color for color in COLORS if color not in ("brown", "gray"))
"""A brown block cannot be told from a table, nor a gray one from a white one: the lamps are bright."""
X_LIMITS, Y_LIMITS = (0.25, 0.75), (-0.5, 0.5)
"""The part of the table on which things lie (m)."""
GAP = 0.015
"""The least distance (m) between two things' circles."""
INNER = 0.078, 0.052
"""The radius of a bowl's rim on its inner side, and its height above the table (m)."""
CAMERAS = {
    "overhead": ((0.50, -0.02, 1.05), (0.50, 0.0, 0.0), (480, 640), 430.0),
    "left": ((1.05, 0.62, 0.62), (0.48, 0.05, 0.0), (360, 640), 460.0),
    "right": ((1.10, -0.58, 0.55), (0.48, -0.05, 0.0), (480, 640), 470.0),
}
"""By name: position and target (m), height and width (pixels), focal length (pixels)."""


@dataclass(frozen=True)
class Thing:
    """A thing on a table: its colour and kind, its place (m) and its turn (degrees)."""

    color: str
    kind: str
    x: float
    y: float
    turn: float = 0.0


@dataclass(frozen=True)
class Scene:
    """A table: its colour, where its lamp hangs (m), and what lies on it."""

    table: tuple[float, ...]
    lamp: tuple[float, ...]
    things: tuple[Thing, ...]


def profile_mesh(name: str, profile: list[tuple[float, float]], steps: int = 48) -> str:
    """A body of revolution from a closed profile of (radius, height), as MJCF."""
    radii, heights = np.array(profile).T
    if np.sum(radii * np.roll(heights, -1) - np.roll(radii, -1) * heights) < 0:
        profile = profile[::-1]  # counter-clockwise, so that all faces look outwards
    angles = np.linspace(0, 2 * math.pi, steps, endpoint=False)
    vertices = np.array([(r * math.cos(a), r * math.sin(a), z) for a in angles for r, z in profile])
    count, faces = len(profile), []
    for i in range(steps):
        for j in range(count):
            a, b = i * count + j, i * count + (j + 1) % count
            c, d = ((i + 1) % steps) * count + j, ((i + 1) % steps) * count + (j + 1) % count
            faces += [(a, c, b), (b, c, d)]
    return mesh(name, vertices, faces)


def star_mesh(name: str, radius: float, height: float) -> str:
    """An extruded star with five points, as MJCF."""
    angles = np.arange(10) * math.pi / 5
    radii = np.where(np.arange(10) % 2 == 0, radius, 0.45 * radius)
    ring = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    vertices = [(x, y, z) for z in (0.0, height) for x, y in ring] + [(0, 0, 0), (0, 0, height)]
    faces = []
    for i in range(10):
        j = (i + 1) % 10
        faces += [(i, j, 10 + i), (j, 10 + j, 10 + i), (j, i, 20), (10 + i, 10 + j, 21)]
    return mesh(name, np.array(vertices), faces)


def mesh(name: str, vertices: np.ndarray, faces: list) -> str:
    """A mesh as MJCF."""
    numbers = " ".join(f"{value:.5f}" for value in vertices.ravel())
    corners = " ".join(str(number) for face in faces for number in face)
    return f'<mesh name="{name}" inertia="shell" vertex="{numbers}" face="{corners}"/>'


MESHES = (
    profile_mesh("bowl", [(0.0, 0.004), (0.045, 0.006), (0.066, 0.024), (0.078, 0.052), (0.083, 0.052), (0.071, 0.020),
                          (0.050, 0.0), (0.0, 0.0)])
    + profile_mesh("plate", [(0.0, 0.006), (0.060, 0.006), (0.088, 0.016), (0.092, 0.014), (0.062, 0.0), (0.0, 0.0)])
    + profile_mesh("cup", [(0.0, 0.005), (0.034, 0.005), (0.036, 0.085), (0.040, 0.085), (0.038, 0.0), (0.0, 0.0)])
    + profile_mesh("ring", [(0.030 + 0.016 * math.cos(a), 0.016 + 0.016 * math.sin(a))
                            for a in np.linspace(0, 2 * math.pi, 16, endpoint=False)])
    + profile_mesh("handle", [(0.022 + 0.006 * math.cos(a), 0.006 * math.sin(a))
                              for a in np.linspace(0, 2 * math.pi, 12, endpoint=False)])
    + star_mesh("star", 0.055, 0.025)
)  # fmt: skip


def geoms(thing: Thing, physics: str = "") -> str:
    """The shapes of a thing, as MJCF. ``physics`` holds more attributes of each."""
    look = 'rgba="{} {} {} 1" material="plastic" '.format(*COLORS[thing.color]) + physics
    made_of_mesh = {"bowl", "plate", "ring", "star"}
    if thing.kind in made_of_mesh:
        return f'<geom type="mesh" mesh="{thing.kind}" {look}/>'
    match thing.kind:
        case "block":
            return f'<geom type="box" size="0.024 0.024 0.024" pos="0 0 0.024" {look}/>'
        case "cylinder":
            return f'<geom type="cylinder" size="0.028 0.035" pos="0 0 0.035" {look}/>'
        case "ball":
            return f'<geom type="sphere" size="0.034" pos="0 0 0.034" {look}/>'
        case "mug":
            handle = f'<geom type="mesh" mesh="handle" pos="0.045 0 0.045" quat="0.707 0.707 0 0" {look}/>'
            return f'<geom type="mesh" mesh="cup" {look}/>{handle}'
    raise ValueError(f"unknown kind {thing.kind!r}")


def prism(kind: str, mass: float) -> str:
    """The prism of four crossed boxes as which a thing collides, as MJCF. Cylinders and hulls tremble on a box."""
    radius, height = PRISMS[kind]
    size = f"{radius} {radius * math.tan(math.pi / 8):.5f} {height / 2}"
    look = f'size="{size}" pos="0 0 {height / 2}" mass="{mass / 4}" {HIDDEN}'
    return f'<replicate count="4" euler="0 0 45"><geom type="box" {look}/></replicate>'


def bowl_wall(mass: float, steps: int = 24) -> str:
    """The wall with which a bowl collides, as MJCF: two rings of boxes."""
    wall = ""
    # The inner side of the wall from below to above, as (radius, height), and how thick it is.
    for (r0, z0), (r1, z1), thick in (((0.045, 0.006), (0.066, 0.024), 0.0075), ((0.066, 0.024), INNER, 0.0045)):
        length = math.hypot(r1 - r0, z1 - z0)
        slope_r, slope_z = (r1 - r0) / length, (z1 - z0) / length
        r, z = (r0 + r1) / 2 + slope_z * thick / 2, (z0 + z1) / 2 - slope_r * thick / 2
        size = f"{length / 2:.5f} {r1 * math.tan(math.pi / steps):.5f} {thick / 2:.5f}"
        pose = f'pos="{r:.5f} 0 {z:.5f}" xyaxes="{slope_r:.5f} 0 {slope_z:.5f} 0 1 0"'
        look = f'size="{size}" {pose} mass="{mass / (2 * steps):.6f}" {HIDDEN}'
        wall += f'<replicate count="{steps}" euler="0 0 {360 / steps}"><geom type="box" {look}/></replicate>'
    return wall


def free_body(number: int, thing: Thing) -> str:
    """A thing that moves, as MJCF."""
    mass = KINDS[thing.kind][2]
    if thing.kind in PRISMS:
        wall = bowl_wall(0.6 * mass) if thing.kind == "bowl" else ""
        rest = prism(thing.kind, 0.4 * mass if wall else mass)
        shapes = geoms(thing, 'contype="0" conaffinity="0" mass="0"') + rest + wall
    else:
        rolls = 'condim="6" friction="0.8 0.005 0.002"' if thing.kind == "ball" else 'condim="4"'
        shapes = geoms(thing, f'{rolls} mass="{mass}"')
    pose = f'pos="{thing.x} {thing.y} 0" euler="0 0 {thing.turn}"'
    return f'<body name="thing{number}" {pose}><freejoint/>{shapes}</body>'


def model_of(scene: Scene, bodies: str, more: str = "") -> mujoco.MjModel:
    """The whole table: ``bodies`` on it, and more sections of the model, both as MJCF."""
    cameras = ""
    for name, (position, target, (height, _), focal) in CAMERAS.items():
        right, up, _ = axes(position, target)
        fovy = math.degrees(2 * math.atan(height / 2 / focal))
        numbers = " ".join(f"{value:.6f}" for value in (*right, *up))
        cameras += f'<camera name="{name}" pos="{" ".join(map(str, position))}" xyaxes="{numbers}" fovy="{fovy:.6f}"/>'
    lamp = " ".join(map(str, scene.lamp))
    color = " ".join(map(str, scene.table))
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <visual><global offwidth="640" offheight="480"/><quality shadowsize="4096"/>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.25 0.25 0.25" specular="0.05 0.05 0.05"/></visual>
  <asset>
    <material name="plastic" specular="0.4" shininess="0.6"/>
    <texture name="grain" type="2d" builtin="flat" rgb1="{color}" mark="random" markrgb="0 0 0" random="0.004"
      width="256" height="256"/>
    <material name="table" texture="grain" texrepeat="3 3" specular="0.1"/>
    {MESHES}
  </asset>
  <worldbody>
    <light pos="{lamp}" dir="{0.5 - scene.lamp[0]} {-scene.lamp[1]} {-scene.lamp[2]}" diffuse="0.55 0.55 0.5"
      cutoff="80" castshadow="true"/>
    <geom type="box" size="0.45 0.70 0.02" pos="0.5 0 -0.02" material="table"/>
    <geom type="plane" size="5 5 0.1" pos="0 0 -0.75" rgba="0.55 0.53 0.50 1"/>
    {bodies}{cameras}
  </worldbody>
  {more}
</mujoco>""")


def axes(position: tuple, target: tuple) -> np.ndarray:
    """(3, 3) rows: a camera's right, up and backward directions in the world."""
    backward = np.subtract(position, target)
    backward /= np.linalg.norm(backward)
    right = np.cross((0, 0, 1) if abs(backward[2]) < 0.95 else (-1, 0, 0), backward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(backward, right), backward])


def intrinsics(name: str) -> np.ndarray:
    """(3, 3) of a camera, in pixels."""
    _, _, (height, width), focal = CAMERAS[name]
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])


def camera_pose(name: str) -> np.ndarray:
    """(4, 4) of a camera in the table's frame (m): its axes are x to the right, y down, z forward."""
    position, target, _, _ = CAMERAS[name]
    right, up, backward = axes(position, target)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, -up, -backward], axis=1)
    pose[:3, 3] = position
    return pose.round(9)


def picture(renderer: mujoco.Renderer, data: mujoco.MjData, name: str) -> tuple[np.ndarray, np.ndarray]:
    """What a camera sees: (H, W, 3) uint8 RGB, and (H, W) float32 depth along its axis (m)."""
    renderer.update_scene(data, name)
    rgb = renderer.render()
    renderer.enable_depth_rendering()
    depth = renderer.render()
    renderer.disable_depth_rendering()
    return rgb, depth


def random_scene(seed: int) -> Scene:
    """The table of a seed. Its first thing is the named block, its second the named bowl."""
    rng = np.random.default_rng(seed)
    blocks, bowls = (rng.permutation(NAMED)[: rng.integers(2, most + 1)].tolist() for most in (4, 3))
    others = rng.permutation(["ball", "cylinder", "star", "ring", "mug"])[: rng.integers(0, 3)].tolist()
    kinds = [(blocks[0], "block"), (bowls[0], "bowl"), *((c, "block") for c in blocks[1:])]
    kinds += [(c, "bowl") for c in bowls[1:]] + [(str(rng.choice(NAMED)), kind) for kind in others]
    table, lamp = random_look(rng, tuple(LOOKS))
    while (things := _spread(kinds, rng)) is None:
        pass
    return Scene(table, lamp, tuple(things))


def random_look(rng: np.random.Generator, names: tuple[str, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The colour of a table, and where its lamp hangs (m): each near that of one of the named looks."""
    table = np.array(LOOKS[names[rng.integers(len(names))]][0]) + rng.uniform(-0.02, 0.02)
    lamp = np.array(LOOKS[names[rng.integers(len(names))]][1]) + rng.uniform(-0.1, 0.1, 3)
    return tuple(table.round(4).tolist()), tuple(lamp.round(4).tolist())


def _spread(kinds: list[tuple[str, str]], rng: np.random.Generator) -> list[Thing] | None:
    """Things at random places, none touching another; None if one found no place. Large ones choose first."""
    placed: dict[int, Thing] = {}
    for number in sorted(range(len(kinds)), key=lambda number: -KINDS[kinds[number][1]][0]):
        color, kind = kinds[number]
        radius, border, _ = KINDS[kind]
        for _ in range(200):
            x = rng.uniform(X_LIMITS[0] + border, X_LIMITS[1] - border)
            y = rng.uniform(Y_LIMITS[0] + border, Y_LIMITS[1] - border)
            if all(math.hypot(x - t.x, y - t.y) >= radius + KINDS[t.kind][0] + GAP for t in placed.values()):
                placed[number] = Thing(color, kind, round(x, 5), round(y, 5), round(rng.uniform(-180, 180), 3))
                break
        else:
            return None
    return [placed[number] for number in range(len(kinds))]
