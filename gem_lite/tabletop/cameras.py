"""RGB-D cameras: CLIPort's three views of the table, and the true bodies from above, for scoring and tests."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from gem_lite.se2 import Workspace

LIGHT_DIRECTION = (0.3, 0.2, 1.0)
OFF_CENTRE = (0.5, -0.5)
"""TinyRenderer looks through a pixel's lower left corner: pictures lie so far (x, y pixels) from the optical axis."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. Its axes: +z forward, +x to the image's right, +y down.

    Attributes:
        name: how pictures of it are labelled.
        position: (x, y, z) in metres, world frame.
        quaternion: (x, y, z, w), camera to world.
        size: (H, W) in pixels.
        focal: focal length in pixels.
    """

    name: str
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    size: tuple[int, int] = (480, 640)
    focal: float = 450.0
    near: float = 0.01
    far: float = 10.0

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) camera-to-world rotation."""
        return Rotation.from_quat(self.quaternion).as_matrix()

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) intrinsics as a calibration would find them: for (x, y) pixels from the upper left edge."""
        (height, width), (right, down) = self.size, OFF_CENTRE
        return np.array([[self.focal, 0, width / 2 + right], [0, self.focal, height / 2 + down], [0, 0, 1]])


@dataclass(frozen=True)
class View:
    """What one camera sees: ``rgb`` (H, W, 3) uint8, ``depth`` (H, W) float32 metres along the axis."""

    camera: Camera
    rgb: np.ndarray
    depth: np.ndarray

    def __post_init__(self) -> None:
        if self.rgb.dtype != np.uint8 or self.rgb.shape != (*self.camera.size, 3):
            raise ValueError(
                f"rgb of camera {self.camera.name!r} must be uint8 of shape {(*self.camera.size, 3)}, "
                f"got {self.rgb.dtype} of shape {self.rgb.shape}"
            )
        if self.depth.dtype != np.float32 or self.depth.shape != self.camera.size:
            raise ValueError(
                f"depth of camera {self.camera.name!r} must be float32 of shape {self.camera.size}, "
                f"got {self.depth.dtype} of shape {self.depth.shape}"
            )

    def points(self) -> np.ndarray:
        """(H, W, 3) float32: the world position of every pixel, in metres."""
        points = _rays(self.camera) * self.depth[..., None]
        points += np.array(self.camera.position, np.float32)
        return points


@lru_cache(maxsize=16)
def _rays(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32: from the camera to each pixel's point at depth 1, in the world's directions."""
    height, width = camera.size
    x = (np.arange(width, dtype=np.float32) + 0.5 - width / 2) / camera.focal
    y = (np.arange(height, dtype=np.float32) + 0.5 - height / 2) / camera.focal
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], np.float32(1.0)), axis=-1)
    return rays @ camera.rotation.T.astype(np.float32)


CAMERAS: tuple[Camera, ...] = (
    Camera("front", (1.0, 0.0, 0.75), (0.6533, 0.6533, -0.2706, -0.2706)),
    Camera("left", (0.0, 0.5, 0.75), (-0.3596, 0.8682, -0.3160, 0.1309)),
    Camera("right", (0.0, -0.5, 0.75), (-0.8682, 0.3596, -0.1309, 0.3160)),
)
"""CLIPort's front, left and right cameras."""


def cameras_around(workspace: Workspace) -> tuple[Camera, ...]:
    """`CAMERAS`, drawn nearer or farther with the table's length (CLIPort's is 1 m long)."""
    middle = np.array([(workspace.x_min + workspace.x_max) / 2, (workspace.y_min + workspace.y_max) / 2, 0.0])
    placed = [middle + workspace.length * (np.array(camera.position) - (0.5, 0.0, 0.0)) for camera in CAMERAS]
    return tuple(replace(c, position=tuple(at.tolist())) for c, at in zip(CAMERAS, placed, strict=True))


def looking(name: str, position: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    """A camera at ``position`` that looks at ``target`` (m), upright; not for straight down."""
    forward = np.subtract(target, position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    turn = Rotation.from_matrix(np.stack([right, np.cross(forward, right), forward], axis=1))
    return Camera(name, position, tuple(turn.as_quat().tolist()))


def render(
    client: int,
    camera: Camera,
    light: tuple[float, float, float] = LIGHT_DIRECTION,
    light_color: tuple[float, float, float] = (1.0, 1.0, 1.0),
    segmentation: bool = False,
) -> tuple[View, np.ndarray | None]:
    """Take a picture of a PyBullet world.

    Returns:
        The view, and with ``segmentation`` the (H, W) body id of each pixel (-1: none), plus
        (link + 1) << 24 on a body's links. Segmentation is for training CLIP and for tests; no policy
        sees it.
    """
    forward, up = camera.rotation[:, 2], -camera.rotation[:, 1]
    eye = np.array(camera.position)
    height, width = camera.size
    fov = 2 * np.degrees(np.arctan(height / 2 / camera.focal))
    _, _, rgba, buffer, ids = p.getCameraImage(
        width,
        height,
        viewMatrix=p.computeViewMatrix(eye, eye + forward, up),
        projectionMatrix=p.computeProjectionMatrixFOV(fov, width / height, camera.near, camera.far),
        shadow=0,
        lightDirection=light,
        lightColor=light_color,
        flags=p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX if segmentation else p.ER_NO_SEGMENTATION_MASK,
        renderer=p.ER_TINY_RENDERER,
        physicsClientId=client,
    )
    rgb = np.asarray(rgba, np.uint8).reshape(height, width, 4)[..., :3].copy()
    b = np.asarray(buffer, np.float32).reshape(height, width)
    near, far = camera.near, camera.far
    depth = (near * far / (far - b * (far - near))).astype(np.float32)
    masks = np.asarray(ids).reshape(height, width) if segmentation else None
    return View(camera, rgb, depth), masks


def bodies_from_above(client: int, workspace: Workspace) -> np.ndarray:
    """Which body lies on top in each cell of a height map: for scoring and tests, no policy sees it.

    Returns:
        (H, W) body ids (-1: none), each taken at the centre of its cell.
    """
    # So far up, a block's top moves by less than half a millimetre; and TinyRenderer is not reliable with an
    # orthographic projection (it loses parts of bowls).
    w, height = workspace, 50.0
    # TinyRenderer looks through a pixel's lower left corner; half a cell further is the cell's centre.
    x, y = (w.x_min + w.x_max + w.pixel) / 2, (w.y_min + w.y_max + w.pixel) / 2
    camera = Camera(
        "above", (x, y, height), (1.0, 0.0, 0.0, 0.0), w.shape, height / w.pixel, near=height - w.z_max, far=height + 1
    )
    ids = render(client, camera, segmentation=True)[1]
    return np.where(ids < 0, ids, ids & 0xFFFFFF)  # without the link's bits
