"""Random free places on the table, and the brown box that several families put there."""

from __future__ import annotations

import math

import numpy as np

from gem_lite import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation import trays
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.goals import ZoneMetric
from gem_lite.simulation.shapes import Body
from gem_lite.simulation.worlds import HOME, WorldStyle

TRIES = 1000
GAP = 0.015
"""Free space (m) round every body."""
CONTACT = 0.001
"""Free space (m) between bodies that are put against each other: one picture shows none, and nothing is pushed."""


class TableFullError(RuntimeError):
    """A body that a scene needs finds no free place."""


class FreeSpace:
    """Samples poses whose bounding circles neither overlap nor leave the workspace.

    In a world of touching bodies, some are put against the side of another one instead; then their circles may
    overlap, their sides do not.
    """

    def __init__(
        self, workspace: Workspace, rng: np.random.Generator, style: WorldStyle = HOME, gap: float = GAP
    ) -> None:  # fmt: skip
        self._workspace, self._rng, self._style, self._gap = workspace, rng, style, gap
        self._taken: list[tuple[Pose2, float, float]] = []  # pose, radius, side
        # Of its own, so that a world of other containers lays out the same episodes.
        self._choices = rng.spawn(1)[0]

    def sample(self, radius: float, side: float | None = None) -> Pose2 | None:
        """A free pose for a body inside a circle of ``radius`` metres; None if none was found.

        Args:
            side: how far (m) the body reaches along its own axes; its radius unless given.
        """
        side = radius if side is None else side
        style = self._style
        pose = None
        if style.touching and self._taken and self._rng.random() < style.touching:
            pose = self._against_a_body(radius, side)
        if pose is None:
            at_edge = style.at_edge > 0 and self._rng.random() < style.at_edge
            pose = self._anywhere(radius, at_edge)
        if pose is not None:
            self._taken.append((pose, radius, side))
        return pose

    def choose(self, count: int) -> int:
        """The number of one of ``count`` ways to make a body."""
        return int(self._choices.integers(count))

    def take(self, radius: float, side: float | None = None) -> Pose2:
        """Like `sample`, for a body that the scene needs. Raises TableFullError if there is no free place."""
        pose = self.sample(radius, side)
        if pose is None:
            raise TableFullError(f"the table has no free place for a body of radius {radius} m")
        return pose

    def _anywhere(self, radius: float, at_edge: bool) -> Pose2 | None:
        w = self._workspace
        borders = (w.x_min + radius, w.x_max - radius, w.y_min + radius, w.y_max - radius)
        for _ in range(TRIES):
            x = self._rng.uniform(*borders[:2])
            y = self._rng.uniform(*borders[2:])
            if at_edge:
                border = int(self._rng.integers(4))
                x = borders[border] if border < 2 else x
                y = borders[border] if border >= 2 else y
            if self._is_free(x, y, radius):
                return Pose2(x, y, self._rng.uniform(-np.pi, np.pi))
        return None

    def _against_a_body(self, radius: float, side: float) -> Pose2 | None:
        """Face to face with another body, as that one is turned; None if no body has room."""
        w = self._workspace
        for index in self._rng.permutation(len(self._taken)):
            neighbour, _, its_side = self._taken[index]
            face = int(self._rng.integers(4)) * math.pi / 2
            away = its_side + side + CONTACT
            pose = neighbour @ Pose2(away * math.cos(face), away * math.sin(face))
            inside = w.contains(pose.x, pose.y, radius)
            if inside and self._is_free(pose.x, pose.y, radius, beside=int(index)):
                return pose
        return None

    def _is_free(self, x: float, y: float, radius: float, beside: int | None = None) -> bool:
        return all(
            index == beside or np.hypot(x - pose.x, y - pose.y) >= radius + other + self._gap
            for index, (pose, other, _) in enumerate(self._taken)
        )


def put_brown_box(
    environment: Environment, rng: np.random.Generator, free: FreeSpace, sides: tuple[float, float]
) -> tuple[Body, ZoneMetric]:
    """Put a fixed brown box, open on top, on a free place.

    Args:
        sides: its two sides (m) are drawn from this range, each for itself.

    Returns:
        The box, and what says whether a body is inside: between its walls and below their rim.
    """
    x, y = rng.uniform(*sides, 2).tolist()
    heights = environment.style.box_heights
    height = heights[free.choose(len(heights))]
    pose = free.take(math.hypot(x, y) / 2)
    box = environment.add(trays.add_container(environment.client, (x, y), colors.rgba("brown"), pose, height))
    return box, ZoneMetric((x, y), height)
