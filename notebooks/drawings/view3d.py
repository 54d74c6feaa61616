"""3-D scenes in meshcat. They are stored inside the notebook, so that a stored copy shows them too."""

from __future__ import annotations

import contextlib
import io

import meshcat
import meshcat.geometry as geometry
import meshcat.transformations as transformations
import numpy as np
from IPython.display import HTML

from gem_lite.se2 import Pose2

FRAME_HEIGHT = 0.12
"""Height (m) of the frames above the table, so that no object hides them."""

CAMERA = [0.36, 0.46, 0.0]
"""Where the scene is looked at from, relative to the table's middle (m): x, up, -y."""


def build_scene(points: np.ndarray, rgb: np.ndarray, frames: dict[str, Pose2]) -> meshcat.Visualizer:
    """A point cloud (N, 3) metres with colours (N, 3) uint8, and a frame of three arms at each named pose.

    The orange arm is the frame's x (the gripper's yaw), the light blue one its y. The black one shows how the tool
    moves down to the table.
    """
    with contextlib.redirect_stdout(io.StringIO()):
        scene = meshcat.Visualizer()
    colors = (rgb.T / 255).astype(np.float32)
    scene["table"]["cloud"].set_object(geometry.PointCloud(points.T.astype(np.float32), colors, size=0.006))
    for name, pose in frames.items():
        place = transformations.translation_matrix([pose.x, pose.y, FRAME_HEIGHT])
        place = place @ transformations.rotation_matrix(pose.yaw, [0, 0, 1])
        for axis, color, direction in (
            ("x", 0xD55E00, [1, 0, 0]),
            ("y", 0x56B4E9, [0, 1, 0]),
            ("z", 0x202020, [0, 0, -1]),
        ):
            length = FRAME_HEIGHT if axis == "z" else 0.08
            node = scene["table"][name][axis]
            node.set_object(geometry.Cylinder(length, 0.004), geometry.MeshLambertMaterial(color=color))
            # meshcat's cylinders lie along y.
            turn = transformations.rotation_matrix(*_turn_y_to(np.array(direction, float)))
            shift = transformations.translation_matrix(np.array(direction) * length / 2)
            node.set_transform(place @ shift @ turn)
    # meshcat's camera looks at the origin, so the middle of the points goes there.
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    scene["table"].set_transform(transformations.translation_matrix([-middle[0], -middle[1], 0]))
    scene["/Cameras/default/rotated/<object>"].set_property("position", CAMERA)
    scene["/Background"].set_property("top_color", [1, 1, 1])
    scene["/Background"].set_property("bottom_color", [0.85, 0.87, 0.9])
    for helper in ("/Grid", "/Axes"):
        scene[helper].set_property("visible", False)
    return scene


def _turn_y_to(direction: np.ndarray) -> tuple[float, np.ndarray]:
    axis = np.cross([0, 1, 0], direction)
    norm = np.linalg.norm(axis)
    if norm < 1e-9:
        return 0.0, np.array([1.0, 0, 0])
    return float(np.arctan2(norm, direction[1])), axis / norm


def embed(scene: meshcat.Visualizer, height: int = 420) -> HTML:
    """The scene as HTML that needs no running server: drag to turn, scroll to zoom."""
    return scene.render_static(height)
