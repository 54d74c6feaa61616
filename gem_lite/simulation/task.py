"""What every task offers to an environment; most of it follows from the task's goals."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from gem_lite.actions import ExpertAction, Push
from gem_lite.se2 import Workspace
from gem_lite.simulation import goals
from gem_lite.simulation.effectors import EFFECTORS
from gem_lite.simulation.goals import Goal

if TYPE_CHECKING:
    from gem_lite.simulation.environment import Environment

Split = Literal["train", "val", "test"]


class Task(ABC):
    """One family's scenes; sentence, score and expert follow from their goals.

    The goals are reached one after the other. One that is reached after an action counts for good, and the next
    sentence follows; one that is not stays, until `max_steps` actions are taken.

    A family writes `lay_out`, and overrides only what is special to it.

    Attributes:
        workspace: the table that the task is made for.
        effector: the name of its tool, see `effectors`.
        max_steps: actions after which an episode ends.
        goals: the present episode's; none before `reset`.
        named_colors: the palette's colours that the sentences name.
        names: what each body is, such as "red block", by its id: for scoring maps alone, no policy sees it.
        unseen: whether its words come from the unseen sets.

    Args:
        split: of the episodes.
        unseen: whether words come from the unseen sets in validation and test; in training they never do.
    """

    workspace: ClassVar[Workspace] = Workspace()
    effector: ClassVar[str] = "suction"
    max_steps: int = 1

    def __init__(self, split: Split = "train", unseen: bool = False) -> None:
        self.unseen = unseen and split != "train"
        self.goals: tuple[Goal, ...] = ()
        self.named_colors: tuple[str, ...] = ()
        self.names: dict[int, str] = {}
        self._reached = 0

    def reset(self, environment: Environment, rng: np.random.Generator, seed: int) -> None:
        """Lay out an episode: see `lay_out`."""
        self.names = {}
        self._reached = 0
        self.goals = tuple(self.lay_out(environment, rng, seed))

    @abstractmethod
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> Sequence[Goal]:
        """Put the bodies of an episode on the tables and name them in `names`.

        Args:
            environment: empty but for its tables.
            rng: what is random comes from it.
            seed: the episode's, for a family that goes through its objects in turn.

        Returns:
            The goals in their order, at least one.

        Raises:
            TableFullError: a body that the scene needs finds no place (never seen); see `spawn`.
        """

    @property
    def instruction(self) -> str:
        """What to do now: policies see nothing else of a task. The last sentence stays; none before `reset`."""
        return self.goals[min(self._reached, len(self.goals) - 1)].sentence if self.goals else ""

    def score(self, environment: Environment) -> float:
        """The share of the job that is done, in [0, 1]."""
        reached = self._reached_now(environment)
        done = sum(goal.share for goal in self.goals[:reached])
        if reached < len(self.goals):
            goal = self.goals[reached]
            done += goal.share * goal.done(environment)
        return done / sum(goal.share for goal in self.goals)

    def expert(self, environment: Environment) -> ExpertAction | None:
        """The next action from ground truth, or None if nothing is left to do."""
        reached = self._reached_now(environment)
        if reached == len(self.goals):
            return None
        pushes = Push in EFFECTORS.find(self.effector).actions
        act = goals.push if pushes else goals.pick_and_place
        return act(environment, self.goals[reached])

    def placed(self, environment: Environment) -> set[int]:
        """The ids of bodies that already lie where the sentences want them: whoever picks one of them undoes work."""
        reached = self._reached_now(environment)
        there = {body.id for goal in self.goals[:reached] for body in goal.bodies}
        if reached < len(self.goals):
            goal = self.goals[reached]
            there = there - {body.id for body in goal.bodies} | goal.placed(environment)
        return there

    def advance(self, environment: Environment) -> None:
        """Called after every step: go on to the next goal that is open."""
        self._reached = self._reached_now(environment)

    def subsets(self) -> tuple[str, ...]:
        """The sets of episodes, besides all, to which the present one belongs: each has a row of results of its own."""
        return ()

    def _reached_now(self, environment: Environment) -> int:
        """How many goals are reached: those before, and from the present one on until one is open."""
        reached = self._reached
        while reached < len(self.goals) and self.goals[reached].done(environment) == 1.0:
            reached += 1
        return reached
