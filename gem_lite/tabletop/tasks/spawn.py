"""Random free places on the table."""

from __future__ import annotations

import numpy as np

from gem_lite.se2 import Pose2, Workspace

TRIES = 1000


class FreeSpace:
    """Samples poses whose bounding circles neither overlap nor leave the workspace."""

    def __init__(self, workspace: Workspace, rng: np.random.Generator, gap: float = 0.015) -> None:
        self._workspace, self._rng, self._gap = workspace, rng, gap
        self._taken: list[tuple[float, float, float]] = []

    def sample(self, radius: float) -> Pose2 | None:
        """A free pose for a body inside a circle of ``radius`` metres; None if none was found."""
        w = self._workspace
        for _ in range(TRIES):
            x = self._rng.uniform(w.x_min + radius, w.x_max - radius)
            y = self._rng.uniform(w.y_min + radius, w.y_max - radius)
            if all(np.hypot(x - a, y - b) >= radius + r + self._gap for a, b, r in self._taken):
                self._taken.append((x, y, radius))
                return Pose2(x, y, self._rng.uniform(-np.pi, np.pi))
        return None

    def take(self, radius: float) -> Pose2:
        """Like `sample`, for a body that the scene needs. Raises RuntimeError if there is no free place."""
        pose = self.sample(radius)
        if pose is None:
            raise RuntimeError(f"the table has no free place for a body of radius {radius} m")
        return pose
