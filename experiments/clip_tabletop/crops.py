"""The embedded CLIP's pictures: scenes rendered in PyBullet, cut into labelled crops.

Crops are cut as semantic maps cut them, from jittered copies of the table's cameras and from the fused
height map, under changing light. Labels come from the renderer's segmentation.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from experiments.clip_tabletop import vocabulary
from experiments.clip_tabletop.scenes import NOUN_NAMES, Kind, LabelledScene, lay_out
from gem_lite.evaluation import workers
from gem_lite.rgbd.camera import Camera, as_pose
from gem_lite.rgbd.heightmap import fuse_views, sort_points
from gem_lite.se2 import Workspace
from gem_lite.simulation.rendering import CAMERAS, LIGHT, Light, render

IMAGE_SIZE = 40
SIDE_PATCH = (30, 62)
"""Side lengths (pixels) of crops from camera views; the maps use 40."""
TOP_PATCH = (0.09, 0.15)
"""Side lengths (metres) of crops from the height map; the maps use 0.125."""
SCENES_PER_PROCESS = 160
"""New processes take over after this number of scenes for each: PyBullet keeps some memory of every scene."""
PART_KEYS = tuple(vocabulary.PARTS)
TABLE = -1
"""The index in ``shape`` of a crop of the bare table."""
NO_NAME = -2
"""The index in ``shape`` of something that no caption may name. No rendered crop has it; see `withheld`."""
NO_PART = -1
"""The index in ``part`` of a crop without a single part that has a name."""


@dataclass
class Crops:
    """Rendered crops and their labels, N of each.

    ``images`` (N, 40, 40, 3) uint8. ``color``, ``shape`` and ``part`` (N,) are indices into `COLOR_NAMES`,
    `NOUN_NAMES` and `PART_KEYS`; -1 for an unnamed colour, `TABLE`, `NO_NAME` and `NO_PART` are none of them.
    ``whole`` (N,) is True for crops that frame a whole object.
    """

    images: np.ndarray
    color: np.ndarray
    shape: np.ndarray
    part: np.ndarray
    whole: np.ndarray

    def __len__(self) -> int:
        return len(self.images)

    def select(self, keep: np.ndarray) -> Crops:
        """The crops of a mask or an index array."""
        return Crops(**{field.name: getattr(self, field.name)[keep] for field in dataclasses.fields(self)})

    def save(self, folder: Path) -> None:
        """Write one .npy for each array. ``images`` is the last, so a folder that has it is complete."""
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("color", "shape", "part", "whole", "images"):
            partial = folder / f"{name}.part.npy"
            np.save(partial, getattr(self, name))
            os.replace(partial, folder / f"{name}.npy")

    @classmethod
    def load(cls, folder: Path) -> Crops:
        """The inverse of `save`."""
        return cls(**{field.name: np.load(folder / f"{field.name}.npy") for field in dataclasses.fields(cls)})


def _jittered_camera(camera: Camera, rng: np.random.Generator) -> Camera:
    turn = camera.rotation @ Rotation.from_euler("xyz", rng.normal(0, 0.06, 3)).as_matrix()
    position = camera.position + rng.normal(0, 0.06, 3)
    return dataclasses.replace(camera, pose=as_pose(turn, position))


def render_scene(rng: np.random.Generator, kind: Kind) -> list[tuple]:
    """One scene's crops as (image, colour, shape, part, whole), from camera views and the height map."""
    client = p.connect(p.DIRECT)
    try:
        workspace = Workspace(pixel=float(rng.choice([0.00625, 0.003125])))
        scene = lay_out(client, workspace, kind, rng)
        direction = tuple(np.array(LIGHT.direction) + rng.normal(0, 0.25, 3))
        light = Light(direction, tuple(np.clip(rng.normal(1, 0.03, 3), 0.85, 1.0)))
        taken = [render(client, _jittered_camera(c, rng), light, segmentation=True) for c in CAMERAS]
    finally:
        p.disconnect(client)
    views = [view for view, _ in taken]
    masks = [ids for _, ids in taken]
    crops = []
    for view, ids in taken:
        crops += _cut_crops(view.rgb, ids, scene, SIDE_PATCH, 120, rng)
    points = sort_points(views, workspace)
    ids = np.concatenate([mask[kept] for mask, kept in zip(masks, points.kept, strict=True)])
    top = np.full(workspace.shape, -1)
    top.flat[points.cell[points.on_top]] = ids[points.on_top]
    sides = tuple(round(length / workspace.pixel) for length in TOP_PATCH)
    return crops + _cut_crops(fuse_views(views, workspace, points).rgb, top, scene, sides, 20, rng)


def _cut_crops(
    image: np.ndarray, ids: np.ndarray, scene: LabelledScene, sides: tuple[int, int], least: int,
    rng: np.random.Generator,
) -> list[tuple]:  # fmt: skip
    """For each body, cut three patches anywhere on it and a crop that frames it; also cut some of the table."""
    bodies = scene.grouped(np.where(ids >= 0, ids & 0xFFFFFF, -1))
    crops = []

    def add(row: int, col: int, side: int, whole: bool) -> None:
        top = row - side // 2
        left = col - side // 2
        if top < 0 or left < 0 or top + side > image.shape[0] or left + side > image.shape[1]:
            return
        window = np.s_[top : top + side, left : left + side]
        label = _label(bodies[window], ids[window] >> 24, scene)
        if label is not None:
            crops.append((_resized(image[window]), *label, whole))

    for body in np.intersect1d(bodies, list(scene.labels)):
        rows, cols = np.nonzero(bodies == body)
        if len(rows) < least:
            continue
        for pixel in rng.integers(len(rows), size=3):
            row, col = np.array([rows[pixel], cols[pixel]]) + np.round(rng.normal(0, 0.1 * sides[0], 2)).astype(int)
            add(int(row), int(col), int(rng.integers(*sides)), False)
        extent = max(np.ptp(rows), np.ptp(cols)) * rng.uniform(1.1, 1.4)
        side = int(np.clip(extent, *sides))
        add((rows.min() + rows.max()) // 2, (cols.min() + cols.max()) // 2, side, bool(extent < 1.5 * sides[1]))
    for _ in range(6):
        add(int(rng.integers(image.shape[0])), int(rng.integers(image.shape[1])), int(rng.integers(*sides)), False)
    return crops


@cache
def _window(side: int) -> np.ndarray:
    offset = (np.arange(side) + 0.5) / side - 0.5
    profile = np.exp(-np.square(offset / 0.35) / 2)
    return profile[:, None] * profile


def _label(bodies: np.ndarray, links: np.ndarray, scene: LabelledScene) -> tuple[int, int, int] | None:
    """Colour, shape and part of the body that fills most of a crop, weighted to its middle. None if it is ambiguous."""
    weight = _window(len(bodies))
    present, inverse = np.unique(bodies, return_inverse=True)
    share = np.bincount(inverse.ravel(), weights=weight.ravel()) / weight.sum()
    labelled = [(s, int(body)) for s, body in zip(share, present, strict=True) if int(body) in scene.labels]
    if any(body not in scene.ground and s > 0.1 for s, body in labelled):
        labelled = [(s, body) for s, body in labelled if body not in scene.ground]
    labelled.sort(reverse=True)
    if not labelled or labelled[0][0] < 0.01:
        return -1, -1, -1
    largest, body = labelled[0]
    if largest < 0.05 or (len(labelled) > 1 and labelled[1][0] > 0.4 * largest):
        return None
    label = scene.labels[body]
    inside = bodies == body
    part = -1
    if label.parts:
        shares = np.bincount(links[inside], weights=weight[inside], minlength=len(label.parts)) / weight[inside].sum()
        name = label.parts[int(shares.argmax())]
        if name and shares.max() > 0.65:
            part = PART_KEYS.index((NOUN_NAMES[label.noun], name))
    return label.color, label.noun, part


def _resized(image: np.ndarray) -> np.ndarray:
    method = cv2.INTER_AREA if image.shape[0] > IMAGE_SIZE else cv2.INTER_CUBIC
    return cv2.resize(image, (IMAGE_SIZE, IMAGE_SIZE), interpolation=method)


@dataclass(frozen=True)
class Job:
    """A few scenes for one process."""

    seed: int
    kind: Kind
    indices: Sequence[int]


def run_job(job: Job) -> list[tuple]:
    """The crops of a job's scenes, see `render_scene`."""
    return [crop for index in job.indices for crop in render_scene(np.random.default_rng((job.seed, index)), job.kind)]


def render_crops(scenes: int, seed: int, kind: Kind = "training") -> Crops:
    """Render ``scenes`` scenes, one process a core; the same crops whatever the number of cores.

    Args:
        kind: "training"; "test" has other variants of the objects; in "held-out" half the bodies are of
            pairs that training never shows; in "foreign" half are pybullet_data's own mug and duck.

    Raises:
        ChildProcessError: a process was killed, see `workers.run_jobs`.
    """
    rows = []
    at_once = SCENES_PER_PROCESS * (os.cpu_count() or 1)
    for first in range(0, scenes, at_once):
        jobs = [Job(seed, kind, part) for part in workers.chunks(first, min(at_once, scenes - first))]
        rows += workers.run_jobs(run_job, jobs, f"rendering ({kind}), from scene {first}", unit="scene")
    images, color, shape, part, whole = zip(*rows, strict=True)
    return Crops(np.stack(images), np.array(color), np.array(shape), np.array(part), np.array(whole))


def rendered_crops(run: Path, scenes: int, seed: int, kind: Kind = "training") -> Crops:
    """`render_crops`, saved in ``run``. A later call with the same scenes, seed and kind reads the saved crops.

    The first scene is always rendered, and its SHA-256 is a part of the folder's name. So after a change of objects,
    cameras or light, old crops are not used.
    """
    first_scene = hashlib.sha256()
    for image, *label in run_job(Job(seed, kind, [0])):
        first_scene.update(image.tobytes() + repr(label).encode())
    cache = run / f"crops-{kind}-{scenes}-{seed}-{first_scene.hexdigest()[:12]}"
    if (cache / "images.npy").exists():
        return Crops.load(cache)
    crops = render_crops(scenes, seed, kind)
    crops.save(cache)
    return crops
