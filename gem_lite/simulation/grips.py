"""What a parallel jaw would hold, from the surfaces of bodies: the geometry alone decides (A.11 of the paper).

The jaw's two fingers stand at both ends of its opening, which lies along its y axis. They go down and close. Surfaces
are sampled points with normals. Nothing collides here, so a finger may go down inside a mug, although the contact shape
of a mug has no inside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pybullet as p
import trimesh

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies.shapes import Body

OPENINGS = (0.035, 0.025, 0.015)
"""The jaw opens as wide as it has room (m); the widest comes first."""
FINGER = (0.003, 0.005)
"""Thickness (along y) and width (along x) of a finger (m)."""
REACH = math.hypot(OPENINGS[0] / 2 + FINGER[0], FINGER[1] / 2)
"""No point of the open jaw is farther (m) from its middle, seen from above."""
DEPTH = 0.012
"""The fingers go so far (m) below the highest point between them, but not below the table."""
CONE = math.radians(25)
"""A surface slips off a finger if it is turned away from it by more than this: a friction of about 0.47."""
SKIN = 0.00025
"""What is so near (m) to the outermost point touches a finger."""
CLEAR = 0.0003
"""A finger may come so near (m) to a surface without touching it."""
DENSITY = 4e6
"""Points per square metre: a patch of the size of a finger's tip has about a hundred."""


@dataclass(frozen=True)
class Grip:
    """What a jaw holds at a pose.

    Attributes:
        body: the id of the body.
        part: the name of the part, "" for one without a name.
        tip: the height (m) of the fingers' ends.
        middle: where the middle of what it holds lies on the jaw's y axis (m).
    """

    body: int
    part: str
    tip: float
    middle: float


@lru_cache(maxsize=512)
def sample_surface(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Points of a mesh's surface and their outward normals, both (N, 3); the same ones each time."""
    points, faces = trimesh.sample.sample_surface(mesh, math.ceil(mesh.area * DENSITY), seed=0)
    return np.asarray(points), mesh.face_normals[faces]


@dataclass(frozen=True)
class Surfaces:
    """The surfaces of bodies, as points in the world.

    Attributes:
        points, normals: (N, 3) metres, and unit vectors.
        owners: (N,) the number in ``parts`` of each point's part.
        parts: for each part its body and its name.
    """

    points: np.ndarray
    normals: np.ndarray
    owners: np.ndarray
    parts: tuple[tuple[Body, str], ...]

    @classmethod
    def of(cls, client: int, bodies: Sequence[Body]) -> Surfaces:
        """The surfaces of bodies at their present poses. A body without parts has none."""
        points, normals, owners = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0, int)]
        parts: list[tuple[Body, str]] = []
        for body in bodies:
            position, turn = p.getBasePositionAndOrientation(body.id, physicsClientId=client)
            rotation = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)
            for part in body.parts:
                of_part, outward = sample_surface(part.mesh)
                points.append((of_part - (0, 0, body.rest_height)) @ rotation.T + position)
                normals.append(outward @ rotation.T)
                owners.append(np.full(len(of_part), len(parts)))
                parts.append((body, part.name))
        return cls(np.concatenate(points), np.concatenate(normals), np.concatenate(owners), tuple(parts))

    def around(self, points: np.ndarray) -> Surfaces:
        """The surfaces that a jaw can meet whose middle is at one of some ``points`` (N, 2) (m): fewer, so faster."""
        near = np.ones(len(self.points), bool)
        for axis in (0, 1):
            near &= self.points[:, axis] >= points[:, axis].min() - REACH
            near &= self.points[:, axis] <= points[:, axis].max() + REACH
        return Surfaces(self.points[near], self.normals[near], self.owners[near], self.parts)

    def grip(self, pose: Pose2) -> Grip | None:
        """What a jaw at a pose in the world holds, opened as wide as it has room; None if it holds nothing."""
        near = (np.abs(self.points[:, 0] - pose.x) <= REACH) & (np.abs(self.points[:, 1] - pose.y) <= REACH)
        turn = _axes(pose)
        below = np.abs((self.points[near, :2] - (pose.x, pose.y)) @ turn[:, 0]) <= FINGER[1] / 2
        near[near] = below  # The jaw's own rectangle.
        points = self.points[near]
        across = (points[:, :2] - (pose.x, pose.y)) @ turn[:, 1]
        facing = self.normals[near, :2] @ turn[:, 1]
        for opening in OPENINGS:
            held = self._closed(opening, across, points[:, 2], facing, self.owners[near])
            if held is not None:
                return held
        return None

    def _closed(
        self, opening: float, across: np.ndarray, height: np.ndarray, facing: np.ndarray, owners: np.ndarray
    ) -> Grip | None:
        """What the jaw holds after it went down with an ``opening`` (m).

        Args:
            across, height: of each point below the jaw: its place on the jaw's y axis, and its height (m).
            facing: how far each point's normal shows along that axis, from -1 to 1.
        """
        between = np.abs(across) < opening / 2
        if not between.any():
            return None
        tip = max(0.0, float(height[between].max()) - DEPTH)
        under_fingers = ~between & (np.abs(across) <= opening / 2 + FINGER[0])
        if (height[under_fingers] > tip + CLEAR).any():
            return None
        between &= height > tip
        across, facing, owners = across[between], facing[between], owners[between]
        bodies = {self.parts[number][0] for number in np.unique(owners)}
        low, high = float(across.min()), float(across.max())
        ends = ((across < low + SKIN, -facing), (across > high - SKIN, facing))
        if len(bodies) != 1 or not all(_presses(toward[end]) for end, toward in ends):
            return None
        (body,) = bodies
        return Grip(body.id, self._main_part(owners), tip, (low + high) / 2) if body.movable else None

    def part_between(self, pose: Pose2, opening: float, width: float, tip: float) -> str:
        """The name of the part of which most points lie between closed fingers; "" if there is none with a name.

        Args:
            pose: of the jaw in the world.
            opening: the distance (m) of the fingers.
            width: of a finger (m), along the jaw's x axis.
            tip: the height (m) of the fingers' ends.
        """
        along, across = np.abs((self.points[:, :2] - (pose.x, pose.y)) @ _axes(pose)).T
        between = (along <= width / 2) & (across <= opening / 2 + SKIN) & (self.points[:, 2] > tip)
        return self._main_part(self.owners[between]) if between.any() else ""

    def _main_part(self, owners: np.ndarray) -> str:
        """The name of the part with the most points. A part without a name counts only if no other is there."""
        counts = np.bincount(owners, minlength=len(self.parts))
        named = [number if name else 0 for number, (_, name) in zip(counts, self.parts, strict=True)]
        return self.parts[int(np.argmax(named if any(named) else counts))][1]


def _axes(pose: Pose2) -> np.ndarray:
    """(2, 2): the jaw's x axis and its y axis in the world, as columns."""
    return np.array([[math.cos(pose.yaw), -math.sin(pose.yaw)], [math.sin(pose.yaw), math.cos(pose.yaw)]])


def _presses(toward: np.ndarray) -> bool:
    """Whether most of a surface at a finger faces it: its normals' parts ``toward`` the finger, from -1 to 1."""
    outer = toward[toward > 0]
    return len(outer) > 0 and float(np.median(outer)) >= math.cos(CONE)
