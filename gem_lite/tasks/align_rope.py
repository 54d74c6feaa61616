"""align-rope: "align the rope from front left tip to front right tip", after CLIPort."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from typing_extensions import override

from gem_lite.actions import ExpertAction
from gem_lite.simulation.bodies import ropes
from gem_lite.simulation.environment import Environment
from gem_lite.tasks import goals
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace
from gem_lite.tasks.task import Task

TOLERANCE = 0.02
FALL = 2.0
"""Seconds in which the rope falls onto the table, as in CLIPort."""
GUIDE_RADIUS = ropes.LENGTH / math.sqrt(2) + ropes.STRIP[0]
ROPE_RADIUS = 0.07


@register("align-rope")
class AlignRope(Task):
    """A rope of 20 beads that fell into loops, and a guide with four corners; the sentence names two of them.

    Each end of the rope may go to each of the two corners: a bead has two targets.
    """

    effector = "low-suction"
    max_steps = 20

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        guide_pose = free.take(GUIDE_RADIUS)
        self.put(environment, ropes.add_guide(environment.client, guide_pose), "square guide")
        points = ropes.hanging_points(free.take(ROPE_RADIUS))
        beads = [self.put(environment, bead, "rope") for bead in ropes.add_rope(environment.client, points)]
        environment.wait(FALL)
        start, end = ropes.DIRECTIONS[int(rng.integers(len(ropes.DIRECTIONS)))]
        targets = tuple(ropes.targets(guide_pose, start, end))
        last = len(beads) - 1
        matches = tuple((number, last - number) for number in range(len(beads)))
        sentence = f"align the rope from {start} to {end}"
        return [Goal(sentence, tuple(beads), targets, PoseMetric(TOLERANCE), matches=matches, rotations=False)]

    @override
    def expert(self, environment: Environment) -> ExpertAction | None:
        """As in every task, but the rope keeps the direction in which it is nearer to its targets."""
        if self._reached_now(environment) == len(self.goals):
            return None
        (goal,) = self.goals
        beads = np.array([(pose.x, pose.y) for pose in (environment.pose(bead)[0] for bead in goal.bodies)])
        places = np.array([(target.x, target.y) for target in goal.targets if not isinstance(target, goals.Body)])
        along, against = (np.square(beads - order).sum() for order in (places, places[::-1]))
        numbers = range(len(beads))
        one_way = numbers if along <= against else reversed(numbers)
        directed = replace(goal, matches=tuple((number,) for number in one_way))
        if directed.done(environment) == 1:
            return None
        return goals.pick_and_place(environment, directed)
