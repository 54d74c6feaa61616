"""Five tables that another simulator renders: python make_scenes.py FOLDER. It needs `pip install mujoco`.

Nothing here comes from gem_lite: MuJoCo has its own renderer, lights and materials, and all shapes are made below. So
these scenes are a test for what gem_lite does with a table that is not its own. The folders are in the format of
`gem_lite.rgbd.observation.Observation.load`. They are written by hand here, with OpenCV and JSON, as another program
would.
"""

import json
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import mujoco
import numpy as np

DEPTH_SCALE = 0.001
"""Metres of one step of a depth picture."""
COLORS = {
    "red": (0.78, 0.11, 0.12), "green": (0.13, 0.52, 0.20), "blue": (0.14, 0.27, 0.72), "yellow": (0.92, 0.76, 0.13),
    "orange": (0.93, 0.46, 0.09), "purple": (0.45, 0.20, 0.60), "pink": (0.94, 0.55, 0.66), "cyan": (0.22, 0.72, 0.76),
    "brown": (0.42, 0.26, 0.14), "white": (0.92, 0.92, 0.90), "gray": (0.50, 0.50, 0.50),
}  # fmt: skip


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
    """A table: its colour, where its lamp hangs, and what lies on it."""

    name: str
    table: tuple[float, float, float]
    lamp: tuple[float, float, float]
    things: tuple[Thing, ...]


SCENES = (
    Scene("workbench", (0.36, 0.30, 0.24), (0.2, 0.5, 1.6), (
        Thing("red", "block", 0.40, 0.25, 20), Thing("green", "block", 0.58, 0.10, 50),
        Thing("blue", "bowl", 0.62, 0.36), Thing("yellow", "bowl", 0.38, -0.08),
        Thing("purple", "block", 0.63, -0.22, 10), Thing("orange", "cylinder", 0.42, -0.34),
    )),
    Scene("kitchen", (0.30, 0.31, 0.33), (0.9, -0.2, 1.4), (
        Thing("red", "mug", 0.36, 0.20, 140), Thing("white", "bowl", 0.62, 0.26),
        Thing("blue", "mug", 0.58, -0.05, 60),
        Thing("yellow", "plate", 0.40, -0.12), Thing("green", "bowl", 0.64, -0.33),
        Thing("orange", "ball", 0.36, -0.37),
    )),
    Scene("nursery", (0.24, 0.33, 0.38), (0.5, 0.0, 1.8), (
        Thing("pink", "block", 0.35, 0.36, 35), Thing("cyan", "ring", 0.60, 0.30), Thing("green", "ball", 0.42, 0.08),
        Thing("purple", "bowl", 0.64, 0.00), Thing("red", "cylinder", 0.35, -0.20),
        Thing("blue", "block", 0.56, -0.28, 70),
        Thing("yellow", "star", 0.44, -0.40, 15),
    )),
    Scene("workshop", (0.20, 0.20, 0.21), (0.1, -0.6, 1.5), (
        Thing("yellow", "block", 0.64, 0.40, 5), Thing("red", "bowl", 0.40, 0.34),
        Thing("green", "block", 0.34, 0.04, 65),
        Thing("gray", "bowl", 0.62, 0.08), Thing("orange", "block", 0.50, -0.20, 40),
        Thing("pink", "bowl", 0.36, -0.36),
        Thing("purple", "ring", 0.65, -0.38),
    )),
    Scene("desk", (0.45, 0.38, 0.30), (0.8, 0.6, 1.3), (
        Thing("blue", "block", 0.36, 0.40, 25), Thing("orange", "bowl", 0.60, 0.38),
        Thing("red", "star", 0.50, 0.14, 80),
        Thing("white", "mug", 0.66, 0.06, 200), Thing("green", "cylinder", 0.34, -0.05),
        Thing("cyan", "bowl", 0.60, -0.22),
        Thing("brown", "block", 0.38, -0.36, 55),
    )),
)  # fmt: skip

CAMERAS = {
    "overhead": ((0.50, -0.02, 1.05), (0.50, 0.0, 0.0), (480, 640), 430.0),
    "left": ((1.05, 0.62, 0.62), (0.48, 0.05, 0.0), (360, 640), 460.0),
    "right": ((1.10, -0.58, 0.55), (0.48, -0.05, 0.0), (480, 640), 470.0),
}
"""By name: position and target (m), height and width (pixels), focal length (pixels)."""


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


def still_bodies(scene: Scene) -> str:
    """The things of a table that never move, as MJCF."""
    return "".join(
        f'<body pos="{thing.x} {thing.y} 0" euler="0 0 {thing.turn}">{geoms(thing)}</body>' for thing in scene.things
    )


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


def write(scene: Scene, folder: Path) -> None:
    """Render a scene and write its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    model = model_of(scene, still_bodies(scene))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    cameras = []
    for name, (_, _, (height, width), _) in CAMERAS.items():
        with mujoco.Renderer(model, height, width) as renderer:
            rgb, depth = picture(renderer, data, name)
        cv2.imwrite(str(folder / f"{name}.color.png"), rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        steps = np.round(depth / DEPTH_SCALE)
        steps[steps > 65535] = 0
        cv2.imwrite(str(folder / f"{name}.depth.png"), steps.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 9])
        (fx, _, cx), (_, fy, cy), _ = intrinsics(name).tolist()
        cameras.append({
            "name": name, "color": f"{name}.color.png", "depth": f"{name}.depth.png", "depth_scale": DEPTH_SCALE,
            "intrinsics": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "pose": camera_pose(name).tolist(),
        })  # fmt: skip
    (folder / "cameras.json").write_text(json.dumps({"version": 1, "cameras": cameras}, indent=1) + "\n")
    truth = [vars(thing) for thing in scene.things]
    (folder / "truth.json").write_text(json.dumps({"things": truth}, indent=1) + "\n")


if __name__ == "__main__":
    for one in SCENES:
        write(one, Path(sys.argv[1]) / one.name)
