"""Random free places on the table, and the brown box of several families."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import trays
from gem_lite.simulation.bodies.shapes import Body, PieceForm
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.looks import HOME, Look
from gem_lite.tasks.goals import ZoneMetric
from gem_lite.tasks.task import Task

TRIES = 1000
GAP = 0.015
"""Free space (m) around every body."""
CONTACT = 0.001
"""Free space (m) between neighbours that seem to touch. It is not visible, and the bodies do not push each other."""


class TableFullError(RuntimeError):
    """There is no free place for a body that a scene needs."""


class FreeSpace:
    """Samples poses whose bounding circles neither overlap nor leave the workspace.

    In a world with touching bodies, some bodies are put next to the side of another body. Then their circles may
    overlap; their sides do not.
    """

    def __init__(
        self, workspace: Workspace, rng: np.random.Generator, style: Look = HOME, gap: float = GAP
    ) -> None:  # fmt: skip
        self._workspace, self._rng, self._style, self._gap = workspace, rng, style, gap
        self._taken: list[tuple[Pose2, float, float]] = []  # pose, radius, side
        # A separate generator: worlds with different containers still have the same poses in their episodes.
        self._choices = rng.spawn(1)[0]

    def sample(self, radius: float, side: float | None = None) -> Pose2 | None:
        """A free pose for a body inside a circle of ``radius`` metres, or None if there is none.

        Args:
            side: the distance (m) from the body's centre to its sides; by default its radius.
        """
        side = radius if side is None else side
        pose = None
        if self._style.touching and self._taken and self._rng.random() < self._style.touching:
            pose = self._against_a_body(radius, side)
        if pose is None:
            pose = self._anywhere(radius)
        if pose is not None:
            self._taken.append((pose, radius, side))
        return pose

    def choose(self, count: int) -> int:
        """A random number in [0, ``count``): the choice of one of several forms of a body."""
        return int(self._choices.integers(count))

    def factor(self) -> float:
        """A random factor of a length, in the range of the world's `Look.stretch`."""
        low, high = self._style.stretch
        return float(self._choices.uniform(low, high))

    def piece_form(self, symmetric: bool) -> PieceForm:
        """A random form of a flat piece; a ``symmetric`` one, as `packing_shapes.is_symmetric` says, stays so."""
        along_x, along_y = self.factor(), self.factor()
        fonts = self._style.fonts
        return PieceForm((along_x, along_x if symmetric else along_y), fonts[self.choose(len(fonts))])

    def take(self, radius: float, side: float | None = None) -> Pose2:
        """A free pose as from `sample`. Raises TableFullError if there is none."""
        pose = self.sample(radius, side)
        if pose is None:
            raise TableFullError(f"the table has no free place for a body of radius {radius} m")
        return pose

    def _anywhere(self, radius: float) -> Pose2 | None:
        at_edge = self._style.at_edge > 0 and self._rng.random() < self._style.at_edge
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
        """A pose beside another body, with the same yaw and a side next to its side. None if no body has room."""
        w = self._workspace
        for index in self._rng.permutation(len(self._taken)):
            neighbour, _, neighbour_side = self._taken[index]
            direction = int(self._rng.integers(4)) * math.pi / 2
            distance = neighbour_side + side + CONTACT
            pose = neighbour @ Pose2(distance * math.cos(direction), distance * math.sin(direction))
            if w.contains(pose.x, pose.y, radius) and self._is_free(pose.x, pose.y, radius, beside=int(index)):
                return pose
        return None

    def _is_free(self, x: float, y: float, radius: float, beside: int | None = None) -> bool:
        return all(
            index == beside or np.hypot(x - pose.x, y - pose.y) >= radius + other + self._gap
            for index, (pose, other, _) in enumerate(self._taken)
        )


def draw(rng: np.random.Generator, names: Sequence[str], count: int) -> list[str]:
    """``count`` different names at random."""
    return [str(name) for name in rng.choice(names, count, replace=False)]


def put_brown_box(
    task: Task, environment: Environment, rng: np.random.Generator, free: FreeSpace, sides: tuple[float, float]
) -> tuple[Body, ZoneMetric]:
    """Put a fixed brown box, open on top, on a free place.

    Args:
        sides: each side (m) of the box is drawn from this range.

    Returns:
        The box, and the metric for a body inside: it lies between the walls and below their upper edge.
    """
    x, y = rng.uniform(*sides, 2).tolist()
    heights = environment.style.box_heights
    height = task.scale * heights[free.choose(len(heights))]
    pose = free.take(math.hypot(x, y) / 2)
    box = trays.add_container(environment.client, (x, y), colors.rgba("brown"), pose, height)
    return task.put(environment, box, "brown box"), ZoneMetric((x, y), height)


MARGIN = 0.01
"""Free space (m) along the walls of a brown box, and between the cells of its floor."""


def split_floor(
    rng: np.random.Generator, sides: tuple[float, float], shortest: float
) -> list[tuple[Pose2, tuple[float, float]]]:  # fmt: skip
    """Cut the floor of a box into cells at random, as CLIPort does. A side of more than twice ``shortest`` is cut.

    Args:
        sides: the sides (m) of the box.
        shortest: a cut is at least this far (m) from both ends of the side.

    Returns:
        For each cell, its middle in the box's frame and its sides (m).
    """
    uncut = [np.array([[MARGIN - side / 2, side / 2 - MARGIN] for side in sides])]  # (2 axes, 2 ends)
    cells = []
    while uncut:
        cell = uncut.pop()
        lengths = cell[:, 1] - cell[:, 0]
        long = np.flatnonzero(lengths > 2 * shortest)
        if len(long) == 0:
            length, width = lengths.tolist()
            cells.append((Pose2(*cell.mean(axis=1).tolist()), (length, width)))
            continue
        axis = int(rng.choice(long))
        cut = rng.uniform(cell[axis, 0] + shortest, cell[axis, 1] - shortest)
        for end, border in ((1, cut - MARGIN / 2), (0, cut + MARGIN / 2)):
            part = cell.copy()
            part[axis, end] = border
            uncut.append(part)
    return cells
