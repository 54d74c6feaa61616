"""The base of all tasks. Sentence, score and expert follow from the goals of a task."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal

import numpy as np

from gem_lite.actions import ExpertAction, Push
from gem_lite.foundations import colors
from gem_lite.language import Instruction
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.effectors import EFFECTORS
from gem_lite.simulation.environment import Environment
from gem_lite.tasks import goals
from gem_lite.tasks.goals import Goal

Split = Literal["train", "val", "test"]
NEARLY = 0.01
"""A goal is reached if less than this share of the whole task is missing from it: CLIPort's rule."""


class Task(ABC):
    """A family of tasks: it lays out scenes and sets their goals.

    The goals follow one another. After each action, a goal that is reached is done for the rest of the episode, and the
    next sentence follows. A goal that is not reached stays. The episode ends after `max_steps` actions.

    A family defines `lay_out`. It overrides other methods only if its rules differ.

    Attributes:
        workspace: the area of the task's table.
        scale: the size of its things, as a multiple of CLIPort's.
        effector: the name of the tool, see `effectors`.
        max_steps: the number of actions after which an episode ends.
        goals: the goals of the present episode; empty before `reset`.
        named_colors: the colours that the sentences name.
        names: the name of each body, such as "red block", by its id: for scoring maps; no policy gets it.
        unseen: whether colours, shapes and objects come from the unseen sets.

    Args:
        split: the split of the episodes.
        unseen: whether the unseen sets are used in validation and test. They are never used in training.
    """

    workspace: Workspace = Workspace()
    scale: float = 1.0
    effector: str = "suction"
    max_steps: int = 1

    def __init__(self, split: Split = "train", unseen: bool = False) -> None:
        self.unseen = unseen and split != "train"
        self.goals: tuple[Goal, ...] = ()
        self.named_colors: tuple[str, ...] = ()
        self.names: dict[int, str] = {}
        self._reached = 0

    def reset(self, environment: Environment, rng: np.random.Generator, seed: int) -> None:
        """Lay out an episode with `lay_out`."""
        self.names = {}
        self._reached = 0
        self.goals = tuple(self.lay_out(environment, rng, seed))

    @abstractmethod
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> Sequence[Goal]:
        """Put the bodies of an episode on the tables with `put`.

        Args:
            environment: has its tables, and no bodies on them.
            rng: the source of all random choices.
            seed: the seed of the episode, for a family that uses its objects in turn.

        Returns:
            The goals in their order, at least one.

        Raises:
            TableFullError: there is no free place for a body that the scene needs (this never happened); see `spawn`.
        """

    @property
    def palette(self) -> tuple[str, ...]:
        """The colours of the present split."""
        return colors.UNSEEN if self.unseen else colors.SEEN

    def put(self, environment: Environment, body: Body, name: str) -> Body:
        """Register a body that lies on a table, and its name. Returns the body."""
        self.names[body.id] = name
        return environment.add(body)

    @property
    def instruction(self) -> Instruction:
        """The present sentence: all that a policy gets from a task. After the last goal, the last sentence stays.

        It is empty before `reset`.
        """
        if not self.goals:
            return ""
        return self.goals[min(self._reached, len(self.goals) - 1)].sentence

    def score(self, environment: Environment) -> float:
        """The share of the task that is done, in [0, 1]."""
        reached = self._reached_now(environment)
        done = sum(goal.share for goal in self.goals[:reached])
        if reached < len(self.goals):
            goal = self.goals[reached]
            done += goal.share * goal.done(environment)
        return done / sum(goal.share for goal in self.goals)

    def expert(self, environment: Environment) -> ExpertAction | None:
        """The next action, from ground truth. None if no goal is left, or if the next body lies off the tables."""
        reached = self._reached_now(environment)
        if reached == len(self.goals):
            return None
        goal = self.goals[reached]
        act = goals.push if Push in EFFECTORS.find(self.effector).actions else goals.pick_and_place
        expert = act(environment, goal)
        poses = [value for value in vars(expert.action).values() if isinstance(value, Pose2)]
        return expert if all(self.workspace.contains(pose.x, pose.y) for pose in poses) else None

    def placed(self, environment: Environment) -> set[int]:
        """The ids of the bodies that are already at their targets. To pick one of them is a mistake."""
        reached = self._reached_now(environment)
        placed = {body.id for goal in self.goals[:reached] for body in goal.bodies}
        if reached < len(self.goals):
            goal = self.goals[reached]
            placed = placed - {body.id for body in goal.bodies} | goal.placed(environment)
        return placed

    def advance(self, environment: Environment) -> None:
        """Called after every action: go on to the next goal that is not reached."""
        self._reached = self._reached_now(environment)

    def subsets(self) -> tuple[str, ...]:
        """The names of the subsets that contain the present episode. Each subset gets its own row of results."""
        return ()

    def _reached_now(self, environment: Environment) -> int:
        """The number of reached goals, in their order: counting ends at the first goal that is not reached."""
        reached = self._reached
        whole = sum(goal.share for goal in self.goals)
        for goal in self.goals[reached:]:
            if goal.share * (1.0 - goal.done(environment)) >= NEARLY * whole:
                break
            reached += 1
        return reached
