"""What every task offers to the world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from gem_lite.demonstrations import ExpertAction
from gem_lite.se2 import Workspace

if TYPE_CHECKING:
    from gem_lite.simulation.world import World


class Task(ABC):
    """One family's scene, sentence, score and expert.

    Attributes:
        seed: the episode's, set before `reset`; what is random comes from the generator, not from it.
        instruction: what to do now; policies see it, and nothing else of a task.
        max_steps: actions after which an episode ends.
        workspace: the table that the task is made for.
        jaw: whether the tool has a parallel jaw instead of suction, see `gripper`.
        named_colors: the palette's colours that the instruction names.
        names: what each body is, such as "red block", by its id: for scoring maps alone, no policy sees it.
    """

    workspace: ClassVar[Workspace] = Workspace()
    jaw: ClassVar[bool] = False

    def __init__(self) -> None:
        self.seed = 0
        self.instruction = ""
        self.max_steps = 0
        self.named_colors: tuple[str, ...] = ()
        self.names: dict[int, str] = {}

    @abstractmethod
    def reset(self, world: World, rng: np.random.Generator) -> None:
        """Lay out the scene and set the instruction. Raises RuntimeError if a body finds no place (never seen)."""

    @abstractmethod
    def score(self, world: World) -> float:
        """The share of the job that is done, in [0, 1]."""

    @abstractmethod
    def expert(self, world: World) -> ExpertAction | None:
        """The next action from ground truth, or None if nothing is left to do."""

    def placed(self, world: World) -> set[int]:
        """The ids of bodies that already lie where the sentences want them: whoever picks one of them undoes work."""
        return set()

    def advance(self, world: World) -> None:  # noqa: B027
        """Called after every step: where a task has several instructions, go on to the next one that is open."""
