"""RGB-D cameras: CLIPort's three views of the table, and the true bodies from above, for scoring and tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from gem_lite.se2 import Workspace

RENDERED_CORNER = (-0.5, 0.5)
"""TinyRenderer sees through a pixel's lower left corner: that far (x, y pixels) from the pixel's centre."""
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. Its axes: +z forward, +x to the image's right, +y down.

    Points, renders and localisation share this one model.

    Attributes:
        name: how pictures of it are labelled.
        intrinsics: (3, 3). A point (X, Y, Z) in the camera's axes appears at (x, y) pixels from the upper left
            edge of the picture, with (x, y, 1) = intrinsics (X, Y, Z) / Z; pixel (row, col) has its centre at
            (col + 1/2, row + 1/2).
        pose: (4, 4), from the camera's axes to the frame that the camera is given in (metres).
        size: (H, W) in pixels.
        near, far: what is nearer or farther (metres along the axis) is not seen.
    """

    name: str
    intrinsics: Matrix
    pose: Matrix
    size: tuple[int, int] = (480, 640)
    near: float = 0.01
    far: float = 10.0

    @classmethod
    def pinhole(
        cls, name: str, position: Sequence[float], quaternion: Sequence[float], size: tuple[int, int] = (480, 640),
        focal: float = 450.0, near: float = 0.01, far: float = 10.0,
    ) -> Camera:  # fmt: skip
        """A camera whose axis goes through the middle of its picture.

        Args:
            position: (x, y, z) in metres.
            quaternion: (x, y, z, w), camera to world.
            focal: focal length in pixels.
        """
        intrinsics = ((focal, 0.0, size[1] / 2), (0.0, focal, size[0] / 2), (0.0, 0.0, 1.0))
        rotation = Rotation.from_quat(quaternion).as_matrix()
        return cls(name, intrinsics, as_pose(rotation, position), size, near, far)

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) camera-to-world rotation."""
        return np.array(self.pose)[:3, :3]

    @property
    def position(self) -> np.ndarray:
        """(3,) where the camera is, in metres."""
        return np.array(self.pose)[:3, 3]

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) ``intrinsics`` as an array."""
        return np.array(self.intrinsics)

    @property
    def focal(self) -> float:
        """The focal length in pixels, along the picture's rows."""
        return self.intrinsics[0][0]


def as_pose(rotation: np.ndarray, position: Sequence[float]) -> Matrix:
    """A (3, 3) rotation and a position (m) as the (4, 4) ``pose`` of a `Camera`."""
    rows = np.column_stack([rotation, position]).tolist()
    return (*(tuple(row) for row in rows), (0.0, 0.0, 0.0, 1.0))


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
        points += self.camera.position.astype(np.float32)
        return points


@lru_cache(maxsize=16)
def _rays(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32: from the camera to each pixel's point at depth 1, in the world's directions."""
    height, width = camera.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)  # the pixels' centres, each (H, W)
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    return (pixels @ np.linalg.inv(camera.matrix).T @ camera.rotation.T).astype(np.float32)


CAMERAS: tuple[Camera, ...] = (
    Camera.pinhole("front", (1.0, 0.0, 0.75), (0.6533, 0.6533, -0.2706, -0.2706)),
    Camera.pinhole("left", (0.0, 0.5, 0.75), (-0.3596, 0.8682, -0.3160, 0.1309)),
    Camera.pinhole("right", (0.0, -0.5, 0.75), (-0.8682, 0.3596, -0.1309, 0.3160)),
)
"""CLIPort's front, left and right cameras."""


def cameras_around(workspace: Workspace) -> tuple[Camera, ...]:
    """`CAMERAS`, drawn nearer or farther with the table's length (CLIPort's is 1 m long)."""
    middle = np.array([(workspace.x_min + workspace.x_max) / 2, (workspace.y_min + workspace.y_max) / 2, 0.0])
    placed = [middle + workspace.length * (camera.position - (0.5, 0.0, 0.0)) for camera in CAMERAS]
    return tuple(replace(c, pose=as_pose(c.rotation, at)) for c, at in zip(CAMERAS, placed, strict=True))


def looking(name: str, position: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    """A camera at ``position`` that looks at ``target`` (m), upright; not for straight down."""
    forward = np.subtract(target, position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    turn = Rotation.from_matrix(np.stack([right, np.cross(forward, right), forward], axis=1))
    return Camera.pinhole(name, position, turn.as_quat())


@dataclass(frozen=True)
class Light:
    """The one lamp of a scene, far away.

    Attributes:
        direction: towards the lamp (x, y, z), of any length.
        color: (red, green, blue) in [0, 1].
        ambient, diffuse: how strongly it lights what faces away and what faces it; TinyRenderer adds both.
        shadow: whether bodies cast shadows.
    """

    direction: tuple[float, float, float] = (0.3, 0.2, 1.0)
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ambient: float = 0.6
    diffuse: float = 0.35
    shadow: bool = False


LIGHT = Light()
"""The lamp of every world where nothing else is said."""


def render(
    client: int, camera: Camera, light: Light = LIGHT, segmentation: bool = False
) -> tuple[View, np.ndarray | None]:
    """Take a picture of a PyBullet world.

    Returns:
        The view, and with ``segmentation`` the (H, W) body id of each pixel (-1: none), plus
        (link + 1) << 24 on a body's links. Segmentation is for training CLIP and for tests; no policy
        sees it.
    """
    forward, up = camera.rotation[:, 2], -camera.rotation[:, 1]
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
    b = np.asarray(buffer, np.float32).reshape(height, width)
    near, far = camera.near, camera.far
    depth = (near * far / (far - b * (far - near))).astype(np.float32)
    masks = np.asarray(ids).reshape(height, width) if segmentation else None
    return View(camera, rgb, depth), masks


def projection(camera: Camera) -> list[float]:
    """OpenGL's projection matrix (16 numbers) with which TinyRenderer draws what ``camera.intrinsics`` describe."""
    height, width = camera.size
    (focal_x, _, x), (_, focal_y, y), _ = camera.intrinsics
    # Each pixel is drawn as seen through its corner, so the picture moves until that is the centre's ray.
    x, y = x + RENDERED_CORNER[0], y + RENDERED_CORNER[1]
    left, right = -x / focal_x * camera.near, (width - x) / focal_x * camera.near
    bottom, top = (y - height) / focal_y * camera.near, y / focal_y * camera.near
    return p.computeProjectionMatrix(left, right, bottom, top, camera.near, camera.far)


def bodies_from_above(client: int, workspace: Workspace) -> np.ndarray:
    """Which body lies on top in each cell of a height map: for scoring and tests, no policy sees it.

    Returns:
        (H, W) body ids (-1: none), each taken at the centre of its cell.
    """
    # So far up, a block's top moves by less than half a millimetre; and TinyRenderer is not reliable with an
    # orthographic projection (it loses parts of bowls).
    w, height = workspace, 50.0
    x, y = (w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2
    near, far = height - w.z_max, height + 1
    camera = Camera.pinhole("above", (x, y, height), (1.0, 0.0, 0.0, 0.0), w.shape, height / w.pixel, near, far)
    ids = render(client, camera, segmentation=True)[1]
    return np.where(ids < 0, ids, ids & 0xFFFFFF)  # without the link's bits
