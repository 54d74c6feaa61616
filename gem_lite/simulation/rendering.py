"""Pictures of a PyBullet world: sets of three cameras, and the lamp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pybullet as p

from gem_lite.rgbd.camera import Camera, View, as_pose
from gem_lite.se2 import Workspace

RENDERED_CORNER = (-0.5, 0.5)
"""TinyRenderer looks through the lower left corner of a pixel: its offset (x, y pixels) from the pixel's centre."""
CAMERAS: tuple[Camera, ...] = (
    Camera.pinhole("front", (1.0, 0.0, 0.75), (0.6533, 0.6533, -0.2706, -0.2706)),
    Camera.pinhole("left", (0.0, 0.5, 0.75), (-0.3596, 0.8682, -0.3160, 0.1309)),
    Camera.pinhole("right", (0.0, -0.5, 0.75), (-0.8682, 0.3596, -0.1309, 0.3160)),
)
"""CLIPort's front, left and right cameras."""
_D455_INTRINSICS = ((424.0, 0.0, 424.0), (0.0, 424.0, 240.0), (0.0, 0.0, 1.0))
AZURE_AND_D455: tuple[Camera, ...] = (
    Camera.pinhole("top", (0.5, 0.0, 0.9), (0.5**0.5, 0.5**0.5, 0.0, 0.0), size=(576, 640), focal=500.0),
    *(replace(camera, intrinsics=_D455_INTRINSICS, size=(480, 848)) for camera in CAMERAS[1:]),
)
"""An Azure Kinect that looks straight down, and two D455 in the poses of CLIPort's left and right cameras.

Sizes are those of the depth pictures (Azure: NFOV unbinned). Intrinsics: a D455's at 848 pixels from its field of view;
an Azure's as its units have about. The height is a guess at which the top camera sees the table and what stands on it.
"""
AROUND_A_SMALL_TABLE: tuple[Camera, ...] = tuple(
    replace(camera, pose=as_pose(camera.rotation, 2 * camera.position - (0.5, 0.0, 0.0))) for camera in AZURE_AND_D455
)
"""The same three, twice as far from the middle of a table that is 1 m long.

Such cameras measure no depth from near: round a table that is 0.29 m long, the top one is 0.52 m and the others 0.60 m
from its middle. There, a thing of half the size has nearly as many pixels.
"""


def cameras_around(workspace: Workspace, cameras: Sequence[Camera] = CAMERAS) -> tuple[Camera, ...]:
    """Cameras of CLIPort's table, with distances scaled by the table's length (CLIPort's table is 1 m long)."""
    middle = np.array([(workspace.x_min + workspace.x_max) / 2, (workspace.y_min + workspace.y_max) / 2, 0.0])
    positions = [middle + workspace.length * (camera.position - (0.5, 0.0, 0.0)) for camera in cameras]
    return tuple(
        replace(camera, pose=as_pose(camera.rotation, position))
        for camera, position in zip(cameras, positions, strict=True)
    )


@dataclass(frozen=True)
class Light:
    """The one lamp of a scene, far away.

    Attributes:
        direction: towards the lamp (x, y, z), of any length.
        color: (red, green, blue) in [0, 1].
        ambient: brightness of all surfaces.
        diffuse: brightness that is added to surfaces that face the lamp.
        shadow: whether bodies cast shadows.
    """

    direction: tuple[float, float, float] = (0.3, 0.2, 1.0)
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ambient: float = 0.6
    diffuse: float = 0.35
    shadow: bool = False

    @property
    def brightness(self) -> float:
        """The brightness of a white surface that faces the lamp, as a multiple of the default lamp's."""
        return (self.ambient + self.diffuse) / (LIGHT.ambient + LIGHT.diffuse)


LIGHT = Light()
"""The default lamp of a world."""


@dataclass(frozen=True)
class LampRange:
    """How the lamp differs from episode to episode. By default, it does not.

    Attributes:
        lean: the lamp is moved by at most this far (m) sideways for each metre of its height.
        strength: e; ambient and diffuse light are multiplied by a factor between 1 / (1 + e) and 1 + e, log-uniform.
        tint: the lamp's red, green and blue are each lowered by a share of up to this.
        contrast: a share of up to this of the ambient light becomes diffuse light.
        shadows: the share of episodes in which a lamp that casts shadows does so.
    """

    lean: float = 0.0
    strength: float = 0.0
    tint: float = 0.0
    contrast: float = 0.0
    shadows: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be a finite number of at least 0, got {value!r}")
        for name in ("tint", "contrast", "shadows"):
            if getattr(self, name) > 1:
                raise ValueError(f"{name} must be a share in [0, 1], got {getattr(self, name)!r}")

    def draw(self, light: Light, rng: np.random.Generator) -> Light:
        """The lamp of an episode, near ``light``."""
        x, y, z = light.direction
        away = self.lean * z * math.sqrt(rng.random())
        towards = rng.uniform(-math.pi, math.pi)
        direction = (x + away * math.cos(towards), y + away * math.sin(towards), z)
        factor = (1 + self.strength) ** rng.uniform(-1, 1)
        red, green, blue = (
            part * (1 - self.tint * share) for part, share in zip(light.color, rng.random(3), strict=True)
        )
        moved = self.contrast * rng.random() * light.ambient
        return Light(
            direction, (red, green, blue), factor * (light.ambient - moved), factor * (light.diffuse + moved),
            light.shadow and rng.random() < self.shadows,
        )  # fmt: skip


STEADY = LampRange()
"""The same lamp in every episode."""


def render(
    client: int, camera: Camera, light: Light = LIGHT, segmentation: bool = False
) -> tuple[View, np.ndarray | None]:
    """Take a picture of a PyBullet world.

    Returns:
        The view; and with ``segmentation`` the (H, W) body id of each pixel (-1: no body), plus (link + 1) << 24 on a
        body's links. Segmentation is for training CLIP, for tests, and for experiments that
        say so; no policy of the library gets it.
    """
    forward = camera.rotation[:, 2]
    up = -camera.rotation[:, 1]
    eye = camera.position
    height, width = camera.size
    _, _, rgba, buffer, ids = p.getCameraImage(
        width,
        height,
        viewMatrix=p.computeViewMatrix(eye, eye + forward, up),
        projectionMatrix=projection(camera),
        shadow=int(light.shadow),
        lightDirection=light.direction,
        lightColor=light.color,
        lightAmbientCoeff=light.ambient,
        lightDiffuseCoeff=light.diffuse,
        flags=p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX if segmentation else p.ER_NO_SEGMENTATION_MASK,
        renderer=p.ER_TINY_RENDERER,
        physicsClientId=client,
    )
    rgb = np.asarray(rgba, np.uint8).reshape(height, width, 4)[..., :3].copy()
    buffer = np.asarray(buffer, np.float32).reshape(height, width)
    depth = (camera.near * camera.far / (camera.far - buffer * (camera.far - camera.near))).astype(np.float32)
    masks = np.asarray(ids).reshape(height, width) if segmentation else None
    return View(camera, rgb, depth), masks


def projection(camera: Camera) -> list[float]:
    """The OpenGL projection matrix (16 numbers) that makes TinyRenderer use ``camera.intrinsics``."""
    height, width = camera.size
    (focal_x, _, x), (_, focal_y, y), _ = camera.intrinsics
    # TinyRenderer looks through the corner of each pixel. This shift makes it look through the centre.
    x += RENDERED_CORNER[0]
    y += RENDERED_CORNER[1]
    left = -x / focal_x * camera.near
    right = (width - x) / focal_x * camera.near
    bottom = (y - height) / focal_y * camera.near
    top = y / focal_y * camera.near
    return p.computeProjectionMatrix(left, right, bottom, top, camera.near, camera.far)
