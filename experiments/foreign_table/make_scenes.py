"""Render the still tables of data/foreign-scenes again.

What lies on a table is in its truth.json. The folders are in the format of `rgbd.observation.Observation.load`. They
are written by hand here, with OpenCV and JSON, as another program would: nothing comes from gem_lite.
"""

import json
from pathlib import Path

import cv2
import numpy as np
from foreign_world import tables

import mujoco  # isort: skip  # after foreign_world, which chooses its renderer

TRUTHS = Path(__file__).parents[2] / "data" / "foreign-scenes"
DEPTH_SCALE = 0.001
"""Metres of one step of a depth picture."""


def write_all(folder: Path) -> None:
    """Render all tables."""
    for name in tables.LOOKS:
        write(name, folder / name)


def write(name: str, folder: Path) -> None:
    """Render a table and write its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = (TRUTHS / name / "truth.json").read_text()
    things = tuple(tables.Thing(**entry) for entry in json.loads(truth)["things"])
    pose = '<body pos="{0.x} {0.y} 0" euler="0 0 {0.turn}">{1}</body>'
    bodies = "".join(pose.format(thing, tables.geoms(thing)) for thing in things)
    model = tables.model_of(tables.Scene(*tables.LOOKS[name], things), bodies)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    cameras = []
    for camera, (_, _, (height, width), _) in tables.CAMERAS.items():
        with mujoco.Renderer(model, height, width) as renderer:
            rgb, depth = tables.picture(renderer, data, camera)
        color_file, depth_file = f"{camera}.color.png", f"{camera}.depth.png"
        steps = np.round(depth / DEPTH_SCALE)
        steps[steps > 65535] = 0
        cv2.imwrite(str(folder / color_file), rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        cv2.imwrite(str(folder / depth_file), steps.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 9])
        cameras.append({
            "name": camera, "color": color_file, "depth": depth_file, "depth_scale": DEPTH_SCALE,
            "intrinsics": tables.intrinsics(camera).tolist(), "pose": tables.camera_pose(camera).tolist(),
        })  # fmt: skip
    (folder / "cameras.json").write_text(json.dumps({"version": 1, "cameras": cameras}, indent=1) + "\n")
    (folder / "truth.json").write_text(truth)
